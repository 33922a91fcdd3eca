"""Likelihoods as sums of squares: residuals whose squares are twice the loss of log likelihood.

    r_i = sign(y_i - m_i) sqrt(2 (ln p(y_i|y_i) - ln p(y_i|m_i)))        m the curve

so that the least sum of squares is the largest likelihood, and J^T J there is the information.
Normal noise needs none of this: its residuals are y - m (`fitting.lines.solve.fit_model`), weighted
where its size is known.

Source: P. McCullagh and J. Nelder, Generalized Linear Models, section 2.3 (deviance residuals);
P. Whittle, Ark. Mat. 2 (1953) 423, for spectral densities.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fitting.text.arrays import FloatArray

#: Relative deviation below which a logarithm is its series.
SMALL = 1e-4


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
