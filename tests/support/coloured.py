"""Noise whose neighbours correlate by a known share."""

from __future__ import annotations

import math

import numpy as np

from fitting.text.arrays import FloatArray


def coloured(rho: float, points: int, rng: np.random.Generator) -> FloatArray:
    """Noise of unit variance whose neighbours correlate by rho: e_t = rho e_(t-1) + ..."""
    e = rng.standard_normal(points)
    for t in range(1, points):
        e[t] = rho * e[t - 1] + math.sqrt(1.0 - rho**2) * e[t]
    return e
