"""Hidden traces: ringdowns, responses to a recorded input, and demodulated decays."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray
from tests.support.hidden.laboratory import (
    NOISE,
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
from tests.support.hidden.motion import TWO_PI, chain, hybrid

VARIANTS = ("ringdown", "two ringdowns", "driven", "driven pair", "lock-in")
OFFSET, GAIN, SECOND, DRIFT = (
    "undeclared offset",
    "undeclared gain",
    "second line that the model does not see",
    "frequency drifts during the decay",
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Record:
    """What an instrument recorded, and how a campaign tells it.

    Args:
        model: of the FMU, the output that is seen, and its start values.
        t: times of samples, (n,), s.
        exact: what was there, (n,); complex ones are X + iY.
        scale: largest amplitude of the answer, that noise and mistakes are shares of.
        unknowns: what is fitted.
        predicted: part that is as it is, and columns whose factors are solved for.
        causes: that name the mistake rightly.
        keys: of the trace.
        b: recorded input, (n,).
        equal: parameters that may fit as well.
    """

    model: str
    output: str
    start: dict[str, float | str]
    t: FloatArray
    exact: FloatArray | ComplexArray
    scale: float
    unknowns: tuple[Unknown, ...]
    predicted: Callable[[Values], tuple[FloatArray, FloatArray]]
    keys: tuple[str, ...]
    b: FloatArray | None = None
    equal: tuple[Values, ...] = ()


def laboratory(seed: int) -> Laboratory:
    """One hidden trace."""
    draw = generator("traces", seed)
    variant = VARIANTS[seed % len(VARIANTS)]
    mistake = _mistake(draw, variant) if seed % 3 == 2 else ""
    made = {
        "ringdown": ringdown,
        "two ringdowns": two_ringdowns,
        "driven": driven,
        "driven pair": driven_pair,
        "lock-in": lock_in,
    }[variant]
    record = made(draw, mistake)
    sigma = record.scale * draw.log(1e-4, 0.1)
    noise = draw.rng.standard_normal((2, record.t.size))
    y = record.exact
    exact = np.concatenate([np.real(y), np.imag(y)]) if np.iscomplexobj(y) else np.real(y)
    if np.iscomplexobj(y):
        measured = [np.real(y) + sigma * noise[0], np.imag(y) + sigma * noise[1]]
        names = ["time (s)", "X (V)", "Y (V)"]
    else:
        measured, names = [y + sigma * noise[0]], ["time (s)", f"{record.output} (m)"]
    if record.b is not None:
        measured, names = [record.b, *measured], [names[0], "b (m/s2)", *names[1:]]
    stated = sigma / 3.0 if mistake == NOISE else sigma
    keys = list(record.keys)
    if mistake == NOISE or draw.happens(0.6):
        unit = "V" if np.iscomplexobj(y) else "m"
        keys.append(f'sigma = "{stated!r} {unit}"')
    kind = "demodulated_trace" if np.iscomplexobj(y) else "trace"
    text = head(f"Hidden trace {seed}", record.output, record.start)
    text = text.replace("steady_start = true\n", "")
    text += f'[[{kind}]]\nfile = "trace.csv"\n' + "\n".join(keys) + "\n\n"
    causes = {NOISE: ["noise_underestimated"], OFFSET: ["offset"], GAIN: ["gain"]}
    return Laboratory(
        kind="traces",
        seed=seed,
        variant=variant,
        mistake=mistake,
        causes=frozenset(causes.get(mistake, [])),
        campaigns={"campaign": text + parameters(record.unknowns)},
        model=record.model,
        tables={"trace.csv": csv(names, record.t, *measured)},
        unknowns=record.unknowns,
        curves=(
            Curve(
                name="trace",
                exact=exact,
                sigma=np.full(exact.size, sigma),
                model=record.predicted,
            ),
        ),
        noise_factor=3.0 if mistake == NOISE else 1.0,
        equal=record.equal,
    )


def _mistake(draw: Draw, variant: str) -> str:
    choices = {
        "ringdown": [OFFSET, SECOND, DRIFT],
        "two ringdowns": [OFFSET],
        "driven": [OFFSET, GAIN, SECOND],
        "driven pair": [OFFSET, GAIN],
        "lock-in": [OFFSET, SECOND, DRIFT],
    }[variant]
    return draw.one_of([NOISE, *choices])


def _one(draw: Draw, low: float = 30.0, high: float = 1e6) -> tuple[float, float]:
    """Frequency and width of a line, Hz."""
    f = draw.log(10.0, 1e8)
    return f, f / draw.log(low, high)


def _still(f: float, width: float) -> dict[str, float | str]:
    """Start values of one mode that nothing drives: the other one is far off."""
    return {
        "A1": 0.0,
        "A2": 0.0,
        "theta": 0.0,
        "g2": 0.0,
        "eta_minus": 1.7 * f,
        "d2": width,
    }


def _sampled(draw: Draw, f: float, decays_s: float, points: int) -> FloatArray:
    """Times (n,) over so long, spaced so that the line lies between multiples of half the rate."""
    turns = f * decays_s / (points - 1)  # turns from one sample to the next
    turns = max(math.floor(2.0 * turns) / 2.0, 0.0) + draw.even(0.13, 0.37)
    return np.asarray(np.arange(points) * (turns / f))


def _decaying(
    t: FloatArray, f: float, width: float, shift: float = 0.0, start: complex = 1.0
) -> ComplexArray:
    """One line by its closed form; its frequency is off by a shift that decays as its energy."""
    eta = math.sqrt(max(f * f - 0.25 * width * width, 0.0))
    rate = TWO_PI * width
    turned = TWO_PI * (eta * t - shift * np.expm1(-rate * t) / rate)
    return np.asarray(start * np.exp(1j * turned - 0.5 * rate * t))


def _aliases(f: float, t: FloatArray, unknown: Unknown, *, folded: bool) -> list[float]:
    """Frequencies of the box with the same samples: f + k/h, and k/h - f of real ones."""
    rate = 1.0 / float(t[1] - t[0])
    span = math.ceil((unknown.high - unknown.low) / rate) + 1
    found = [f + k * rate for k in range(-span, span + 1) if k]
    if folded:
        middle = round(2.0 * f / rate)
        found += [k * rate - f for k in range(middle - span, middle + span + 1)]
    return [x for x in found if unknown.low <= x <= unknown.high]


def ringdown(draw: Draw, mistake: str) -> Record:
    """One mode that is let go, its start unknown."""
    f, width = _one(draw)
    t = _sampled(draw, f, draw.log(1.0, 6.0) / (math.pi * width), draw.points(24.0))
    step = float(t[1])
    reach = min(width * draw.log(5.0, 50.0), 0.1 / step)
    if draw.happens(0.15):  # the box holds more than the rate of the samples tells apart
        reach = min(draw.log(0.3, 1.5) / step, 0.4 * f)
    eta = draw.place("eta_plus", f, reach, min(2.0 * width, 0.5 * reach))
    unknowns = (eta, draw.size("d1", width))
    offset = mistake == OFFSET or draw.happens(0.5)
    declared = offset and mistake != OFFSET
    shift = draw.log(1.0, 3.0) * width if mistake == DRIFT else 0.0
    y = np.real(_decaying(t, f, width, shift, np.exp(1j * draw.even(0.0, TWO_PI))))
    if mistake == SECOND:
        near = f + draw.sign() * draw.log(3.0, 15.0) * width
        y = y + draw.log(0.1, 0.6) * np.real(_decaying(t, near, width * draw.log(0.5, 2.0)))
    level = (draw.log(0.07, 0.5) if mistake == OFFSET else draw.even(-1.0, 1.0)) if offset else 0.0

    def predicted(values: Values) -> tuple[FloatArray, FloatArray]:
        z = _decaying(t, values["eta_plus"], values["d1"])
        columns = [np.real(z), np.imag(z)] + ([np.ones(t.size)] if declared else [])
        return np.zeros(t.size), np.stack(columns, axis=1)

    size = draw.log(1e-12, 1e-6)
    return Record(
        model="CoupledOscillator",
        output="q1_hybrid",
        start=_still(f, width),
        t=t,
        exact=size * (y + level),
        scale=size * float(np.max(np.abs(y))),
        unknowns=unknowns,
        predicted=predicted,
        keys=(
            'input = "b"',
            'start = "unknown"',
            "states = 2",
            f"offset = {'true' if declared else 'false'}",
        ),
        equal=tuple(
            {"eta_plus": math.hypot(x, 0.5 * width), "d1": width}
            for x in _aliases(math.sqrt(f * f - 0.25 * width**2), t, eta, folded=True)
        ),
    )


def two_ringdowns(draw: Draw, mistake: str) -> Record:
    """Two hybridised modes that beat in q1, their start unknown; theta is known."""
    f, width = _one(draw, 300.0)
    narrow = width / draw.log(1.0, 8.0)
    d1, d2 = (width, narrow) if draw.happens(0.5) else (narrow, width)
    theta = draw.even(0.3, 1.25)
    other = f + width * draw.log(1.5, 20.0)
    points = draw.points(60.0)
    t = _sampled(draw, 0.5 * (f + other), draw.log(1.5, 5.0) / (math.pi * width), points)
    near = min(0.45 * (other - f), 0.06 / float(t[1]))
    unknowns = (
        draw.place("eta_plus", f, near, 0.3 * near),
        draw.place("eta_minus", other, near, 0.3 * near),
        draw.size("d1", d1, 2.0),
        draw.size("d2", d2, 2.0),
    )
    fixed = {"theta": theta, "g1": math.cos(theta), "g2": math.sin(theta)}
    truth = {"eta_plus": f, "eta_minus": other, "d1": d1, "d2": d2}
    state = draw.rng.standard_normal(4)
    y = hybrid({**fixed, **truth}, "q1").free(t, state)
    top = float(np.max(np.abs(y)))
    declared = mistake != OFFSET and draw.happens(0.5)
    level = top * (draw.log(0.07, 0.5) if mistake == OFFSET else draw.even(-0.5, 0.5) * declared)

    def predicted(values: Values) -> tuple[FloatArray, FloatArray]:
        motion = hybrid({**fixed, **values}, "q1")
        columns = [motion.free(t, one) for one in np.eye(4)]
        columns += [np.ones(t.size)] if declared else []
        return np.zeros(t.size), np.stack(columns, axis=1)

    size = draw.log(1e-12, 1e-6)
    return Record(
        model="CoupledOscillator",
        output="q1",
        start={"A1": 0.0, "A2": 0.0, **fixed},
        t=t,
        exact=size * (y + level),
        scale=size * top,
        unknowns=unknowns,
        predicted=predicted,
        keys=(
            'input = "b"',
            'start = "unknown"',
            "states = 4",
            f"offset = {'true' if declared else 'false'}",
        ),
    )


def driven(draw: Draw, mistake: str, *, pair: bool = False) -> Record:
    """From rest under a recorded force that a generator holds from sample to sample."""
    f, width = _one(draw, 30.0, 300.0)
    points = draw.points(60.0)
    step = draw.even(0.06, 0.4) / f
    t = np.asarray(step * np.arange(points), dtype=float)
    hold = max(1, round(draw.even(0.3, 1.5) / (f * step)))
    b = draw.log(1e-3, 1e3) * np.repeat(draw.rng.standard_normal(points // hold + 1), hold)
    b = np.asarray(b[:points])
    if pair:
        split = width * draw.log(0.5, 10.0)
        other, narrow = f + split * draw.even(-1.0, 1.0), width / draw.log(1.0, 5.0)
        coupling = math.sqrt(split * f)
        reach = 1.5 * split + width
        unknowns: tuple[Unknown, ...] = (
            draw.place("f1", f, reach, 0.3 * reach),
            draw.place("f2", other, reach, 0.3 * reach),
            draw.size("lambda12", coupling, 1.5),
            draw.size("d1", width),
            draw.size("d2", narrow, 2.0),
        )
    else:
        unknowns = (
            draw.place("eta_plus", f, width * draw.log(4.0, 8.0), 1.5 * width),
            draw.size("d1", width),
        )

    def seen(values: Values) -> FloatArray:
        if pair:
            return chain(values).held(step, b)
        one = {"theta": 0.0, "eta_minus": 1.7 * f, "d2": width, "g2": 0.0, **values}
        return hybrid(one, "q1_hybrid").held(step, b)

    y = seen({u.name: u.truth for u in unknowns})
    top = float(np.max(np.abs(y)))
    free_gain, declared = draw.happens(0.5) and mistake != GAIN, draw.happens(0.4)
    declared = declared and mistake != OFFSET
    if mistake == SECOND:
        beside = {"eta_plus": f + draw.sign() * draw.log(2.0, 8.0) * width, "d1": width}
        y = y + draw.log(0.15, 0.6) * seen(beside)
    gain = draw.log(0.4, 2.5) if free_gain else 1.0
    gain = draw.log(1.25, 3.0) ** draw.sign() if mistake == GAIN else gain
    level = top * (draw.log(0.07, 0.5) if mistake == OFFSET else draw.even(-0.5, 0.5) * declared)

    def predicted(values: Values) -> tuple[FloatArray, FloatArray]:
        found = seen(values)
        columns = ([found] if free_gain else []) + ([np.ones(points)] if declared else [])
        fixed = np.zeros(points) if free_gain else found
        return fixed, np.stack(columns, axis=1) if columns else np.empty((points, 0))

    start: dict[str, float | str] = {"A1": 0.0, "A2": 0.0, "g2": 0.0} if pair else _still(f, width)
    return Record(
        model="CoupledModes2" if pair else "CoupledOscillator",
        output="q1" if pair else "q1_hybrid",
        start=start,
        t=t,
        exact=gain * y + level,
        scale=gain * top,
        unknowns=unknowns,
        predicted=predicted,
        keys=(
            'input = "b"',
            'interpolation = "held"',
            f'gain = "{"fit" if free_gain else "one"}"',
            f"offset = {'true' if declared else 'false'}",
        ),
        b=b,
    )


def driven_pair(draw: Draw, mistake: str) -> Record:
    """The same of two coupled modes, of which the first is driven and seen."""
    return driven(draw, mistake, pair=True)


def lock_in(draw: Draw, mistake: str) -> Record:
    """X and Y of a decay beside the frequency of a demodulator."""
    f, width = _one(draw, 300.0)
    points = draw.points(24.0)
    span = draw.log(1.0, 5.0) / (math.pi * width)
    t = np.asarray(np.arange(points) * (span / (points - 1)), dtype=float)
    rate = 1.0 / float(t[1])
    away = draw.even(-0.3, 0.3) * rate if draw.happens(0.5) else draw.even(-3.0, 3.0) * width
    reference = f + math.copysign(min(abs(away), 0.3 * rate, 0.3 * f), away)
    reach = min(width * draw.log(5.0, 50.0), 0.15 * rate, 0.3 * f)
    if draw.happens(0.15):
        reach = min(draw.log(0.3, 2.0) * rate, 0.3 * f)
    eta = draw.place("eta_plus", f, reach, min(2.0 * width, 0.5 * reach))
    offset = mistake == OFFSET or draw.happens(0.5)
    declared = offset and mistake != OFFSET
    shift = draw.log(1.0, 3.0) * width if mistake == DRIFT else 0.0
    start = np.exp(1j * draw.even(0.0, TWO_PI))
    turned = np.exp(-1j * TWO_PI * reference * t)
    z = _decaying(t, f, width, shift, start) * turned
    if mistake == SECOND:
        near = f + draw.sign() * draw.log(3.0, 15.0) * width
        z = z + draw.log(0.1, 0.6) * _decaying(t, near, width * draw.log(0.5, 2.0)) * turned
    level = (draw.log(0.07, 0.5) if mistake == OFFSET else draw.even(0.0, 0.5)) if offset else 0.0
    size = draw.log(1e-6, 1.0)

    def predicted(values: Values) -> tuple[FloatArray, FloatArray]:
        w = _decaying(t, values["eta_plus"], values["d1"]) * turned
        parts = [w, 1j * w] + ([np.ones(points), 1j * np.ones(points)] if declared else [])
        columns = [np.concatenate([np.real(p), np.imag(p)]) for p in parts]
        return np.zeros(2 * points), np.stack(columns, axis=1)

    return Record(
        model="CoupledOscillator",
        output="q1_hybrid",
        start=_still(f, width),
        t=t,
        exact=np.asarray(size * (z + level * np.exp(1j * draw.even(0.0, TWO_PI)))),
        scale=size,
        unknowns=(eta, draw.size("d1", width)),
        predicted=predicted,
        keys=(
            'input = "b"',
            f'frequency = "{reference!r} Hz"',
            "modes = 1",
            f"offset = {'true' if declared else 'false'}",
        ),
        equal=tuple(
            {"eta_plus": math.hypot(x, 0.5 * width), "d1": width}
            for x in _aliases(math.sqrt(f * f - 0.25 * width**2), t, eta, folded=False)
        ),
    )
