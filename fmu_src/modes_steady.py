"""Steady state of N modes: one linear solve, or harmonic balance over the pump's sidebands.

A tone exp(2 pi i u t) moves the pumped modes at v_k = u + k u_p, all integers k,

    A(v_k) X_k + C_p/2 (X_(k-1) + X_(k+1)) = g for k = 0, else 0,     A(v) = C - v^2 + i v D,

everything over (2 pi)^2 and the pump's phase taken out (X_k turns with exp(i k phi_p)). The chain
is cut at -below and +above and eliminated in doubles from both ends to the middle (a matrix
continued fraction: H. Risken, The Fokker-Planck Equation, chapter 9). What that costs is bounded:

* the cut changes the last blocks by at most p^2 s/4, p = |C_p|, s a bound of the inverse Schur
  complement beyond (``modes_tails``), and leaves out all that is beyond;
* rounding leaves a residual r_j in each block, which is calculated, and its own rounding added;
* what both do to all X_k follows from norms of blocks B_kj of the chain's inverse, which the
  elimination yields: the sum over k of |X_k - true X_k| is at most that over j of
  |r_j| times the sum over k of |B_kj|.

The chain grows until the cut costs less than is asked for. Where rounding costs more, the solution
is corrected with residuals of 50 digits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import Decimal
from typing import TYPE_CHECKING, NamedTuple

from .model_error import ModelError
from .modes_matrices import applied, frobenius, inverse, length, product, solve_precise
from .modes_tails import Side, Tail
from .oscillator_precise import Precise, in_precise_arithmetic

if TYPE_CHECKING:  # subscripted here, these would need a host with Python 3.9 or later
    from .modes_equations import Matrices
    from .modes_matrices import Complex

    Vector = list[Precise]
    Rounded = list[complex]

#: Least and largest error that may be asked for; the least is as exact as doubles are.
TOLERANCES = 1e-14, 0.1
#: No more sidebands on a side than this.
MOST_SIDEBANDS = 1500
#: Rounding of a double, relative.
EPSILON = 2.0**-53


class Frame(NamedTuple):
    """The equations of a solver: the full ones, or (``centre`` in Hz) those of the envelope.

    The envelope in the frame that rotates at c has c^2 + 2 c (v - c) for v^2 and c D for v D.
    """

    matrices: Matrices
    centre: float | None
    pump_hz: float

    def square(self, v: float) -> float:
        """Return what is v^2."""
        c = self.centre
        return v * v if c is None else c * (2.0 * v - c)

    def carrier(self, v: float) -> float:
        """Return what is v before D."""
        return v if self.centre is None else self.centre

    def block(self, v: Decimal) -> list[list[Precise]]:
        """Return A(v) in the current decimal arithmetic."""
        square, carrier = self._exact(v)
        m = self.matrices
        return [
            [Precise(x - square, carrier * d) if i == j else Precise(x) for j, x in enumerate(row)]
            for i, (row, d) in enumerate(zip(m.stiffness, m.damping))
        ]

    def rounded(self, v: Decimal) -> Complex:
        """Return A(v) in doubles, but for rounding that of the current decimal arithmetic."""
        square, carrier = self._exact(v)
        m = self.matrices
        rows: Complex = [list(row) for row in m.stiffness_values]
        speed = float(carrier)
        for i, (row, d) in enumerate(zip(rows, m.damping_values)):
            row[i] = complex(float(m.stiffness[i][i] - square), speed * d)
        return rows

    def _exact(self, v: Decimal) -> tuple[Decimal, Decimal]:
        """Return what is v^2, and v before D."""
        if self.centre is None:
            return v * v, v
        c = Decimal(self.centre)
        return c * (v + v - c), c

    def distance(self, v: float) -> float:
        """Return a lower bound of 1/|A(v)^-1|.

        A's field of values keeps the first two off 0, its distance from a normal matrix the third.
        """
        m = self.matrices
        square, carrier = self.square(v), abs(self.carrier(v))
        gap = max(square - m.highest, m.lowest - square)
        between = min(abs(eta * eta - square) for eta in m.eta) - 1e-12 * m.highest
        return max(gap, carrier * m.narrowest, between - carrier * m.widest)


class Wanted(NamedTuple):
    """What accuracy is asked for: that of the read-out, and of the largest displacement.

    ``tolerance``: the error, relative to either at the tone's own frequency; ``readout``: weights
    of the modes in it, none: it does not count.
    """

    tolerance: float = TOLERANCES[0]
    readout: Sequence[float] = ()

    def error(self, carrier: Sequence[complex], largest: float) -> float:
        """Return how far all sidebands together may be off.

        Args:
            carrier: X_0.
            largest: the norm of the largest sideband, of which no more can be asked than doubles
                hold.
        """
        size = length(carrier)
        observed = abs(sum(w * x for w, x in zip(self.readout, carrier)))
        if observed:
            size = min(size, observed / math.hypot(*self.readout))
        return max(self.tolerance * size, TOLERANCES[0] * largest)


class Steady(NamedTuple):
    """Response to exp(2 pi i u t), in s^2 times (2 pi)^2: X_k for k = -below and up.

    ``bound``: how far, at most, all sidebands together are from those of the endless chain;
    ``exact``: X_0 in 50 digits, without a pump.
    """

    sidebands: list[Rounded]
    below: int
    bound: float
    exact: Vector

    def sideband(self, k: int) -> Rounded:
        """Return X_k; 0 beyond the chain."""
        place = self.below + k
        if 0 <= place < len(self.sidebands):
            return self.sidebands[place]
        return [0j] * len(self.sidebands[0])


def steady_state(
    frame: Frame, g: Sequence[float], u: float, wanted: Wanted | None = None
) -> Steady:
    """Return the response of the modes to a tone of unit amplitude on the gains ``g``.

    Args:
        frame: the equations.
        g: gain of the drive on each mode.
        u: frequency of the tone in Hz.
        wanted: accuracy under a pump; None: as exact as doubles are.

    Raises:
        ModelError: there is none, or the sidebands do not converge.
    """
    with in_precise_arithmetic():
        if frame.matrices.pump_norm:
            return _pumped(frame, g, u, wanted or Wanted())
        try:
            exact = solve_precise(frame.block(Decimal(u)), [Precise(x) for x in g])
        except ZeroDivisionError as error:
            raise ModelError(
                f"a drive at {u!r} Hz has no steady state: it lies on an undamped eigenfrequency"
            ) from error
        return Steady([[complex(x) for x in exact]], 0, 0.0, exact)


def _pumped(frame: Frame, g: Sequence[float], u: float, wanted: Wanted) -> Steady:
    """Return the response under the pump from a chain that is long enough."""
    sides = Side(frame, u, 1), Side(frame, u, -1)
    above, below = (side.guess(0.5 * wanted.tolerance, MOST_SIDEBANDS) for side in sides)
    while True:
        tails = sides[0].tail(above), sides[1].tail(below)
        above, below = (tail.end for tail in tails)
        if max(above, below) > MOST_SIDEBANDS:
            raise ModelError(
                f"the pump at pump_hz = {frame.pump_hz!r} Hz needs more than {MOST_SIDEBANDS} "
                f"sidebands of a drive at {u!r} Hz: a faster or a weaker pump is wanted"
            )
        chain = _Chain(frame, u, below, above)
        result = chain.solved(g)
        sizes = [length(x) for x in result]
        cut, rounding = chain.errors(g, result, sizes, tails)
        most = wanted.error(result[below], max(sizes))
        ends = max(sizes[0], sizes[-1])
        if ends * cut <= most and not (ends + rounding) * cut + rounding <= most:
            result, rounding = chain.corrected(g, result), 0.0
            ends = max(length(result[0]), length(result[-1]))
        bound = (ends + rounding) * cut + rounding
        if bound <= most:
            # and the way to the outputs: amplitude, phase, sum over the modes
            return Steady(result, below, bound + (len(g) + 12) * EPSILON * sum(sizes), [])
        above, below = above + 1 + above // 4, below + 1 + below // 4


class _Chain:
    """The blocks from -below to +above, eliminated in doubles from both ends to the middle.

    Sidebands stand in lists in rising order: X_0 at the place ``below``.
    """

    def __init__(self, frame: Frame, u: float, below: int, above: int) -> None:
        self.frame, self.below, self.above = frame, below, above
        step, tone = Decimal(frame.pump_hz), Decimal(u)
        self._at = [tone + k * step for k in range(-below, above + 1)]
        self._blocks = [frame.rounded(v) for v in self._at]
        self._half_pump = [[0.5 * x for x in row] for row in frame.matrices.pump_values]
        self.inverses: dict[int, Complex] = {}
        self.ratios: dict[int, Complex] = {}
        try:
            for sign, most in ((1, above), (-1, below)):
                for k in range(most, 0, -1):
                    self._eliminate(sign * k, sign * (k + 1))
            self.inverses[0] = inverse(self._schur(0, (1, -1)))
        except ZeroDivisionError as error:
            raise self._refusal() from error

    def _refusal(self) -> ModelError:
        return ModelError(
            f"the sidebands of the pump at pump_hz = {self.frame.pump_hz!r} Hz cannot be solved "
            "for: the modes are too close to undamped, or to instability"
        )

    def _eliminate(self, k: int, outer: int) -> None:
        """Store S_k^-1 and R_k of X_k = R_k X_(k-1)."""
        self.inverses[k] = inverse(self._schur(k, (outer,)))
        self.ratios[k] = [[-x for x in row] for row in product(self.inverses[k], self._half_pump)]

    def _schur(self, k: int, outer: Sequence[int]) -> Complex:
        """Return A(v_k) + C_p/2 R_j summed over the neighbours j further out."""
        rows = self._blocks[self.below + k]
        for j in outer:
            if j in self.ratios:
                added = product(self._half_pump, self.ratios[j])
                rows = [[x + y for x, y in zip(a, b)] for a, b in zip(rows, added)]
        return rows

    # -- solutions ------------------------------------------------------------------------------

    def solved(self, g: Sequence[float]) -> list[Rounded]:
        """Return X_k for a drive g of X_0, in doubles."""
        result = {0: applied(self.inverses[0], g)}
        for sign, most in ((1, self.above), (-1, self.below)):
            for k in range(1, most + 1):
                result[sign * k] = applied(self.ratios[sign * k], result[sign * (k - 1)])
        return [result[k] for k in range(-self.below, self.above + 1)]

    def corrected(self, g: Sequence[float], result: Sequence[Rounded]) -> list[Rounded]:
        """Return X_k, corrected by residuals of 50 digits until doubles can hold no more."""
        blocks = [self.frame.block(v) for v in self._at]
        exact = [[_precise(x) for x in row] for row in result]
        before = max(abs(x) for row in result for x in row)
        while True:
            change = self._solved_for(self._residual(blocks, g, exact))
            exact = [[x + _precise(y) for x, y in zip(*rows)] for rows in zip(exact, change)]
            size = max(abs(y) for row in change for y in row)
            rounded = [[complex(x) for x in row] for row in exact]
            largest = max(abs(x) for row in rounded for x in row)
            # each change is as much smaller than the one before as this one was
            if size * size <= 1e-19 * largest * before:
                return rounded
            if not size < 0.1 * before:
                raise self._refusal()
            before = size

    def _residual(
        self, blocks: Sequence[list[Vector]], g: Sequence[float], result: Sequence[Vector]
    ) -> list[Rounded]:
        """Return what the equations leave, in the current decimal arithmetic, rounded."""
        half = Decimal("0.5")
        weights = [[half * x for x in row] for row in self.frame.matrices.pump]
        left = []
        for place, block in enumerate(blocks):
            sides = [result[j] for j in (place - 1, place + 1) if 0 <= j < len(result)]
            rests = []
            for i, (row, weighted) in enumerate(zip(block, weights)):
                rest = Precise(g[i] if place == self.below else 0.0)
                for j, (x, weight) in enumerate(zip(row, weighted)):
                    rest = rest - x * result[place][j]
                    if weight:
                        for y in (side[j] for side in sides):
                            rest = Precise(rest.re - weight * y.re, rest.im - weight * y.im)
                rests.append(complex(rest))
            left.append(rests)
        return left

    def _solved_for(self, rest: list[Rounded]) -> list[Rounded]:
        """Return the solution for any right side, by the elimination that is in store."""
        gathered = {k: rest[self.below + k] for k in range(-self.below, self.above + 1)}
        for sign, most in ((1, self.above), (-1, self.below)):
            for k in range(most, 0, -1):
                # (C_p/2 S^-1)^T = S^-1 C_p/2, both are symmetric
                inward = applied(list(zip(*self.ratios[sign * k])), gathered[sign * k])
                inner = gathered[sign * (k - 1)]
                gathered[sign * (k - 1)] = [x + y for x, y in zip(inner, inward)]
        result = {0: applied(self.inverses[0], gathered[0])}
        for sign, most in ((1, self.above), (-1, self.below)):
            for k in range(1, most + 1):
                own = applied(self.inverses[sign * k], gathered[sign * k])
                led = applied(self.ratios[sign * k], result[sign * (k - 1)])
                result[sign * k] = [x + y for x, y in zip(own, led)]
        return [result[k] for k in range(-self.below, self.above + 1)]

    # -- errors ---------------------------------------------------------------------------------

    def errors(
        self,
        g: Sequence[float],
        result: Sequence[Rounded],
        sizes: Sequence[float],
        tails: tuple[Tail, Tail],
    ) -> tuple[float, float]:
        """Return what the cut costs at most, over |X| at the ends, and what rounding does.

        Both over all sidebands; inf where no bound holds. ``sizes``: the norms of ``found``;
        ``tails``: what is beyond the chain, above and below it.
        """
        high, low = self._spread(1, self.above), self._spread(-1, self.below)
        columns = [*reversed(low.columns(high)), *high.columns(low)[1:]]
        # of norms that are known to some digits alone
        rounding = 1.01 * sum(
            column * rest for column, rest in zip(columns, self._rests(g, result, sizes))
        )
        quarter = 0.25 * self.frame.matrices.pump_norm**2
        cut = quarter * tails[0].schur, quarter * tails[1].schur
        across = high.reach[-1] * high.own[0] * low.reach[-1]
        feedback = max(
            high.own[-1] * cut[0] + across * cut[1], across * cut[0] + low.own[-1] * cut[1]
        )
        if not feedback < 0.5:
            return math.inf, rounding
        changed = cut[0] * columns[-1] + cut[1] * columns[0]
        return (changed + (tails[0].rest + tails[1].rest)) / (1.0 - feedback), rounding

    def _spread(self, sign: int, most: int) -> _Spread:
        """Return norms of blocks of the chain's inverse on one side, the middle included."""
        ratios = [0.0, *(frobenius(self.ratios[sign * k]) for k in range(1, most + 1))]
        reach, own = [1.0], [frobenius(self.inverses[0])]
        for k in range(1, most + 1):
            reach.append(reach[-1] * ratios[k])
            own.append(frobenius(self.inverses[sign * k]) + ratios[k] * ratios[k] * own[-1])
        return _Spread(ratios, reach, own)

    def _rests(
        self, g: Sequence[float], result: Sequence[Rounded], sizes: Sequence[float]
    ) -> list[float]:
        """Return bounds of the 2-norms of what the equations of each block leave.

        Of sums of 3 n + 1 products of doubles, and of entries of A that are rounded.
        """
        least = 8.0 * (len(g) + 2) * EPSILON
        half = 0.5 * self.frame.matrices.pump_norm
        none: Rounded = [0j] * len(g)
        around, weights = [none, *result, none], [0.0, *sizes, 0.0]
        rests = []
        for place, (block, own) in enumerate(zip(self._blocks, result)):
            sides = [x + y for x, y in zip(around[place], around[place + 2])]
            driven: Sequence[complex] = g if place == self.below else none
            pushed, tied = applied(block, own), applied(self._half_pump, sides)
            left = [x - y - z for x, y, z in zip(driven, pushed, tied)]
            size = frobenius(block) * sizes[place] + half * (weights[place] + weights[place + 2])
            rests.append(length(left) + least * (size + length(driven)))
        return rests


class _Spread(NamedTuple):
    """Bounds of one side: |R_k|, |X_k|/|X_0|, and |block (k, k)| of the chain's inverse."""

    ratios: list[float]
    reach: list[float]
    own: list[float]

    def columns(self, other: _Spread) -> list[float]:
        """Return the sums over all i of |block (i, k)| of the inverse, k = 0 and up.

        Outwards the blocks of a column fall by |R_i|, inwards they are those of a row, as the
        inverse is symmetric; on the other side they are |X_i|/|X_0| times that in the middle.
        """
        outwards = [1.0]
        for ratio in reversed(self.ratios[1:]):
            outwards.append(1.0 + ratio * outwards[-1])
        outwards.reverse()
        inner = self.own[0] * sum(other.reach[1:])
        columns = [self.own[0] * outwards[0] + inner]
        for ratio, own, before, out in zip(self.ratios[1:], self.own[1:], self.own, outwards[1:]):
            inner = ratio * (inner + before)
            columns.append(own * out + inner)
        return columns


def _precise(z: complex) -> Precise:
    return Precise(z.real, z.imag)
