"""Steady state of N modes: one linear solve, or harmonic balance over the pump's sidebands.

A tone exp(2 pi i u t) moves the pumped modes at v_k = u + k u_p, all integers k,

    A(v_k) X_k + C_p/2 (X_(k-1) + X_(k+1)) = g for k = 0, else 0,     A(v) = C - v^2 + i v D,

everything over (2 pi)^2 and the pump's phase taken out (X_k turns with exp(i k phi_p)). The chain
is cut at -below and +above and eliminated from both ends to the middle (a matrix continued
fraction: H. Risken, The Fokker-Planck Equation, chapter 9), then corrected with residuals of 50
digits, so that what is left is the cut. It is bounded: beyond it the Schur complements S_k obey

    |S_k^-1| <= s_k = 1/(1/a_k - p^2 s_(k+1)/4),     |A(v_k)^-1| <= a_k,  p = |C_p|,

    1/a_k = max(|v_k| min d, distance of v_k^2 from the range of C's eigenvalues,
                distance of v_k^2 from the nearest one - |v_k| max d),

so cutting there changes the last blocks by at most p^2 s/4, and what that does to every X_k follows
from norms of the inverse, which the elimination yields too. The chain grows until the sum of all
these, and of all that is beyond the cut, is below ``WANTED`` of the largest X_k.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import Decimal
from typing import TYPE_CHECKING, NamedTuple

from .model_error import ModelError
from .modes_matrices import applied, frobenius, inverse, length, product, solve_precise
from .oscillator_precise import Precise, in_precise_arithmetic

if TYPE_CHECKING:  # subscripted here, these would need a host with Python 3.9 or later
    from .modes_equations import Matrices
    from .modes_matrices import Complex

    Vector = list[Precise]

#: Largest part of the largest sideband that cutting the chain may cost, all sidebands together.
WANTED = 1e-14
#: No more sidebands on a side than this, and none of the scalar bounds beyond this many.
MOST_SIDEBANDS = 1500
MOST_BOUNDED = 200_000


class Frame(NamedTuple):
    """The equations of a solver: the full ones, or (``centre`` in Hz) those of the envelope.

    The envelope in the frame that rotates at c has c^2 + 2 c (v - c) for v^2 and c D for v D.
    """

    matrices: Matrices
    centre: float | None
    pump_hz: float

    def square(self, v: float) -> float:
        """Return what stands for v^2."""
        c = self.centre
        return v * v if c is None else c * (2.0 * v - c)

    def carrier(self, v: float) -> float:
        """Return what stands for v before D."""
        return v if self.centre is None else self.centre

    def block(self, v: Decimal) -> list[list[Precise]]:
        """Return A(v) in the current decimal arithmetic."""
        c = None if self.centre is None else Decimal(self.centre)
        square = v * v if c is None else c * (v + v - c)
        carrier = v if c is None else c
        m = self.matrices
        return [
            [Precise(x - square, carrier * d) if i == j else Precise(x) for j, x in enumerate(row)]
            for i, (row, d) in enumerate(zip(m.stiffness, m.damping))
        ]

    def distance(self, v: float) -> float:
        """Return a lower bound of 1/|A(v)^-1|.

        A's field of values keeps the first two off 0, its distance from a normal matrix the third.
        """
        m = self.matrices
        square, carrier = self.square(v), abs(self.carrier(v))
        gap = max(square - m.highest, m.lowest - square)
        between = min(abs(eta * eta - square) for eta in m.eta) - 1e-12 * m.highest
        return max(gap, carrier * m.narrowest, between - carrier * m.widest)


class Steady(NamedTuple):
    """Response to exp(2 pi i u t), in s^2 times (2 pi)^2: X_k for k = -below and up.

    ``bound``: how far, at most, all sidebands together are from those of the endless chain.
    """

    sidebands: list[list[Precise]]
    below: int
    bound: float

    def sideband(self, k: int) -> list[complex]:
        """Return X_k; 0 beyond the chain."""
        place = self.below + k
        if 0 <= place < len(self.sidebands):
            return [complex(x) for x in self.sidebands[place]]
        return [0j] * len(self.sidebands[0])


def steady_state(frame: Frame, g: Sequence[float], u: float) -> Steady:
    """Return the response of the modes to a tone of unit amplitude on the gains ``g``.

    Raises ModelError where there is none, and where the sidebands do not converge.
    """
    with in_precise_arithmetic():
        if not frame.matrices.pump_norm:
            try:
                return Steady([_unpumped(frame, g, u)], 0, 0.0)
            except ZeroDivisionError as error:
                raise ModelError(
                    f"a drive at {u!r} Hz has no steady state: it lies on an undamped "
                    "eigenfrequency"
                ) from error
        return _pumped(frame, g, u)


def _unpumped(frame: Frame, g: Sequence[float], u: float) -> Vector:
    return solve_precise(frame.block(Decimal(u)), [Precise(x) for x in g])


def _pumped(frame: Frame, g: Sequence[float], u: float) -> Steady:
    """Return the response under the pump from a chain that is long enough."""
    tails = _Tail(frame, u, 1), _Tail(frame, u, -1)
    above, below = (tail.first_guess() for tail in tails)
    while True:
        if max(above, below) > MOST_SIDEBANDS:
            raise ModelError(
                f"the pump at pump_hz = {frame.pump_hz!r} Hz needs more than {MOST_SIDEBANDS} "
                f"sidebands of a drive at {u!r} Hz: a faster or a weaker pump is wanted"
            )
        chain = _Chain(frame, u, below, above)
        found = chain.solved(g)
        sizes = [length([complex(x) for x in row]) for row in found]
        bound = chain.bound(tails, sizes)
        if bound <= WANTED * max(sizes):
            return Steady(found, below, bound)
        above, below = above + 1 + above // 4, below + 1 + below // 4


class _Tail:
    """The scalar bounds s_k of one side, k = 1 and up in the direction ``sign``."""

    def __init__(self, frame: Frame, u: float, sign: int) -> None:
        p = frame.matrices.pump_norm
        near: list[float] = []
        while True:
            v = u + sign * (len(near) + 1) * frame.pump_hz
            last = _beyond(frame, v, sign)
            if last is not None:
                break
            if len(near) == MOST_BOUNDED:
                raise ModelError(
                    f"pump_hz = {frame.pump_hz!r} Hz is too slow: more than {MOST_BOUNDED} "
                    f"sidebands of a drive at {u!r} Hz lie below the highest eigenfrequency"
                )
            near.append(frame.distance(v))
        # from here on all a_k are smaller: the fixed point of the recursion bounds every s_k
        s = 2.0 / (last + math.sqrt((last - p) * (last + p)))
        bounds = [s]
        self.least = 0  # the chain must reach this far: beyond it every s_k exists
        for k in range(len(near), 0, -1):
            rest = near[k - 1] - 0.25 * p * p * s
            if rest <= 0.0:
                self.least = k
                break
            s = 1.0 / rest
            bounds.append(s)
        self._bounds = bounds[::-1]
        self._half = 0.5 * p

    def at(self, k: int) -> float:
        """Return s_k, k > ``least``."""
        return self._bounds[min(k - self.least, len(self._bounds)) - 1]

    def first_guess(self) -> int:
        """Return where the sidebands have fallen to the wanted part, by their bounds."""
        k, left = max(self.least, 1), 1.0
        while left > WANTED and k < MOST_SIDEBANDS:
            k += 1
            left *= min(1.0, self._half * self.at(k))
        return k

    def after(self, k: int) -> float:
        """Return a bound of the sum of all |X_j|, j > k, over |X_k|."""
        total, part, last = 0.0, 1.0, self.least + len(self._bounds)
        for j in range(k + 1, max(last, k + 1) + 1):
            part *= self._half * self.at(j)
            total += part
            if part < 1e-300:
                return total
        # beyond the last one every ratio is at most that of the fixed point, below 1/3
        ratio = self._half * self._bounds[-1]
        return total + part * ratio / (1.0 - ratio)


def _beyond(frame: Frame, v: float, sign: int) -> float | None:
    """Return a bound of 1/|A| that holds from v outwards, if it is twice the pump's norm."""
    m = frame.matrices
    square = frame.square(v)
    gap = m.lowest - square if frame.centre is not None and sign < 0 else square - m.highest
    outwards = frame.centre is not None or v * sign > 0.0
    return gap if outwards and gap >= 2.0 * m.pump_norm else None


class _Chain:
    """The blocks from -below to +above, eliminated in doubles from both ends to the middle."""

    def __init__(self, frame: Frame, u: float, below: int, above: int) -> None:
        self.frame, self.below, self.above = frame, below, above
        step, tone = Decimal(frame.pump_hz), Decimal(u)
        self.blocks = {k: frame.block(tone + k * step) for k in range(-below, above + 1)}
        self._half_pump = [[0.5 * x for x in row] for row in frame.matrices.pump_values]
        self.inverses: dict[int, Complex] = {}
        self.ratios: dict[int, Complex] = {}
        for sign, most in ((1, above), (-1, below)):
            for k in range(most, 0, -1):
                self._eliminate(sign * k, sign * (k + 1))
        self.inverses[0] = inverse(self._schur(0, (1, -1)))

    def _eliminate(self, k: int, outer: int) -> None:
        """Store S_k^-1 and R_k of X_k = R_k X_(k-1)."""
        self.inverses[k] = inverse(self._schur(k, (outer,)))
        self.ratios[k] = [[-x for x in row] for row in product(self.inverses[k], self._half_pump)]

    def _schur(self, k: int, outer: Sequence[int]) -> Complex:
        """Return A(v_k) + C_p/2 R_j summed over the neighbours j further out."""
        rows = [[complex(x) for x in row] for row in self.blocks[k]]
        for j in outer:
            if j in self.ratios:
                added = product(self._half_pump, self.ratios[j])
                rows = [[x + y for x, y in zip(a, b)] for a, b in zip(rows, added)]
        return rows

    def solved(self, g: Sequence[float]) -> list[Vector]:
        """Return X_k for k = -below and up, corrected until doubles can hold no more."""
        n = len(g)
        keys = range(-self.below, self.above + 1)
        found = {k: [Precise(0.0)] * n for k in keys}
        right = {k: [Precise(x if k == 0 else 0.0) for x in g] for k in keys}
        before = math.inf
        while True:
            change = self._solved_in_doubles(self._residual(right, found))
            for k in keys:
                found[k] = [x + _precise(y) for x, y in zip(found[k], change[k])]
            size = max(abs(y) for row in change.values() for y in row)
            largest = max(abs(complex(x)) for row in found.values() for x in row)
            if size <= 1e-19 * largest:
                return [found[k] for k in keys]
            if not size < 0.1 * before:
                raise ModelError(
                    f"the sidebands of the pump at pump_hz = {self.frame.pump_hz!r} Hz cannot be "
                    "solved for: the modes are too close to undamped, or to instability"
                )
            before = size

    def _residual(self, right: dict[int, Vector], found: dict[int, Vector]) -> dict[int, Vector]:
        """Return what the equations leave, in the current decimal arithmetic."""
        pump = self.frame.matrices.pump
        half = Decimal("0.5")
        left = {}
        for k, block in self.blocks.items():
            sides = [found[j] for j in (k - 1, k + 1) if j in found]
            row_rest = []
            for i, row in enumerate(block):
                rest = right[k][i]
                for j, x in enumerate(row):
                    rest = rest - x * found[k][j]
                    if pump[i][j]:
                        weight = half * pump[i][j]
                        for side in sides:
                            y = side[j]
                            rest = Precise(rest.re - weight * y.re, rest.im - weight * y.im)
                row_rest.append(rest)
            left[k] = row_rest
        return left

    def _solved_in_doubles(self, rest: dict[int, Vector]) -> dict[int, list[complex]]:
        """Return the solution for a right side, by the elimination that is in store."""
        gathered = {k: [complex(x) for x in row] for k, row in rest.items()}
        for sign, most in ((1, self.above), (-1, self.below)):
            for k in range(most, 0, -1):
                # (C_p/2 S^-1)^T = S^-1 C_p/2, both are symmetric
                inward = applied(list(zip(*self.ratios[sign * k])), gathered[sign * k])
                inner = gathered[sign * (k - 1)]
                gathered[sign * (k - 1)] = [x + y for x, y in zip(inner, inward)]
        found = {0: applied(self.inverses[0], gathered[0])}
        for sign, most in ((1, self.above), (-1, self.below)):
            for k in range(1, most + 1):
                own = applied(self.inverses[sign * k], gathered[sign * k])
                led = applied(self.ratios[sign * k], found[sign * (k - 1)])
                found[sign * k] = [x + y for x, y in zip(own, led)]
        return found

    def bound(self, tails: tuple[_Tail, _Tail], sizes: Sequence[float]) -> float:
        """Return what the cut costs at most, over all sidebands; inf where no bound holds."""
        quarter = 0.25 * self.frame.matrices.pump_norm**2
        above, below = self._norms(1, self.above), self._norms(-1, self.below)
        cut = quarter * tails[0].at(self.above + 1), quarter * tails[1].at(self.below + 1)
        middle = frobenius(self.inverses[0])
        across = above.reach[-1] * middle * below.reach[-1]
        feedback = max(
            above.own[-1] * cut[0] + across * cut[1], across * cut[0] + below.own[-1] * cut[1]
        )
        if feedback >= 0.5:
            return math.inf
        last = max(sizes[0], sizes[-1]) / (1.0 - feedback)
        changed = cut[0] * (above.from_end + sum(below.reach[1:]) * middle * above.reach[-1])
        changed += cut[1] * (below.from_end + sum(above.reach[1:]) * middle * below.reach[-1])
        beyond = tails[0].after(self.above) + tails[1].after(self.below)
        return last * (changed + beyond)

    def _norms(self, sign: int, most: int) -> _Norms:
        """Return norms of blocks of the chain's inverse on one side, the middle included."""
        ratios = [frobenius(self.ratios[sign * k]) for k in range(1, most + 1)]
        reach, own = [1.0], [frobenius(self.inverses[0])]
        for k, ratio in enumerate(ratios, start=1):
            reach.append(reach[-1] * ratio)
            own.append(frobenius(self.inverses[sign * k]) + ratio * ratio * own[-1])
        from_end, part = 0.0, 1.0
        for k in range(most, -1, -1):
            from_end += own[k] * part
            part *= ratios[k - 1] if k else 1.0
        return _Norms(reach, own, from_end)


class _Norms(NamedTuple):
    """Bounds: |X_k|/|X_0|, |block (k, k)| of the inverse, sum of |blocks (k, last)|."""

    reach: list[float]
    own: list[float]
    from_end: float


def _precise(z: complex) -> Precise:
    return Precise(z.real, z.imag)
