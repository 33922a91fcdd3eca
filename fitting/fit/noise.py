"""Noise of the residual rows: what every reader of a fit weighs it with.

    V = diag(sigma^2) + U U^T

sigma are the relative standard deviations of the rows, U columns of errors that rows share: an
error e of chi moves r = chi z/z* - 1 by (1 + r) e. A scale that is fitted is a parameter and no
column.

What a simulation may be off by is no noise: it has no distribution, and is the same in every
repetition. A plan promises that amplitudes are within a share e of themselves, however these errors
are correlated; rows then are off by B d with all |d_j| <= 1, a column of B for every amplitude,

    e (1 + r) for its own row, as above, and one for chi where that is taken from a simulated sweep

What halved steps of a trace were seen to change is one column of all its rows, with their signs.

An estimate with the slopes G = d value/d rows is then off by sum_j |G B_j| at most. This is added
to what noise makes of the error, for 68 % and for 95 % alike: no part of it averages out over rows
or repetitions, so that a sum in quadrature would assume what is unknown. Source: Guide to the
Expression of Uncertainty in Measurement (JCGM 100:2008), F.2.4.5, on a bias that is not corrected.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.fit.covariance import BoundedErrors, RowCovariance
from fitting.fit.linearisation import Linearisation, row_sigmas
from fitting.fit.objective import Objective, Point
from fitting.measurements.dataset import Dataset
from fitting.text.arrays import FloatArray

#: Standard deviations of the data by which two standard deviations of a scale may be misread.
NOTICED = 1.0


@dataclass(frozen=True)
class RowNoise:
    """Relative noise of the rows: `sigma` (m,) of each alone, `common` (m, k) shared by rows.

    `bounded` are the columns B of what the simulation may be off by, none where it is exact, and
    of scales that are in doubt.
    `scatter` (m,) is zero for rows whose noise is known; for the others, that have the scatter of
    such rows, it is the factor by which they count as wider. It is empty where all noise is known;
    `freedom` are the degrees of freedom of that scatter.
    """

    sigma: FloatArray
    common: FloatArray
    bounded: BoundedErrors = field(default_factory=BoundedErrors.none)
    scatter: FloatArray = field(default_factory=lambda: np.empty(0))
    freedom: float = np.inf

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
        sigma, scatter = self.sigma.copy(), self.scatter.copy()
        sigma[rows] *= factor
        if scatter.size:
            scatter[rows] *= factor
        return replace(self, sigma=sigma, scatter=scatter)


def noise_of(objective: Objective, point: Point, fitted: float = 0.0) -> RowNoise:
    """Noise of the rows of an objective at a point.

    Rows whose noise is unknown have the scatter of such rows.

    Args:
        objective: rows, parameters and weights.
        point: where the rows were evaluated.
        fitted: number of parameters that rows of unknown noise determine, which makes their
            scatter smaller than their noise.
    """
    data = objective.data
    taken = data.solved_of(known=False) + fitted
    sigma = row_sigmas(data.sigma, point.residuals, taken)
    unknown = ~(data.sigma > 0.0)
    freedom = max(1.0, float(np.count_nonzero(unknown)) - taken)
    noise = RowNoise(sigma, shared(data, point.residuals), _bounded(data, point))
    if not np.any(unknown):
        return noise
    return replace(noise, scatter=unknown.astype(float), freedom=freedom)


def shared_at(noise: RowNoise, data: Dataset, point: Point) -> RowNoise:
    """The noise with what rows share as it is at another point; itself where that is much the same.

    Columns (1 + r) e of a point where some rows are far off let the scale explain these rows,
    anywhere.

    Args:
        noise: of the rows.
        data: whose rows they are.
        point: where they are to be weighed.
    """
    there = shared(data, point.residuals)
    if not there.shape[1]:
        return noise
    sigma = noise.sigma[:, np.newaxis]
    with np.errstate(over="ignore", invalid="ignore"):  # of rows that nothing describes
        old, new = noise.common / sigma, there / sigma
        sizes = np.sum(old**2, axis=0)
        apart = sizes * new - np.sum(old * new, axis=0) * old  # a factor errs the error alone
        moved = np.sum(apart**2, axis=0)
        if not np.any(moved > (0.5 * NOTICED * sizes) ** 2):
            return noise
    return replace(noise, common=there)


def fitted_noise(
    objective: Objective, point: Point, matrix: FloatArray, prior: FloatArray
) -> RowNoise:
    """Noise of the rows at a fit, with the parameters counted that were fitted to them.

    Args:
        objective: rows, parameters and weights.
        point: end of the fit.
        matrix: dr/dx there, shape (m, n).
        prior: standard deviations in x without data, shape (n,).
    """
    noise = noise_of(objective, point)
    if not noise.scatter.size:
        return noise
    covariance = noise.covariance
    here = Linearisation(
        rows=covariance.whitened(point.residuals), matrix=covariance.whitened(matrix), prior=prior
    )
    return noise_of(objective, point, float(here.leverage @ noise.scatter))


def shared(data: Dataset, residuals: FloatArray) -> FloatArray:
    """U, (m, k): the errors of scales of series, those that have one.

    Args:
        data: whose rows they are.
        residuals: where U is asked for, shape (m,); zeros where the model fits exactly.
    """
    errors = {k: error for k, error in enumerate(data.scale_sigmas) if error > 0.0}
    return _along_scales(data, residuals, errors)


def _bounded(data: Dataset, point: Point) -> BoundedErrors:
    """What the simulation may be off by."""
    if not any(point.promised) and not point.shift.size:
        return BoundedErrors.none()
    share = np.zeros(point.residuals.size)
    for promised, place in zip(point.promised, data.slices, strict=True):
        share[place] = promised
    along = point.residuals + data.measured_rows  # dr/d ln amplitude, of rows that have a scale
    along = np.where(data.measured_rows == 0.0, 1.0 + np.abs(point.residuals), along)
    # where a scale is one nothing was simulated for it
    simulated = {series: share for series, chi in enumerate(point.chis) if chi != 1.0}
    common = _along_scales(data, point.residuals, simulated)
    if point.shift.size:
        common = np.column_stack([common, point.shift])
    return BoundedErrors(share * along, common)


def doubted(noise: RowNoise, data: Dataset, point: Point, doubts: Mapping[str, float]) -> RowNoise:
    """The noise, and scales of series that may be off by so much: bounded errors.

    Args:
        noise: of the rows.
        data: whose rows they are.
        point: where the rows were evaluated.
        doubts: |ln| of the factor by which the scale of a series may be off, at most, by its name.
    """
    errors = {k: doubts[n] for k, n in enumerate(data.series) if doubts.get(n, 0.0) > 0.0}
    if not errors:
        return noise
    columns = _along_scales(data, point.residuals, errors)
    return replace(noise, bounded=noise.bounded.with_scales(columns))


def _along_scales(
    data: Dataset, residuals: FloatArray, errors: Mapping[int, float | FloatArray]
) -> FloatArray:
    """Errors of ln chi as columns of the rows, (m, k), by the number of the series.

    dr/d ln chi is 1 + r for peaks, r + measured/maximum for points of a sweep.
    """
    along = residuals + data.measured_rows
    columns = np.empty((residuals.size, len(errors)))
    for k, (series, error) in enumerate(errors.items()):
        columns[:, k] = error * np.where(data.series_of_rows == series, along, 0.0)
    return columns
