"""Hidden joint fits: two series of one string, two sweeps, and three kinds of measurements."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import erfc

from fitting.text.arrays import FloatArray
from tests.support.hidden.laboratory import (
    NOISE,
    TONE,
    TONES,
    Curve,
    Draw,
    Laboratory,
    Unknown,
    Values,
    csv,
    generator,
    head,
    parameters,
)
from tests.support.hidden.motion import Motion, chain, hybrid
from tests.support.hidden.noise import coupled

VARIANTS = ("series", "sweeps", "kinds")
OTHER, OUTLIER, OFFSET = (
    "one measurement is of another damping",
    "peaks of one experiment are too high",
    "undeclared offset of one sweep",
)
#: Chi square of what noise adds to small amplitudes from which an offset is in the data, and so no
#: wrong cause.
FLOOR_SEEN = 9.0


def laboratory(seed: int) -> Laboratory:
    """One hidden joint fit."""
    draw = generator("joint", seed)
    variant = VARIANTS[seed % len(VARIANTS)]
    wrong = seed // 3 % 3 == 2
    choices = {
        "series": [NOISE, OTHER, OUTLIER],
        "sweeps": [OTHER, OFFSET],
        "kinds": [NOISE, OTHER],
    }[variant]
    mistake = draw.one_of(choices) if wrong else ""
    made = {"series": series, "sweeps": sweeps, "kinds": kinds}[variant]
    return made(draw, seed, mistake)


@dataclass(frozen=True, kw_only=True)
class String:
    """A string whose angle and dampings are looked for; its eigenfrequencies are known."""

    truth: Values
    known: Values
    unknowns: tuple[Unknown, ...]
    asks_coupling: bool

    @property
    def start(self) -> dict[str, float | str]:
        """Start values of the FMU."""
        return {"periodic_start": "true", **self.known}

    def motion(self, values: Values, output: str) -> Motion:
        """With parameters in place."""
        return hybrid({**self.known, **values}, output)

    @property
    def widths(self) -> tuple[float, float]:
        """Line widths, Hz."""
        c2, s2 = math.cos(self.truth["theta"]) ** 2, math.sin(self.truth["theta"]) ** 2
        d1, d2 = self.truth["d1"], self.truth["d2"]
        return c2 * d1 + s2 * d2, s2 * d1 + c2 * d2

    @property
    def derived(self) -> dict[str, float]:
        """Truth of the outputs that are asked for."""
        wide, other = self.widths
        found = {"width_plus": wide, "width_minus": other}
        if self.asks_coupling:
            plus, minus = self.known["eta_plus"], self.known["eta_minus"]
            square = -0.5 * math.sin(2.0 * self.truth["theta"]) * (minus**2 - plus**2)
            found["lambda"] = math.sqrt(square)
        return found

    @property
    def equal(self) -> tuple[Values, ...]:
        """The same matrix of damping, or one of the other sign beside the diagonal."""
        theta, d1, d2 = (self.truth[n] for n in ("theta", "d1", "d2"))
        found = [
            (theta + 0.5 * math.pi, d2, d1),
            (theta - 0.5 * math.pi, d2, d1),
            (0.5 * math.pi - theta, d2, d1),
            (1.5 * math.pi - theta, d2, d1),
            (math.pi - theta, d1, d2),
            (-theta, d1, d2),
        ]
        possible = [e for e in found if not self.asks_coupling or math.sin(2.0 * e[0]) <= 0.0]
        return tuple(dict(zip(("theta", "d1", "d2"), e, strict=True)) for e in possible)


def string(draw: Draw, far: float) -> String:
    """A string with lines up to so many widths apart."""
    f, q = draw.log(10.0, 1e8), draw.log(100.0, 1e6)
    wide = f / q
    narrow = wide / draw.log(1.0, 30.0)
    d1, d2 = (wide, narrow) if draw.happens(0.5) else (narrow, wide)
    theta = draw.even(1.68, 3.03)  # lambda is real
    other = f + wide * draw.log(2.0, min(far, 0.2 * q))
    half = draw.happens(0.5)  # the box of theta: where lambda is real, or a whole turn
    low, high = (0.5 * math.pi, math.pi) if half else (0.0, math.pi)
    begun = min(max(theta + draw.even(-0.6, 0.6), low + 0.05), high - 0.05)
    angle = Unknown(name="theta", truth=theta, start=begun, low=low, high=high, unit="rad")
    return String(
        truth={"theta": theta, "d1": d1, "d2": d2},
        known={"eta_plus": f, "eta_minus": other},
        unknowns=(angle, draw.size("d1", d1), draw.size("d2", d2)),
        asks_coupling=draw.happens(0.6),
    )


def _other(draw: Draw, truth: Values, mistake: str) -> dict[str, float]:
    """What the second measurement is of: another damping, where that is the mistake."""
    factor = draw.log(1.5, 3.0) ** draw.sign()
    if mistake != OTHER:
        return dict(truth)
    return {n: v * factor if n in ("d1", "d2") else v for n, v in truth.items()}


def _outputs(sample: String) -> str:
    names = ", ".join(f'"{n}"' for n in sample.derived)
    return f"[derived]\noutputs = [{names}]\n\n"


def series(draw: Draw, seed: int, mistake: str) -> Laboratory:
    """Two series of pairs of tones, at either line; both modes are read at every pair."""
    sample = string(draw, 60.0)
    tables, campaigns, curves = {}, {}, []
    share = draw.log(3e-4, 0.05)
    pairs = round(draw.even(5.0, 9.0))
    outlier = int(draw.rng.integers(pairs)) if mistake == OUTLIER else -1
    for number, (name, line) in enumerate((("one", "eta_plus"), ("two", "eta_minus"))):
        truth = _other(draw, sample.truth, mistake) if number == 1 else dict(sample.truth)
        offs = sample.widths[number] * np.geomspace(0.15, draw.log(1.0, 3.0), pairs)
        centre = sample.known[line]
        rows: dict[str, list[float]] = {n: [] for n in ("u1", "u2", "p1", "p2", "s1", "s2")}
        labels, outputs = [], []
        gain = draw.log(1e-3, 1e3)
        for output in ("q1_hybrid", "q2_hybrid"):
            u = np.stack([centre - offs, centre + offs], axis=1)
            exact = gain * np.abs(sample.motion(truth, output).transfer(u.ravel()))
            if number == 0 and outlier >= 0 and output == "q1_hybrid":
                exact[2 * outlier : 2 * outlier + 2] *= draw.log(1.5, 3.0)
            sigma = share * exact
            measured = exact + sigma * draw.rng.standard_normal(exact.size)
            stated = sigma / (3.0 if mistake == NOISE else 1.0)
            for key, values in (("u", u.ravel()), ("p", measured), ("s", stated)):
                rows[f"{key}1"] += list(values[::2])
                rows[f"{key}2"] += list(values[1::2])
            labels += [f"{output[:2]}pair{k + 1}" for k in range(pairs)]
            outputs += [output] * pairs
            curves.append((u.ravel(), exact, sigma, output, gain))
        tables[f"{name}.csv"] = csv(
            ["experiment", "u1 (Hz)", "u2 (Hz)", "output", "p1 (m)", "p2 (m)", "s1 (m)", "s2 (m)"],
            labels,
            rows["u1"],
            rows["u2"],
            outputs,
            *([x / gain for x in rows[k]] for k in ("p1", "p2", "s1", "s2")),
        )
        text = head(f"Hidden series {seed} {name}", "q1_hybrid", sample.start, TONES)
        text += f'[experiments]\nfile = "{name}.csv"\npeaks = ["p1", "p2"]\n'
        text += 'peak_sigmas = ["s1", "s2"]\namplitude = "m peak"\n\n' + _outputs(sample)
        campaigns[name] = text + parameters(sample.unknowns)
    causes = {
        NOISE: ["noise_underestimated"],
        OTHER: ["contradiction"],
        OUTLIER: ["outlier"],
    }
    return Laboratory(
        kind="joint",
        seed=seed,
        variant="series",
        mistake=mistake,
        causes=frozenset(causes.get(mistake, [])),
        subject=f"q1pair{outlier + 1}" if mistake == OUTLIER else "",
        campaigns=campaigns,
        model="CoupledOscillator",
        tables=tables,
        unknowns=sample.unknowns,
        derived=sample.derived,
        curves=tuple(
            Curve(
                name=output,
                exact=exact / gain,
                sigma=sigma / gain,
                model=_peaks(sample, u, output),
                axis=False,
            )
            for u, exact, sigma, output, gain in curves
        ),
        noise_factor=3.0 if mistake == NOISE else 1.0,
        equal=sample.equal,
    )


def _peaks(
    sample: String, u: FloatArray, output: str
) -> Callable[[Values], tuple[FloatArray, FloatArray]]:
    def model(values: Values) -> tuple[FloatArray, FloatArray]:
        return np.abs(sample.motion(values, output).transfer(u)), np.empty((u.size, 0))

    return model


def noise_floor(exact: FloatArray, sigma: FloatArray) -> FloatArray:
    """Mean of |a + sigma g| above a, (n,), for a Gaussian g: sigma sqrt(2/pi) where a is nothing.

    Args:
        exact: amplitudes a without noise, (n,), zero or more.
        sigma: noise of each, (n,), above zero.
    """
    ratio = exact / (math.sqrt(2.0) * sigma)
    return np.asarray(math.sqrt(2.0 / math.pi) * sigma * np.exp(-(ratio**2)) - exact * erfc(ratio))


def sweeps(draw: Draw, seed: int, mistake: str) -> Laboratory:
    """A sweep of either mode over both lines, each with a gain of its own.

    Amplitudes are magnitudes: of a mode that hardly stands out of the noise most points are noise
    without its sign, which is an offset of the data that no campaign here declares.
    """
    sample = string(draw, 12.0)
    causes = {OTHER: {"contradiction"}, OFFSET: {"offset", "contradiction"}}.get(mistake, set())
    tables, campaigns, curves = {}, {}, []
    points, share, wide = draw.points(40.0, 250.0), draw.log(1e-4, 0.05), draw.log(4.0, 12.0)
    broad = max(sample.widths)
    f, g = sample.known["eta_plus"], sample.known["eta_minus"]
    u = np.linspace(f - wide * broad, g + wide * broad, points)
    for number, (name, output) in enumerate((("one", "q1_hybrid"), ("two", "q2_hybrid"))):
        truth = _other(draw, sample.truth, mistake) if number == 1 else sample.truth
        exact = np.abs(sample.motion(truth, output).transfer(u))
        exact *= draw.log(1e-3, 1e3) / np.max(exact)
        if mistake == OFFSET and number == 1:
            exact = exact + np.max(exact) * draw.log(0.08, 0.4)
        sigma = np.full(points, share * np.max(exact))
        measured = exact + sigma * draw.rng.standard_normal(points)
        if float(np.sum((noise_floor(exact, sigma) / sigma) ** 2)) > FLOOR_SEEN:
            causes = causes | {"offset"}
        tables[f"{name}.csv"] = csv(["frequency (Hz)", "amplitude (V)"], u, np.abs(measured))
        text = head(f"Hidden sweeps {seed} {name}", output, sample.start, TONES)
        text += f'[sweep]\nfile = "{name}.csv"\namplitude = "V peak"\nuse = "fit"\n'
        text += 'scale = "fit"\n\n' + _outputs(sample)
        campaigns[name] = text + parameters(sample.unknowns)
        curves.append(Curve(name=name, exact=exact, sigma=sigma, model=_scaled(sample, u, output)))
    return Laboratory(
        kind="joint",
        seed=seed,
        variant="sweeps",
        mistake=mistake,
        causes=frozenset(causes),
        campaigns=campaigns,
        model="CoupledOscillator",
        tables=tables,
        unknowns=sample.unknowns,
        derived=sample.derived,
        curves=tuple(curves),
        equal=sample.equal,
    )


def _scaled(
    sample: String, u: FloatArray, output: str
) -> Callable[[Values], tuple[FloatArray, FloatArray]]:
    def model(values: Values) -> tuple[FloatArray, FloatArray]:
        found = np.abs(sample.motion(values, output).transfer(u))
        return np.zeros(u.size), found[:, None]

    return model


def kinds(draw: Draw, seed: int, mistake: str) -> Laboratory:
    """A complex sweep and a ringdown of two coupled modes, in one campaign."""
    sample = coupled(draw, 300.0)
    truth = {u.name: u.truth for u in sample.unknowns}
    d = max(truth["d1"], truth["d2"])
    points, wide = draw.points(30.0, 80.0), draw.log(4.0, 10.0)
    low, high = (f for f, _ in sample.lines)
    u = np.linspace(low - wide * d, high + wide * d, points)
    h = chain(truth).transfer(u)
    h *= draw.log(1e-3, 1e3) * np.exp(1j * draw.even(0.0, 6.28)) / np.max(np.abs(h))
    swept = np.concatenate([np.real(h), np.imag(h)])
    sigmas = [draw.log(1e-4, 0.05) * float(np.max(np.abs(h)))]
    samples = draw.points(60.0, 120.0)
    turns = draw.even(0.13, 0.37) + round(draw.log(1.0, 3.0) * low / (math.pi * d * samples))
    t = np.asarray(np.arange(samples) * (turns / low), dtype=float)
    state = draw.rng.standard_normal(4)
    decay = 1e-9 * chain(_other(draw, truth, mistake)).free(t, state)
    sigmas.append(draw.log(1e-4, 0.05) * float(np.max(np.abs(decay))))
    noisy = swept + sigmas[0] * draw.rng.standard_normal(swept.size)
    ring = decay + sigmas[1] * draw.rng.standard_normal(samples)
    stated = [s / (3.0 if mistake == NOISE else 1.0) for s in sigmas]
    start = {**sample.start, "A2": 0.0}
    text = head(f"Hidden kinds {seed}", "q1", start, TONE)
    text += f'[[complex_sweep]]\nfile = "sweep.csv"\nsigma = "{stated[0]!r} V"\n\n'
    text += '[[trace]]\nfile = "ring.csv"\ninput = "b"\nstart = "unknown"\nstates = 4\n'
    text += f'sigma = "{stated[1]!r} m"\nset = {{ A1 = 0.0, periodic_start = false }}\n\n'

    def swept_model(values: Values) -> tuple[FloatArray, FloatArray]:
        z = chain(values).transfer(u)
        z = z / np.max(np.abs(z))
        columns = [np.concatenate([np.real(p), np.imag(p)]) for p in (z, 1j * z)]
        return np.zeros(2 * points), np.stack(columns, axis=1)

    def ring_model(values: Values) -> tuple[FloatArray, FloatArray]:
        motion = chain(values)
        return np.zeros(samples), np.stack([motion.free(t, one) for one in np.eye(4)], axis=1)

    causes = {NOISE: ["noise_underestimated"], OTHER: ["contradiction"]}
    return Laboratory(
        kind="joint",
        seed=seed,
        variant="kinds",
        mistake=mistake,
        causes=frozenset(causes.get(mistake, [])),
        campaigns={"campaign": text + parameters(sample.unknowns)},
        model="CoupledModes2",
        tables={
            "sweep.csv": csv(
                ["frequency (Hz)", "X (V)", "Y (V)"], u, noisy[:points], noisy[points:]
            ),
            "ring.csv": csv(["time (s)", "q1 (m)"], t, ring),
        },
        unknowns=sample.unknowns,
        curves=(
            Curve(
                name="sweep",
                exact=swept,
                sigma=np.full(swept.size, sigmas[0]),
                model=swept_model,
            ),
            Curve(name="ring", exact=decay, sigma=np.full(samples, sigmas[1]), model=ring_model),
        ),
        noise_factor=3.0 if mistake == NOISE else 1.0,
    )
