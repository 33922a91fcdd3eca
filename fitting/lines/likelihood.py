"""Likelihoods as sums of squares: residuals whose squares are twice the loss of log likelihood.

    r_i = sign(y_i - m_i) sqrt(2 (ln p(y_i|y_i) - ln p(y_i|m_i)))        m the curve

so that the least sum of squares is the largest likelihood, and J^T J there is the information.
Normal noise needs none of this: its residuals are y - m (`fitting.lines.solve.fit_model`), weighted
where its size is known. Where it grows with the amplitude,

    sigma_i^2 = a^2 + (r |m_i|)^2        a absolute, r relative

its size is that of largest likelihood of residuals with these variances (`noise_weights`).

Source: R. Carroll and D. Ruppert, Transformation and Weighting in Regression, chapter 3;
P. McCullagh and J. Nelder, Generalized Linear Models, section 2.3 (deviance residuals);
P. Whittle, Ark. Mat. 2 (1953) 423, for spectral densities.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray

#: Relative deviation below which a logarithm is its series.
SMALL = 1e-4
#: Rounds of weighted least squares of the squared residuals; least share of a variance.
ROUNDS, LEAST = 30, 1e-6


class Likelihood(Protocol):
    """How values scatter about a curve."""

    def residuals(self, values: FloatArray, curve: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residuals (n,) and their derivatives by the curve (n,)."""

    def deviation(self, curve: FloatArray) -> FloatArray:
        """Standard deviation of the values about a curve, (n,)."""


@dataclass(frozen=True)
class Whittle:
    """Densities of a noise spectrum, each the mean of so many periodograms."""

    averages: float

    def residuals(self, values: FloatArray, curve: FloatArray) -> tuple[FloatArray, FloatArray]:
        """r^2 = 2 m (y/S - 1 - ln(y/S)), m averages, S the density of the curve."""
        floor = np.finfo(float).tiny
        ratio = np.maximum(values, floor) / np.maximum(curve, floor)
        off = ratio - 1.0
        small = np.abs(off) < SMALL
        safe = np.where(small, 1.0, off)
        loss = np.where(small, off**2 * (0.5 - off / 3.0 + 0.25 * off**2), safe - np.log1p(safe))
        root = math.sqrt(2.0 * self.averages)
        size = np.sqrt(np.maximum(loss, 0.0))
        # d loss/dS = -off/S, of which half over the size stays finite where values meet the curve
        share = np.where(
            small, np.sqrt(0.5) * (1.0 + off / 3.0), 0.5 * np.abs(off) / np.where(small, 1.0, size)
        )
        return root * np.sign(off) * size, -root * share / np.maximum(curve, floor)

    def deviation(self, curve: FloatArray) -> FloatArray:
        """S over the root of m."""
        return np.asarray(curve / math.sqrt(self.averages))


def noise_weights(
    residuals: FloatArray | ComplexArray, curve: FloatArray | ComplexArray
) -> FloatArray:
    """Weights (n,) of points, one over their noise, one where the curve is largest.

    Args:
        residuals: shape (n,), any unit.
        curve: fitted values, shape (n,), in that unit.
    """
    size = np.abs(curve) / float(np.max(np.abs(curve)))
    squares = np.abs(residuals) ** 2
    design = np.stack([np.ones_like(size), size**2], axis=1)
    mean = float(np.mean(squares))
    variances = np.full(2, mean)
    for _ in range(ROUNDS):
        sizes = np.maximum(design @ variances, LEAST * mean)
        # squares of normal deviates scatter as their variances
        scaled = design / sizes[:, None]
        found = np.linalg.lstsq(scaled, squares / sizes, rcond=None)[0]
        found = np.maximum(found, LEAST * mean)
        if np.allclose(found, variances, rtol=1e-3, atol=0.0):
            break
        variances = found
    sizes = np.maximum(design @ variances, LEAST * mean)
    return np.asarray(np.sqrt(np.sum(variances) / sizes))
