"""Tables of two-tone experiments: every peak, and mean deviations."""

from __future__ import annotations

import math

from fitting.report.shown import ShownCampaign
from fitting.report.table import Column, Table, tabulate
from fitting.result.result import Peak, Result

#: Which point "after" is.
OF_ALGORITHM_2 = (
    "“Before” is at the start, “after” where Algorithm 2, the method as published, ended. χ² "
    "without ν is that of the most likely values, which leave other residuals."
)
#: A peak with its relative deviations before and after.
Deviation = tuple[Peak, float, float]
#: A name with mean deviations before and after.
Mean = tuple[str, float, float]


def _percent(before: float, after: float) -> float:
    return 100.0 * after / before if before > 0.0 else math.nan


def deviation_table(result: Result, data: ShownCampaign) -> Table | None:
    """Every peak: measured, simulated before and after, deviations; None without peaks.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    if not result.peaks:
        return None
    unit, top = data.unit, max(p.measured_v for p in result.peaks)
    columns: tuple[Column[Deviation], ...] = (
        Column("experiment", lambda d: d[0].experiment, role="name"),
        Column(
            "tone",
            lambda d: d[0].frequency_hz,
            unit="Hz",
            digits=10,
            size=max(p.frequency_hz for p in result.peaks),
        ),
        Column("measured z*", lambda d: d[0].measured_v, unit=unit, digits=5, size=top),
        Column("σ", lambda d: d[0].sigma_v, unit=unit, digits=2, size=top),
        Column("simulated before", lambda d: d[0].initial_v, unit=unit, digits=5, size=top),
        Column("simulated after", lambda d: d[0].final_v, unit=unit, digits=5, size=top),
        Column("deviation before", lambda d: d[1], digits=3),
        Column("deviation after", lambda d: d[2], digits=3),
        Column("after / before", lambda d: _percent(d[1], d[2]), unit="%", digits=3),
        Column("residual after", lambda d: _sigmas(d[0]), unit="σ", digits=3),
    )
    before, after = result.deviations.initial.per_peak, result.deviations.final.per_peak
    return tabulate(
        "Peaks: measured and simulated amplitudes, relative deviations",
        columns,
        zip(result.peaks, before, after, strict=True),
        OF_ALGORITHM_2,
    )


def _sigmas(peak: Peak) -> float:
    return (peak.final_v - peak.measured_v) / peak.sigma_v if peak.sigma_v > 0.0 else math.nan


MEANS: tuple[Column[Mean], ...] = (
    Column("experiment", lambda mean: mean[0], role="name"),
    Column("before", lambda mean: mean[1], digits=4),
    Column("after", lambda mean: mean[2], digits=4),
    Column("after / before", lambda mean: _percent(mean[1], mean[2]), unit="%", digits=3),
)


def mean_deviation_table(result: Result, data: ShownCampaign) -> Table:
    """Mean deviations per experiment and overall, before and after.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    first, last = result.deviations.initial, result.deviations.final
    labels = data.labels or ("curve",)
    means = [*zip(labels, first.per_experiment, last.per_experiment, strict=False)]
    if len(means) > 1:
        means.append(("all", first.mean, last.mean))
    return tabulate("Mean relative deviation", MEANS, means, OF_ALGORITHM_2)
