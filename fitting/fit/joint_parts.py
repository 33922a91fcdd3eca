"""One campaign of a joint fit by itself: its share of the result, as if it had been alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from fitting.campaign import BoundCampaign
from fitting.campaign.joint import series_names
from fitting.fit.result import DeviationSet, Result, SweepCurves


def parts_of(result: Result, bound: BoundCampaign) -> list[tuple[str, Result, BoundCampaign]]:
    """Name, share of the result and campaign of every member; empty for a single campaign."""
    if result.joint is None:
        return []
    parts = []
    for name, series, member in zip(
        series_names(bound.members), result.joint.series, bound.members, strict=True
    ):
        mine = tuple(e for e in bound.experiments if e.label.startswith(f"{name}/"))
        labels = {e.label for e in mine}
        rows = [k for k, peak in enumerate(result.peaks) if peak.experiment in labels]
        places = [k for k, e in enumerate(bound.experiments) if e.label in labels]
        deviations = replace(
            result.deviations,
            initial=_share(result.deviations.initial, rows, places),
            final=_share(result.deviations.final, rows, places),
        )
        curves = None
        if member.sweep is not None and series.swept_final_v:
            curves = SweepCurves(
                tuple(map(float, member.sweep.frequency_hz)),
                tuple(map(float, member.sweep.amplitude_v)),
                series.swept_initial_v,
                series.swept_final_v,
            )
        share = replace(
            result,
            title=member.title,
            synthetic=member.synthetic,
            peaks=tuple(result.peaks[k] for k in rows),
            deviations=deviations,
            sweep=curves,
            scale=replace(result.scale, kind=series.scale_kind, final=series.chi),
        )
        parts.append((name, share, replace(member, experiments=mine)))
    return parts


def _share(whole: DeviationSet, rows: Sequence[int], places: Sequence[int]) -> DeviationSet:
    peaks = tuple(whole.per_peak[k] for k in rows)
    groups = tuple(whole.per_experiment[k] for k in places)
    return DeviationSet(peaks, groups, math.fsum(peaks) / len(peaks) if peaks else math.nan)
