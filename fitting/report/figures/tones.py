"""Figures of two-tone experiments: the drive, how far simulated peaks are off."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from fitting.measurements.figure import Figure as Described
from fitting.report.figures.simulate import CARRIERS, beats_s, drive_envelope, drive_periods
from fitting.report.figures.style import (
    AFTER,
    BAND,
    GREY,
    PALE,
    axes_of,
    described,
    experiment_handles,
    handles_of,
    ink,
    label_experiments,
    legend_below,
    log_axis,
    marker_of,
    new_figure,
    plain_ticks,
    say_empty,
    short,
)
from fitting.report.shown import ShownCampaign, ShownTones
from fitting.result.result import Peak, Result
from fitting.text.notation import listed, number, prefixed, scaling_for, sign, signed

DRIVE, OVER_FREQUENCY, IMPROVEMENT = "drive", "deviation_over_frequency", "improvement"
PER_EXPERIMENT = "deviation_per_experiment"
#: Drives drawn one below the other: a figure is to stay readable.
MOST_DRIVES = 8
LONGEST_LABEL = 10


def draw_drive(result: Result, data: ShownCampaign) -> Described:
    """The drive of every experiment over time: envelope of its beating, and a close-up of it.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    shown = data.tones[:MOST_DRIVES]
    beats = [_beat_words(experiment) for experiment in shown]
    words = described(DRIVE, shown=shown, total=len(data.tones), periods=CARRIERS, beats=beats)
    height = 1.6 + max(2.2, 0.72 * len(shown))
    figure = new_figure(words.title, data.title, synthetic=data.synthetic, height=height)
    grid = figure.add_gridspec(len(shown), 2, width_ratios=(2.1, 1.0))
    first: Axes | None = None
    for i, experiment in enumerate(shown):
        axes = figure.add_subplot(grid[i, 0], sharex=first, sharey=first)
        first = first or axes
        drive_envelope(experiment, span_s=beats_s(shown), ax=axes)
        label = short(experiment.label, LONGEST_LABEL)
        axes.set_title(f"{label}: {beats[i]}", loc="left", fontsize=8, pad=3)
        axes.set_ylabel("")
        if i < len(shown) - 1:
            axes.set_xlabel("")
            axes.tick_params(labelbottom=False)
    figure.supylabel(f"drive {data.drive}(t), in the FMU's unit", x=0.008, fontsize=9)
    close = drive_periods(shown[0], ax=figure.add_subplot(grid[:, 1]))
    close.set_ylabel("")
    label = short(shown[0].label, LONGEST_LABEL)
    close.set_title(f"close-up of {label}", loc="left", fontsize=8)
    return replace(words, drawn=figure)


def _beat_words(experiment: ShownTones) -> str:
    tones = experiment.tones_hz
    factor, unit = prefixed(max(tones), "Hz")
    decimals = max(len(f"{tone / factor:.9g}".partition(".")[2]) for tone in tones)
    words = f"{listed(f'{tone / factor:.{decimals}f}' for tone in tones)} {unit}"
    if len(tones) != 2 or tones[0] == tones[1]:
        return words
    gap = abs(tones[1] - tones[0])
    period, period_unit = prefixed(1.0 / gap, "s")
    return f"{words}, beats every {1.0 / gap / period:.4g} {period_unit} ({gap:.6g} Hz)"


def draw_over_frequency(result: Result, data: ShownCampaign) -> Described:
    """Relative deviation |chi z - z*|/z* of every peak over its frequency, before and after.

    The range through which a drifting variable moved is shaded where it lies among the drive
    frequencies.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    shaded = list(drift_among([p.frequency_hz for p in result.peaks], data.drift_hz))
    words = described(OVER_FREQUENCY, result=result, shaded=shaded)
    figure = new_figure(words.title, data.title, synthetic=data.synthetic, height=4.7)
    axes = deviations(result, drift_hz=data.drift_hz, ax=figure.subplots())
    legend_below(figure, [*handles_of(axes), *experiment_handles(data.labels)], ncols=4)
    return replace(words, drawn=figure)


def draw_improvement(result: Result, data: ShownCampaign) -> Described:
    """Final deviation in percent of the initial one, for every tone.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    shares, overall = improvement_percent(result), mean_improvement_percent(result)
    worse = sum(1 for share in shares if math.isfinite(share) and share > 100.0)
    words = described(IMPROVEMENT, count=len(shares), worse=worse, overall=overall)
    figure = new_figure(words.title, data.title, synthetic=data.synthetic, height=4.3)
    axes = improvement(result, ax=figure.subplots())
    legend_below(figure, [*handles_of(axes), *experiment_handles(data.labels)], ncols=4)
    return replace(words, drawn=figure)


def draw_per_experiment(result: Result, data: ShownCampaign) -> Described:
    """Deviation of every peak by experiment, with error bars, and the residuals in their sigmas.

    Error bars are sigma/z*; the lower panel is (chi z - z*)/sigma, so that one wrong peak stands
    out however large the deviations are.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    sigmas = residuals_in_sigmas(result)
    words = described(
        PER_EXPERIMENT,
        result=result,
        count=len(sigmas),
        beyond=len(notable(sigmas)),
        notable=NOTABLE_SIGMA,
        worst=_worst_words(result, sigmas),
    )
    figure = new_figure(words.title, data.title, synthetic=data.synthetic, height=5.8)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1.0))
    deviations_by_experiment(result, ax=upper)
    residuals(result, ax=lower)
    upper.tick_params(labelbottom=False)
    legend_below(figure, [*handles_of(upper), *handles_of(lower)], ncols=3)
    return replace(words, drawn=figure)


def _worst_words(result: Result, residuals: list[float]) -> str:
    known = [k for k, r in enumerate(residuals) if math.isfinite(r)]
    if not known:
        return "The standard deviations of the peaks are not known."
    worst = max(known, key=lambda k: abs(residuals[k]))
    peak = result.peaks[worst]
    value = signed(residuals[worst], 1)
    factor, unit = prefixed(peak.frequency_hz, "Hz")
    where = f"{peak.frequency_hz / factor:.9g} {unit} of {peak.experiment}"
    return f"The largest residual is {value} σ, at {where}."


#: Means this far apart are drawn on a logarithmic axis, or the lesser could not be seen.
FAR_APART = 30.0
#: Residuals beyond this many standard deviations get their value written beside them.
NOTABLE_SIGMA = 5.0
MOST_NOTES = 10
#: Shift of "before" and "after" of one peak within its experiment's column.
ASIDE = 0.09
#: Ratios of deviations are drawn on a logarithmic axis from this one on, in percent.
FAR_WORSE = 300.0


def deviations(
    result: Result,
    *,
    drift_hz: Mapping[str, tuple[float, float]] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw the relative deviation |χz − z*|/z* of every peak over its frequency.

    Before the fit open, after it filled, both joined; dashed lines are the means. The marker shape
    marks the experiment.

    Args:
        result: a reconstruction with peaks.
        drift_hz: frequencies (before, after the series) of drifting variables, Hz, by name; those
            that lie among the tones are shaded.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes, places = axes_of(ax), _places(result)
    tones = [p.frequency_hz for p in result.peaks]
    along = scaling_for(tones, "Hz")
    for peak, before, after in _pairs(result):
        x, marker = along(peak.frequency_hz), marker_of(places[peak.experiment])
        axes.plot([x, x], [before, after], color=PALE, linewidth=1.0, zorder=1)
        axes.plot(x, before, **_before(axes, marker))
        axes.plot(x, after, **_after(marker))
    _draw_means(axes, result)
    for name, ends in drift_among(tones, drift_hz or {}).items():
        _shade_drift(axes, name, (along(ends[0]), along(ends[1])))
    axes.set_xlabel(along.label("drive frequency f"))
    axes.set_ylabel("relative deviation |χz − z*| / z*")
    plain_ticks(axes, x=8)
    _scale_deviations(axes, result)
    return axes


def improvement(result: Result, *, ax: Axes | None = None) -> Axes:
    """Draw the deviation after the fit in percent of the one before, for every peak.

    Args:
        result: a reconstruction with peaks; a peak that was matched exactly before has no point.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes, places = axes_of(ax), _places(result)
    along = scaling_for([p.frequency_hz for p in result.peaks], "Hz")
    shares = improvement_percent(result)
    for peak, share in zip(result.peaks, shares, strict=True):
        if math.isfinite(share):
            marker = marker_of(places[peak.experiment])
            axes.plot(along(peak.frequency_hz), share, **_after(marker))
    overall = mean_improvement_percent(result)
    if math.isfinite(overall):
        axes.axhline(
            overall,
            color=AFTER,
            linestyle="--",
            linewidth=1.1,
            label=f"ratio of the means: {number(overall, 3)} %",
        )
    axes.axhline(100.0, color=GREY, linestyle=":", linewidth=1.3, label="no change: 100 %")
    axes.set_xlabel(along.label("drive frequency f"))
    axes.set_ylabel("final / initial deviation (%)")
    plain_ticks(axes, x=8)
    finite = [s for s in shares if math.isfinite(s) and s > 0.0]
    if finite and max(finite) > FAR_WORSE:
        log_axis(axes)
    else:
        axes.set_ylim(0.0, 1.08 * max([100.0, *finite]))
    return axes


def improvement_percent(result: Result) -> list[float]:
    """100 final/initial deviation per peak; nan where a peak was matched exactly before.

    Args:
        result: of a reconstruction.
    """
    return [_share(before, after) for _, before, after in _pairs(result)]


def mean_improvement_percent(result: Result) -> float:
    """100 final/initial mean deviation; nan where all peaks were matched exactly before.

    Args:
        result: of a reconstruction.
    """
    return _share(result.deviations.initial.mean, result.deviations.final.mean)


def _share(before: float, after: float) -> float:
    return 100.0 * after / before if before > 0.0 else math.nan


def deviations_by_experiment(result: Result, *, ax: Axes | None = None) -> Axes:
    """Draw the relative deviation |χz − z*|/z* of every peak in the column of its experiment.

    Before the fit open, after it filled, error bars σ/z*; dashed lines are the means.

    Args:
        result: a reconstruction with peaks.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes, places = axes_of(ax), _places(result)
    for (peak, before, after), at in zip(_pairs(result), _columns(result), strict=True):
        marker = marker_of(places[peak.experiment])
        for value, aside, look in (
            (before, -ASIDE, _before(axes, marker)),
            (after, ASIDE, _after(marker)),
        ):
            sigma = _relative_sigma(peak)
            bar = axes.errorbar(  # an absolute value has nothing below zero
                at + aside,
                value,
                yerr=[[min(sigma, value)], [sigma]],
                ecolor=look["color"],
                capsize=2.5,
                elinewidth=1.0,
                **look,
            )
            for part in (*bar.lines[1], *bar.lines[2]):
                part.set_clip_on(True)  # the marker may lie on the axis, the bar not beyond it
    _draw_means(axes, result)
    axes.set_ylabel("relative deviation\n|χz − z*| / z*")
    plain_ticks(axes)
    _scale_deviations(axes, result, with_errors=True)
    label_experiments(axes, list(places))
    return axes


def residuals(result: Result, *, ax: Axes | None = None) -> Axes:
    """Draw what the fit leaves of every peak, (χz − z*)/σ, in the column of its experiment.

    The band is ±2; values beyond 5 are written next to their points.

    Args:
        result: a reconstruction with peaks; those without a standard deviation have no point.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes, places = axes_of(ax), _places(result)
    x, left = _columns(result), residuals_in_sigmas(result)
    axes.axhspan(
        -2.0,
        2.0,
        color=GREY,
        alpha=BAND,
        linewidth=0.0,
        zorder=0,
        label="±2 σ of the measured peak",
    )
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    known = [r for r in left if math.isfinite(r)]
    if not known:
        say_empty(axes, "no standard deviations given for these peaks")
    for peak, at, residual in zip(result.peaks, x, left, strict=True):
        if math.isfinite(residual):
            axes.vlines(at, 0.0, residual, color=AFTER, linewidth=1.0)
            axes.plot(at, residual, **_after(marker_of(places[peak.experiment])))
    limit = 1.3 * max([3.5, *(abs(r) for r in known)])
    axes.set_ylim(-limit, limit)
    axes.set_ylabel("residual after the fit\n(χz − z*) / σ")
    plain_ticks(axes)
    for k in notable(left)[:MOST_NOTES]:
        above = left[k] > 0.0
        axes.annotate(
            signed(left[k], 1),
            (x[k], left[k]),
            ha="center",
            va="bottom" if above else "top",
            xytext=(0.0, 6.0 if above else -6.0),
            textcoords="offset points",
            fontsize="small",
        )
    label_experiments(axes, list(places))
    return axes


def residuals_in_sigmas(result: Result) -> list[float]:
    """(chi z - z*)/sigma per peak after the fit; nan where sigma is not known.

    Args:
        result: of a reconstruction.
    """
    return [
        (p.final_v - p.measured_v) / p.sigma_v if p.sigma_v > 0.0 else math.nan
        for p in result.peaks
    ]


def notable(residuals: Sequence[float]) -> list[int]:
    """Places of residuals beyond the notable number of sigmas, worst first.

    Args:
        residuals: one per point, relative.
    """
    result = [k for k, r in enumerate(residuals) if math.isfinite(r) and abs(r) > NOTABLE_SIGMA]
    return sorted(result, key=lambda k: -abs(residuals[k]))


def drift_among(
    tones_hz: Sequence[float], drift_hz: Mapping[str, tuple[float, float]]
) -> dict[str, tuple[float, float]]:
    """Drifting frequencies that lie among the tones or within their range of them.

    Args:
        tones_hz: frequencies of the tones, Hz.
        drift_hz: range of the drift of each value, Hz.
    """
    margin = max(max(tones_hz) - min(tones_hz), 1e-9 * max(tones_hz))
    low, high = min(tones_hz) - margin, max(tones_hz) + margin
    return {n: ends for n, ends in drift_hz.items() if low <= min(ends) and max(ends) <= high}


def _pairs(result: Result) -> list[tuple[Peak, float, float]]:
    """Every peak with its deviations before and after."""
    before, after = result.deviations.initial.per_peak, result.deviations.final.per_peak
    return list(zip(result.peaks, before, after, strict=True))


def _places(result: Result) -> dict[str, int]:
    """Number of every experiment, in the order of their peaks."""
    names = dict.fromkeys(p.experiment for p in result.peaks)
    return {name: i for i, name in enumerate(names)}


def _columns(result: Result) -> list[float]:
    """x of every peak: the experiment's column, its tones spread within."""
    places = _places(result)
    counts = dict.fromkeys(places, 0)
    for peak in result.peaks:
        counts[peak.experiment] += 1
    observed, x = dict.fromkeys(places, 0), []
    for peak in result.peaks:
        count = counts[peak.experiment]
        step = 0.5 / max(1, count - 1)
        x.append(places[peak.experiment] + (observed[peak.experiment] - 0.5 * (count - 1)) * step)
        observed[peak.experiment] += 1
    return x


def _relative_sigma(peak: Peak) -> float:
    return peak.sigma_v / peak.measured_v if peak.sigma_v > 0.0 else 0.0


def _before(axes: Axes, marker: str) -> dict[str, Any]:
    look = _after(marker) | {"color": ink(), "markeredgecolor": ink(), "zorder": 3}
    return look | {"markerfacecolor": axes.get_facecolor()}


def _after(marker: str) -> dict[str, Any]:
    return {
        "linestyle": "none",
        "marker": marker,
        "color": AFTER,
        "markerfacecolor": AFTER,
        "markeredgecolor": AFTER,
        "markersize": 6.5,
        "zorder": 4,
        "clip_on": False,
    }


def _draw_means(axes: Axes, result: Result) -> None:
    """Dashed mean lines, their numbers in the legend next to the marker that they belong to."""
    for colour, face, deviation, when in (
        (ink(), axes.get_facecolor(), result.deviations.initial, "before"),
        (AFTER, AFTER, result.deviations.final, "after"),
    ):
        axes.axhline(deviation.mean, color=colour, linestyle="--", linewidth=1.1, zorder=2)
        axes.plot(
            [],
            [],
            color=colour,
            linestyle="--",
            marker="o",
            markersize=5.5,
            markerfacecolor=face,
            label=f"{when}, mean {number(deviation.mean, 3)}",
        )


def _scale_deviations(axes: Axes, result: Result, *, with_errors: bool = False) -> None:
    """From zero, or logarithmic where the fit made the deviations vanish on that scale."""
    before, after = result.deviations.initial, result.deviations.final
    positive = [v for v in (*before.per_peak, *after.per_peak) if v > 0.0]
    means = sorted((before.mean, after.mean))
    if positive and 0.0 < FAR_APART * means[0] < means[1]:
        log_axis(axes)
        for line in axes.lines:  # zero lies a thousand decades below: a peak matched exactly
            if not np.all(np.asarray(line.get_ydata()) > 0.0):
                line.set_clip_on(True)
        return
    errors = max(map(_relative_sigma, result.peaks), default=0.0) if with_errors else 0.0
    axes.set_ylim(0.0, 1.1 * (max(positive, default=1.0) + errors))


def _shade_drift(axes: Axes, name: str, ends: tuple[float, float]) -> None:
    """Shade the range of a drifting variable, an arrow in the direction of its drift."""
    axes.axvspan(
        *ends, color=GREY, alpha=BAND, linewidth=0.0, zorder=0, label=f"drift of {sign(name)}"
    )
    axes.annotate(
        "",
        (ends[1], 0.97),
        (ends[0], 0.97),
        xycoords=("data", "axes fraction"),
        arrowprops={"arrowstyle": "->", "color": GREY},
    )
