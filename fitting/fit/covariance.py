"""Covariance of the residual rows as what it is: a diagonal, and a few columns that rows share.

    V = S^2 + U U^T        S = diag(sigma)        S^-1 U = Q diag(s) R^T

    V^-1/2 = (1 + Q diag((1 + s^2)^-1/2 - 1) Q^T) S^-1

is a root of V^-1 in the sense W^T W = V^-1, so that chi square, information and everything made of
them are those of any other root, Cholesky's for one. It costs m k numbers and as many
multiplications a column; an array (m, m) of the 16,441 points of 41 spectra would be two gigabytes.

What a simulation may be off by (`fitting.fit.noise`) has the same shape: a column for each row, and
a few that rows share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from fitting.text.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class RowCovariance:
    """V = diag(sigma^2) + U U^T of m rows.

    `sigma` (m,) are the standard deviations of each row alone, all positive; `common` (m, k) the
    columns of errors that rows share.
    """

    sigma: FloatArray
    common: FloatArray

    @classmethod
    def of(cls, sigma: FloatArray) -> RowCovariance:
        """That of rows that share nothing.

        Args:
            sigma: standard deviations, shape (m,), all positive.
        """
        return cls(sigma, np.empty((sigma.size, 0)))

    @classmethod
    def joined(cls, parts: Sequence[RowCovariance]) -> RowCovariance:
        """That of the rows of all parts, which share nothing with each other.

        Args:
            parts: one at least.
        """
        common = np.zeros((sum(p.size for p in parts), sum(p.common.shape[1] for p in parts)))
        row = column = 0
        for part in parts:
            height, width = part.common.shape
            common[row : row + height, column : column + width] = part.common
            row, column = row + height, column + width
        return cls(np.concatenate([part.sigma for part in parts]), common)

    @property
    def size(self) -> int:
        """Number m of rows."""
        return int(self.sigma.size)

    @cached_property
    def _shared(self) -> tuple[FloatArray, FloatArray]:
        """Q (m, k) and s (k,)."""
        if not self.common.shape[1]:
            return self.common, np.empty(0)
        return np.linalg.svd(self.common / self.sigma[:, np.newaxis], full_matrices=False)[:2]

    @property
    def row_sigma(self) -> FloatArray:
        """Standard deviation of every row, what it shares with others included, (m,)."""
        return np.asarray(np.sqrt(self.sigma**2 + np.sum(self.common**2, axis=1)))

    @property
    def precision(self) -> FloatArray:
        """Diagonal of V^-1, (m,)."""
        axes, sizes = self._shared
        taken = np.sum(axes**2 * (sizes**2 / (1.0 + sizes**2)), axis=1)
        return np.asarray((1.0 - taken) / self.sigma**2)

    @property
    def log_determinant(self) -> float:
        """ln det V."""
        _, sizes = self._shared
        return float(2.0 * np.sum(np.log(self.sigma)) + np.sum(np.log1p(sizes**2)))

    def whitened(self, rows: FloatArray) -> FloatArray:
        """V^-1/2 rows: rows of unit variance, or their derivatives.

        Args:
            rows: shape (m,) or (m, n).
        """
        axes, sizes = self._shared
        return _along(axes, 1.0 / np.sqrt(1.0 + sizes**2), (rows.T / self.sigma).T)

    def coloured(self, white: FloatArray) -> FloatArray:
        """V^1/2 rows: back from `whitened`.

        Args:
            white: rows of unit variance, shape (m,) or (m, n).
        """
        axes, sizes = self._shared
        return np.asarray((_along(axes, np.sqrt(1.0 + sizes**2), white).T * self.sigma).T)

    def pulled_back(self, pull: FloatArray) -> FloatArray:
        """V^-1/2^T pull, (m,): slopes in rows from slopes in whitened rows.

        Args:
            pull: d value/d whitened rows, shape (m,).
        """
        axes, sizes = self._shared
        return np.asarray(_along(axes, 1.0 / np.sqrt(1.0 + sizes**2), pull) / self.sigma)

    def restricted(self, kept: BoolArray | IntArray) -> RowCovariance:
        """That of some of the rows.

        Args:
            kept: which, shape (m,), or their numbers.
        """
        return RowCovariance(self.sigma[kept], self.common[kept])

    def times(self, factor: float) -> RowCovariance:
        """The same with all standard deviations times a factor.

        Args:
            factor: positive.
        """
        return RowCovariance(factor * self.sigma, factor * self.common)

    def loosened(self, bounded: BoundedErrors) -> RowCovariance:
        """V + j B B^T: by it no bounded error d adds more than one to chi square.

        |d|^2 <= j for all |d_i| <= 1, and (B d)^T (j B B^T)^-1 B d <= |d|^2/j. Scales in doubt
        loosen nothing: a model that fails is not excused by them.

        Args:
            bounded: B; nothing changes without columns.
        """
        if not bounded.columns:
            return self
        weight = np.sqrt(bounded.own.size + bounded.common.shape[1])
        common = np.column_stack([self.common, weight * bounded.common])
        return RowCovariance(np.hypot(self.sigma, weight * bounded.own), common)


def _along(axes: FloatArray, factors: FloatArray, rows: FloatArray) -> FloatArray:
    """Rows (m,) or (m, n), their components along orthonormal axes (m, k) times factors (k,)."""
    if not factors.size:
        return np.asarray(rows)
    parts = axes.T @ rows
    scaled = (factors * parts.T).T
    return np.asarray(rows - axes @ parts + axes @ scaled)


@dataclass(frozen=True)
class BoundedErrors:
    """Errors of m rows that have no distribution: B d with all |d_j| <= 1.

    B has a column for every row, `own` (m,) on its diagonal, those of `common` (m, k), and those of
    `scales` (m, l), along scales that are in doubt; none where `own` is empty: nothing is.
    """

    own: FloatArray
    common: FloatArray
    scales: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    @classmethod
    def none(cls) -> BoundedErrors:
        """No error at all."""
        return cls(np.empty(0), np.empty((0, 0)))

    @property
    def columns(self) -> int:
        """Number j of columns."""
        return int(self.own.size + self.common.shape[1] + self.scales.shape[1])

    def with_scales(self, columns: FloatArray) -> BoundedErrors:
        """The same, and scales that are in doubt.

        Args:
            columns: by how much each moves the rows, shape (m, l).
        """
        nothing = np.zeros(columns.shape[0]), np.empty((columns.shape[0], 0))
        own, common = (self.own, self.common) if self.own.size else nothing
        return BoundedErrors(own, common, columns)

    @property
    def together(self) -> FloatArray:
        """All columns that rows share, (m, k + l)."""
        return np.hstack([self.common, self.scales]) if self.scales.size else self.common

    @property
    def largest(self) -> FloatArray:
        """By how much every row may be off, (m,)."""
        return np.asarray(np.abs(self.own) + np.sum(np.abs(self.together), axis=1))

    def moved(self, slopes: FloatArray) -> float:
        """How far a value may move, sum_j |slopes B_j|.

        Args:
            slopes: d value/d rows, shape (m,).
        """
        return float(np.sum(np.abs(slopes * self.own)) + np.sum(np.abs(slopes @ self.together)))

    def restricted(self, kept: BoolArray) -> BoundedErrors:
        """Those of some of the rows, all columns kept that they may share.

        Args:
            kept: which, shape (m,).
        """
        if not self.columns:
            return self
        scales = self.scales[kept] if self.scales.size else self.scales
        return BoundedErrors(self.own[kept], self.common[kept], scales)


@dataclass(frozen=True)
class WhitenedErrors:
    """Bounded errors of rows that are looked at whitened: V^-1/2 B d."""

    errors: BoundedErrors
    covariance: RowCovariance

    @property
    def reach(self) -> float:
        """How far a value of unit slope may move in all, sum_j |V^-1/2 B_j|."""
        own = np.sum(np.abs(self.errors.own) * np.sqrt(self.covariance.precision))
        common = np.linalg.norm(self.covariance.whitened(self.errors.together), axis=0)
        return float(own + np.sum(common))

    def moved(self, pull: FloatArray) -> float:
        """How far a value may move, sum_j |pull V^-1/2 B_j|.

        Args:
            pull: d value/d whitened rows, shape (m,).
        """
        return self.errors.moved(self.covariance.pulled_back(pull))

    def widened(self, factor: float) -> WhitenedErrors:
        """The same among rows whose standard deviations are larger by a factor.

        Args:
            factor: positive.
        """
        return replace(self, covariance=self.covariance.times(factor))
