"""Noise of a curve that is smooth but for it: what fourth differences leave of its values."""

from __future__ import annotations

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray

#: Differences of this order leave noise alone where a curve is resolved; its weight on white noise.
DIFFERENCES, WEIGHT = 4, float(np.sqrt(70.0))
#: Curves with fewer points do not show their noise by themselves.
LEAST_FOR_NOISE = 50
#: Degrees of freedom that an estimate has of each point beyond the differences: neighbouring ones
#: are correlated, and their median determines less than their squares would.
FREEDOM = 0.2
#: Median of |x| of a normal distribution of unit variance.
MEDIAN_OF_NORMAL = 0.6744897501960817


def roughness(values: FloatArray | ComplexArray) -> float:
    """Standard deviation of values about a smooth curve; 0 where too few points determine it.

    Median of |fourth differences|, of complex values that of both quadratures.

    Args:
        values: one after the other along the curve, (n,).
    """
    if values.size < LEAST_FOR_NOISE:
        return 0.0
    left = np.diff(values, DIFFERENCES) / WEIGHT
    return float(np.median(np.abs([left.real, left.imag] if np.iscomplexobj(left) else left))) / (
        MEDIAN_OF_NORMAL
    )


def roughness_freedom(points: int) -> float:
    """Degrees of freedom of a `roughness`: its relative variance is 1/(2 nu), of a smooth curve.

    nu = 0.2 (n - 4), found by simulation for 60 to 400 points of white noise (0.195 to 0.205).

    Args:
        points: of the curve, n.
    """
    return FREEDOM * max(points - DIFFERENCES, 1)
