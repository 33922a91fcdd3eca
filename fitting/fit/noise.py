"""Noise of the residual rows: what every reader of a fit weighs it with.

    V = diag(sigma^2) + U U^T

sigma are the relative standard deviations of the rows, U columns of errors that rows share: an
error e of chi moves r = chi z/z* - 1 by (1 + r) e. A scale that is fitted is a parameter and no
column.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.fit.objective import Objective, Point
from fitting.fit.problem import Problem
from fitting.inference.uncertainty import row_sigmas
from fitting.measurements.dataset import Dataset
from fitting.text.arrays import FloatArray
from fitting.text.notation import hertz

#: Outliers that are named one by one.
MOST_NAMED = 6


@dataclass(frozen=True)
class RowNoise:
    """Relative noise of the rows: `sigma` (m,) of each alone, `common` (m, k) shared by rows."""

    sigma: FloatArray
    common: FloatArray

    @property
    def covariance(self) -> FloatArray:
        """V (m, m)."""
        return np.asarray(np.diag(self.sigma**2) + self.common @ self.common.T)


def noise_of(objective: Objective, point: Point) -> RowNoise:
    """Noise of the rows of an objective at a point.

    Rows whose noise nobody knows have the scatter of such rows.
    """
    data = objective.data
    sigma = row_sigmas(data.sigma, point.residuals)
    columns = [
        error * _along_scale(data, point, series)
        for series, error in enumerate(data.scale_sigmas)
        if error > 0.0
    ]
    common = np.stack(columns, axis=1) if columns else np.empty((sigma.size, 0))
    return RowNoise(sigma, common)


def _along_scale(data: Dataset, point: Point, series: int) -> FloatArray:
    """dr/d ln chi of one series: 1 + r for peaks, r + measured/maximum for points of a sweep."""
    column = point.residuals + data.level
    return np.asarray(np.where(data.series_of_rows == series, column, 0.0))


def outlier_sentences(
    problem: Problem,
    residuals: FloatArray,
    sigma: FloatArray,
    matrix: FloatArray,
    precision: FloatArray,
) -> list[str]:
    """Peaks whose residual is beyond the campaign's threshold of its own standard deviation.

    Studentised, r/(sigma sqrt(1 - h)), h the leverage of the row; against the scatter of all where
    that is wider than the noise. ``precision`` (n,) of the priors in x.
    """
    white = matrix / sigma[:, np.newaxis]
    leverage = np.sum((white @ np.linalg.inv(white.T @ white + np.diag(precision))) * white, axis=1)
    scores = residuals / sigma / np.sqrt(np.maximum(1.0 - leverage, 0.05))
    lines = [f"{e.label} at {hertz(f)}" for e in problem.experiments for f in e.read_hz]
    scores = scores[: len(lines)]
    if scores.size < 4:
        return []
    wide = max(1.0, float(np.median(np.abs(scores))) / 0.6745)
    far = [int(k) for k in np.argsort(-np.abs(scores)) if abs(scores[k]) > problem.threshold * wide]
    if not far:
        return []
    named = ", ".join(f"{lines[k]} ({scores[k]:+.3g})" for k in far[:MOST_NAMED])
    more = f" and {len(far) - MOST_NAMED} more" if len(far) > MOST_NAMED else ""
    tamed = ' They count less (outliers = "huber").' if problem.data.outliers == "huber" else ""
    return [f"Outliers, in standard deviations of their residual: {named}{more}.{tamed}"]


def prior_precision(widths: FloatArray, nu: float) -> FloatArray:
    """Precision of the priors in x (n,), from `fitting.campaign.parameters.prior_widths`."""
    return np.asarray(12.0 / widths**2 + nu)
