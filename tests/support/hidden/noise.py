"""Hidden noise spectra: averages of periodograms, drawn from their Gamma distribution.

Thermal force: S = -4 kT Im H/(2 pi u m), by the fluctuation-dissipation theorem; white: S = |H|^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fitting.text.arrays import FloatArray
from tests.support.hidden.laboratory import (
    NOISE,
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
from tests.support.hidden.motion import TWO_PI, Motion, chain, hybrid

BOLTZMANN = 1.380649e-23
VARIANTS = ("read-out", "displacement", "temperature", "white", "coupled")
TEMPERATURE, SECOND, FLOOR, DRIFT = (
    "temperature stated wrongly",
    "second line that the model does not see",
    "undeclared floor",
    "line drifts while it is averaged",
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Sample:
    """A sample in heat or under a white force.

    Args:
        motion: from the parameters.
        model: of the FMU.
        output: that is seen.
        start: values of the FMU.
        unknowns: what is fitted.
        lines: frequencies and widths of its lines, Hz.
        thermal: whether heat drives it.
    """

    motion: Callable[[Values], Motion]
    model: str
    output: str
    start: dict[str, float | str]
    unknowns: tuple[Unknown, ...]
    lines: tuple[tuple[float, float], ...]
    thermal: bool = True

    def shape(self, values: Values, u: FloatArray) -> FloatArray:
        """Density (n,) for kT/m = 1 J/kg, or for a unit of a white force."""
        h = self.motion(values).transfer(u)
        return np.asarray(-4.0 * h.imag / (TWO_PI * u) if self.thermal else np.abs(h) ** 2)


def one_line(draw: Draw) -> Sample:
    """One mode in heat."""
    f, q = draw.log(10.0, 1e8), draw.log(30.0, 1e6)
    width = f / q
    away = 1.9 * f

    def motion(values: Values) -> Motion:
        fixed = {"theta": 0.0, "eta_minus": away, "d2": width, "g2": 0.0}
        return hybrid({**fixed, **values}, "q1_hybrid")

    unknowns = (
        draw.place("eta_plus", f, width * draw.log(3.0, 30.0), 2.0 * width),
        draw.size("d1", width),
    )
    start: dict[str, float | str] = {
        "periodic_start": "true",
        "theta": 0.0,
        "g2": 0.0,
        "eta_minus": away,
        "d2": width,
        "u1": f,
        "u2": f + width,
    }
    return Sample(
        motion=motion,
        model="CoupledOscillator",
        output="q1_hybrid",
        start=start,
        unknowns=unknowns,
        lines=((f, width),),
    )


def two_lines(draw: Draw) -> Sample:
    """Two hybridised modes under a white force on q1, which is seen; theta is known."""
    f, q = draw.log(10.0, 1e8), draw.log(60.0, 1e6)
    wide = f / q
    narrow = wide / draw.log(1.0, 30.0)
    d1, d2 = (wide, narrow) if draw.happens(0.5) else (narrow, wide)
    theta = draw.even(0.25, 1.3)
    c, s = math.cos(theta), math.sin(theta)
    other = f + wide * draw.log(1.5, min(30.0, 0.3 * q))

    def motion(values: Values) -> Motion:
        return hybrid({"theta": theta, "g1": c, "g2": s, **values}, "q1")

    near = 0.45 * (other - f)
    unknowns = (
        draw.place("eta_plus", f, near, 0.3 * near),
        draw.place("eta_minus", other, near, 0.3 * near),
        draw.size("d1", d1),
        draw.size("d2", d2),
    )
    start: dict[str, float | str] = {
        "periodic_start": "true",
        "theta": theta,
        "g1": c,
        "g2": s,
        "u1": f,
        "u2": other,
    }
    return Sample(
        motion=motion,
        model="CoupledOscillator",
        output="q1",
        start=start,
        unknowns=unknowns,
        lines=((f, c * c * d1 + s * s * d2), (other, s * s * d1 + c * c * d2)),
        thermal=False,
    )


def coupled(draw: Draw, least_quality: float = 60.0) -> Sample:
    """Two modes in heat, coupled weakly to strongly; the first is seen."""
    f, q = draw.log(10.0, 1e8), draw.log(least_quality, 1e6)
    wide = f / q
    narrow = wide / draw.log(1.0, 30.0)
    d1, d2 = (wide, narrow) if draw.happens(0.5) else (narrow, wide)
    split = wide * draw.log(0.5, min(30.0, 0.2 * q))
    other = f + split * draw.even(-1.0, 1.0)
    coupling = math.sqrt(split * f)
    truth = {"f1": f, "f2": other, "lambda12": coupling, "d1": d1, "d2": d2}
    reach = 1.5 * split + wide
    unknowns = (
        draw.place("f1", f, reach, 0.3 * reach),
        draw.place("f2", other, reach, 0.3 * reach),
        draw.size("lambda12", coupling, 1.7),
        draw.size("d1", d1),
        draw.size("d2", d2),
    )
    start: dict[str, float | str] = {"periodic_start": "true", "g2": 0.0, "u1": f, "u2": f + wide}
    return Sample(
        motion=chain,
        model="CoupledModes2",
        output="q1",
        start=start,
        unknowns=unknowns,
        lines=hybrid_lines(truth),
    )


def hybrid_lines(truth: Values) -> tuple[tuple[float, float], ...]:
    """Frequencies and widths of the coupled lines, Hz."""
    k = np.diag([truth["f1"] ** 2, truth["f2"] ** 2])
    k[0, 1] = k[1, 0] = -(truth["lambda12"] ** 2)
    squares, vectors = np.linalg.eigh(k)
    widths = (vectors**2).T @ np.array([truth["d1"], truth["d2"]])
    return tuple(zip(map(float, np.sqrt(squares)), map(float, widths), strict=True))


def about(draw: Draw, lines: tuple[tuple[float, float], ...], points: int) -> FloatArray:
    """Frequencies over all lines: some even over the whole, the others nearer to the lines."""
    wide = draw.log(4.0, 15.0)
    low = min(f - wide * w for f, w in lines)
    high = max(f + wide * w for f, w in lines)
    parts = [np.linspace(max(low, 0.02 * high), high, max(points // 2, 8))]
    for f, w in lines:
        spread = np.linspace(-1.0, 1.0, max(points // (2 * len(lines)), 6))
        parts.append(f + 4.0 * w * spread * (0.3 + 0.7 * np.abs(spread)))
    u = np.unique(np.concatenate(parts))
    apart = np.append(np.diff(u) > 1e-6 * (u[-1] - u[0]), True)
    return np.asarray(u[apart & (u > 0.0)])


def laboratory(seed: int) -> Laboratory:
    """One hidden noise spectrum."""
    draw = generator("noise", seed)
    variant = VARIANTS[seed % len(VARIANTS)]
    sample = {"white": two_lines, "coupled": coupled}.get(variant, one_line)(draw)
    u = about(draw, sample.lines, draw.points(20.0, 600.0 if len(sample.lines) == 1 else 120.0))
    mass, temperature, read_out = draw.log(1e-16, 1e-6), draw.log(4.0, 400.0), draw.log(1e3, 1e7)
    level = BOLTZMANN * temperature / mass if sample.thermal else draw.log(1e-6, 1e-2)
    in_volts = variant in ("read-out", "white", "coupled")
    level *= read_out**2 if in_volts else 1.0
    truth = {p.name: p.truth for p in sample.unknowns}
    mistake = _mistake(draw, variant, wrong=seed % 3 == 2)
    clean = level * _averaged(draw, sample, truth, u, drifting=mistake == DRIFT)
    top, floor = float(np.max(clean)), 0.0
    if mistake == SECOND:
        f, width = sample.lines[0]
        at, broad = f + draw.sign() * draw.even(3.0, 7.0) * width, width * draw.log(0.5, 2.0)
        clean = clean + top * draw.log(0.08, 0.6) / (1.0 + (2.0 * (u - at) / broad) ** 2)
    if mistake == FLOOR or draw.happens(0.7):
        floor = top * (draw.log(0.05, 0.4) if mistake == FLOOR else draw.log(1e-4, 0.1))
    exact = clean + floor
    averages = round(draw.log(20.0, 1e6))
    measured = exact * draw.rng.gamma(averages, 1.0 / averages, u.size)
    stated_t = temperature * (draw.log(1.4, 3.0) ** draw.sign() if mistake == TEMPERATURE else 1.0)
    known = BOLTZMANN * stated_t / mass if variant == "displacement" else None
    keys = [f"averages = {averages * (9 if mistake == NOISE else 1)}"]
    keys += [f"floor = {'false' if mistake == FLOOR else 'true'}"]
    if sample.thermal:
        keys += ['force = "thermal"', f'mass = "{mass!r} kg"']
        keys += [] if variant == "temperature" else [f'temperature = "{stated_t!r} K"']
    text = head(f"Hidden noise {seed}", sample.output, sample.start, TONES)
    text += '[[noise_spectrum]]\nfile = "noise.csv"\n' + "\n".join(keys) + "\n\n"
    qualities = {"read-out": {"read": read_out}, "temperature": {"temperature": temperature}}
    return Laboratory(
        kind="noise",
        seed=seed,
        variant=variant,
        mistake=mistake,
        causes=frozenset(
            {NOISE: ["noise_underestimated"], TEMPERATURE: ["noise_level"], FLOOR: ["offset"]}.get(
                mistake, []
            )
        ),
        campaigns={"campaign": text + parameters(sample.unknowns)},
        model=sample.model,
        tables={
            "noise.csv": csv(
                ["frequency (Hz)", f"density ({'V' if in_volts else 'm'}2/Hz)"], u, measured
            )
        },
        unknowns=sample.unknowns,
        qualities=qualities.get(variant, {}),
        curves=(
            Curve(
                name="noise",
                exact=exact,
                sigma=exact / math.sqrt(averages),
                model=_model(sample, u, known, floor=mistake != FLOOR),
            ),
        ),
        noise_factor=3.0 if mistake == NOISE else 1.0,
    )


def _mistake(draw: Draw, variant: str, *, wrong: bool) -> str:
    choices = [NOISE, SECOND, FLOOR, DRIFT]
    if variant == "displacement":
        choices += [TEMPERATURE, TEMPERATURE, TEMPERATURE]
    return draw.one_of(choices) if wrong else ""


def _averaged(
    draw: Draw, sample: Sample, truth: Values, u: FloatArray, *, drifting: bool
) -> FloatArray:
    """The density; of lines that drift, averaged over where they are."""
    if not drifting:
        return sample.shape(truth, u)
    reach = draw.log(0.7, 3.0) * max(w for _, w in sample.lines)
    names = [n for n in truth if n[0] in "ef"]
    places = np.linspace(-0.5, 0.5, 81) * reach
    moved = [{**truth, **{n: truth[n] + x for n in names}} for x in places]
    return np.asarray(np.mean([sample.shape(values, u) for values in moved], axis=0))


def _model(
    sample: Sample, u: FloatArray, known: float | None, *, floor: bool
) -> Callable[[Values], tuple[FloatArray, FloatArray]]:
    def model(values: Values) -> tuple[FloatArray, FloatArray]:
        shape = sample.shape(values, u)
        columns = ([] if known is not None else [shape]) + ([np.ones(u.size)] if floor else [])
        fixed = np.zeros(u.size) if known is None else known * shape
        return fixed, np.stack(columns, axis=1) if columns else np.empty((u.size, 0))

    return model
