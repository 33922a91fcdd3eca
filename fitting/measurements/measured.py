"""What the laboratory measured, as the rows of an objective need it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from fitting.signal.scale import SCALES, laboratory_maximum
from fitting.text.arrays import FloatArray, IntArray

#: Residuals beyond this many standard deviations count linearly with outliers = "huber".
HUBER = 1.345


def _nothing() -> FloatArray:
    return np.empty(0)


@dataclass(frozen=True)
class Measured:
    """Laboratory values that the model is held against, amplitudes in V peak.

    `peaks_v`, `sigmas_v` (n_peaks,) in the order experiments x tones; `sweep_v`, `sweep_sigmas_v`
    (n_sweep,); `scale` "maximum" (Algorithm 1), "fit", "robust" (least squares and Huber's estimate
    over the sweep), "free" (that of "fit" times a fitted factor) or "none" (the model answers in
    their unit); `fit_sweep` makes every sweep point a residual row, relative to `maximum_v`, with
    `sweep_known` of known noise; `maximum_sigma` is the relative error of `maximum_v`; `weigh` and
    `outliers` change the misfit "squares", see there.
    `parts` are the campaigns of a joint fit, each with its own scale: rows are all their peaks,
    then all their fitted sweeps.

    Raises:
        ValueError: shapes that differ, a peak that is not positive, a scale without a sweep.
    """

    peaks_v: FloatArray
    sigmas_v: FloatArray
    sweep_v: FloatArray
    scale: str = "maximum"
    fit_sweep: bool = False
    maximum_v: float = 0.0
    weigh: bool = False
    outliers: str = "keep"
    sweep_sigmas_v: FloatArray = field(default_factory=_nothing)
    sweep_known: bool = False
    maximum_sigma: float = 0.0
    parts: tuple[Measured, ...] = ()

    def __post_init__(self) -> None:
        if self.peaks_v.shape != self.sigmas_v.shape:
            raise ValueError(f"{self.peaks_v.size} peaks, but {self.sigmas_v.size} sigmas")
        if not np.all(np.isfinite(self.peaks_v)) or np.any(self.peaks_v <= 0.0):
            raise ValueError("a measured peak is not positive and finite")
        if self.scale not in SCALES:
            raise ValueError(f"scale {self.scale!r} is none of {', '.join(SCALES)}")
        if self.sweep_v.size == 0 and (self.scale != "none" or self.fit_sweep):
            raise ValueError("a scale or a fit of the sweep needs a sweep")
        if self.peaks_v.size == 0 and not self.fit_sweep:
            raise ValueError("neither peaks nor a fitted sweep: nothing to minimise")
        if self.sweep_v.size and self.maximum_v <= 0.0:
            peak = laboratory_maximum(np.arange(self.sweep_v.size, dtype=float), self.sweep_v)
            object.__setattr__(self, "maximum_v", peak.value_v)
        if self.sweep_sigmas_v.shape != self.sweep_v.shape:
            object.__setattr__(self, "sweep_sigmas_v", np.zeros(self.sweep_v.size))

    @property
    def rows_sigma(self) -> FloatArray:
        """Relative standard deviation of each residual row, (n_rows,); zero where unknown."""
        peaks = np.nan_to_num(self.sigmas_v / self.peaks_v, nan=0.0)
        if not self.fit_sweep:
            return peaks
        known = 1.0 if self.sweep_known else 0.0
        return np.concatenate([peaks, known * self.sweep_sigmas_v / self.maximum_v])

    @property
    def level(self) -> FloatArray:
        """What chi multiplies in each row where the model fits, (n_rows,): dr/d ln chi = r + it."""
        ones = np.ones(self.peaks_v.size)
        return np.concatenate([ones, self.sweep_v / self.maximum_v]) if self.fit_sweep else ones

    @property
    def part_of_rows(self) -> IntArray:
        """Which campaign each row belongs to, (n_rows,)."""
        parts = self.parts or (self,)
        peaks = [np.full(part.peaks_v.size, k) for k, part in enumerate(parts)]
        swept = [np.full(p.sweep_v.size, k) for k, p in enumerate(parts) if p.fit_sweep]
        return np.concatenate([*peaks, *swept]).astype(np.intp)

    def squares(self, residuals: FloatArray) -> tuple[float, FloatArray]:
        """Misfit "squares" of rows (m,), and the weights (m,) that its gradient 2 J^T w r has.

        sum r^2; with `weigh`, if every sigma is known, sum w r^2, w = sigma^-2/mean(sigma^-2), and
        with outliers = "huber" rows beyond 1.345 sigma count linearly (P. Huber, Robust
        Statistics, 1981).
        """
        sigma = self.rows_sigma
        if not (self.weigh and np.all(sigma > 0.0)):
            return float(np.dot(residuals, residuals)), np.ones(residuals.size)
        weights = sigma**-2 / np.mean(sigma**-2)
        if self.outliers != "huber":
            return float(np.sum(weights * residuals**2)), weights
        far = np.maximum(np.abs(residuals) / (HUBER * sigma), 1.0)
        value = np.sum(weights * residuals**2 * (2.0 * far - 1.0) / far**2)
        return float(value), weights / far


def join_measured(parts: Sequence[Measured]) -> Measured:
    """Campaigns side by side, as one: every part keeps its own scale."""
    swept = [part for part in parts if part.fit_sweep]
    return Measured(
        peaks_v=np.concatenate([part.peaks_v for part in parts]),
        sigmas_v=np.concatenate([part.sigmas_v for part in parts]),
        sweep_v=np.concatenate([np.empty(0), *(p.sweep_v / p.maximum_v for p in swept)]),
        scale="none",
        fit_sweep=bool(swept),
        maximum_v=1.0,
        weigh=any(part.weigh for part in parts),
        outliers="huber" if all(part.outliers == "huber" for part in parts) else "keep",
        sweep_sigmas_v=np.concatenate(
            [np.empty(0), *(p.sweep_sigmas_v / p.maximum_v for p in swept)]
        ),
        sweep_known=bool(swept) and all(part.sweep_known for part in swept),
        parts=tuple(parts),
    )
