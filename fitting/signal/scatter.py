"""Scatter of the points of a curve about a smooth one, without a model of it."""

from __future__ import annotations

import numpy as np

from fitting.text.arrays import FloatArray

#: Differences of this order leave noise alone where a curve is resolved; its weight on white noise.
DIFFERENCES, WEIGHT = 4, float(np.sqrt(70.0))
#: Curves with fewer points say nothing of their noise by themselves.
LEAST_FOR_NOISE = 50
#: Median of |x| of a normal distribution of unit variance.
MEDIAN_OF_NORMAL = 0.6744897501960817


def scatter_of(*values: FloatArray) -> float:
    """Standard deviation of values about smooth curves, 0 where too few tell it.

    Median of |fourth differences|, which leave noise alone where the curves are resolved.

    Args:
        values: of each curve, (n,): the parts of a complex one are two.
    """
    if min(v.size for v in values) < LEAST_FOR_NOISE:
        return 0.0
    left = np.concatenate([np.diff(v, DIFFERENCES) for v in values]) / WEIGHT
    return float(np.median(np.abs(left))) / MEDIAN_OF_NORMAL
