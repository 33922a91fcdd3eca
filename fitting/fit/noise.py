"""Noise of the residual rows: what every reader of a fit weighs it with.

    V = diag(sigma^2) + U U^T

sigma are the relative standard deviations of the rows, U columns of errors that rows share: an
error e of chi moves r = chi z/z* - 1 by (1 + r) e. A scale that is fitted is a parameter and no
column.

What a simulation may be off by is no noise: it has no distribution, and is the same in every
repetition. A plan promises that amplitudes are within a share e of themselves, however these errors
hang together; rows then are off by B d with all |d_j| <= 1, a column of B for every amplitude,

    e (1 + r) for its own row, as above, and one for chi where that is taken from a simulated sweep

An estimate with the slopes G = d value/d rows is then off by sum_j |G B_j| at most. This is added
to what noise makes of the error, for 68 % and for 95 % alike: no part of it averages out over rows
or repetitions, so that a sum in quadrature would promise what nobody knows. Source: Guide to the
Expression of Uncertainty in Measurement (JCGM 100:2008), F.2.4.5, on a bias that is not corrected.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fitting.fit.covariance import BoundedErrors, RowCovariance
from fitting.fit.linearisation import row_sigmas
from fitting.fit.objective import Objective, Point
from fitting.measurements.dataset import Dataset
from fitting.text.arrays import FloatArray


@dataclass(frozen=True)
class RowNoise:
    """Relative noise of the rows: `sigma` (m,) of each alone, `common` (m, k) shared by rows.

    `bounded` are the columns B of what the simulation may be off by, none where it is exact.
    """

    sigma: FloatArray
    common: FloatArray
    bounded: BoundedErrors = field(default_factory=BoundedErrors.none)

    @property
    def covariance(self) -> RowCovariance:
        """V."""
        return RowCovariance(self.sigma, self.common)

    @property
    def loosest(self) -> RowCovariance:
        """V, loosened for what the simulation may be off by: for tests of agreement."""
        return self.covariance.loosened(self.bounded)

    def widened(self, rows: slice, factor: float) -> RowNoise:
        """The same noise, some rows counting as if theirs were wider.

        Args:
            rows: which.
            factor: on their standard deviations.
        """
        sigma = self.sigma.copy()
        sigma[rows] *= factor
        return replace(self, sigma=sigma)


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
    return RowNoise(sigma, common, _bounded(data, point))


def _bounded(data: Dataset, point: Point) -> BoundedErrors:
    """What the simulation may be off by."""
    if not any(point.promised):
        return BoundedErrors.none()
    share = np.zeros(point.residuals.size)
    for promised, place in zip(point.promised, data.slices, strict=True):
        share[place] = promised
    along = point.residuals + data.measured_rows  # dr/d ln amplitude, of rows that have a scale
    along = np.where(data.measured_rows == 0.0, 1.0 + np.abs(point.residuals), along)
    columns = [
        share * _along_scale(data, point, series)
        for series, chi in enumerate(point.chis)
        if chi != 1.0  # else nothing was simulated for it
    ]
    common = np.stack(columns, axis=1) if columns else np.empty((share.size, 0))
    return BoundedErrors(share * along, common)


def _along_scale(data: Dataset, point: Point, series: int) -> FloatArray:
    """dr/d ln chi of one series: 1 + r for peaks, r + measured/maximum for points of a sweep."""
    column = point.residuals + data.measured_rows
    return np.asarray(np.where(data.series_of_rows == series, column, 0.0))
