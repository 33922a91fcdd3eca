"""Noise of the residual rows: what every reader of a fit weighs it with.

    V = diag(sigma^2) + U U^T

sigma are the relative standard deviations of the rows, U columns of errors that rows share: an
error e of chi moves r = chi z/z* - 1 by (1 + r) e. A scale that is fitted is a parameter and no
column.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.fit.linearisation import row_sigmas
from fitting.fit.objective import Objective, Point
from fitting.measurements.dataset import Dataset
from fitting.text.arrays import FloatArray


@dataclass(frozen=True)
class RowNoise:
    """Relative noise of the rows: `sigma` (m,) of each alone, `common` (m, k) shared by rows."""

    sigma: FloatArray
    common: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """V (m, m)."""
        return np.asarray(np.diag(self.sigma**2) + self.common @ self.common.T)

    def widened(self, rows: slice, factor: float) -> RowNoise:
        """The same noise, some rows counting as if theirs were wider.

        Args:
            rows: which.
            factor: on their standard deviations.
        """
        sigma = self.sigma.copy()
        sigma[rows] *= factor
        return RowNoise(sigma, self.common)


def noise_of(objective: Objective, point: Point) -> RowNoise:
    """Noise of the rows of an objective at a point.

    Rows whose noise nobody knows have the scatter of such rows.

    Args:
        objective: rows, parameters and weights.
        point: where the rows were evaluated.
    """
    data = objective.data
    sigma = row_sigmas(data.sigma, point.residuals, data.solved_of(known=False))
    columns = [
        error * _along_scale(data, point, series)
        for series, error in enumerate(data.scale_sigmas)
        if error > 0.0
    ]
    common = np.stack(columns, axis=1) if columns else np.empty((sigma.size, 0))
    return RowNoise(sigma, common)


def _along_scale(data: Dataset, point: Point, series: int) -> FloatArray:
    """dr/d ln chi of one series: 1 + r for peaks, r + measured/maximum for points of a sweep."""
    column = point.residuals + data.measured_rows
    return np.asarray(np.where(data.series_of_rows == series, column, 0.0))
