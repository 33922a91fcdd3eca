"""Everything that a bound campaign holds, as measurements.

Apart from the kinds: who has a campaign needs only those that it holds, and loading all takes time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from fitting.campaign import BoundCampaign
from fitting.measurements.complex.tones import ComplexTones
from fitting.measurements.measurement import Measurement
from fitting.measurements.sweep import sweep_of
from fitting.measurements.tones import Tones, peak_sigmas


def measurements_of(bound: BoundCampaign, series: str = "") -> tuple[Measurement, ...]:
    """Everything that a campaign holds, as measurements: curves last.

    Args:
        bound: campaign, bound to its FMU.
        series: name of the series.
    """
    result: list[Measurement] = list(_tones(bound, series))
    if bound.sweep is not None:
        result.append(sweep_of(bound, bound.sweep, series))
    for table, further in bound.measurements.items():
        if not isinstance(further, Measurement):
            raise TypeError(f"[{table}] is bound to {further!r}, wanted a Measurement")
        result.append(further.within(bound.setup, series))
    return tuple(sorted(result, key=lambda m: m.is_curve))


def _tones(bound: BoundCampaign, series: str) -> Iterator[Tones]:
    """The experiments without phases and those with, each with everything known of their noise."""
    for kind, with_phases in ((Tones, False), (ComplexTones, True)):
        mine = tuple(e for e in bound.experiments if (e.phases_rad is not None) == with_phases)
        if mine:
            sigmas_v, origin = peak_sigmas(replace(bound, experiments=mine))
            yield kind(
                bound.setup,
                mine,
                series=series,
                sigmas_v=sigmas_v,
                noise_origin=origin,
                unit=bound.amplitude_unit,
            )
