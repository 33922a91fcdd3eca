"""Hidden control maps: a mode that a voltage tunes through another one, and what is seen of it.

f1 = a0 + a1 V        f2 = b0        amplitude or complex value of q1 under a tone on mode 1
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray
from tests.support.hidden.laboratory import (
    NOISE,
    TONE,
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
from tests.support.hidden.motion import chain
from tests.support.hidden.noise import hybrid_lines

VARIANTS = ("amplitude", "complex", "amplitude, noise estimated")
OFFSET, SECOND, DRIFT, LAW, VOLTAGE = (
    "undeclared offset",
    "second line that the model does not see",
    "drift from sweep to sweep",
    "law without its bend",
    "voltage of one sweep stated wrongly",
)


def laboratory(seed: int) -> Laboratory:
    """One hidden control map."""
    draw = generator("maps", seed)
    variant = VARIANTS[seed % len(VARIANTS)]
    f = draw.log(10.0, 1e8)
    width = f / draw.log(100.0, 1e6)
    split = width * draw.log(0.6, min(20.0, 0.1 * f / width))
    volts = draw.log(0.1, 30.0) * np.linspace(-1.0, 1.0, round(draw.even(3.6, 5.4)))
    slope = draw.sign() * draw.even(1.0, 3.0) * (split + width) / float(volts[-1])
    narrow = width / draw.log(1.0, 30.0)
    d1, d2 = (width, narrow) if draw.happens(0.5) else (narrow, width)
    coupling = math.sqrt(split * f)
    searched = draw.happens(0.2)
    truths = (f, slope, coupling, d1, d2)
    unknowns = _unknowns(draw, truths, split + width, volts, far=1.0 if searched else 0.3)
    truth = {u.name: u.truth for u in unknowns}
    wrong = seed // 3 % 3 == 2
    mistake = draw.one_of([NOISE, OFFSET, SECOND, DRIFT, LAW, VOLTAGE]) if wrong else ""
    true_volts, off_hz = _differing(draw, mistake, volts, split + width)
    u = _swept(draw, truth, volts, variant)
    exact = []
    for k, volt in enumerate(true_volts):
        y = response(truth, volt, u[k], off_hz[k])
        y = y * draw.log(0.5, 2.0) / np.max(np.abs(y))
        if variant == "complex":
            y = y * np.exp(1j * draw.even(0.0, 6.28))
        exact.append(y)
    if mistake == SECOND:
        at, broad = f + 0.5 * slope * volts[-1] * draw.even(-1.0, 1.0), width * draw.log(0.5, 1.0)
        size = draw.log(0.15, 0.6)
        exact = [
            y + size * np.max(np.abs(y)) / (1.0 + 2j * (x - at) / broad)
            for x, y in zip(u, exact, strict=True)
        ]
    seen = exact if variant == "complex" else [np.abs(y).astype(complex) for y in exact]
    if mistake == OFFSET:
        level = draw.log(0.08, 0.4)
        seen = [y + level * np.max(np.abs(y)) for y in seen]
    sigma = draw.log(1e-4, 0.1)
    made = _Map(variant, mistake, unknowns, volts, u, seen, searched)
    return made.laboratory(draw, seed, sigma)


def response(values: Values, volt: float, u: FloatArray, off_hz: float = 0.0) -> ComplexArray:
    """Complex response of q1 (n,) at a voltage."""
    f1 = values["a0"] + values["a1"] * volt + off_hz
    at = {"f1": f1, "f2": values["b0"]}
    at |= {n: values[n] for n in ("lambda12", "d1", "d2")}
    return chain(at).transfer(u)


def _unknowns(
    draw: Draw, truth: tuple[float, ...], reach: float, volts: FloatArray, *, far: float
) -> tuple[Unknown, ...]:
    """What is fitted, with starts nearer where the box is not searched."""
    f, slope, coupling, d1, d2 = truth
    steep = abs(slope)
    a1 = Unknown(
        name="a1",
        truth=slope,
        start=slope * (1.0 + 0.3 * far * draw.even(-1.0, 1.0)),
        low=slope - 0.8 * steep,
        high=slope + 0.8 * steep,
        unit="Hz/V",
    )
    return (
        draw.place(
            "a0", f + draw.even(-0.4, 0.4) * steep * float(volts[-1]), reach, 0.4 * far * reach
        ),
        a1,
        draw.place("b0", f, reach, 0.4 * far * reach),
        draw.size("lambda12", coupling, 1.0 + 0.5 * far),
        draw.size("d1", d1, 1.0 + far),
        draw.size("d2", d2, 1.0 + far),
    )


def _differing(
    draw: Draw, mistake: str, volts: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Voltages that there were, and how far mode 1 was off the law, Hz, (sweeps,) each."""
    none = np.zeros(volts.size)
    if mistake == VOLTAGE:
        moved = volts.copy()
        k = int(draw.rng.integers(volts.size))
        step = float(volts[1] - volts[0])
        moved[k] += step * draw.sign() * draw.even(0.7, 1.5)
        return moved, none
    if mistake == LAW:
        return volts, reach * draw.log(0.7, 3.0) * (volts / volts[-1]) ** 2
    if mistake == DRIFT:
        return volts, reach * draw.log(0.5, 2.0) * draw.rng.permutation(
            np.linspace(-0.5, 0.5, volts.size)
        )
    return volts, none


def _swept(draw: Draw, truth: Values, volts: FloatArray, variant: str) -> list[FloatArray]:
    """Frequencies of each sweep: over both lines, the same number for all."""
    least = 50.0 if "estimated" in variant else 20.0
    points = draw.points(least, 60.0 if "estimated" in variant else 40.0)
    wide = draw.log(4.0, 10.0)
    found = []
    for volt in volts:
        at = {n: truth[n] for n in ("lambda12", "d1", "d2")}
        lines = hybrid_lines({**at, "f1": truth["a0"] + truth["a1"] * volt, "f2": truth["b0"]})
        broad = max(w for _, w in lines)
        low, high = min(f for f, _ in lines), max(f for f, _ in lines)
        found.append(np.linspace(low - wide * broad, high + wide * broad, points))
    return found


@dataclass(frozen=True)
class _Map:
    """Sweeps at several voltages without their noise, and what is told of them."""

    variant: str
    mistake: str
    unknowns: tuple[Unknown, ...]
    volts: FloatArray
    u: list[FloatArray]
    seen: list[ComplexArray]
    searched: bool

    def laboratory(self, draw: Draw, seed: int, sigma: float) -> Laboratory:
        """With noise, as files."""
        whole = self.variant == "complex"
        noisy = []
        for y in self.seen:
            one, other = draw.rng.standard_normal((2, y.size))
            noisy.append(y + sigma * (one + 1j * other))
        names = ["V (V)", "frequency (Hz)", *(["X (V)", "Y (V)"] if whole else ["amplitude (V)"])]
        z = np.concatenate(noisy)
        values = [np.real(z), np.imag(z)] if whole else [np.abs(z)]
        places = np.repeat(self.volts, [x.size for x in self.u])
        causes = {NOISE: ["noise_underestimated"], OFFSET: ["offset"]}
        causes[VOLTAGE] = ["outlier", "shift"]
        return Laboratory(
            kind="maps",
            seed=seed,
            variant=self.variant,
            mistake=self.mistake,
            causes=frozenset(causes.get(self.mistake, [])),
            campaigns={"campaign": self._text(seed, sigma)},
            model="CoupledModes2",
            tables={"map.csv": csv(names, places, np.concatenate(self.u), *values)},
            unknowns=self.unknowns,
            curves=tuple(self._curves(sigma)),
            noise_factor=3.0 if self.mistake == NOISE else 1.0,
        )

    def _text(self, seed: int, sigma: float) -> str:
        whole = self.variant == "complex"
        keys = ['file = "map.csv"', 'controls = ["V"]']
        keys += [] if whole else ['amplitude = "V peak"']
        if self.mistake == NOISE or "estimated" not in self.variant:
            keys.append(f'sigma = "{sigma / (3.0 if self.mistake == NOISE else 1.0)!r} V"')
        start: dict[str, float | str] = {"periodic_start": "true", "g2": 0.0, "A2": 0.0}
        text = head(f"Hidden map {seed}", "q1", start, TONE)
        text += f"[{'complex_' if whole else ''}control_sweep]\n" + "\n".join(keys)
        text += '\n\n[laws]\nf1 = "a0 + a1*V"\nf2 = "b0"\n\n' + parameters(self.unknowns)
        return text + ("" if self.searched else "starts = 1\n")

    def _curves(self, sigma: float) -> Iterator[Curve]:
        whole = self.variant == "complex"
        for volt, x, y in zip(self.volts, self.u, self.seen, strict=True):
            exact = np.concatenate([np.real(y), np.imag(y)]) if whole else np.abs(y)
            yield Curve(
                name=f"V = {volt:.3g}",
                exact=exact,
                sigma=np.full(exact.size, sigma),
                model=_model(float(volt), x, whole=whole),
            )


def _model(
    volt: float, u: FloatArray, *, whole: bool
) -> Callable[[Values], tuple[FloatArray, FloatArray]]:
    """One sweep, its gain of its own: real for amplitudes, complex for both quadratures."""

    def model(values: Values) -> tuple[FloatArray, FloatArray]:
        h = response(values, volt, u)
        h = h / np.max(np.abs(h))
        parts = [h, 1j * h] if whole else [np.abs(h)]
        columns = [np.concatenate([np.real(p), np.imag(p)]) if whole else p for p in parts]
        rows = 2 * u.size if whole else u.size
        return np.zeros(rows), np.stack([np.real(c) for c in columns], axis=1)

    return model
