"""Lines beyond the ends of a range, of which a tail may stand in it.

The points outside of a range that was chosen show them: a top that stands above the lowest point
between it and the end of the range by `STANDS_OUT` times the noise, which second differences
tell, and by a share of the largest point. Without points there, another line may begin right
beyond either end.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.resonance.trace import Trace
from fitting.signal.complex_line import extent
from fitting.signal.least_squares import minimise_squares
from fitting.signal.peaks import mode_response, point_noise
from fitting.text.arrays import FloatArray

#: Noise, and share of the largest point, by which another line stands out.
STANDS_OUT, LEAST_SHARE = 10.0, 0.03
#: Rise over that of the highest one from which a nearer top is a line.
NEAREST_SHARE = 0.3
#: Evaluations after which a flank that is still looked for is none.
ROUNDS = 100


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


def beyond_ends(frequency_hz: FloatArray, width_hz: float) -> tuple[FurtherLine, ...]:
    """Where another line may be of which nothing is known: a width beyond either end.

    Args:
        frequency_hz: of the points, rising, shape (n,), Hz.
        width_hz: full width that lines have here, Hz.
    """
    ends = frequency_hz[0] - width_hz, frequency_hz[-1] + width_hz
    return tuple(FurtherLine(float(end), width_hz) for end in ends)


@dataclass(frozen=True)
class Flank:
    """A line beyond the points, as they show its flank: place, full width, Hz, squares left."""

    frequency_hz: float
    width_hz: float
    squares: float


def flank(trace: Trace, begin: Sequence[FurtherLine]) -> Flank | None:
    """The one line, outside of the points, that describes amplitudes best; None without one.

    Args:
        trace: amplitudes.
        begin: where it may be.
    """
    f, shares = trace.frequency_hz, trace.amplitude / float(np.max(trace.amplitude))
    found = []
    for line in begin:
        near = 0 if line.frequency_hz < f[0] else -1

        def curve(x: FloatArray, line: FurtherLine = line) -> FloatArray:
            width = line.width_hz * math.exp(float(np.clip(x[1], -50.0, 50.0)))
            return np.abs(mode_response(f, line.frequency_hz + line.width_hz * float(x[0]), width))

        height = min(float(shares[near] / curve(np.zeros(2))[near]), 1e3)

        def left(x: FloatArray, curve=curve, height: float = height) -> FloatArray:  # type: ignore[no-untyped-def]
            return np.asarray(height * x[2] * curve(x) - shares)

        fit = minimise_squares(left, np.array([0.0, 0.0, 1.0]), rounds=ROUNDS)
        eta = line.frequency_hz + line.width_hz * float(fit.values[0])
        width = line.width_hz * math.exp(float(np.clip(fit.values[1], -50.0, 50.0)))
        if not f[0] < eta < f[-1]:
            found.append(Flank(eta, width, float(fit.residuals @ fit.residuals)))
    return min(found, key=lambda each: each.squares, default=None)
