"""Smooth least squares: scipy's solver, and the damped Gauss-Newton step for searches of our own.

The one small door to ``scipy.optimize`` beside the continuation. A search that has to run in step
with others, or whose merit is no plain sum of squares, goes its own way by `damped_step`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares, lsq_linear

from fitting.text.arrays import FloatArray

#: Share of the largest singular value below which a direction may be folded; first step along it.
FOLDED, SMALL = 0.1, 0.01
#: Unknowns from which a damped step goes by a triangular factor: singular values take ten times
#: as long. Rounding of squared rows, as a share of the damping, up to which that is Cholesky's.
MANY, ROUNDED = 100, 1e-3
#: Step of a central difference, over the larger of an unknown's size and one.
STEP = float(np.finfo(float).eps) ** (1.0 / 3.0)


@dataclass(frozen=True, kw_only=True)
class LeastSquaresFit:
    """The minimum of a sum of squares and the curvature there.

    ``values`` (n,), ``covariance`` (n, n) in units of the values, ``residuals`` (m,), ``jacobian``
    (m, n) there, ``converged`` and the solver's own ``message``; ``freedom`` that of the residuals
    where they tell their noise, infinite where it is known; ``variance`` that of a residual.
    """

    values: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    jacobian: FloatArray
    converged: bool
    message: str
    freedom: float
    variance: float


def minimise_squares(
    residuals: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    *,
    residual_sigma: float | None = None,
    rounds: int | None = None,
    gain: float = 1e-15,
    slopes: Callable[[FloatArray], FloatArray] | None = None,
) -> LeastSquaresFit:
    """Minimise ``sum(residuals(x)**2)`` without bounds, by a trust-region Gauss-Newton method.

    The covariance is ``s**2 (J^T J)^-1``; ``s`` is ``residual_sigma`` where it is known and
    otherwise ``sqrt(sum(r**2) / (m - n))``. ``start`` (n,) should be of order one in every
    coordinate: the caller scales, because only the caller knows the scales. A direction that the
    data do not see gets an infinite variance.

    Args:
        residuals: of x (n,), shape (m,).
        start: shape (n,), of order one in every coordinate.
        residual_sigma: standard deviation of a residual, if known, in its unit.
        rounds: evaluations at most, slopes not counted; None: as many as it takes.
        gain: relative fall of the sum of squares below which a step is the last one.
        slopes: derivatives of the residuals at x, shape (m, n); None: differences.

    Raises:
        ValueError: fewer residuals than unknowns.

    Source: scipy.optimize.least_squares (Branch, Coleman and Li 1999).
    """
    if residuals(start).size < start.size:
        raise ValueError(f"{residuals(start).size} residuals cannot fix {start.size} unknowns")
    # with 2-point differences the noise of the gradient stops the fit near 1e-8 of the width
    fit = least_squares(
        residuals,
        start,
        jac=partial(_differences, residuals) if slopes is None else slopes,
        method="trf",
        xtol=1e-15,
        ftol=gain,
        gtol=1e-15,
        max_nfev=rounds,
    )
    freedom = max(1, fit.fun.size - start.size)
    variance = (
        residual_sigma**2 if residual_sigma is not None else float(fit.fun @ fit.fun) / freedom
    )
    return LeastSquaresFit(
        values=np.asarray(fit.x, dtype=float),
        covariance=_covariance(np.asarray(fit.jac, dtype=float), variance),
        residuals=np.asarray(fit.fun, dtype=float),
        jacobian=np.asarray(fit.jac, dtype=float),
        converged=bool(fit.status > 0 and np.all(np.isfinite(fit.x))),
        message=str(fit.message),
        freedom=float(freedom) if residual_sigma is None else np.inf,
        variance=variance,
    )


def _differences(residuals: Callable[[FloatArray], FloatArray], x: FloatArray) -> FloatArray:
    """Slopes (m, n) of residuals at x by central differences, to the last bit scipy's "3-point".

    Of residuals as short as ours, what scipy does around them takes longer than they do.
    """
    slopes = []
    for k, step in enumerate(STEP * np.where(x >= 0.0, 1.0, -1.0) * np.maximum(1.0, np.abs(x))):
        below, above = x.copy(), x.copy()
        below[k] -= step
        above[k] += step
        slopes.append((residuals(above) - residuals(below)) / (above[k] - below[k]))
    return np.transpose(slopes)


def folded(residuals: Callable[[FloatArray], FloatArray], fit: LeastSquaresFit) -> LeastSquaresFit:
    """The fit with errors that hold where residuals are even along a direction.

    Two minima that lie mirrored merge where the truth is near the mirror: r(x + t v) = r + t^2 h/2,
    and slopes along v, a right singular vector of the jacobian with value s, vanish though the data
    bound t. Where |h'| sigma > s^2, with h' the part of h that other unknowns do not make up for,
    h takes the place of the slope and t^2/2 that of t:

        |t| = sqrt(2 sigma/|h'|)

    Args:
        residuals: as they were minimised, of x (n,), shape (m,).
        fit: their minimum.
    """
    left, singular, rows = np.linalg.svd(fit.jacobian, full_matrices=False)
    sigma = float(np.sqrt(fit.variance))
    columns, kept, bends = left * singular, np.ones(singular.size, dtype=bool), []
    for k, along in enumerate(rows):
        if singular[k] > FOLDED * singular[0]:
            continue
        bend = _bend(residuals, fit, along, sigma)
        rest = np.delete(left, k, axis=1)
        own = float(np.linalg.norm(bend - rest @ (rest.T @ bend)))
        if own * sigma > singular[k] ** 2:
            columns[:, k], kept[k] = bend, False
            bends.append(k)
    spread = _covariance(columns, fit.variance)
    if not bends or not np.all(np.isfinite(spread)):
        return fit
    covariance = rows[kept].T @ spread[np.ix_(kept, kept)] @ rows[kept]
    for k in bends:
        covariance = covariance + 2.0 * np.sqrt(spread[k, k]) * np.outer(rows[k], rows[k])
    return replace(fit, covariance=covariance)


def _bend(
    residuals: Callable[[FloatArray], FloatArray],
    fit: LeastSquaresFit,
    along: FloatArray,
    sigma: float,
) -> FloatArray:
    """Second derivative (m,) along a direction, over the step that the data allow."""
    step = SMALL
    for _ in range(2):
        ends = residuals(fit.values + step * along) + residuals(fit.values - step * along)
        bend = (ends - 2.0 * fit.residuals) / step**2
        size = float(np.linalg.norm(bend))
        step = float(np.clip(np.sqrt(2.0 * sigma / size), 0.01 * SMALL, 1.0)) if size else SMALL
    return np.asarray(bend)


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
    return _step_in_box(np.concatenate([matrix, anchor]), target, *room)


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
        turned = np.asarray(np.linalg.qr(np.column_stack([root[:, order], target]), mode="r"))
        step[last] = _step_in_box(turned[k:, k:-1], turned[k:, -1], lower[last], upper[last])
        rest = turned[:k, -1] - turned[:k, k:-1] @ step[last]
        step[first] = solve_triangular(turned[:k, :k], rest)
    return np.asarray(step)


def _root(matrix: FloatArray, damping: float) -> FloatArray:
    """R (n, n), upper triangular, with R^T R = J^T J + damping."""
    n = matrix.shape[1]
    squares = matrix.T @ matrix
    if np.finfo(float).eps * np.max(np.diag(squares)) < ROUNDED * damping:
        squares[np.diag_indices(n)] += damping
        return np.asarray(np.linalg.cholesky(squares).T)
    return np.asarray(np.linalg.qr(np.vstack([matrix, np.sqrt(damping) * np.eye(n)]), mode="r"))


def _step_in_box(
    matrix: FloatArray, target: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """The step d (n,) in a box that minimises ``|matrix d - target|^2``."""
    # the solver wants room between its bounds
    room = upper - lower > 1e-14 * np.maximum(1.0, np.abs(lower) + np.abs(upper))
    step = np.clip(np.zeros_like(lower), lower, upper)
    if np.any(room):
        rest = target - matrix[:, ~room] @ step[~room]
        fit = lsq_linear(matrix[:, room], rest, (lower[room], upper[room]), method="bvls")
        step[room] = np.clip(fit.x, lower[room], upper[room])
    return step


def _covariance(jacobian: FloatArray, variance: float) -> FloatArray:
    """variance (J^T J)^-1 through the singular values, infinite along unseen directions.

    They stay infinite where the variance is zero: residuals that vanish say nothing about them.
    """
    _, singular, rows = np.linalg.svd(jacobian, full_matrices=False)
    unseen = singular <= singular[0] * np.finfo(float).eps * max(jacobian.shape)
    if np.any(unseen):
        touched = np.any(np.abs(rows[unseen]) > 1e-8, axis=0)
        covariance = variance * _inverse_seen(singular[~unseen], rows[~unseen])
        covariance[touched, touched] = np.inf
        return covariance
    return variance * _inverse_seen(singular, rows)


def _inverse_seen(singular: FloatArray, rows: FloatArray) -> FloatArray:
    weighted = rows / singular[:, np.newaxis]
    return np.asarray(weighted.T @ weighted, dtype=float)
