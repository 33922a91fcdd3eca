"""A flat top of a sweep, as an instrument makes it at its limit: which points say nothing there."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fitting.lines.faults import CLIPPED_POINTS
from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.signal.complex_line import complex_line
from fitting.text.arrays import BoolArray, ComplexArray, FloatArray

#: A real part of complex values, (n,).
Part = Callable[[ComplexArray], FloatArray]
#: A top that is flat by the steps of the scale alone is left by one of them, not by so many.
JUMP = 20.0
#: Standard deviations of a reading within which noise may take a point to the limit.
CLOSE = 3.0
#: Parts of complex values that a limit may cut off.
PARTS: tuple[Part, ...] = (np.real, lambda v: -np.real(v), np.imag, lambda v: -np.imag(v))
#: What one mode leaves of values that follow it, over their spread; rounds about the limit.
FOLLOWED, ROUNDS = 0.2, 3
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


def clipped_parts(frequency_hz: FloatArray, values: ComplexArray) -> tuple[BoolArray, float]:
    """Points of a complex sweep that are cut off at a limit of X, of Y or of their size, and it.

    A lock-in amplifier that overflows cuts each part by itself, at either sign: a point is lost as
    a whole with one of its parts. The size is looked at where neither part is cut off, as of a file
    of amplitude and phase. Points go, too, where a mode and a constant that the others follow
    comes within three standard deviations of the limit. The limit is the largest one, 0 where
    nothing is cut off.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: shape (n,), any unit.
    """
    for parts in (PARTS, (np.abs,)):
        tops = [(part, clipped_top(part(values))) for part in parts]
        limits = [float(np.max(part(values))) for part, cut in tops if np.any(cut)]
        if limits:
            limit = max(limits)
            # the other parts have the same limit, though too few of their points are at it
            alike = [part for part in parts if np.max(part(values)) <= limit * (1.0 + 1e-12)]
            at = [part(values) >= limit * (1.0 - 1e-12) for part in alike]
            cut = np.any([*at, *(cut for _, cut in tops)], axis=0)
            return _with_close(frequency_hz, values, cut, alike, limit), limit
    return np.zeros(values.size, dtype=np.bool_), 0.0


def _with_close(
    f: FloatArray, values: ComplexArray, cut: BoolArray, parts: Sequence[Part], limit: float
) -> BoolArray:
    """Points that are cut, and those whose own line is close to a limit: noise decides there."""
    for _ in range(ROUNDS):
        if np.sum(~cut) < MIN_SWEEP_POINTS:
            break
        line = complex_line(f[~cut], values[~cut])
        shape = 1.0 / (f - line.eta_hz - 0.5j * line.width_hz)
        design = np.stack([shape / np.max(np.abs(shape)), np.ones(f.size)], axis=1)
        if not (line.misfit < FOLLOWED and np.isfinite(design).all()):
            break
        curve = design @ np.linalg.lstsq(design[~cut], values[~cut], rcond=None)[0]
        noise = float(np.sqrt(0.5 * np.mean(np.abs(values - curve)[~cut] ** 2)))
        close = np.any([part(curve) > limit - CLOSE * noise for part in parts], axis=0)
        if not np.any(close & ~cut):
            break
        cut = cut | close
    return cut
