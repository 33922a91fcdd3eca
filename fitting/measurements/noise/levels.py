"""Levels of a noise spectrum: what multiplies its shape, and a white floor, solved inside.

    S = a N + b,   a, b >= 0, least of  L(a, b) = sum_i M (ln S_i + P_i/S_i)

the negative logarithm of the likelihood of densities P_i that are averages over M periodograms:
P_i/S_i follows a Gamma distribution of shape M and mean 1. Source: P. Whittle, Ark. Mat. 2 (1953)
423; averages as in D. Percival and A. Walden, Spectral Analysis (1993), section 4.7.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fitting.text.arrays import FloatArray

#: Steps at most, and the relative change that ends them.
STEPS, SETTLED = 60, 1e-13
#: Halvings of a step that does not lead down.
HALVINGS = 30


def best_levels(
    shape: FloatArray, density: FloatArray, known: float | None, *, floor: bool = True
) -> FloatArray:
    """Levels a and b (2,) of the largest likelihood.

    Args:
        shape: N, (n,), zero or more.
        density: P, (n,), above zero.
        known: a where it is known; None: it is solved for.
        floor: whether b is solved for; else it is zero.
    """
    sizes = np.array([np.max(density) / (np.max(shape) or 1.0), np.max(density)])
    columns = np.stack([shape * sizes[0], np.full(shape.size, sizes[1])], axis=1)
    low = float(np.quantile(density, 0.25)) / sizes[1]
    levels = np.array([1.0 if known is None else known / sizes[0], low if floor else 0.0])
    free = np.array([known is None, floor])
    for _ in range(STEPS):
        step = _step(columns, density, levels, free)
        moved = _downhill(columns, density, levels, step)
        done = bool(np.all(np.abs(moved - levels) <= SETTLED * np.max(levels)))
        levels = moved
        if done:
            break
    return np.asarray(levels * sizes)


def _loss(columns: FloatArray, density: FloatArray, levels: FloatArray) -> float:
    s = columns @ levels
    if not np.all(s > 0.0):
        return np.inf
    return float(np.sum(np.log(s) + density / s))


def _step(
    columns: FloatArray, density: FloatArray, levels: FloatArray, free: npt.NDArray[np.bool_]
) -> FloatArray:
    """Newton's step of those that are free and not held at zero, or Fisher's."""
    s = columns @ levels
    slope = columns.T @ ((s - density) / s**2)
    moving = free & ~((levels <= 0.0) & (slope > 0.0))
    if not np.any(moving):
        return np.zeros(2)
    mine = columns[:, moving]
    for weights in ((2.0 * density - s) / s**3, 1.0 / s**2):
        curved = (mine * weights[:, None]).T @ mine
        if np.all(np.linalg.eigvalsh(curved) > 0.0):
            step = np.zeros(2)
            step[moving] = -np.linalg.solve(curved, slope[moving])
            return step
    return np.asarray(np.where(moving, -np.sign(slope) * 0.1 * np.max(levels), 0.0))


def _downhill(
    columns: FloatArray, density: FloatArray, levels: FloatArray, step: FloatArray
) -> FloatArray:
    before = _loss(columns, density, levels)
    for k in range(HALVINGS):
        moved = np.maximum(levels + 0.5**k * step, 0.0)
        if _loss(columns, density, moved) <= before:
            return np.asarray(moved)
    return levels
