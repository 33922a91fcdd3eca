"""Limits of recordings as next measurements: what [design] says, else as the traces had them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fitting.design.candidates import MOST_SAMPLES, Limits, TraceLimits
from fitting.design.recordings import TracesSoFar, longest_s, repeated, traces_of
from fitting.design.sweep_limits import HEADROOM, OF_TONES
from fitting.design.table import DesignTable, most_of
from fitting.extension.records import BoundCampaign, WrittenDesign, WrittenTraces
from fitting.measurements.traces.grid import LEAST_SAMPLES
from fitting.text.errors import BadInput
from fitting.text.written import positive_in

#: Keys of [design] that have no meaning beside traces.
OF_OTHERS = (*OF_TONES, "centres", "relative_noise")
#: Tables of traces.
OF_TRACES = {"trace", "demodulated_trace"}
#: Lengths that are tried where nothing is said, in units of the longest trace.
LENGTHS = (0.25, 0.5, 1.0, 2.0)


def traces_asked_of(bound: BoundCampaign, said: WrittenDesign, keys: frozenset[str]) -> bool:
    """Whether recordings are asked for; of a campaign of traces alone, unless it asks for tones.

    Args:
        bound: campaign, bound to its FMU.
        said: [design], as it was read.
        keys: those that are written there.
    """
    if said.traces is not None:
        return True
    others = bound.experiments or bound.sweep is not None or said.sweeps is not None
    if others or keys & {*OF_TONES, "centres"}:
        return False
    return bool(bound.measurements) and set(bound.measurements) <= OF_TRACES


def trace_limits(bound: BoundCampaign, table: DesignTable) -> Limits:
    """Limits of a campaign whose next measurements are recordings over time.

    Args:
        bound: campaign, bound to its FMU.
        table: [design], as it was read.

    Raises:
        BadInput: no traces, or some whose repetition nothing is known of, an unknown name, a value
            of the wrong unit, traces of several units, a key that does not apply to traces.
    """
    so_far, said = traces_of(bound), table.keys
    asked = said.traces or WrittenTraces()
    for key in OF_OTHERS:
        if key in table.said:
            raise BadInput(
                f"{table.where(key)}: has no meaning together with traces, which are proposed in "
                f"place of "
                "tones"
            )
    own = next((p.name for p in bound.parameters if p.experiments), None)
    if own is not None:
        raise BadInput(
            f"{table.where('traces')}: '{own}' is fitted to single traces, and nothing is known of "
            "it in a new one; wanted parameters that all traces share"
        )
    of = tuple(dict.fromkeys(asked.of or so_far.labels))
    records = repeated(so_far, of, table.where("traces"))
    unit = records[0].unit
    floor = 0.0 if said.noise_floor is None else positive_in(said.noise_floor, unit)
    seen = max(float(np.max(np.abs(record.y))) for record in records)
    return Limits(
        outputs=tuple(dict.fromkeys(map(so_far.output, of))),
        centres_hz=(1.0,),
        frequency_step_hz=1.0,
        least_spacing_hz=1.0,
        farthest_hz=1.0,
        both_sides=True,
        levels=(1.0,),
        repeats=(1,),
        noise_floor_v=floor,
        relative_noise=0.0,
        largest_v=HEADROOM * seen if said.largest is None else positive_in(said.largest, unit),
        number=most_of(said),
        tones=1,
        traces=TraceLimits(
            of=of,
            lengths_s=_lengths(so_far, of, asked),
            spacings_s=_spacings(so_far, of, asked),
            samples=_samples(so_far, asked, table),
        ),
    )


def _lengths(so_far: TracesSoFar, of: tuple[str, ...], asked: WrittenTraces) -> tuple[float, ...]:
    records = [so_far.record(label) for label in of]
    longest = max((record.y.size - 1) * record.spacing_s for record in records)
    given = asked.lengths
    if given is None:
        # of a recorded input no more is known than was recorded
        most = max(map(longest_s, records))
        given = tuple(share * longest for share in LENGTHS if share <= 1.0 or most == math.inf)
    return tuple(sorted(set(given)))


def _spacings(
    so_far: TracesSoFar, of: tuple[str, ...], asked: WrittenTraces
) -> Mapping[str, tuple[float, ...]]:
    return {
        label: tuple(sorted(set(asked.spacings or (so_far.record(label).spacing_s,))))
        for label in of
    }


def _samples(so_far: TracesSoFar, asked: WrittenTraces, table: DesignTable) -> int:
    own = round(HEADROOM * max(record.y.size for record in so_far.records))
    samples = asked.samples or min(own, MOST_SAMPLES)
    if not LEAST_SAMPLES <= samples <= MOST_SAMPLES:
        raise BadInput(
            f"{table.where('traces')}: {samples} samples, wanted {LEAST_SAMPLES} to {MOST_SAMPLES}"
        )
    return samples
