"""Lines beyond the ends of a range, of which a tail may stand in it.

The points outside of a range that was chosen show them: a top that stands above the lowest point
between it and the end of the range by `STANDS_OUT` times the noise, which second differences
tell, and by a share of the largest point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fitting.lines.poles import extent
from fitting.lines.starts import point_noise
from fitting.resonance.trace import Trace
from fitting.text.arrays import FloatArray

#: Noise, and share of the largest point, by which another line stands out.
STANDS_OUT, LEAST_SHARE = 10.0, 0.03
#: Rise over that of the highest one from which a nearer top is a line.
NEAREST_SHARE = 0.3


@dataclass(frozen=True)
class FurtherLine:
    """A line outside of the range: its top and full width as the points there show it, Hz."""

    frequency_hz: float
    width_hz: float


def further_lines(trace: Trace) -> tuple[FurtherLine, ...]:
    """Lines that points outside of the range show, the highest below it and above it.

    Args:
        trace: the range, and the trace of which it is a part.
    """
    if trace.whole is None:
        return ()
    f, a = trace.whole.frequency_hz, trace.whole.amplitude
    first, last = (int(np.searchsorted(f, end)) for end in trace.frequency_hz[[0, -1]])
    least = max(STANDS_OUT * point_noise(a), LEAST_SHARE * float(np.max(a)))
    found = []
    for there in (np.arange(first, -1, -1), np.arange(last, f.size)):  # outwards
        rises = a[there] - np.minimum.accumulate(a[there])
        if np.max(rises) > least:
            other = int(there[_nearest_top(a[there], rises, least)])
            width = extent(f, a >= math.sqrt(0.5) * a[other], other)
            found.append(FurtherLine(float(f[other]), width))
    return tuple(found)


def _nearest_top(a: FloatArray, rises: FloatArray, least: float) -> int:
    """The first top that rises by a share of the highest one, up to where it has fallen as far."""
    enough = max(least, NEAREST_SHARE * float(np.max(rises)))
    begin = int(np.argmax(rises >= enough))
    fallen = np.maximum.accumulate(a[begin:]) - a[begin:] >= enough
    end = begin + int(np.argmax(fallen)) if np.any(fallen) else a.size
    return begin + int(np.argmax(a[begin:end]))
