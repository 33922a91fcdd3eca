"""A top that an instrument cut off at its limit: those points say nothing of how high the line is.

All points at the limit are left out, and so are others where the line of the rest comes within
`CLOSE` times its noise of it: of points there noise decides which are cut off, and those that are
left would be the low ones. What decides is the line, not the point itself, so that the rest is a
fair sample.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace

import numpy as np

from fitting.lines.clipped_top import clipped_parts
from fitting.lines.faults import CLIPPED_POINTS
from fitting.lines.form import AMPLITUDE_FORMS, LineFit, fit_form
from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.resonance.trace import Trace
from fitting.text.arrays import BoolArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind, note

#: Standard deviations of a reading within which noise may take a point to the limit.
CLOSE = 3.0
#: Steps of the scale over noise, up to which three largest points are not equal by chance.
FINE = 0.1
#: What is missing at the top over its error, from which that needs no such scale.
NOTABLE = 2.0
#: Forms of the line that decide which points are close to the limit.
FORMS = ("transmission", "offset", "sloped")
#: Rounds in which the points close to the limit are found.
ROUNDS = 3


@dataclass(frozen=True, kw_only=True)
class Clipped:
    """A top that was cut off.

    Attributes:
        limit: size of the points that were cut off, of complex values of the part that was, in the
            trace's unit.
        count: how many there are.
        beside: how many others were left out, where noise decides which are cut off.
        low_hz: of the first point that was left out, Hz.
        high_hz: of the last one, Hz.
        width_hz: full width at half of the power that the line of all points would have, Hz; NaN
            of complex values.
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
    if trace.is_complex:
        return _without_clipped_parts(trace)
    a = trace.amplitude
    limit = float(np.max(a, initial=0.0))
    flat = a >= limit * (1.0 - 1e-12)
    if not _is_cut(flat):
        return trace, None
    kept, plain = _kept(trace, ~flat, limit), _line(trace.frequency_hz, a, trace.source)
    if kept is None:
        return trace, None
    left = trace.frequency_hz[~kept]
    found = Clipped(
        limit=limit,
        count=int(np.sum(flat)),
        beside=int(np.sum(~kept & ~flat)),
        low_hz=float(left[0]),
        high_hz=float(left[-1]),
        width_hz=math.nan if plain is None else plain.width.value,
    )
    return _rest(trace, kept, _note(found, trace.unit)), found


def _without_clipped_parts(trace: Trace) -> tuple[Trace, Clipped | None]:
    """The same of complex values, of which X and Y may be cut off, each by itself."""
    cut, limit = clipped_parts(trace.frequency_hz, np.asarray(trace.values))
    if not np.any(cut) or np.sum(~cut) < MIN_SWEEP_POINTS:
        return trace, None
    left = trace.frequency_hz[cut]
    found = Clipped(
        limit=limit,
        count=int(np.sum(cut)),
        beside=0,
        low_hz=float(left[0]),
        high_hz=float(left[-1]),
        width_hz=math.nan,
    )
    return _rest(trace, ~cut, _note(found, trace.unit, parts=("X", "Y"))), found


def _rest(trace: Trace, kept: BoolArray, excluded: Finding) -> Trace:
    """The trace of the points that are kept, and a finding on the others."""
    whole = trace.whole
    if whole is not None:
        whole = whole.points(~np.isin(whole.frequency_hz, trace.frequency_hz[~kept]))
    reading = (*trace.reading, excluded)
    return replace(replace(trace, whole=whole).points(kept), reading=reading)


def _note(found: Clipped, unit: str, parts: tuple[str, ...] = ()) -> Finding:
    """How many points were left out, and why; of complex values ``parts`` were clipped."""
    return note(
        Kind.top_excluded,
        "",
        {"unit": (unit,), "parts": parts},
        size=found.limit,
        count=found.count,
        near=found.beside,
        low_hz=found.low_hz,
        high_hz=found.high_hz,
        width_hz=found.width_hz,
    )


def _is_cut(flat: BoolArray) -> bool:
    """Whether so many of the largest points are equal, side by side, that it is no chance."""
    run = np.convolve(flat, np.ones(CLIPPED_POINTS), mode="valid")
    return bool(np.any(run >= CLIPPED_POINTS)) and int(np.sum(~flat)) >= MIN_SWEEP_POINTS


def _kept(trace: Trace, below: BoolArray, limit: float) -> BoolArray | None:
    """Points far enough below the limit, by their own line, (n,); None where that stays below."""
    f, a = trace.frequency_hz, trace.amplitude
    kept = below
    for _ in range(ROUNDS):
        form = _line(f[kept], a[kept], trace.source)
        if form is None or not (_no_chance(a, form) or _is_below(limit, form)):
            return None
        close = np.zeros(f.size, dtype=np.bool_)
        close[kept] = form.curve > limit - CLOSE * form.rms_residual * form.amplitude.value
        if not np.any(close) or np.sum(kept & ~close) < MIN_SWEEP_POINTS:
            break
        kept = kept & ~close
    return kept


def _no_chance(a: FloatArray, form: LineFit) -> bool:
    """Whether noise is so much larger than steps of the scale that it makes no points equal."""
    steps = np.diff(np.unique(a))
    return bool(np.min(steps) < FINE * form.rms_residual * form.amplitude.value)


def _is_below(limit: float, form: LineFit) -> bool:
    """Whether a limit is below the top of a line by more than its error."""
    return form.amplitude.value + form.background.real - limit > NOTABLE * form.amplitude.std


def _line(f: FloatArray, a: FloatArray, source: str) -> LineFit | None:
    """The line of some points, alone or beside a real background, by Akaike's criterion."""
    forms = []
    for name in FORMS:
        with contextlib.suppress(BadInput):
            forms.append(fit_form(f, a, AMPLITUDE_FORMS[name], source=source))
    return min(
        forms,
        key=lambda form: f.size * np.log(form.rms_residual * form.amplitude.value) + form.unknowns,
        default=None,
    )
