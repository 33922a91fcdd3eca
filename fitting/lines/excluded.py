"""Points of a sweep that are excluded from its line, and lines that its other points show.

A line that is a third of the distance of the points wide, or wider, is seen in the neighbours of
its top, too. A point is none of a line where it stands off the straight line through its six
neighbours by `OFF` times as much as each of these does, by as many times the noise, and by
`LEAST` of what they make likely, which noise that grows with the amplitude is not: an overload, a
lost reading, or a line so narrow that these points cannot resolve it. A flat top is made by an
instrument at its limit.

Points outside of a range that was chosen show lines whose tails may be in it: a top that is above
the lowest point between it and the end of the range by `OUTSTANDING` times the noise, which second
differences show, and by a share of the largest point.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fitting.lines.choice import criteria_of, order_of
from fitting.lines.faults import CLIPPED_POINTS
from fitting.lines.form import AMPLITUDE_FORMS, LineFit, fit_form
from fitting.lines.lorentzian import mode_response
from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.lines.starts import complex_line, extent, point_noise
from fitting.lines.sweep_model import Place
from fitting.lines.trace import Trace
from fitting.text.arrays import BoolArray, ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind, note

#: Neighbours on each side that show where a point ought to be.
REACH = 3
#: Times their own distances, and the noise, that a point stands off.
OFF = 10.0
#: Share of what is likely there by which it does.
LEAST = 0.5
#: Most such points, and share of all; more of them are no single ones.
MOST, SHARE = 3, 0.02


def single_points(
    frequency_hz: FloatArray, values: FloatArray | ComplexArray
) -> tuple[tuple[int, complex], ...]:
    """Number of each point that no line of the grid makes, and what its neighbours make likely.

    None where there are many; the first and the last point have too few neighbours.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes, or complex values, shape (n,), any unit.
    """
    f, y = frequency_hz, values
    if f.size < MIN_SWEEP_POINTS + MOST:
        return ()
    parts = [np.asarray(part, dtype=float) for part in (y.real, y.imag)][: 1 + np.iscomplexobj(y)]
    noise = 0.0  # or the last digit of an instrument, as the smallest of all steps shows it
    for part in parts:
        steps = np.diff(np.unique(part))
        noise = max(noise, point_noise(part), float(np.min(steps)) if steps.size else 0.0)
    share = (f[1:-1] - f[:-2]) / (f[2:] - f[:-2])
    between = (1.0 - share) * y[:-2] + share * y[2:]
    points = []
    # as far off its two neighbours, but for their own distance from the line of all six
    for k in 1 + np.flatnonzero(np.abs(y[1:-1] - between) > (OFF - 1.0) * noise):
        first = min(max(0, int(k) - REACH), f.size - 2 * REACH - 1)
        near = np.delete(np.arange(first, first + 2 * REACH + 1), k - first)
        x = f[near] - f[k]
        columns = np.stack([np.ones_like(x), x / np.max(np.abs(x))], axis=1)
        line = np.linalg.lstsq(columns, y[near], rcond=None)[0]
        scatter = float(np.max(np.abs(columns @ line - y[near])))
        if abs(y[k] - line[0]) > max(OFF * scatter, OFF * noise, LEAST * abs(line[0])):
            points.append((int(k), complex(line[0])))
    return tuple(points) if len(points) <= max(MOST, SHARE * f.size) else ()


@dataclass(frozen=True, kw_only=True)
class Spike:
    """An excluded point: its ``place`` in the file, frequency, and ``size`` in the trace's unit.

    ``expected``: the size that its neighbours make likely.
    """

    place: str
    frequency_hz: float
    size: float
    expected: float


def spikes_in(trace: Trace) -> tuple[Spike, ...]:
    """The points of a trace that no line of its grid makes; none where there are many.

    Args:
        trace: what was measured.
    """
    f, sizes = trace.frequency_hz, trace.amplitude
    return tuple(
        Spike(
            place=trace.places[k],
            frequency_hz=float(f[k]),
            size=float(sizes[k]),
            expected=abs(there),
        )
        for k, there in single_points(f, trace.values)
    )


def without_spikes(trace: Trace, spikes: Sequence[Spike]) -> Trace:
    """The trace without some of its points, which its notes list.

    Args:
        trace: what was measured.
        spikes: of it.
    """
    if trace.whole is not None:
        whole = without_spikes(trace.whole, spikes_in(trace.whole))
        trace = replace(trace, whole=whole)
    if not spikes:
        return trace
    kept = ~np.isin(trace.frequency_hz, [spike.frequency_hz for spike in spikes])
    notes = [spike_note(spike, trace.unit) for spike in spikes]
    return replace(trace.points(kept), reading=(*trace.reading, *notes))


def spike_note(spike: Spike, unit: str, *, campaign: bool = False) -> Finding:
    """A point that was left out, as a finding.

    Args:
        spike: that point.
        unit: of its size.
        campaign: whether a campaign counts it.
    """
    return note(
        Kind.point_excluded,
        spike.place,
        {"unit": (unit,), **({"campaign": ("yes",)} if campaign else {})},
        size=spike.size,
        expected=spike.expected,
        frequency_hz=spike.frequency_hz,
    )


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
    steps of the scale. What lies between points at the limit, and next to them within three
    standard deviations of it, belongs to them: noise decides there which are cut off, and those
    that are left would be the low ones.

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
    near = [amplitude[k] for k in (first - 1, last + 1) if 0 <= k < amplitude.size]
    step, noise = float(np.min(np.diff(levels))), point_noise(amplitude[~flat])
    # noise that is larger than steps of the scale makes no equal points
    if not near or (limit - max(near) < JUMP * step and not step < FINE * noise):
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


@dataclass(frozen=True, kw_only=True)
class Clipped:
    """A top that was cut off and excluded.

    Attributes:
        limit: size of cut points, of complex values of the cut part, in the trace's unit.
        count: number of them.
        beside: further excluded points, where noise determines which are cut.
        low_hz: first excluded point, Hz.
        high_hz: last one, Hz.
        width_hz: FWHM with all points, Hz; NaN of complex values.
    """

    limit: float
    count: int
    beside: int
    low_hz: float
    high_hz: float
    width_hz: float


def without_clipped(trace: Trace) -> tuple[Trace, Clipped | None]:
    """The trace without a top that was cut off, and what was; as it is where none was.

    Args:
        trace: what was measured.
    """
    cut, limit = clipped_points(trace.frequency_hz, trace.values)
    if not np.any(cut) or np.sum(~cut) < MIN_SWEEP_POINTS:
        return trace, None
    # of complex values noise does not decide alone which points are at the limit of either part
    flat = cut if trace.is_complex else trace.amplitude >= limit * (1.0 - 1e-12)
    plain = None if trace.is_complex else plain_line(trace.frequency_hz, trace.amplitude)
    top = Clipped(
        limit=limit,
        count=int(np.sum(flat)),
        beside=int(np.sum(cut & ~flat)),
        low_hz=float(trace.frequency_hz[cut][0]),
        high_hz=float(trace.frequency_hz[cut][-1]),
        width_hz=math.nan if plain is None else plain.width.value,
    )
    excluded = note(
        Kind.top_excluded,
        "",
        {"unit": (trace.unit,), "parts": ("X", "Y") if trace.is_complex else ()},
        size=top.limit,
        count=top.count,
        near=top.beside,
        low_hz=top.low_hz,
        high_hz=top.high_hz,
        width_hz=top.width_hz,
    )
    whole = trace.whole
    if whole is not None:
        whole = whole.points(~np.isin(whole.frequency_hz, trace.frequency_hz[cut]))
    rest = replace(trace, whole=whole).points(~cut)
    return replace(rest, reading=(*trace.reading, excluded)), top


#: Noise, and share of the largest point, by which another line stands out.
OUTSTANDING, LEAST_SHARE = 10.0, 0.03
#: Rise over that of the highest one from which a nearer top is a line.
NEAREST_SHARE = 0.3


def further_lines(trace: Trace) -> tuple[Place, ...]:
    """Lines that points outside of the range show, the highest below it and above it.

    Args:
        trace: the range, and the trace of which it is a part.

    Returns:
        Frequency of the top and FWHM as the points there show it, Hz.
    """
    if trace.whole is None:
        return ()
    f, a = trace.whole.frequency_hz, trace.whole.amplitude
    first, last = (int(np.searchsorted(f, end)) for end in trace.frequency_hz[[0, -1]])
    least = max(OUTSTANDING * point_noise(a), LEAST_SHARE * float(np.max(a)))
    places = []
    for there in (np.arange(first, -1, -1), np.arange(last, f.size)):  # outwards
        sizes = a[there]
        rises = sizes - np.minimum.accumulate(sizes)
        if not np.max(rises) > least:
            continue
        # the first top that rises by a share of the highest one, up to where it has fallen as far
        enough = max(least, NEAREST_SHARE * float(np.max(rises)))
        low = int(np.argmax(rises >= enough))
        fallen = np.maximum.accumulate(sizes[low:]) - sizes[low:] >= enough
        end = low + int(np.argmax(fallen)) if np.any(fallen) else sizes.size
        top = int(there[low + int(np.argmax(sizes[low:end]))])
        width = extent(f, a >= math.sqrt(0.5) * a[top], top)
        places.append(Place(float(f[top]), width))
    return tuple(places)
