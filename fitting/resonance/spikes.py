"""Single points far off a trace that no line of its grid makes: each named, and left out.

A line that is a third of the distance of the points wide, or wider, is seen in the neighbours of
its top, too. A point is none of a line where it stands off the straight line through its six
neighbours by `BESIDE` times as much as each of these does, and by as many times the noise: an
overload, a lost reading, or a line so narrow that these points cannot tell of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.resonance.trace import Trace
from fitting.signal.peaks import MIN_SWEEP_POINTS, point_noise
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.notation import hertz, number, prefixed

#: Neighbours on each side that tell where a point ought to be.
REACH = 3
#: Times their own distances, and the noise, that a point stands off.
BESIDE = 10.0
#: Most such points, and share of all; more of them are no single ones.
MOST, SHARE = 3, 0.02


@dataclass(frozen=True, kw_only=True)
class Spike:
    """A point that was left out: ``place`` in the file, frequency in Hz, size in the trace's unit.

    ``expected`` is the size that its neighbours make likely.
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
    f, y, sizes = trace.frequency_hz, trace.values, trace.amplitude
    if f.size < MIN_SWEEP_POINTS + MOST:
        return ()
    parts = (y.real, y.imag) if trace.is_complex else (y.real,)
    noise = max(max(point_noise(part), _digit(part)) for part in parts)
    found = [
        Spike(
            place=trace.places[k],
            frequency_hz=float(f[k]),
            size=float(sizes[k]),
            expected=abs(there),
        )
        for k, there in _off(f, y, noise)
    ]
    return tuple(found) if len(found) <= max(MOST, SHARE * f.size) else ()


def _off(
    f: FloatArray, y: FloatArray | ComplexArray, noise: float
) -> Iterator[tuple[int, complex]]:
    """Number of each such point, and what its neighbours make of it; the ends have none."""
    share = (f[1:-1] - f[:-2]) / (f[2:] - f[:-2])
    between = (1.0 - share) * y[:-2] + share * y[2:]
    # as far off its two neighbours, but for their own distance from the line of all six
    doubtful = np.flatnonzero(np.abs(y[1:-1] - between) > (BESIDE - 1.0) * noise)
    for k in (1 + int(each) for each in doubtful):
        first = min(max(0, k - REACH), f.size - 2 * REACH - 1)
        beside = np.delete(np.arange(first, first + 2 * REACH + 1), k - first)
        x = f[beside] - f[k]
        columns = np.stack([np.ones_like(x), x / np.max(np.abs(x))], axis=1)
        line = np.linalg.lstsq(columns, y[beside], rcond=None)[0]
        scatter = float(np.max(np.abs(columns @ line - y[beside])))
        if abs(y[k] - line[0]) > BESIDE * max(scatter, noise):
            yield k, complex(line[0])


def _digit(numbers: FloatArray) -> float:
    """The last digit of an instrument, as the smallest of all steps shows it."""
    steps = np.diff(np.unique(numbers))
    return float(np.min(steps, initial=np.inf)) if steps.size else 0.0


def without_spikes(trace: Trace, spikes: Sequence[Spike]) -> Trace:
    """The trace without some of its points, which it tells of.

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
    words = [spike_words(spike, trace.unit) for spike in spikes]
    return replace(trace.points(kept), said=(*trace.said, *words))


def spike_words(spike: Spike, unit: str) -> str:
    """What is said of a point that was left out.

    Args:
        spike: that point.
        unit: of its size.
    """
    factor, of_unit = prefixed(spike.size, "" if unit == "1" else unit)
    size, there = (
        f"{number(value / factor, 3)} {of_unit}".rstrip() for value in (spike.size, spike.expected)
    )
    return (
        f"Left out: {spike.place}, {size} at {hertz(spike.frequency_hz, digits=8)}, where its "
        f"neighbours make {there} likely: a single point far off them is no line that these "
        "points could tell of, and a narrower one needs a finer grid."
    )
