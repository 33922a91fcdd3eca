"""Which model of two modes two lines of one sweep want, and the values with which it begins.

With D = f0^2 - f^2 + i f d of each mode by itself, and k = lambda^2 the coupling,

    separate   S = 1/D1 + g/D2                     each line is a mode, both are seen
    coupled    S = D2/(D1 D2 - k^2)                mode 1 is driven and seen, mode 2 is coupled
    driven     S = (D2 + k g)/(D1 D2 - k^2)        and mode 2 is driven, too

times a gain, and next to a constant where there are phases. The first has lines in phase, or half a
turn apart; of coupled modes of unlike dampings they are not. The simplest one is taken that leaves
no more than noise lets it beside two lines of any heights and phases (`fitting.lines.several`);
both with one unknown less are equally simple, and the first of them goes before.

The lines of a pair, p = f + i w/2 with residues r, give the begin: z = (r1 p2 + r2 p1)/(r1 + r2) is
where nothing is seen, which is mode 2 of `coupled`, and p1 + p2 - z is mode 1. Amplitudes are as
well those of the mirrored z.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitting.lines.choice import chance
from fitting.lines.form import LineFit
from fitting.lines.record import LineNumber
from fitting.lines.several import fit_lines
from fitting.lines.trace import Trace
from fitting.signal.least_squares import minimise_squares
from fitting.text.arrays import ComplexArray, FloatArray, both_parts

SEPARATE, COUPLED, DRIVEN = "separate", "coupled", "driven"
#: Probability from which noise is why two lines of any phases leave less.
BY_CHANCE = 0.01
#: Evaluations of a fit, and the relative fall of the squares at which it ends.
ROUNDS, GAIN = 300, 1e-12
#: Unknowns of x that each model has.
UNKNOWNS = {SEPARATE: 5, COUPLED: 5, DRIVEN: 6}
#: Drives of the second mode, g, from which coupled modes begin: none, or both signs.
STARTS: Mapping[str, tuple[tuple[float, ...], ...]] = {COUPLED: ((),), DRIVEN: ((0.1,), (-0.1,))}


@dataclass(frozen=True, kw_only=True)
class TwoModes:
    """Two modes that describe a sweep: `kind` of model, and its values.

    `frequency_hz` and `width_hz` (2,) of each mode by itself, Hz; `coupling_hz` is lambda, Hz,
    `drive` g2, zero where there is none. `describes` is False where even this one leaves more than
    the noise. `lines` are the frequencies of both lines, then their widths, Hz, with errors.
    """

    kind: str
    frequency_hz: tuple[float, float]
    width_hz: tuple[float, float]
    coupling_hz: float
    drive: float
    describes: bool
    lines: tuple[LineNumber, ...]

    @cached_property
    def apart_hz(self) -> tuple[float, ...]:
        """How far the model's own numbers, eta and width, are from those of the lines, Hz, (4,).

        These are frequencies without damping, and widths as if dampings were alike.
        """
        (a, b), squared = self.frequency_hz, self.coupling_hz**2
        own, shapes = np.linalg.eigh([[a**2, squared], [squared, b**2]])
        wide = (shapes**2).T @ np.array(self.width_hz)
        one, two = ([-1.0, 1j * w, f * f] for f, w in zip((a, b), self.width_hz, strict=True))
        both = np.polymul(one, two)
        both[-1] -= squared**2
        poles = sorted((p for p in np.roots(both) if p.real > 0.0), key=abs)[:2]
        if len(poles) < 2:  # a mode that does not oscillate is no line
            return (math.inf,) * 4
        lines = np.array([*map(abs, poles), *(2.0 * p.imag for p in poles)])
        return tuple(np.abs(lines - [*np.sqrt(np.abs(own)), *wide]).tolist())

    @property
    def matches_lines(self) -> bool:
        """Whether the model's own numbers are those of the lines, within half their errors."""
        pairs = zip(self.apart_hz, self.lines, strict=True)
        return all(apart < 0.5 * number.std for apart, number in pairs)


def two_modes_of(trace: Trace) -> TwoModes | None:
    """The simplest model of two modes that describes a trace; None where no two lines fit it.

    Args:
        trace: what was measured.
    """
    values = trace.values if trace.is_complex else trace.amplitude
    pair = fit_lines(trace.frequency_hz, values, 2)
    if pair is None:
        return None
    y = values / float(np.max(trace.amplitude))
    models = {kind: _Model(trace.frequency_hz, y, pair, kind) for kind in UNKNOWNS}
    fits = {kind: model.lowest() for kind, model in models.items()}
    linear = 4 if trace.is_complex else 1
    probabilities = {
        kind: chance(
            squares,
            UNKNOWNS[kind] + linear,
            pair.squares,
            pair.unknowns,
            pair.structure,
            trace.rows,
        )
        for kind, (squares, _) in fits.items()
        if math.isfinite(squares)
    }
    if not probabilities:
        return None
    likely = [kind for kind, by_chance in probabilities.items() if by_chance > BY_CHANCE]
    kind = likely[0] if likely else min(probabilities, key=lambda each: fits[each][0])
    return models[kind].modes_at(fits[kind][1], describes=bool(likely))


class _Model:
    """A model of two modes, and a sweep over its largest value.

    x holds shifts of both modes from the middle of the lines and logarithms of their widths, both
    over the larger of the widths and the distance, then k over 2 f0 of it, and g.
    """

    def __init__(
        self, f: FloatArray, y: FloatArray | ComplexArray, pair: LineFit, kind: str
    ) -> None:
        self.f, self.y, self.kind = f, y, kind
        heights = [1.0 + 0j, *(other.height for other in pair.others)]
        both = list(zip((pair, *pair.others), heights, strict=True))
        both.sort(key=lambda each: each[0].frequency.value)
        self.numbers = [line.frequency for line, _ in both] + [line.width for line, _ in both]
        self.place_hz, self.width_hz = np.reshape([each.value for each in self.numbers], (2, 2))
        self.height = np.array([height for _, height in both])
        self.middle = float(np.mean(self.place_hz))
        self.unit = max(float(np.ptp(self.place_hz)), float(np.max(self.width_hz)))

    def modes(self, x: FloatArray) -> list[tuple[float, float]]:
        """Frequency and width of each mode by itself, Hz."""
        widths = self.unit * np.exp(np.clip(x[2:4], -30.0, 30.0))
        return [(self.middle + self.unit * float(x[k]), float(widths[k])) for k in (0, 1)]

    def residuals(self, x: FloatArray) -> FloatArray:
        """What the best gain, and a constant beside phases, leaves of S."""
        size = 2.0 * self.middle * self.unit
        one, two = (
            ((a - self.f) * (a + self.f) + 1j * self.f * w) / size for a, w in self.modes(x)
        )
        if self.kind == SEPARATE:
            response = 1.0 / one + x[4] / two
        else:
            more = x[4] * x[5] if self.kind == DRIVEN else 0.0
            response = (two + more) / (one * two - x[4] ** 2)
        if not np.iscomplexobj(self.y):
            made = np.abs(response)
            return np.asarray(made * float(made @ self.y) / float(made @ made) - self.y)
        columns = np.column_stack([response, np.ones(self.f.size)])
        return both_parts(columns @ np.linalg.lstsq(columns, self.y, rcond=None)[0] - self.y)

    def lowest(self) -> tuple[float, FloatArray]:
        """Squares and x of the lowest minimum; infinite where there is none."""
        best = math.inf, np.zeros(UNKNOWNS[self.kind])
        for start in self.starts():
            with contextlib.suppress(ValueError, np.linalg.LinAlgError):
                x, squares = minimise_squares(self.residuals, start, rounds=ROUNDS, gain=GAIN)
                best = min(best, (squares, x), key=lambda each: each[0])
        return best

    def starts(self) -> list[FloatArray]:
        """Where the fit begins, from the lines of the pair."""
        p1, p2 = map(complex, (self.place_hz - self.middle + 0.5j * self.width_hz) / self.unit)
        r1, r2 = self.height * self.width_hz
        z = complex((r1 * p2 + r2 * p1) / (r1 + r2))
        zeros = [z] if np.iscomplexobj(self.y) else [z, z.conjugate()]

        def start(one: complex, two: complex, *more: float) -> FloatArray:
            widths = [math.log(2.0 * max(p.imag, 1e-6)) for p in (one, two)]
            return np.array([one.real, two.real, *widths, *more])

        if self.kind == SEPARATE:  # of both signs: those of the pair may be the mirrored ones
            ratios = {abs((zero - p2) / (p1 - zero)) for zero in zeros if zero != p1}
            return [start(p1, p2, sign * g) for g in sorted(ratios) for sign in (1.0, -1.0)]
        made = []
        least = 0.05 * min(p1.imag, p2.imag)
        for zero in zeros:
            # modes with the poles and the zero, as near as a real coupling comes
            two = complex(zero.real, max(zero.imag, least))
            one = p1 + p2 - two
            one = complex(one.real, max(one.imag, least))
            square = (-(p1 - two) * (p2 - two)).real
            k = math.sqrt(max(square, 0.01))
            made += [start(one, two, k, *g) for g in STARTS[self.kind]]
        return made

    def modes_at(self, x: FloatArray, *, describes: bool) -> TwoModes:
        """The values of x in their units."""
        (f1, w1), (f2, w2) = self.modes(x)
        coupling, drive = 0.0, float(x[4])
        if self.kind != SEPARATE:
            coupling = math.sqrt(2.0 * self.middle * self.unit * abs(float(x[4])))
            # lambda^2 has a sign of its own, which g2 takes
            drive = math.copysign(float(x[5]), float(x[4] * x[5])) if self.kind == DRIVEN else 0.0
        return TwoModes(
            kind=self.kind,
            frequency_hz=(f1, f2),
            width_hz=(w1, w2),
            coupling_hz=coupling,
            drive=drive,
            describes=describes,
            lines=tuple(self.numbers),
        )
