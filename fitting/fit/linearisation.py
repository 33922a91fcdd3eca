"""A problem linearised at a point: what its data hold, and how well.

    rows = V^-1/2 r        W = V^-1/2 dr/dx        F = W^T W        P = diag(1/s^2)
    C = (F + P)^-1 = C F C + C P C

r are the residuals, V their covariance, s the standard deviations of what is known without data:
the box as if uniform (`fitting.campaign.parameters.prior_sigmas`), a Gaussian, Tikhonov's term. The
two terms of C are what noise and prior leave open. shrinkage_i = (C F C)_ii/C_ii is the share of
the variance that the data answer for: near one where they hold the value, near zero where only the
prior does, *also* where the prior holds it through a correlation with something the data know. That
is stricter than 1 - C_ii/(P^-1)_ii, and so meant: the linearisation sees no curved valley.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fitting.fit.covariance import RowCovariance, WhitenedErrors
from fitting.signal.student import freedom_of_share
from fitting.text.arrays import BoolArray, FloatArray

#: Share of the variance from which a linearised value counts as one of the data.
DETERMINED = 0.9
#: Rows count as known no better than this: finite differences and the model's numerics.
SMALLEST_SIGMA = 1e-6


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """Least chi square of a linearised problem over the directions that its data determine.

    `rank` number of these directions; `step` (n,) in x that leads there; `covariance` (n, n) along
    them, and `unseen` (n, n) that of the prior along the others.
    """

    chi_square: float
    rank: int
    step: FloatArray
    covariance: FloatArray
    unseen: FloatArray


@dataclass(frozen=True, kw_only=True)
class Linearisation:
    """Whitened rows and their derivatives at a point, with the prior.

    `rows` (m,) are residuals of unit variance, `matrix` (m, n) their derivatives in x, `prior` (n,)
    the standard deviations in x without data. `inflation` is the factor on the given sigmas that
    the residuals require (one if they fit); it is in the rows already. `bounded` are errors of
    the rows, each column times an unknown number from -1 to 1; None: there are none.
    `scatter` (m,) is above zero for rows whose noise the residuals determine, with `freedom`
    degrees of freedom; empty or None where all noise is known.
    """

    rows: FloatArray
    matrix: FloatArray
    prior: FloatArray
    inflation: float = 1.0
    bounded: WhitenedErrors | None = None
    scatter: FloatArray | None = None
    freedom: float = np.inf

    @property
    def scaled(self) -> FloatArray:
        """Derivatives in units of the prior, (m, n): singular values are precisions over its own.

        They keep small ones apart from rounding, as F + P would not.
        """
        return self.matrix * self.prior

    @property
    def chi_square(self) -> float:
        """Sum of squares of the rows."""
        return float(self.rows @ self.rows)

    @cached_property
    def _decomposed(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Left vectors (m, k), singular values (n,) and all right vectors as rows (n, n)."""
        m, n = self.matrix.shape
        left, values, right = np.linalg.svd(self.scaled, full_matrices=m < n)
        singular = np.zeros(n)
        singular[: values.size] = values
        return left, singular, right

    @property
    def _modes(self) -> tuple[FloatArray, FloatArray]:
        """Squares of the singular values (n,), and the directions in x as columns (n, n)."""
        _, singular, right = self._decomposed
        return singular**2, right.T * self.prior[:, np.newaxis]

    @cached_property
    def covariance(self) -> FloatArray:
        """C in x, (n, n), the sum of what noise and prior leave open."""
        squares, directions = self._modes
        return np.asarray((directions / (1.0 + squares)) @ directions.T)

    @cached_property
    def noise(self) -> FloatArray:
        """C F C in x, (n, n): what the noise of the rows leaves open."""
        squares, directions = self._modes
        return np.asarray((directions * (squares / (1.0 + squares) ** 2)) @ directions.T)

    def of(self, gradient: FloatArray) -> tuple[float, float]:
        """(standard deviation, shrinkage) of a value, both from its slope at the point.

        Args:
            gradient: d value/dx, shape (n,), in the value's unit; the deviation is in it too.
        """
        variance = float(gradient @ self.covariance @ gradient)
        noise = float(gradient @ self.noise @ gradient)
        if not variance > 0.0:
            return 0.0, 1.0  # it does not depend on the parameters at all
        return float(np.sqrt(variance)), noise / variance

    def freedom_of(self, gradient: FloatArray, covariance: FloatArray | None = None) -> float:
        """Degrees of freedom of a value's standard deviation; infinite where no noise is estimated.

        Args:
            gradient: d value/dx, shape (n,).
            covariance: of x, shape (n, n); None: this problem's own.

        Source: F. Satterthwaite, Biometrics Bulletin 2 (1946) 110.
        """
        if np.isinf(self.freedom) or self.scatter is None:
            return np.inf
        along = (self.covariance if covariance is None else covariance) @ gradient
        pull, variance = self.matrix @ along, float(gradient @ along)
        mine = pull[self.scatter > 0.0]
        return freedom_of_share(self.freedom, float(mine @ mine) / variance if variance else 0.0)

    def shift(self, gradient: FloatArray) -> float:
        """How far bounded errors of the rows may move a value: sum_j |g C W^T B_j|.

        Args:
            gradient: d value/dx, shape (n,), in the value's unit; the shift is in it too.
        """
        if self.bounded is None:
            return 0.0
        return self.bounded.moved(self.matrix @ (self.covariance @ gradient))

    @property
    def degrees_of_freedom(self) -> float:
        """Those that the residuals keep: rows less the directions that the data hold.

        m - sum s^2/(1 + s^2), s the singular values in units of the prior. At least one half.

        Source: effective number of parameters of ridge regression (Hastie and Tibshirani).
        """
        squares, _ = self._modes
        return max(0.5, float(self.rows.size - np.sum(squares / (1.0 + squares))))

    @property
    def leverage(self) -> FloatArray:
        """Diagonal of W C W^T, (m,): how much each row pulls the fit towards itself."""
        return np.asarray(np.sum((self.matrix @ self.covariance) * self.matrix, axis=1))

    def undetermined(self, least: float) -> FloatArray:
        """Orthonormal directions, in units of the prior, that the data do not determine, (k, n).

        Args:
            least: precision, as a multiple of the prior's, from which the data determine one.
        """
        return np.asarray(self._decomposed[2][~self._determined(least)])

    def _determined(self, least: float) -> BoolArray:
        """Which directions the data determine, (n,); never one at the rounding of the sharpest."""
        singular = self._decomposed[1]
        return np.asarray(singular > least * max(1.0, 1e-9 * float(singular[0])))

    def minimum(self, least: float) -> Minimum:
        """Least chi square over the directions that the data determine.

        Along the others the rows are curved and nothing is known.

        Args:
            least: precision, as a multiple of the prior's, from which a direction takes part.
        """
        left, singular, right = self._decomposed
        determined = self._determined(least)
        projected = left[:, determined[: left.shape[1]]].T @ self.rows
        spread = right[determined].T / singular[determined]
        unseen = np.eye(self.prior.size) - right[determined].T @ right[determined]
        units = np.outer(self.prior, self.prior)
        return Minimum(
            chi_square=float(self.rows @ self.rows - projected @ projected),
            rank=int(np.count_nonzero(determined)),
            step=-self.prior * (spread @ projected),
            covariance=units * (spread @ spread.T),
            unseen=units * unseen,
        )

    def widened(self, factor: float) -> Linearisation:
        """The same problem with all standard deviations of its rows times a factor.

        Args:
            factor: at least one where errors are not to shrink.
        """
        return replace(
            self,
            rows=self.rows / factor,
            matrix=self.matrix / factor,
            inflation=self.inflation * factor,
            bounded=None if self.bounded is None else self.bounded.widened(factor),
        )


def joined(parts: Sequence[Linearisation]) -> Linearisation:
    """Several problems in the same parameters as one, the prior that of the first.

    Args:
        parts: at least one, with independent rows.
    """
    return Linearisation(
        rows=np.concatenate([part.rows for part in parts]),
        matrix=np.concatenate([part.matrix for part in parts]),
        prior=parts[0].prior,
    )


def linearise(
    residuals: FloatArray,
    matrix: FloatArray,
    noise: FloatArray | RowCovariance,
    prior: FloatArray,
    weighed: FloatArray | RowCovariance | None = None,
    solved: int = 0,
) -> Linearisation:
    """The problem at a point, its noise widened where the residuals are larger.

    inflation^2 = max(1, r^T V^-1 r/(m - n - s)), s what is solved inside the rows.

    Args:
        residuals: r at the point, shape (m,).
        matrix: dr/dx, shape (m, n).
        noise: covariance V of the m rows, positive definite, as it is stated.
        prior: standard deviations in x without data, shape (n,).
        weighed: covariance by which the rows count in place of V, where some weigh less than their
            noise (a sweep whose residuals are correlated: `fitting.signal.residual_tests`).
        solved: number s of unknowns that the rows are solved for inside.
    """
    m, n = matrix.shape
    white = whitened(residuals, noise)
    inflation = max(1.0, float(np.sqrt(np.sum(white**2) / max(m - n - solved, 1))))
    counted = noise if weighed is None else weighed
    return Linearisation(
        rows=whitened(residuals, counted) / inflation,
        matrix=whitened(matrix, counted) / inflation,
        prior=prior,
        inflation=inflation,
    )


def whitened(rows: FloatArray, covariance: FloatArray | RowCovariance) -> FloatArray:
    """L^-1 rows with L L^T = V: rows of unit variance, or their derivatives.

    Args:
        rows: shape (m,) or (..., m, n).
        covariance: V, positive definite: that of m rows, or an array (..., m, m).

    Raises:
        LinAlgError: the covariance is not positive definite.
    """
    if isinstance(covariance, RowCovariance):
        return covariance.whitened(rows)
    return np.asarray(np.linalg.solve(np.linalg.cholesky(covariance), rows))


def information(matrix: FloatArray, covariance: FloatArray | RowCovariance) -> FloatArray:
    """F = J^T V^-1 J, shape (..., n, n).

    Args:
        matrix: J, derivatives of the rows, shape (..., m, n).
        covariance: V of m rows, or an array (..., m, m), positive definite.

    Raises:
        LinAlgError: the covariance is not positive definite.
    """
    white = whitened(matrix, covariance)
    return np.asarray(np.swapaxes(white, -1, -2) @ white)


def row_sigmas(sigmas: FloatArray, residuals: FloatArray, solved: float = 0.0) -> FloatArray:
    """Standard deviation of every row; where it is not known, the scatter of such rows themselves.

    Args:
        sigmas: relative, shape (m,); zero where not known.
        residuals: shape (m,).
        solved: number of unknowns that were fitted to the rows of unknown noise.
    """
    unknown = ~(sigmas > 0.0)
    filled = np.array(sigmas, dtype=float)
    if np.any(unknown):
        freedom = max(float(np.count_nonzero(unknown)) - solved, 1.0)
        filled[unknown] = float(np.sqrt(np.sum(residuals[unknown] ** 2) / freedom))
    return np.asarray(np.maximum(filled, SMALLEST_SIGMA))
