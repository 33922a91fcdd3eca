"""Complex numbers of 50 digits, and divided differences of rational functions with them.

The transient of a resonator of high quality factor is a phase of up to Q cycles, so its eigenvalue
must be known to better than a double holds; and the coefficients in front of nearly equal
eigenvalues are differences of almost equal numbers. Both are computed once per set of parameters
with :mod:`decimal`; what is needed at every step is then rounded to doubles.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from decimal import Context, Decimal, localcontext
from typing import TYPE_CHECKING

#: Digits of the arithmetic. At an exceptional point half of them are lost by the square root.
DIGITS = 50

_ZERO = Decimal(0)

if TYPE_CHECKING:  # subscripted here, it would need a host with Python 3.9 or later
    #: A polynomial: coefficients from the constant term up.
    Polynomial = Sequence["Precise"]


def precise_context() -> Context:
    """Return the arithmetic of this module: 50 digits and exponents without practical bounds."""
    return Context(prec=DIGITS, Emax=999_999, Emin=-999_999)


class Precise:
    """A complex number of two Decimals; the current decimal context sets the digits."""

    __slots__ = ("im", "re")

    def __init__(self, re: Decimal | float, im: Decimal | float = _ZERO) -> None:
        self.re = re if type(re) is Decimal else Decimal(re)
        self.im = im if type(im) is Decimal else Decimal(im)

    def __add__(self, other: Precise) -> Precise:
        return Precise(self.re + other.re, self.im + other.im)

    def __sub__(self, other: Precise) -> Precise:
        return Precise(self.re - other.re, self.im - other.im)

    def __mul__(self, other: Precise) -> Precise:
        a, b, c, d = self.re, self.im, other.re, other.im
        return Precise(a * c - b * d, a * d + b * c)

    def __truediv__(self, other: Precise) -> Precise:
        a, b, c, d = self.re, self.im, other.re, other.im
        scale = c * c + d * d
        return Precise((a * c + b * d) / scale, (b * c - a * d) / scale)

    def __neg__(self) -> Precise:
        return Precise(-self.re, -self.im)

    def __complex__(self) -> complex:
        return complex(float(self.re), float(self.im))

    def conjugate(self) -> Precise:
        """Return the complex conjugate."""
        return Precise(self.re, -self.im)

    def is_zero(self) -> bool:
        """Return whether both parts are exactly zero."""
        return not self.re and not self.im

    def size(self) -> Decimal:
        """Return |re| + |im|, a norm without a square root."""
        return abs(self.re) + abs(self.im)

    def sqrt(self) -> Precise:
        """Return the principal square root, without cancellation for either sign of ``re``."""
        if self.is_zero():
            return Precise(_ZERO)
        modulus = (self.re * self.re + self.im * self.im).sqrt()
        half = ((modulus + abs(self.re)) / 2).sqrt()
        other = self.im / (2 * half)
        if self.re >= 0:
            return Precise(half, other)
        return Precise(abs(other), half if self.im >= 0 else -half)

    def split(self) -> tuple[float, float, float]:
        """Return (re, im_high, im_low): ``im`` as the unevaluated sum of two doubles."""
        high = float(self.im)
        return float(self.re), high, float(self.im - Decimal(high))


def multiply(a: Polynomial, b: Polynomial) -> list[Precise]:
    """Return the product of two polynomials."""
    product = [Precise(_ZERO) for _ in range(len(a) + len(b) - 1)]
    for i, left in enumerate(a):
        if not left.is_zero():
            for j, right in enumerate(b):
                product[i + j] = product[i + j] + left * right
    return product


def add(a: Polynomial, b: Polynomial) -> list[Precise]:
    """Return the sum of two polynomials."""
    if len(a) < len(b):
        a, b = b, a
    return [*(x + y for x, y in zip(a, b)), *a[len(b) :]]


def polynomial_differences(p: Polynomial, nodes: Sequence[Precise]) -> list[list[Precise]]:
    """Return the table t[i][j] = p[n_i, ..., n_j] of divided differences of a polynomial.

    By repeated synthetic division, so that coinciding nodes need no limit and no division is made:
    p(x) = p(n) + (x - n) q(x), and p[n, m] = q(m).
    """
    size = len(nodes)
    table = [[Precise(_ZERO)] * size for _ in range(size)]
    for i in range(size):
        quotient = list(p)
        for j in range(i, size):
            value = Precise(_ZERO)
            reduced: list[Precise] = []
            for coefficient in reversed(quotient):
                reduced.append(value)
                value = value * nodes[j] + coefficient
            table[i][j] = value
            quotient = list(reversed(reduced[1:])) or [Precise(_ZERO)]
    return table


def rational_differences(
    numerator: Polynomial, denominator: list[list[Precise]], nodes: Sequence[Precise]
) -> list[Precise]:
    """Return f[n_0], f[n_0, n_1], ... of f = numerator/denominator by Leibniz' rule.

    ``denominator`` is its table from :func:`polynomial_differences`; from f d = p follows
    f[0..j] d[j] = p[0..j] - sum_{k<j} f[0..k] d[k..j]. The nodes may coincide; none may be a
    root of the denominator (ZeroDivisionError of decimal, then).
    """
    top = polynomial_differences(numerator, nodes)
    result: list[Precise] = []
    for j in range(len(nodes)):
        rest = top[0][j]
        for k in range(j):
            rest = rest - result[k] * denominator[k][j]
        result.append(rest / denominator[j][j])
    return result


def upper_factor(quartic: Polynomial, guess: tuple[Precise, Precise]) -> tuple[Precise, Precise]:
    """Return (e1, e2) of the factor x^2 - e1 x + e2 that holds the two roots above the real axis.

    A real quartic p with no real root is U times the conjugate of U. Bairstow's Newton iteration
    with a complex factor converges quadratically to U even where the two roots of U coincide,
    because U and its conjugate have no root in common. Raises ArithmeticError where it does not
    settle, as with real roots (an overdamped mode).
    """
    e1, e2 = guess
    tolerance = Decimal(10) ** (4 - DIGITS)
    for _ in range(60):
        # p = (x^2 - e1 x + e2) (x^2 + a x + b) + r1 x + r0
        a = quartic[3] + e1
        b = quartic[2] - e2 + e1 * a
        r1 = quartic[1] - e2 * a + e1 * b
        r0 = quartic[0] - e2 * b
        # the cofactor modulo U is the line m1 x + m0; dU = -de1 x + de2 solves (m1 x + m0) dU = r
        m1 = a + e1
        m0 = b - e2
        # (m1 x + m0)(y1 x + y0) mod U = (m1 y0 + m0 y1 + m1 y1 e1) x + (m0 y0 - m1 y1 e2)
        c = m0 + m1 * e1
        determinant = c * m0 + m1 * m1 * e2
        y1 = (r1 * m0 - r0 * m1) / determinant
        y0 = (c * r0 + m1 * e2 * r1) / determinant
        e1, e2 = e1 - y1, e2 + y0
        if y1.size() <= tolerance * e1.size() and y0.size() <= tolerance * e2.size():
            return e1, e2
    raise ArithmeticError("the factor of the characteristic polynomial was not found")


def in_precise_arithmetic() -> AbstractContextManager[Context]:
    """Return the context manager under which every function of this module is to be called."""
    return localcontext(precise_context())
