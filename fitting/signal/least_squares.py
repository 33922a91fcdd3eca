"""Smooth least squares: the one small door to ``scipy.optimize`` beside the continuation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, lsq_linear

from fitting.text.arrays import FloatArray


@dataclass(frozen=True)
class LeastSquaresFit:
    """The minimum of a sum of squares and the curvature there.

    ``values`` (n,), ``covariance`` (n, n) in units of the values, ``residuals`` (m,), ``jacobian``
    (m, n) there, ``converged`` and the solver's own ``message``.
    """

    values: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    jacobian: FloatArray
    converged: bool
    message: str


def minimise_squares(
    residuals: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    *,
    residual_sigma: float | None = None,
) -> LeastSquaresFit:
    """Minimise ``sum(residuals(x)**2)`` without bounds, by a trust-region Gauss-Newton method.

    The covariance is ``s**2 (J^T J)^-1``; ``s`` is ``residual_sigma`` where it is known and
    otherwise ``sqrt(sum(r**2) / (m - n))``. ``start`` (n,) should be of order one in every
    coordinate: the caller scales, because only the caller knows the scales. A direction that the
    data do not see gets an infinite variance.

    Raises:
        ValueError: fewer residuals than unknowns.

    Source: scipy.optimize.least_squares (Branch, Coleman and Li 1999).
    """
    if residuals(start).size < start.size:
        raise ValueError(f"{residuals(start).size} residuals cannot fix {start.size} unknowns")
    # with 2-point differences the noise of the gradient stops the fit near 1e-8 of the width
    fit = least_squares(
        residuals, start, jac="3-point", method="trf", xtol=1e-15, ftol=1e-15, gtol=1e-15
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
    )


def bounded_step(
    matrix: FloatArray, target: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """The step d (n,) in a box that minimises ``|matrix d - target|^2``.

    Source: bounded-variable least squares (Stark and Parker 1995), scipy.optimize.lsq_linear.
    """
    free = np.linalg.lstsq(matrix, target, rcond=None)[0]
    if np.all((lower <= free) & (free <= upper)):
        return np.asarray(free, dtype=float)
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
