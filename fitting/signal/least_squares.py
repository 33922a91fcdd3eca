"""Smooth least squares: scipy's solver, and the damped Gauss-Newton step for searches of our own.

The one small door to ``scipy.optimize`` next to the continuation. A search that has to run in step
with others, or whose merit is no plain sum of squares, goes its own way by `damped_step`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares, lsq_linear

from fitting.text.arrays import FloatArray

#: Unknowns from which a damped step goes by a triangular factor: singular values take ten times
#: as long. Rounding of squared rows, as a share of the damping, up to which that is Cholesky's.
MANY, ROUNDED = 100, 1e-3


def minimise_squares(
    residuals: Callable[[FloatArray], FloatArray], start: FloatArray, *, rounds: int, gain: float
) -> tuple[FloatArray, float]:
    """Minimise ``sum(residuals(x)**2)`` without bounds; x (n,) there, and the sum of squares.

    Args:
        residuals: of x (n,), shape (m,).
        start: shape (n,), of order one in every coordinate.
        rounds: evaluations at most, slopes not counted.
        gain: relative fall of the sum of squares below which a step is the last one.

    Raises:
        ValueError: residuals that are no numbers.

    Source: scipy.optimize.least_squares (Branch, Coleman and Li 1999).
    """
    fit = least_squares(
        residuals, start, jac="3-point", ftol=gain, xtol=1e-15, gtol=1e-15, max_nfev=rounds
    )
    return np.asarray(fit.x, dtype=float), 2.0 * float(fit.cost)


def damped_step(
    matrix: FloatArray,
    rows: FloatArray,
    damping: float,
    room: tuple[FloatArray, FloatArray] | None = None,
    least: float = 0.0,
) -> FloatArray:
    """The step d (n,) that minimises ``|rows + matrix d|^2 + damping |d|^2``.

    Gauss and Newton's step, held back by Levenberg's damping; by the singular values, so that
    directions that the rows hardly see are not lost in the rounding of the others. Priors are rows
    like any. The caller scales: the damping means the same in every variable.

    Args:
        matrix: d rows/dx in the units of the step, shape (m, n).
        rows: shape (m,).
        damping: weight of the step's length, at least zero, in units of squared rows.
        room: least and greatest step in every variable, shape (n,) each.
        least: singular values below it, or at the rounding of the largest, are left out: nothing
            moves along such directions, unless a bound does it.

    Source: K. Levenberg, Quart. Appl. Math. 2 (1944) 164; in a box by bounded-variable least
    squares (Stark and Parker 1995), scipy.optimize.lsq_linear.
    """
    if matrix.shape[1] >= MANY and damping > 0.0 and not least:
        return _step_of_many(matrix, rows, damping, room)
    left, singular, right = np.linalg.svd(matrix, full_matrices=False)
    rounding = np.finfo(float).eps * max(matrix.shape) * np.max(singular, initial=0.0)
    kept = (singular >= max(least, rounding)) & (singular > 0.0)
    gains = singular[kept] / (singular[kept] ** 2 + damping)
    step = -(right[kept].T @ (gains * (left[:, kept].T @ rows)))
    if room is None or np.all((room[0] <= step) & (step <= room[1])):
        return np.asarray(step, dtype=float)
    anchor = np.sqrt(damping) * np.eye(matrix.shape[1])
    target = np.concatenate([-rows, np.zeros(matrix.shape[1])])
    return step_in_box(np.concatenate([matrix, anchor]), target, *room)


def _step_of_many(
    matrix: FloatArray,
    rows: FloatArray,
    damping: float,
    room: tuple[FloatArray, FloatArray] | None,
) -> FloatArray:
    """The same by R with R^T R = J^T J + damping: |R d - c|^2 is the merit, but for a number.

    Few of many unknowns come to an end of their room. With these last, R = (R11 R12; 0 R22): what
    comes last is least in |R22 d2 - c2|^2 alone, in its box, and the others follow it.
    """
    root = _root(matrix, damping)
    target = solve_triangular(root, -(matrix.T @ rows), trans="T")
    step = solve_triangular(root, target)
    if room is None:
        return np.asarray(step)
    lower, upper = room
    ends = np.zeros(step.size, dtype=bool)
    while np.any(out := ~ends & ((step < lower) | (step > upper))):
        ends |= out
        order = np.concatenate([np.flatnonzero(~ends), np.flatnonzero(ends)])
        first, last = np.split(order, [step.size - int(np.sum(ends))])
        k = first.size
        rotated = np.asarray(np.linalg.qr(np.column_stack([root[:, order], target]), mode="r"))
        step[last] = step_in_box(rotated[k:, k:-1], rotated[k:, -1], lower[last], upper[last])
        rest = rotated[:k, -1] - rotated[:k, k:-1] @ step[last]
        step[first] = solve_triangular(rotated[:k, :k], rest)
    return np.asarray(step)


def _root(matrix: FloatArray, damping: float) -> FloatArray:
    """R (n, n), upper triangular, with R^T R = J^T J + damping."""
    n = matrix.shape[1]
    squares = matrix.T @ matrix
    if np.finfo(float).eps * np.max(np.diag(squares)) < ROUNDED * damping:
        squares[np.diag_indices(n)] += damping
        return np.asarray(np.linalg.cholesky(squares).T)
    return np.asarray(np.linalg.qr(np.vstack([matrix, np.sqrt(damping) * np.eye(n)]), mode="r"))


def step_in_box(
    matrix: FloatArray, target: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """The step d (n,) in a box that minimises ``|matrix d - target|^2``.

    Args:
        matrix: shape (m, n).
        target: shape (m,).
        lower: least step in every variable, shape (n,).
        upper: greatest, shape (n,).
    """
    # the solver wants room between its bounds
    room = upper - lower > 1e-14 * np.maximum(1.0, np.abs(lower) + np.abs(upper))
    step = np.clip(np.zeros_like(lower), lower, upper)
    if np.any(room):
        rest = target - matrix[:, ~room] @ step[~room]
        fit = lsq_linear(matrix[:, room], rest, (lower[room], upper[room]), method="bvls")
        step[room] = np.clip(fit.x, lower[room], upper[room])
    return step
