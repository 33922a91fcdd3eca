"""Resonances side by side in complex data, by linear least squares of a rational function.

    S(u) = (a0 + a1 x + a2 x^2 ...)/(1 + b1 x + ... + bp x^p)     x = (u - u0)/half the span

Its p poles are damped modes, each seen through a complex gain of its own: with p coefficients above
nothing stands beside them, with p + 1 a complex constant, with p + 2 a slope, too. u0 is the middle
of the sweep. `fitting.signal.complex_line` is one mode, behind a delay.

Source: C. Sanathanan and J. Koerner, IEEE Trans. Autom. Control 8 (1963) 56.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fitting.signal.complex_line import ROUNDS
from fitting.text.arrays import ComplexArray, FloatArray

#: Smallest size of the denominator, of which it is one in the middle.
SMALLEST = 1e-12
#: Steps of Gauss and Newton after that, and the parts of one that are tried.
STEPS, PARTS = 12, (1.0, 0.5, 0.125)
#: Neighbours over which residuals are averaged where a further line is looked for, and half of its
#: width at first, over half the span.
AVERAGED, NARROW, WIDE = 3, 0.02, 0.3


@dataclass(frozen=True)
class ComplexMode:
    """A pole: frequency and full width, Hz, complex height at its frequency.

    The width is negative where phases are counted as exp(-i 2 pi u t).
    """

    frequency_hz: float
    width_hz: float
    height: complex

    def is_seen(self, frequency_hz: FloatArray) -> bool:
        """Whether points show it: its top among them, wider than half their spacing, not than all.

        Args:
            frequency_hz: of the points (n,), Hz, rising.
        """
        spacing, span = float(np.median(np.diff(frequency_hz))), float(np.ptp(frequency_hz))
        inside = frequency_hz[0] < self.frequency_hz < frequency_hz[-1]
        return bool(inside) and 0.5 * spacing < abs(self.width_hz) < span


@dataclass(frozen=True, kw_only=True)
class LinesTogether:
    """Resonances side by side: coefficients `above` (k,) and `below` (p,), at points `x` (n,).

    `middle_hz` and `half_hz` make frequencies of x.
    """

    x: FloatArray
    middle_hz: float
    half_hz: float
    above: ComplexArray
    below: ComplexArray

    @property
    def unknowns(self) -> int:
        """Number of real unknowns."""
        return 2 * (self.above.size + self.below.size)

    @cached_property
    def denominator(self) -> ComplexArray:
        """The polynomial below at the points, (n,)."""
        return np.asarray(np.polyval([*self.below[::-1], 1.0], self.x))

    @cached_property
    def curve(self) -> ComplexArray:
        """S at the points, (n,)."""
        return np.asarray(np.polyval(self.above[::-1], self.x) / self.denominator)

    def squares(self, values: ComplexArray) -> float:
        """What it leaves, sum of squares.

        Args:
            values: measured (n,).
        """
        left = float(np.sum(np.abs(self.curve - values) ** 2))
        return left if np.isfinite(left) else np.inf

    @property
    def columns(self) -> ComplexArray:
        """Derivatives of S by all coefficients, (n, k + p)."""
        down, powers = self.denominator, self.x[:, None]
        above = powers ** np.arange(self.above.size)
        below = -self.curve[:, None] * powers ** np.arange(1, self.below.size + 1)
        return np.asarray(np.hstack([above, below]) / down[:, None])

    @property
    def modes(self) -> tuple[ComplexMode, ...]:
        """Its poles, the lowest frequency first; fewer than `below` where one is at infinity."""
        poles = np.roots([*self.below[::-1], 1.0])
        slopes = np.polyval(np.polyder([*self.below[::-1], 1.0]), poles)
        residues = np.polyval(self.above[::-1], poles) / slopes
        found = [
            ComplexMode(
                frequency_hz=self.middle_hz + self.half_hz * float(pole.real),
                width_hz=2.0 * self.half_hz * float(pole.imag),
                height=complex(residue / max(abs(pole.imag), 1e-300)),
            )
            for pole, residue in zip(poles, residues, strict=True)
            if np.isfinite(pole)
        ]
        return tuple(sorted(found, key=lambda mode: mode.frequency_hz))


def lines_together(
    frequency_hz: FloatArray, values: ComplexArray, lines: int, above: int
) -> LinesTogether:
    """The rational function of so many poles that complex values follow best.

    Args:
        frequency_hz: frequencies (n,), Hz, rising.
        values: measured (n,), any unit, the delay of a cable taken off.
        lines: number of poles.
        above: number of coefficients above: as many as poles for lines alone, one more for a
            constant beside them, two more for a slope.

    Raises:
        ValueError: fewer points than coefficients.
    """
    if frequency_hz.size < lines + above:
        raise ValueError(f"{frequency_hz.size} points, wanted {lines + above} for {lines} lines")
    middle = 0.5 * float(frequency_hz[0] + frequency_hz[-1])
    half = 0.5 * float(frequency_hz[-1] - frequency_hz[0])
    x = (frequency_hz - middle) / half
    powers = x[:, None] ** np.arange(max(above, lines + 1))
    below = -powers[:, 1 : lines + 1] * values[:, None]
    columns = np.asarray(np.hstack([powers[:, :above], below]), dtype=complex)
    form = LinesTogether(
        x=x,
        middle_hz=middle,
        half_hz=half,
        above=np.zeros(above, dtype=complex),
        below=np.zeros(lines, dtype=complex),
    )
    best = form
    for _ in range(ROUNDS):
        weights = 1.0 / np.maximum(np.abs(form.denominator), SMALLEST)
        found = _solved(np.asarray(columns * weights[:, None], dtype=complex), values * weights)
        form = replace(form, above=found[:above], below=found[above:])
        best = min(best, form, key=lambda each: each.squares(values))
    ends = [_lowered(best, values)]
    if lines > 1:  # noise may hide a line from the weights, but not from what fewer leave
        fewer = lines_together(frequency_hz, values, lines - 1, above - 1)
        ends.append(_lowered(_with_another(fewer, values), values))
    return min(ends, key=lambda each: each.squares(values))


def _with_another(form: LinesTogether, values: ComplexArray) -> LinesTogether:
    """The form with a further line where most is left, as wide as the widest that it has."""
    left = np.abs(np.convolve(values - form.curve, np.ones(AVERAGED) / AVERAGED, mode="same"))
    poles = np.roots([*form.below[::-1], 1.0])
    wide = float(np.max(np.abs(poles.imag), initial=0.0))
    sign = -1.0 if np.sum(np.sign(poles.imag)) < 0 else 1.0
    new = complex(form.x[int(np.argmax(left))], sign * min(max(wide, NARROW), WIDE))
    below = np.polynomial.polynomial.polymul([1.0, *form.below], [1.0, -1.0 / new])
    powers = form.x[:, None] ** np.arange(form.above.size + 1)
    down = np.polynomial.polynomial.polyval(form.x, below)
    above = _solved(np.asarray(powers / down[:, None], dtype=complex), values)
    return replace(form, above=above, below=np.asarray(below[1:]))


def _solved(columns: ComplexArray, values: ComplexArray) -> ComplexArray:
    """Coefficients of least squares."""
    return np.asarray(np.linalg.lstsq(columns, values, rcond=None)[0], dtype=complex)


def _lowered(form: LinesTogether, values: ComplexArray) -> LinesTogether:
    """The form after a few steps of Gauss and Newton: the weights above are not quite right."""
    for _ in range(STEPS):
        columns = form.columns
        sizes = np.maximum(np.linalg.norm(columns, axis=0), SMALLEST)
        step = np.asarray(_solved(columns / sizes, values - form.curve) / sizes)
        for part in PARTS:
            there = replace(
                form,
                above=np.asarray(form.above + part * step[: form.above.size]),
                below=np.asarray(form.below + part * step[form.above.size :]),
            )
            if there.squares(values) < form.squares(values):
                form = there
                break
        else:
            return form
    return form
