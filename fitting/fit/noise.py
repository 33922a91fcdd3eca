"""Noise of the residual rows: what every reader of a fit weighs it with.

    V = diag(sigma^2) + U U^T

sigma are the relative standard deviations of the rows, U columns of errors that rows share: an
error e of chi moves r = chi z/z* - 1 by (1 + r) e. A scale that is fitted is a parameter and no
column.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.campaign import BoundCampaign
from fitting.campaign.noise import ENOUGH_REPEATS, Noise, repeat_scatter, sweep_scale_sigma
from fitting.fit.objective import Measured, Objective, Point
from fitting.inference.uncertainty import row_sigmas
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
    measured = objective.measured
    sigma = row_sigmas(measured.rows_sigma, point.residuals)
    columns = [
        error * _along_scale(measured, point, part)
        for part, error in enumerate(chi_sigmas(measured))
        if error > 0.0
    ]
    common = np.stack(columns, axis=1) if columns else np.empty((sigma.size, 0))
    return RowNoise(sigma, common)


def chi_sigmas(measured: Measured) -> tuple[float, ...]:
    """Relative standard deviation of chi, of each campaign of a joint fit; zero if it is fitted."""
    parts = measured.parts or (measured,)
    return tuple(
        0.0
        if part.scale == "free"
        else part.maximum_sigma
        if part.scale == "maximum" and part.maximum_sigma > 0.0
        else sweep_scale_sigma(part.sweep_v, part.sweep_sigmas_v, part.scale)
        for part in parts
    )


def _along_scale(measured: Measured, point: Point, part: int) -> FloatArray:
    """dr/d ln chi of one part: 1 + r for peaks, r + measured/maximum for points of the sweep."""
    column = point.residuals + measured.level
    if measured.parts:
        column = np.where(measured.part_of_rows == part, column, 0.0)
    return np.asarray(column)


def peak_sigmas(bound: BoundCampaign) -> tuple[FloatArray, str]:
    """Standard deviations of all peaks (n_peaks,), NaN where unknown, and a sentence on them."""
    if bound.members:
        each = [peak_sigmas(member) for member in bound.members]
        told = dict.fromkeys(sentence for _, sentence in each)
        return np.concatenate([sigmas for sigmas, _ in each]), " ".join(told)
    floors = [e.sigmas_v for e in bound.experiments]
    peaks = [e.peaks_v for e in bound.experiments]
    if not peaks:
        return np.empty(0), ""
    noise, said = bound.noise, []
    if any(np.any(np.nan_to_num(f, nan=0.0) > 0.0) for f in floors):
        said.append("the floor of the spectra, or the columns given")
    if noise.relative == 0.0:
        scatter, freedom = repeat_scatter(_repeats(bound), peaks, floors)
        if freedom >= ENOUGH_REPEATS and scatter > 0.0:
            noise = Noise(scatter, noise.absolute_v)
            said.append(f"{100 * scatter:.3g} % from repeats ({freedom} degrees of freedom)")
    elif noise.declared:
        said.append(f"{100 * noise.relative:.3g} % as declared")
    if noise.absolute_v > 0.0:
        said.append(f"{noise.absolute_v:.3g} {bound.amplitude_unit} as declared")
    sigmas = [noise.beside(p, f) for p, f in zip(peaks, floors, strict=True)]
    sentence = (
        f"Standard deviations of the peaks: {', '.join(said)}, in quadrature."
        if said
        else ("Standard deviations of the peaks are not known: their residuals tell them.")
    )
    return np.concatenate(sigmas), sentence


def _repeats(bound: BoundCampaign) -> list[object]:
    """What tells experiments apart: settings, output, lines, and values that are theirs alone."""
    own = {
        e.label: tuple(p.name for p in bound.parameters if e.label in p.experiments)
        for e in bound.experiments
    }
    return [
        (frozenset(e.settings.items()), e.output, e.read_hz, own[e.label])
        for e in bound.experiments
    ]


def outlier_sentences(
    bound: BoundCampaign,
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
    lines = [f"{e.label} at {hertz(f)}" for e in bound.experiments for f in e.read_hz]
    scores = scores[: len(lines)]
    if scores.size < 4:
        return []
    wide = max(1.0, float(np.median(np.abs(scores))) / 0.6745)
    far = [
        int(k) for k in np.argsort(-np.abs(scores)) if abs(scores[k]) > bound.noise.threshold * wide
    ]
    if not far:
        return []
    named = ", ".join(f"{lines[k]} ({scores[k]:+.3g})" for k in far[:MOST_NAMED])
    more = f" and {len(far) - MOST_NAMED} more" if len(far) > MOST_NAMED else ""
    tamed = ' They count less (outliers = "huber").' if bound.noise.outliers == "huber" else ""
    return [f"Outliers, in standard deviations of their residual: {named}{more}.{tamed}"]


def prior_precision(widths: FloatArray, nu: float) -> FloatArray:
    """Precision of the priors in x (n,), from `fitting.campaign.parameters.prior_widths`."""
    return np.asarray(12.0 / widths**2 + nu)


def strongest(sigmas: Sequence[float]) -> float:
    """The largest of some standard deviations, zero for none."""
    return max(sigmas, default=0.0)
