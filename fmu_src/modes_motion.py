"""Transients of N modes: an exact propagator without a pump, Taylor series with one.

Both move y = (x, x'/(2 pi F)) of the full equations, F near the eigenfrequencies, or y = (Re z,
Im z) of the envelope's analytic signal z, by y' = 2 pi (G + G_p cos psi(t)) y.

Without a pump, exp(2 pi G t) in 50 digits: nothing accumulates, no eigenvalue is needed, and modes
may coincide, be overdamped, or lie at an exceptional point. With one there is no closed form: a
Taylor series is summed to rounding over substeps of a third of a period. Over a pump period that
gives Floquet's propagator, once; from then on a time any number of periods later costs its powers,
one matrix of the table and one substep.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import Decimal
from operator import add, mul
from typing import TYPE_CHECKING, NamedTuple

from .model_error import ModelError
from .modes_steady import Frame
from .oscillator_precise import in_precise_arithmetic

if TYPE_CHECKING:  # subscripted here, these would need a host with Python 3.9 or later
    Exact = Sequence[Sequence[Decimal]]
    #: (column, entry) of the entries that are not 0, row by row.
    Sparse = list[list[tuple[int, float]]]

ZERO = Decimal(0)
TWO_PI = 2.0 * math.pi
#: As it is written: a product here would have the 28 digits of the default context.
TWO_PI_EXACT = Decimal("6.2831853071795864769252867665590057683943387987502116419498891846")
#: Steps that differ by less than this angle share a propagator; a short series does the rest.
NEAR = Decimal("1e-3")
#: Series end at this part of the vector: that of a propagator, which is squared and used again and
#: again, and that of the rest of a step.
SERIES_END, REST_END = Decimal("1e-48"), Decimal("1e-36")
#: Propagators in store: a host that steps evenly needs one, one with two rates two.
MOST_KNOWN = 4
#: Angle of the fastest motion over one substep of the Taylor series, and its highest order.
SUBSTEP_ANGLE, MOST_ORDERS = 2.0, 60


class Generator(NamedTuple):
    """G and G_p in Hz, and the scale F in Hz (0 for the envelope)."""

    still: list[list[Decimal]]
    pumped: list[list[Decimal]]
    scale: Decimal


def generator(frame: Frame) -> Generator:
    """Return the generator of the first-order system of a frame."""
    with in_precise_arithmetic():
        if frame.centre is None:
            return _full(frame)
        return _envelope(frame, Decimal(frame.centre))


def _full(frame: Frame) -> Generator:
    m = frame.matrices
    n = len(m.eta)
    # a power of 2, so that changing it rounds nothing
    scale = Decimal(2.0 ** round(math.log2(m.eta[-1])))
    still = [[Decimal(0)] * (2 * n) for _ in range(2 * n)]
    pumped = [[Decimal(0)] * (2 * n) for _ in range(2 * n)]
    for i in range(n):
        still[i][n + i] = scale
        still[n + i][n + i] = -m.damping[i]
        for j in range(n):
            still[n + i][j] = -m.stiffness[i][j] / scale
            pumped[n + i][j] = -m.pump[i][j] / scale
    return Generator(still, pumped, scale)


def _envelope(frame: Frame, c: Decimal) -> Generator:
    """z' = 2 pi (i c + i (C - c^2 + i c D + C_p cos psi)/(2 c)) z, in real and imaginary parts."""
    if not c:
        raise ModelError(
            "the rotating frame of solver 1 (envelope) needs a drive above 0 Hz; use solver 0 "
            "(exact) or 2 (rk4)"
        )
    m = frame.matrices
    n = len(m.eta)
    still = [[Decimal(0)] * (2 * n) for _ in range(2 * n)]
    pumped = [[Decimal(0)] * (2 * n) for _ in range(2 * n)]
    for i in range(n):
        for j in range(n):
            own = c * c if i == j else Decimal(0)
            turn = (m.stiffness[i][j] + own) / (2 * c)
            still[i][n + j], still[n + i][j] = -turn, turn
            turn = m.pump[i][j] / (2 * c)
            pumped[i][n + j], pumped[n + i][j] = -turn, turn
        still[i][i] = still[n + i][n + i] = -m.damping[i] / 2
    return Generator(still, pumped, Decimal(0))


class Propagator:
    """exp(2 pi G t) applied to vectors, in 50 digits, kept for steps that recur."""

    def __init__(self, rows: Exact) -> None:
        self._rows = [[TWO_PI_EXACT * x for x in row] for row in rows]
        self._norm = max(sum(map(abs, row), ZERO) for row in self._rows)
        self._known: list[tuple[Decimal, list[list[Decimal]]]] = []

    def moved(self, y: Sequence[Decimal], dt: Decimal) -> list[Decimal]:
        """Return exp(2 pi G dt) y, in the current decimal arithmetic."""
        near = [k for k in self._known if abs(dt - k[0]) * self._norm <= NEAR]
        span, matrix = near[0] if near else (dt, self._exponential(dt))
        if not near:
            self._known = [(span, matrix), *self._known[: MOST_KNOWN - 1]]
        whole = [sum(map(mul, row, y), ZERO) for row in matrix]
        return self._series(whole, dt - span, REST_END) if dt != span else whole

    def _series(self, y: list[Decimal], dt: Decimal, end: Decimal) -> list[Decimal]:
        total, term = y, y
        least = end * max(map(abs, y))
        order = 0
        while max(map(abs, term)) > least:
            order += 1
            part = dt / order
            term = [part * sum(map(mul, row, term), ZERO) for row in self._rows]
            total = list(map(add, total, term))
        return total

    def _exponential(self, dt: Decimal) -> list[list[Decimal]]:
        """Return the matrix, column by column by its series over dt/2^s, then squared s times."""
        angle = float(abs(dt) * self._norm)
        squarings = max(0, math.ceil(math.log2(angle)) + 10) if angle else 0
        part = dt / 2**squarings
        n = len(self._rows)
        columns = [
            self._series([Decimal(int(i == j)) for j in range(n)], part, SERIES_END)
            for i in range(n)
        ]
        matrix = [list(row) for row in zip(*columns)]
        for _ in range(squarings):
            across = list(zip(*matrix))
            matrix = [[sum(map(mul, row, column), ZERO) for column in across] for row in matrix]
        return matrix


class PumpedPropagator:
    """y' = 2 pi (G + G_p cos psi) y, psi' = 2 pi u_p, by Taylor series in doubles."""

    def __init__(self, made: Generator, pump_hz: float, fastest_hz: float) -> None:
        self._still = _sparse(made.still)
        self._pumped = _sparse(made.pumped)
        self.pump_hz = pump_hz
        self._speed = TWO_PI * pump_hz
        self.substep = SUBSTEP_ANGLE / (TWO_PI * max(fastest_hz, pump_hz))

    def moved(self, y: Sequence[float], span: float, psi: float) -> list[float]:
        """Return y after ``span`` s that begin at the pump's phase ``psi`` in rad."""
        count = max(1, math.ceil(span / self.substep))
        h = span / count
        state = list(y)
        for k in range(count):
            state = self._series(state, h, psi + self._speed * (k * h))
        return state

    def _series(self, y: list[float], h: float, psi: float) -> list[float]:
        """Return y after h s: y_(m+1) = h (G y_m + sum_l c_l G_p y_(m-l))/(m + 1)."""
        cosine, sine, angle = math.cos(psi), math.sin(psi), self._speed * h
        # Taylor coefficients of cos(psi + angle s), s from 0 to 1
        turns = (cosine, -sine, -cosine, sine)
        weights, factor = [cosine], 1.0
        total, term = list(y), y
        driven: list[list[float]] = []
        size = max(map(abs, y))
        small = 0
        for m in range(MOST_ORDERS):
            driven.append([sum(a * term[j] for j, a in row) for row in self._pumped])
            rate = [sum(a * term[j] for j, a in row) for row in self._still]
            for weight, old in zip(weights, reversed(driven)):
                rate = [a + weight * b for a, b in zip(rate, old)]
            part = h / (m + 1)
            term = [part * x for x in rate]
            total = [a + b for a, b in zip(total, term)]
            # two in a row: the series of a cosine has every other term alone
            small = small + 1 if max(map(abs, term)) <= 1e-18 * size else 0
            if small == 2:
                return total
            factor *= angle / (m + 1)
            if factor > 1e-18:
                weights.append(factor * turns[(m + 1) % 4])
        return total


class PeriodTable:
    """The propagators from the beginning of a pump period to its substeps, and their powers."""

    def __init__(self, flow: PumpedPropagator, size: int) -> None:
        self._flow = flow
        self._count = max(1, math.ceil(1.0 / (flow.pump_hz * flow.substep)))
        self._part = 1.0 / (flow.pump_hz * self._count)
        columns = [[float(i == j) for j in range(size)] for i in range(size)]
        self._steps = [columns]
        for k in range(self._count):
            psi = TWO_PI * k / self._count
            columns = [flow.moved(column, self._part, psi) for column in columns]
            self._steps.append(columns)
        self._powers = [columns]

    @property
    def period(self) -> list[list[float]]:
        """The propagator over one period that begins at the pump's phase 0."""
        return [list(row) for row in zip(*self._steps[-1])]

    def after(self, y: Sequence[float], periods: int, fraction: float) -> list[float]:
        """Return y, at a phase of 0, whole periods and a fraction of one later."""
        state, power = list(y), 0
        while periods >> power:
            if power == len(self._powers):
                last = self._powers[-1]
                self._powers.append([_combined(last, column) for column in last])
            if periods >> power & 1:
                state = _combined(self._powers[power], state)
            power += 1
        place = min(int(fraction * self._count), self._count - 1)
        state = _combined(self._steps[place], state)
        rest = (fraction - place / self._count) / self._flow.pump_hz
        return self._flow.moved(state, rest, TWO_PI * place / self._count)


def _combined(columns: Sequence[Sequence[float]], y: Sequence[float]) -> list[float]:
    """Return the product of a matrix, given by its columns, and a vector."""
    return [sum(map(mul, row, y)) for row in zip(*columns)]


def _sparse(rows: Exact) -> Sparse:
    """Return the rows times 2 pi."""
    return [[(j, TWO_PI * float(x)) for j, x in enumerate(row) if x] for row in rows]
