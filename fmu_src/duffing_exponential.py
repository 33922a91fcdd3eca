"""An exponential Runge-Kutta step of order four with an error estimate and values in between.

    y_j' = L_j y_j + n_j(y, t)

The linear part L, however fast it turns, is propagated exactly, so the step follows the slow forces
n alone. Stages and weights: S. Krogstad, J. Comput. Phys. 203, 72 (2005), scheme ETDRK4-B.
Values in between integrate the parabola through n at beginning, middle and end, which is what the
weights do at the end. The error is estimated by what the parabola misses, n being evaluated once
more where a cubic would be furthest from it. An embedded pair would compare stages half a step and
a step apart, and take a mode that turns as fast as the steps follow each other for one at rest.
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable

    Pair = tuple[complex, complex]
    #: n and Q from y and the linear response.
    Slope = Callable[[Pair, Pair], tuple[complex, complex, complex, complex]]
    #: The same of one component that no other one moves.
    LoneSlope = Callable[[complex, complex], tuple[complex, complex]]

#: Terms of a series of about 1/6 below which no digit changes.
NEGLIGIBLE = 1e-19
#: What a term of it is divided by for the next; whole numbers would take longer to divide by.
ORDERS = tuple(float(k) for k in range(4, 26))
#: Step sizes are powers of 2^(1/4): few different ones, whose coefficients are worth keeping.
NOTCHES = 2.0**-0.25, 2.0**-0.5, 2.0**-0.75, 0.5


def notched(h: float) -> float:
    """Return the largest power of 2^(1/4) up to ``h``, the same bits wherever it is made."""
    if not 0.0 < h < math.inf:
        return h
    mantissa, exponent = math.frexp(h)
    notch = 0
    while NOTCHES[notch] > mantissa:
        notch += 1
    return math.ldexp(NOTCHES[notch], exponent)


def phi(z: complex) -> tuple[complex, complex, complex, complex]:
    """Return exp(z) and phi_1..3, with phi_k(z) = (phi_{k-1}(z) - 1/(k-1)!)/z, phi_0 = exp."""
    if abs(z) > 1.5:
        e = cmath.exp(z)
        p1 = (e - 1.0) / z
        p2 = (p1 - 1.0) / z
        return e, p1, p2, (p2 - 0.5) / z
    p3, term = 0j, complex(1.0 / 6.0)
    for k in ORDERS:
        p3 += term
        if abs(term) < NEGLIGIBLE:
            break
        term *= z / k
    p2 = 0.5 + z * p3
    p1 = 1.0 + z * p2
    return 1.0 + z * p1, p1, p2, p3


class Spread(NamedTuple):
    """y at a part of a step: coefficients of y and of n at beginning, middle (twice) and end."""

    turn: complex
    begin: complex
    middle: complex
    end: complex

    def value(self, y: complex, slopes: tuple[complex, complex, complex]) -> complex:
        """Return y there."""
        n1, n23, n4 = slopes
        turn, begin, middle, end = self
        return turn * y + begin * n1 + middle * n23 + end * n4


def spread(rate: complex, h: float, theta: float) -> Spread:
    """Return the coefficients at the part ``theta`` of a step of ``h`` s, for L = ``rate``."""
    span = theta * h
    e, p1, p2, p3 = phi(rate * span)
    first, second, third = span * p1, span * theta * p2, 4.0 * span * theta * theta * p3
    return Spread(e, first - 3.0 * second + third, 2.0 * second - third, third - second)


class Weights(NamedTuple):
    """The coefficients of one component for one step size."""

    half: complex
    half_first: complex
    half_second: complex
    full_first: complex
    full_second: complex
    full: Spread
    probe: Spread
    missed: float


#: Where a cubic is furthest from its parabola through 0, 1/2 and 1, and the parabola there.
PROBE = 0.5 - 0.5 / math.sqrt(3.0)
PARABOLA = (2.0 * PROBE - 1.0) * (PROBE - 1.0), 2.0 * PROBE * (1.0 - PROBE), PROBE * (2 * PROBE - 1)
#: What y loses by what n differs there: the integral of the cubic over the first half of a step.
MISSED = (1.0 / 64.0) / (PROBE * (PROBE - 0.5) * (PROBE - 1.0))


def weights(rate: complex, h: float) -> Weights:
    """Return the coefficients for L = ``rate`` in 1/s and a step of ``h`` s."""
    e2, a1, a2, _ = phi(0.5 * h * rate)
    _, p1, p2, _ = phi(h * rate)
    return Weights(
        e2,
        0.5 * h * a1,
        h * a2,
        h * p1,
        2.0 * h * p2,
        spread(rate, h, 1.0),
        spread(rate, h, PROBE),
        h * MISSED,
    )


#: The slopes of a component without an n.
AT_EASE = 0j, 0j, 0j


class Step(NamedTuple):
    """A step from ``y`` at ``t`` s: where it ends, what it met, and how far off it may be.

    ``slopes`` are n at the beginning, (twice, added) in the middle and at the end, per component;
    ``largest`` the largest |Q| met and ``error`` the estimate, both per component.
    """

    t: float
    h: float
    y: Pair
    slopes: tuple[tuple[complex, complex, complex], tuple[complex, complex, complex]]
    y_end: Pair
    n_end: Pair
    largest: tuple[float, float]
    error: tuple[float, float]

    @property
    def end(self) -> float:
        """The time that the step reaches."""
        return self.t + self.h

    def between(self, rates: Pair, t: float) -> Pair:
        """Return y at a time within the step."""
        if t == self.end:
            return self.y_end
        theta = (t - self.t) / self.h
        result = [
            spread(rate, self.h, theta).value(y, slopes) if y or any(slopes) else 0j
            for rate, y, slopes in zip(rates, self.y, self.slopes)
        ]
        return result[0], result[1]


def take_step(
    begin: tuple[float, Pair, Pair],
    h: float,
    pair: tuple[Weights, Weights],
    slope: Slope,
    forced: tuple[Pair, Pair, Pair],
) -> Step:
    """Return the step of ``h`` s from ``begin`` = (t, y, n there).

    ``forced`` is what ``slope`` takes as its last argument at the probe, middle and end.
    """
    t, (y1, y2), (a1, a2) = begin
    w, v = pair
    probed, middle, there = forced
    half1, half2 = w.half * y1 + w.half_first * a1, v.half * y2 + v.half_first * a2
    b1, b2, qb1, qb2 = slope((half1, half2), middle)
    c1, c2, qc1, qc2 = slope(
        (half1 + w.half_second * (b1 - a1), half2 + v.half_second * (b2 - a2)), middle
    )
    d1, d2, _, _ = slope(
        (
            w.full.turn * y1 + w.full_first * a1 + w.full_second * (c1 - a1),
            v.full.turn * y2 + v.full_first * a2 + v.full_second * (c2 - a2),
        ),
        there,
    )
    slopes = (a1, b1 + c1, d1), (a2, b2 + c2, d2)
    end = w.full.value(y1, slopes[0]), v.full.value(y2, slopes[1])
    n1, n2, q1, q2 = slope(end, there)
    p1, p2, _, _ = slope((w.probe.value(y1, slopes[0]), v.probe.value(y2, slopes[1])), probed)
    missed = [
        weight.missed * abs(p - sum(k * n for k, n in zip(PARABOLA, result)))
        for weight, p, result in zip(pair, (p1, p2), slopes)
    ]
    return Step(
        t,
        h,
        (y1, y2),
        slopes,
        end,
        (n1, n2),
        (max(abs(q1), abs(qb1), abs(qc1)), max(abs(q2), abs(qb2), abs(qc2))),
        (missed[0], missed[1]),
    )


def take_lone_step(
    begin: tuple[float, Pair, Pair],
    h: float,
    pair: tuple[Weights, Weights],
    slope: LoneSlope,
    forced: tuple[complex, complex, complex],
    lone: int,
) -> Step:
    """Return the step that :func:`take_step` would where only the component ``lone`` has an n.

    ``slope`` and ``forced`` are of this component alone.
    """
    t, both, before = begin
    y, a = both[lone], before[lone]
    half, half_first, half_second, full_first, full_second, full, probe, missed = pair[lone]
    probed, middle, there = forced
    first = half * y + half_first * a
    b, qb = slope(first, middle)
    c, qc = slope(first + half_second * (b - a), middle)
    d, _ = slope(full.turn * y + full_first * a + full_second * (c - a), there)
    slopes = a, b + c, d
    end = full.value(y, slopes)
    n, q = slope(end, there)
    result, _ = slope(probe.value(y, slopes), probed)
    parabola = PARABOLA[0] * a + PARABOLA[1] * slopes[1] + PARABOLA[2] * d
    largest, error = max(abs(q), abs(qb), abs(qc)), missed * abs(result - parabola)
    other = pair[1 - lone].full.turn * both[1 - lone]
    if lone:
        return Step(
            t, h, both, (AT_EASE, slopes), (other, end), (0j, n), (0.0, largest), (0.0, error)
        )
    return Step(t, h, both, (slopes, AT_EASE), (end, other), (n, 0j), (largest, 0.0), (error, 0.0))
