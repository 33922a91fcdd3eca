"""How well the data hold each value: the covariance of the problem linearised at the solution.

    F = J^T V^-1 J (data)     P = diag(12/(u - l)^2) + nu I (prior: the box as if uniform, Tikhonov)
    C = (F + P)^-1 = C F C + C P C

The two terms of C are what noise and prior leave open. shrinkage_i = (C F C)_ii/C_ii is the share
of the variance that the data answer for: near one where they hold the value, near zero where only
the prior does, *also* where the prior holds it through a correlation with something the data know.
That is stricter than 1 - C_ii/(P^-1)_ii, and so meant: the linearisation sees no curved valley.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.fit.result import IDENTIFIABLE
from fitting.text.arrays import FloatArray

#: Shares of the variance from which a value counts as determined, and as partly determined.
DETERMINED, PARTLY = 0.9, 0.1
#: Rows count as known no better than this: finite differences and the model's numerics.
SMALLEST_SIGMA = 1e-6


@dataclass(frozen=True)
class Covariance:
    """Covariance in the search vector, (n, n): `total` = `noise` + `prior`.

    `inflation` is the factor on the given sigmas that the residuals ask for (one if they fit),
    `widening` the one on those of the sweep because its residuals hang together.
    """

    total: FloatArray
    noise: FloatArray
    prior: FloatArray
    inflation: float
    widening: float = 1.0

    def of(self, gradient: FloatArray) -> tuple[float, float]:
        """(standard deviation, shrinkage) of a scalar whose gradient in x is given, (n,)."""
        variance = float(gradient @ self.total @ gradient)
        noise = float(gradient @ self.noise @ gradient)
        if not variance > 0.0:
            return 0.0, 1.0  # it does not depend on the parameters at all
        return float(np.sqrt(variance)), noise / variance


def row_sigmas(sigmas: FloatArray, residuals: FloatArray) -> FloatArray:
    """Sigma of every row; where it is not known (zero), the scatter of such rows themselves."""
    unknown = ~(sigmas > 0.0)
    filled = np.array(sigmas, dtype=float)
    if np.any(unknown):
        filled[unknown] = float(np.sqrt(np.mean(residuals[unknown] ** 2)))
    return np.asarray(np.maximum(filled, SMALLEST_SIGMA))


def effective_degrees_of_freedom(white: FloatArray, prior: FloatArray) -> float:
    """Degrees of freedom that the residuals keep: rows less the directions that the data hold.

    m - sum s^2/(1 + s^2), s the singular values of `white` (m, n) in units of the prior, whose
    inverse standard deviations are `prior` (n,). At least one half.

    Source: effective number of parameters of ridge regression (Hastie and Tibshirani).
    """
    squares = np.linalg.svd(white / prior, compute_uv=False) ** 2
    return max(0.5, float(white.shape[0] - np.sum(squares / (1.0 + squares))))


def covariance(
    matrix: FloatArray,
    residuals: FloatArray,
    sigmas: FloatArray,
    widths: FloatArray,
    nu: float,
    scale_sigma: float = 0.0,
    swept: slice = slice(0, 0),
    widening: float = 1.0,
    common: FloatArray | None = None,
) -> Covariance:
    """Linearised covariance at a solution (see the module).

    V = inflation^2 (diag(sigma^2) + scale_sigma^2 1 1^T): the error of chi is common to all rows.
    inflation^2 = max(1, r^T V^-1 r/(m - n)): residuals larger than the noise widen the errors.
    Rows of the sweep then count with widening sigma: they weigh as their independent points.

    Args:
        matrix: dr/dx, shape (m, n).
        residuals: r at the solution, shape (m,).
        sigmas: relative, shape (m,); zero where not known.
        widths: u - l of the box in x, shape (n,).
        nu: last regularisation.
        scale_sigma: relative standard deviation of chi.
        common: columns of errors that rows share, shape (m, k), in place of scale_sigma.
        swept: the rows of the sweep.
        widening: of the sweep, see `fitting.signal.residual_tests.residual_structure`.
    """
    m, n = matrix.shape
    sigma = row_sigmas(sigmas, residuals)
    if common is None:
        common = np.full((m, 1), scale_sigma)
    shared = common @ common.T
    factor = np.linalg.cholesky(np.diag(sigma**2) + shared)
    chi_square = float(np.sum(np.linalg.solve(factor, residuals) ** 2))
    inflation = max(1.0, float(np.sqrt(chi_square / max(m - n, 1))))
    if widening > 1.0:
        sigma[swept] *= widening
        factor = np.linalg.cholesky(np.diag(sigma**2) + shared)
    white = np.linalg.solve(factor, matrix)
    root = 1.0 / np.sqrt(12.0 / widths**2 + nu)
    # singular values keep the small ones apart from rounding, F + P would not
    _, singular, rows = np.linalg.svd(white / inflation * root, full_matrices=True)
    squares = np.zeros(n)
    squares[: singular.size] = singular**2
    directions = rows.T * root[:, np.newaxis]
    noise = (directions * (squares / (1.0 + squares) ** 2)) @ directions.T
    prior = (directions * (1.0 / (1.0 + squares) ** 2)) @ directions.T
    return Covariance(noise + prior, noise, prior, inflation, widening)


def in_words(shrinkage: float) -> str:
    """The word for a shrinkage: determined (from 0.9), partly (from 0.1), not determined."""
    if shrinkage >= DETERMINED:
        return IDENTIFIABLE[0]
    return IDENTIFIABLE[1] if shrinkage >= PARTLY else IDENTIFIABLE[2]
