"""Single points far off a trace that no line of its grid makes: each named, and left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.lines.single_points import single_points
from fitting.resonance.trace import Trace
from fitting.text.finding import Finding, Kind, note


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
