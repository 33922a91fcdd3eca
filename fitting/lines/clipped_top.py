"""A flat top of a sweep, as an instrument makes it at its limit: which points say nothing there."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fitting.lines.choice import criteria_of, order_of
from fitting.lines.faults import CLIPPED_POINTS
from fitting.lines.form import AMPLITUDE_FORMS, LineFit, fit_form
from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.lines.poles import complex_line
from fitting.lines.starts import point_noise
from fitting.signal.peaks import mode_response
from fitting.text.arrays import BoolArray, ComplexArray, FloatArray
from fitting.text.errors import BadInput

#: A real part of values, (n,).
Part = Callable[[Any], FloatArray]
#: A top that is flat by the steps of the scale alone is left by one of them, not by so many.
JUMP = 20.0
#: Standard deviations of a reading within which noise may take a point to the limit.
CLOSE = 3.0
#: Parts of complex values that a limit may cut off.
PARTS: tuple[Part, ...] = (np.real, lambda v: -np.real(v), np.imag, lambda v: -np.imag(v))
#: What one mode leaves of values that follow it, over their spread; rounds about the limit.
FOLLOWED, ROUNDS = 0.2, 3
#: Steps of the scale over noise, up to which largest points are not equal by chance.
FINE = 0.1


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
    step, noise = float(np.min(np.diff(levels))), point_noise(amplitude[~flat])
    # noise that is larger than steps of the scale makes no equal points
    if not beside or (limit - max(beside) < JUMP * step and not step < FINE * noise):
        return none
    close = limit - CLOSE * noise
    while first > 0 and amplitude[first - 1] > close:
        first -= 1
    while last + 1 < amplitude.size and amplitude[last + 1] > close:
        last += 1
    none[first : last + 1] = True
    return none


def clipped_points(
    frequency_hz: FloatArray, values: FloatArray | ComplexArray
) -> tuple[BoolArray, float]:
    """Points of a sweep that are cut off at a limit, of complex values in X, Y or size, and that.

    A lock-in amplifier that overflows cuts each part by itself, at either sign: a point is lost as
    a whole with one of its parts. The size is looked at where neither part is cut off, as of a file
    of amplitude and phase. Points go, too, where a mode and a constant that the others follow
    comes within three standard deviations of the limit. The limit is the largest one, 0 where
    nothing is cut off.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: shape (n,), any unit.
    """
    for parts in (PARTS, (np.abs,)) if np.iscomplexobj(values) else ((np.real,),):
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
    f: FloatArray,
    values: FloatArray | ComplexArray,
    cut: BoolArray,
    parts: Sequence[Part],
    limit: float,
) -> BoolArray:
    """Points that are cut, and those whose own line is close to a limit: noise decides there."""
    if not np.iscomplexobj(values):  # the line decides, not the reading
        cut = values >= limit * (1.0 - 1e-12)
    for _ in range(ROUNDS):
        if np.sum(~cut) < MIN_SWEEP_POINTS:
            break
        followed = _followed(f, values, cut)
        if followed is None:
            break
        curve, noise = followed
        close = np.any([part(curve) > limit - CLOSE * noise for part in parts], axis=0)
        if not np.any(close & ~cut):
            break
        cut = cut | close
    return cut


def _followed(
    f: FloatArray, values: FloatArray | ComplexArray, cut: BoolArray
) -> tuple[ComplexArray, float] | None:
    """The line that points follow which are not cut off, at all of them, and its noise."""
    if np.iscomplexobj(values):
        line = complex_line(f[~cut], np.asarray(values[~cut], dtype=complex))
        if not line.misfit < FOLLOWED:
            return None
        place = line.eta_hz, line.width_hz
        shape = 1.0 / (f - place[0] - 0.5j * place[1])
        shapes = [shape / np.max(np.abs(shape)), np.ones(f.size)]
    else:
        fit = plain_line(f[~cut], values[~cut].real)
        if fit is None:
            return None
        shape = np.abs(mode_response(f, fit.frequency.value, fit.width.value))
        shapes = [shape, np.ones(f.size), f - f[0]][: 1 + fit.form.background]
    design = np.stack(shapes, axis=1)
    if not np.isfinite(design).all():
        return None
    curve = design @ np.linalg.lstsq(design[~cut], values[~cut], rcond=None)[0]
    squares = float(np.mean(np.abs(values - curve)[~cut] ** 2))
    return curve, math.sqrt(squares / (2.0 if np.iscomplexobj(values) else 1.0))


def plain_line(frequency_hz: FloatArray, amplitude: FloatArray) -> LineFit | None:
    """The line of amplitudes alone or on a real background, by Akaike's criterion; None: no line.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        amplitude: shape (n,), any unit.
    """
    fits = []
    for name in ("transmission", "offset", "sloped"):
        with contextlib.suppress(BadInput):
            fits.append(fit_form(frequency_hz, amplitude, AMPLITUDE_FORMS[name]))
    order = order_of(fits, criteria_of(fits, amplitude.size)) if fits else []
    return fits[order[0]] if fits else None
