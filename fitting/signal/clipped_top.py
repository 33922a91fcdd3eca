"""A flat top of a sweep, as an instrument makes it at its limit: which points say nothing there."""

from __future__ import annotations

import numpy as np

from fitting.signal.sweep_faults import CLIPPED_POINTS
from fitting.text.arrays import BoolArray, FloatArray

#: A top that is flat by the steps of the scale alone is left by one of them, not by so many.
JUMP = 20.0
#: Standard deviations of a reading within which noise may take a point to the limit.
CLOSE = 3.0
#: Of second differences of white noise: their median size over its standard deviation.
MEDIAN_OF_SECOND = 0.6745 * np.sqrt(6.0)


def clipped_top(amplitude: FloatArray) -> BoolArray:
    """Points of a sweep that are cut off at a limit, or may be by noise; none where none are.

    Three or more of the largest are equal side by side, and their neighbours are lower by many
    steps of the scale. What lies between points at the limit, and beside them within three standard
    deviations of it, belongs to them: noise decides there which are cut off, and those that are
    left would be the low ones.

    Args:
        amplitude: over rising frequencies, shape (n,), any unit.
    """
    none = np.zeros(amplitude.size, dtype=np.bool_)
    levels = np.unique(amplitude)
    limit = float(levels[-1]) if levels.size else 0.0
    flat = amplitude >= limit * (1.0 - 1e-12)
    run = np.convolve(flat, np.ones(CLIPPED_POINTS), mode="valid")
    if limit <= 0.0 or levels.size < 2 * CLIPPED_POINTS or not np.any(run >= CLIPPED_POINTS):
        return none
    at = np.flatnonzero(flat)
    first, last = int(at[0]), int(at[-1])
    beside = [amplitude[k] for k in (first - 1, last + 1) if 0 <= k < amplitude.size]
    step = float(np.min(np.diff(levels)))
    if not beside or limit - max(beside) < JUMP * step:
        return none
    noise = float(np.median(np.abs(np.diff(amplitude[~flat], 2)))) / MEDIAN_OF_SECOND
    close = limit - CLOSE * noise
    while first > 0 and amplitude[first - 1] > close:
        first -= 1
    while last + 1 < amplitude.size and amplitude[last + 1] > close:
        last += 1
    none[first : last + 1] = True
    return none
