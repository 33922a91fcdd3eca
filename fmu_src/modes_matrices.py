"""Small dense matrices as lists of rows: what N modes need of linear algebra."""

from __future__ import annotations

import math
from operator import mul
from typing import TYPE_CHECKING

from .oscillator_precise import Precise

if TYPE_CHECKING:  # subscripted here, these would need a host with Python 3.9 or later
    from collections.abc import Sequence

    Real = Sequence[Sequence[float]]
    Complex = list[list[complex]]


def inverse(matrix: Sequence[Sequence[complex]]) -> Complex:
    """Return the inverse by Gauss and Jordan with row pivots; ZeroDivisionError where singular."""
    n = len(matrix)
    rows = [[*row, *(1.0 + 0j if i == j else 0j for j in range(n))] for i, row in enumerate(matrix)]
    for i in range(n):
        best = max(range(i, n), key=lambda k: abs(rows[k][i]))
        rows[i], rows[best] = rows[best], rows[i]
        pivot = rows[i][i]
        top = rows[i] = [x / pivot for x in rows[i]]
        for k in range(n):
            factor = rows[k][i]
            if k != i and factor:
                rows[k] = [x - factor * y for x, y in zip(rows[k], top)]
    return [row[n:] for row in rows]


def solve_precise(matrix: list[list[Precise]], right: Sequence[Precise]) -> list[Precise]:
    """Return the solution by elimination with row pivots; ZeroDivisionError where singular."""
    n = len(matrix)
    rows = [[*row, r] for row, r in zip(matrix, right)]
    for i in range(n):
        best = max(range(i, n), key=lambda k: rows[k][i].size())
        rows[i], rows[best] = rows[best], rows[i]
        if rows[i][i].is_zero():
            raise ZeroDivisionError("singular")
        for k in range(i + 1, n):
            if not rows[k][i].is_zero():
                factor = rows[k][i] / rows[i][i]
                for j in range(i + 1, n + 1):
                    rows[k][j] = rows[k][j] - factor * rows[i][j]
    result: list[Precise] = []
    for i in reversed(range(n)):
        rest = rows[i][n]
        for j, x in zip(range(n - 1, i, -1), result):
            rest = rest - rows[i][j] * x
        result.append(rest / rows[i][i])
    return result[::-1]


def product(a: Sequence[Sequence[complex]], b: Sequence[Sequence[complex]]) -> Complex:
    """Return the product of two matrices."""
    columns = list(zip(*b))
    return [[sum(map(mul, row, column)) for column in columns] for row in a]


def applied(a: Sequence[Sequence[complex]], x: Sequence[complex]) -> list[complex]:
    """Return the product of a matrix and a vector."""
    return [sum(map(mul, row, x)) for row in a]


def frobenius(a: Sequence[Sequence[complex]]) -> float:
    """Return the Frobenius norm, which bounds the 2-norm."""
    return math.hypot(*[abs(x) for row in a for x in row])


def length(x: Sequence[complex]) -> float:
    """Return the 2-norm of a vector."""
    return math.hypot(*map(abs, x))


def eigensystem(matrix: Real) -> tuple[list[float], list[list[float]]]:
    """Return the eigenvalues, rising, of a symmetric matrix and its vectors as columns.

    By Jacobi's rotations (G. H. Golub, C. F. Van Loan, Matrix Computations, section 8.5), which
    keep small eigenvalues of a scaled matrix accurate. A vector's largest part is positive.
    """
    n = len(matrix)
    a = [list(row) for row in matrix]
    v = [[1.0 if i == j else 0.0 for j in range(n)] for i in range(n)]
    for _ in range(60):
        off = [(i, j) for i in range(n) for j in range(i + 1, n) if _counts(a, i, j)]
        if not off:
            break
        for i, j in off:
            if a[i][j]:
                _rotate(a, v, i, j)
    order = sorted(range(n), key=lambda i: a[i][i])
    columns = []
    for i in order:
        column = [v[k][i] for k in range(n)]
        sign = math.copysign(1.0, max(column, key=abs))
        columns.append([sign * x for x in column])
    return [a[i][i] for i in order], [list(row) for row in zip(*columns)]


def _counts(a: list[list[float]], i: int, j: int) -> bool:
    """Return whether an entry off the diagonal is more than rounding."""
    return abs(a[i][j]) > 1e-17 * math.sqrt(abs(a[i][i])) * math.sqrt(abs(a[j][j]))


def _rotate(a: list[list[float]], v: list[list[float]], i: int, j: int) -> None:
    """Turn the entry (i, j) to zero."""
    slope = (a[j][j] - a[i][i]) / (2.0 * a[i][j])
    t = math.copysign(1.0, slope) / (abs(slope) + math.hypot(1.0, slope))
    c = 1.0 / math.hypot(1.0, t)
    s = t * c
    rotated = t * a[i][j]
    a[i][i] -= rotated
    a[j][j] += rotated
    a[i][j] = a[j][i] = 0.0
    for k in range(len(a)):
        if k not in (i, j):
            x, y = a[k][i], a[k][j]
            a[k][i] = a[i][k] = c * x - s * y
            a[k][j] = a[j][k] = s * x + c * y
        x, y = v[k][i], v[k][j]
        v[k][i], v[k][j] = c * x - s * y, s * x + c * y
