"""Noise that grows with the amplitude: how large it is at every point, from the residuals of a fit.

    sigma_i^2 = a^2 + (r |S_i|)^2        a absolute, r relative

by the largest likelihood of residuals with these variances. Source: R. Carroll and D. Ruppert,
Transformation and Weighting in Regression, chapter 3.
"""

from __future__ import annotations

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray

#: Rounds of weighted least squares of the squared residuals; least share of a variance.
ROUNDS, LEAST = 30, 1e-6


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
