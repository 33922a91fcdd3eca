"""A top that an instrument cut off at its limit: those points are left out (`fitting.lines`)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fitting.lines.clipped_top import clipped_points, plain_line
from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.resonance.trace import Trace
from fitting.text.finding import Kind, note


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
    cut, limit = clipped_points(trace.frequency_hz, trace.values)
    if not np.any(cut) or np.sum(~cut) < MIN_SWEEP_POINTS:
        return trace, None
    # of complex values noise does not decide alone which points are at the limit of either part
    flat = cut if trace.is_complex else trace.amplitude >= limit * (1.0 - 1e-12)
    plain = None if trace.is_complex else plain_line(trace.frequency_hz, trace.amplitude)
    found = Clipped(
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
        size=found.limit,
        count=found.count,
        near=found.beside,
        low_hz=found.low_hz,
        high_hz=found.high_hz,
        width_hz=found.width_hz,
    )
    whole = trace.whole
    if whole is not None:
        whole = whole.points(~np.isin(whole.frequency_hz, trace.frequency_hz[cut]))
    rest = replace(trace, whole=whole).points(~cut)
    return replace(rest, reading=(*trace.reading, excluded)), found
