"""Two hybridised modes with cubic terms: the closed forms of the Duffing oscillator.

    q~1'' + D~11 q~1' + D~12 q~2' + (2 pi eta_plus)^2 q~1
          + alpha1 q~1^3 + kappa q~1 q~2^2 = g1 b~(t)
    q~2'' + D~12 q~1' + D~22 q~2' + (2 pi eta_minus)^2 q~2
          + alpha2 q~2^3 + kappa q~1^2 q~2 = g2 b~(t)

The linear part is that of :mod:`oscillator_equations`; the cubic forces are those of the potential
alpha1 q~1^4/4 + alpha2 q~2^4/4 + kappa q~1^2 q~2^2/2 (A. H. Nayfeh, D. T. Mook, Nonlinear
Oscillations, Wiley 1979, chapters 4 and 6).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from .model_error import ModelError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


class Cubic(NamedTuple):
    """The cubic coefficients, in 1/(m^2 s^2)."""

    alpha1: float
    alpha2: float
    kappa: float


def check_cubic(cubic: Cubic) -> None:
    """Raise ModelError, naming the parameter, where a coefficient is not a finite number."""
    for name, value in zip(cubic._fields, cubic):
        if not math.isfinite(value):
            raise ModelError(f"{name} = {value!r} is not a finite number")


def shift(cubic: Cubic, squares: tuple[float, float], centre: float) -> float:
    """Return the relative frequency shift by the cubic terms, the larger one of both modes.

    (3/8) (|alpha1| |a1|^2 + |kappa| |a2|^2)/(2 pi centre)^2 for mode 1, and likewise for mode 2,
    from the squared amplitudes in m^2; the averaging of the envelope is an expansion in it.
    """
    alpha1, alpha2, kappa = cubic
    if not (alpha1 or alpha2 or kappa):
        return 0.0
    m1, m2 = squares
    across = abs(kappa)
    force = max(abs(alpha1) * m1 + across * m2, abs(alpha2) * m2 + across * m1)
    return 0.375 * force / (2.0 * math.pi * centre) ** 2


def steady_squares(
    detuning: float, damping: float, alpha: float, drive: float
) -> tuple[float, float]:
    """Return the smallest and the largest |a|^2 of one driven Duffing mode in its steady state.

    (omega_0^2 - omega^2 + 3/4 alpha |a|^2)^2 |a|^2 + (omega D)^2 |a|^2 = drive^2, the first-order
    averaging (harmonic balance) of x'' + D x' + omega_0^2 x + alpha x^3 = drive cos(omega t);
    ``detuning`` = omega_0^2 - omega^2 in 1/s^2, ``damping`` = omega D > 0 in 1/s^2, alpha in
    1/(m^2 s^2), drive in m/s^2. Both are the same where there is one orbit only.
    """
    if drive == 0.0:
        return 0.0, 0.0
    linear = drive / math.hypot(detuning, damping)
    if alpha == 0.0:
        return linear * linear, linear * linear
    # x = 3/4 |alpha| |a|^2/damping: x ((s + x)^2 + 1) = power, rising but between two turns
    s = math.copysign(1.0, alpha) * detuning / damping
    power = 0.75 * abs(alpha) / damping * (drive / damping) ** 2

    def excess(x: float) -> float:
        return x * ((s + x) ** 2 + 1.0) - power

    turns: list[float] = []
    if s < -math.sqrt(3.0):
        outer = (-2.0 * s + math.sqrt(s * s - 3.0)) / 3.0
        turns = [(s * s + 1.0) / (3.0 * outer), outer]  # the product of the turns is known
    limit = power + 2.0 * abs(s) + 1.0  # excess is positive there
    if not turns or excess(turns[0]) < 0.0:  # beyond the first turn
        low = high = _bisect(excess, turns[1] if turns else 0.0, limit)
    else:
        low = _bisect(excess, 0.0, turns[0])
        high = low if excess(turns[1]) > 0.0 else _bisect(excess, turns[1], limit)
    unit = damping / (0.75 * abs(alpha))
    return low * unit, high * unit


def _bisect(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the root of a rising function between two numbers, to the last digits."""
    for _ in range(200):
        middle = 0.5 * (low + high)
        if not low < middle < high:
            break
        if function(middle) < 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def solve(matrix: Sequence[Sequence[float]], right: Sequence[float]) -> tuple[list[float], float]:
    """Return the solution x of ``matrix`` x = ``right`` and the sign of the determinant.

    Gaussian elimination with row pivoting; raises ModelError for a singular matrix.
    """
    rows = [[*row, value] for row, value in zip(matrix, right)]
    size, sign = len(rows), 1.0
    for i in range(size):
        pivot = max(range(i, size), key=lambda k: abs(rows[k][i]))
        if not abs(rows[pivot][i]) > 0.0:
            raise ModelError("the equations of the periodic orbit are singular")
        if pivot != i:
            rows[i], rows[pivot], sign = rows[pivot], rows[i], -sign
        sign = math.copysign(sign, sign * rows[i][i])
        for k in range(i + 1, size):
            factor = rows[k][i] / rows[i][i]
            for j in range(i, size + 1):
                rows[k][j] -= factor * rows[i][j]
    x = [0.0] * size
    for i in reversed(range(size)):
        known = 0.0
        for j in range(i + 1, size):  # sum() of Python 3.12 rounds another way than the native twin
            known += rows[i][j] * x[j]
        x[i] = (rows[i][size] - known) / rows[i][i]
    return x, sign


#: A root is found where Newton's step is this small beside the unknowns, ...
SETTLED = 1e-12
#: ... or where it is below this and no longer a tenth of the one before: that is rounding.
ROUNDED = 1e-8


def find_root(
    function: Callable[[list[float]], list[float]], start: Sequence[float], scales: Sequence[float]
) -> list[float] | None:
    """Return a zero of ``function`` near ``start`` by Newton's method, None if it does not settle.

    Unknowns are of the size ``scales``; the Jacobian is by central differences. A zero with a
    negative determinant of the Jacobian counts as none: with an even number of unknowns, a
    stable orbit (all eigenvalues of one sign or in conjugate pairs) has a positive one, and the
    saddle between two stable orbits a negative one. At a high quality factor rounding keeps the
    steps from shrinking to nothing: small ones that shrink no more are the end as well.
    """
    x, size, before = list(start), len(start), math.inf
    for _ in range(30):
        here = function(x)
        columns = []
        for i in range(size):
            step = 1e-5 * scales[i]
            ahead, behind = list(x), list(x)
            ahead[i] += step
            behind[i] -= step
            width = ahead[i] - behind[i]
            pairs = zip(function(ahead), function(behind))
            columns.append([(a - b) / width for a, b in pairs])
        change, sign = solve([[c[i] for c in columns] for i in range(size)], here)
        x = [a - b for a, b in zip(x, change)]
        size_of_change = max(abs(b) / s for b, s in zip(change, scales))
        if not size_of_change < 1e3:
            return None
        if size_of_change < SETTLED or 0.1 * before < size_of_change < ROUNDED:
            return x if sign > 0.0 else None
        before = size_of_change
    return None
