"""Figures of how far simulated and measured peaks are apart: over frequency, per experiment."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from fitting.campaign import BoundCampaign
from fitting.fit.result import Peak, Result
from fitting.report.figures.style import (
    AFTER,
    BEFORE,
    GREY,
    PALE,
    Drawing,
    experiment_handles,
    label_experiments,
    legend_below,
    log_axis,
    marker_of,
    new_figure,
    plain_ticks,
)
from fitting.text.notation import Scaling, listed, mathtext, number, plain, prefixed, scaling_for
from fitting.text.units import convert

#: Means this far apart are drawn on a logarithmic axis, or the lesser could not be seen.
FAR_APART = 30.0
#: Residuals beyond this many standard deviations get their value written beside them.
NOTABLE_SIGMA = 5.0
MOST_NOTES = 10
#: Shift of "before" and "after" of one peak within its experiment's column.
ASIDE = 0.09


def draw_over_frequency(result: Result, bound: BoundCampaign) -> Drawing:
    """Relative deviation |chi z - z*|/z* of every peak over its frequency, before and after.

    The range through which a drifting variable moved is shaded where it lies among the drive
    frequencies.
    """
    title = "Deviation over drive frequency"
    figure = new_figure(title, bound.title, synthetic=bound.synthetic, height=4.7)
    axes = figure.subplots()
    places = _places(bound)
    along = scaling_for([p.frequency_hz for p in result.peaks], "Hz")
    pairs = zip(
        result.peaks,
        result.deviations.initial.per_peak,
        result.deviations.final.per_peak,
        strict=True,
    )
    for peak, before, after in pairs:
        x, marker = along(peak.frequency_hz), marker_of(places[peak.experiment])
        axes.plot([x, x], [before, after], color=PALE, linewidth=1.0, zorder=1)
        axes.plot(x, before, **_before(marker))
        axes.plot(x, after, **_after(marker))
    shaded = _shade_drift(axes, bound, along, [p.frequency_hz for p in result.peaks])
    means = _draw_means(axes, result)
    axes.set_xlabel(along.label("drive frequency f"))
    axes.set_ylabel("relative deviation |χz − z*| / z*")
    plain_ticks(axes, x=8)
    _scale_deviations(axes, result)
    legend_below(figure, [*means, *shaded.values(), *experiment_handles(_labels(bound))], ncols=4)
    drift = ""
    if shaded:
        drift = f" Shaded: range of {listed(map(plain, shaded))} during the series."
    caption = (
        "Relative deviation of simulated from measured amplitude at every drive frequency, with "
        "the start parameters (black, open) and the fitted ones (red, filled); dashed: means "
        f"{_from_to(result)}. The marker shape tells the experiment.{drift}"
    )
    alt = (
        f"Relative deviations at {len(result.peaks)} drive frequencies before and after the fit; "
        f"means {_from_to(result)}."
    )
    return Drawing("3_deviation_over_frequency", title, caption, alt, figure)


def draw_improvement(result: Result, bound: BoundCampaign) -> Drawing:
    """Final deviation in percent of the initial one, for every tone."""
    title = "Improvement: deviation after the fit, in % of the one before"
    figure = new_figure(title, bound.title, synthetic=bound.synthetic, height=4.3)
    axes = figure.subplots()
    places = _places(bound)
    along = scaling_for([p.frequency_hz for p in result.peaks], "Hz")
    shares = improvement_percent(result)
    for peak, share in zip(result.peaks, shares, strict=True):
        if math.isfinite(share):
            marker = marker_of(places[peak.experiment])
            axes.plot(along(peak.frequency_hz), share, **_after(marker))
    overall = _share(result.deviations.initial.mean, result.deviations.final.mean)
    handles: list[Artist] = []
    if math.isfinite(overall):
        handles.append(
            axes.axhline(
                overall,
                color=AFTER,
                linestyle="--",
                linewidth=1.1,
                label=f"ratio of the means: {number(overall, 3)} %",
            )
        )
    handles.append(
        axes.axhline(100.0, color=GREY, linestyle=":", linewidth=1.3, label="no change: 100 %")
    )
    axes.set_xlabel(along.label("drive frequency f"))
    axes.set_ylabel("final / initial deviation (%)")
    plain_ticks(axes, x=8)
    finite = [s for s in shares if math.isfinite(s) and s > 0.0]
    if finite and max(finite) > 300.0:
        log_axis(axes)
    else:
        axes.set_ylim(0.0, 1.08 * max([100.0, *finite]))
    legend_below(figure, [*handles, *experiment_handles(_labels(bound))], ncols=4)
    worse = sum(1 for s in finite if s > 100.0)
    caption = (
        "Deviation with the fitted parameters in percent of the deviation with the start "
        "parameters, for every tone: below 100 % the fit brought the peak closer. Of "
        f"{len(shares)} peaks {worse} {'lies' if worse == 1 else 'lie'} above it. The ratio of the "
        f"mean deviations is {number(overall, 3)} %."
    )
    alt = (
        f"Ratio of final to initial deviation for {len(shares)} peaks; ratio of the means "
        f"{number(overall, 3)} percent; {worse} above 100 percent."
    )
    return Drawing("4_improvement", title, caption, alt, figure)


def improvement_percent(result: Result) -> list[float]:
    """100 final/initial deviation per peak; nan where a peak was matched exactly before."""
    before, after = result.deviations.initial.per_peak, result.deviations.final.per_peak
    return [_share(b, a) for b, a in zip(before, after, strict=True)]


def _share(before: float, after: float) -> float:
    return 100.0 * after / before if before > 0.0 else math.nan


def draw_per_experiment(result: Result, bound: BoundCampaign) -> Drawing:
    """Deviation of every peak by experiment, with error bars, and the residuals in their sigmas.

    Error bars are sigma/z*; the lower panel is (chi z - z*)/sigma, so that one wrong peak stands
    out however large the deviations are.
    """
    title = "Deviation per experiment"
    figure = new_figure(title, bound.title, synthetic=bound.synthetic, height=5.8)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1.0))
    x = _columns(result, bound)
    places = _places(bound)
    pairs = zip(
        result.peaks,
        x,
        result.deviations.initial.per_peak,
        result.deviations.final.per_peak,
        strict=True,
    )
    for peak, at, before, after in pairs:
        marker = marker_of(places[peak.experiment])
        for value, aside, look in (
            (before, -ASIDE, _before(marker)),
            (after, ASIDE, _after(marker)),
        ):
            sigma = _relative_sigma(peak)
            bar = upper.errorbar(  # an absolute value has nothing below zero
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
    means = _draw_means(upper, result)
    upper.set_ylabel("relative deviation\n|χz − z*| / z*")
    plain_ticks(upper)
    _scale_deviations(upper, result, with_errors=True)
    residuals = residuals_in_sigmas(result)
    _sigma_panel(lower, result, x, residuals, places)
    label_experiments(lower, _labels(bound))
    legend_below(figure, [*means, _sigma_band()], ncols=3)
    beyond = _notable(residuals)
    worst = _worst_words(result, residuals)
    caption = (
        "Deviation of every peak, tones in the order of the experiments file (left to right within "
        "an experiment): before the fit (black, open) and after it (red, filled), error bars one "
        "standard deviation of the measured peak. Below: what is left after the fit in units of "
        f"that standard deviation; band ±2. {worst}"
    )
    alt = (
        f"Deviations by experiment, means {_from_to(result)}; {len(beyond)} of {len(residuals)} "
        f"residuals beyond {NOTABLE_SIGMA:g} standard deviations. {worst}"
    )
    return Drawing("7_deviation_per_experiment", title, caption, alt, figure)


def residuals_in_sigmas(result: Result) -> list[float]:
    """(chi z - z*)/sigma per peak after the fit; nan where sigma is not known."""
    return [
        (p.final_v - p.measured_v) / p.sigma_v if p.sigma_v > 0.0 else math.nan
        for p in result.peaks
    ]


def _columns(result: Result, bound: BoundCampaign) -> list[float]:
    """x of every peak: the experiment's column, its tones spread within."""
    places, seen = _places(bound), dict.fromkeys(_labels(bound), 0)
    counts = {e.label: len(e.read_hz) for e in bound.experiments}
    x = []
    for peak in result.peaks:
        count = counts[peak.experiment]
        step = 0.5 / max(1, count - 1)
        x.append(places[peak.experiment] + (seen[peak.experiment] - 0.5 * (count - 1)) * step)
        seen[peak.experiment] += 1
    return x


def _sigma_panel(
    axes: Axes,
    result: Result,
    x: Sequence[float],
    residuals: Sequence[float],
    places: Mapping[str, int],
) -> None:
    axes.set_ylabel("residual after the fit\n(χz − z*) / σ")
    axes.axhspan(-2.0, 2.0, color=PALE, alpha=0.6, linewidth=0.0, zorder=0)
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    known = [r for r in residuals if math.isfinite(r)]
    if not known:
        axes.text(
            0.5,
            0.75,
            "no standard deviations given for these peaks",
            ha="center",
            transform=axes.transAxes,
            color=GREY,
        )
    for peak, at, residual in zip(result.peaks, x, residuals, strict=True):
        if math.isfinite(residual):
            axes.vlines(at, 0.0, residual, color=AFTER, linewidth=1.0)
            axes.plot(at, residual, **_after(marker_of(places[peak.experiment])))
    limit = 1.3 * max([3.5, *(abs(r) for r in known)])
    axes.set_ylim(-limit, limit)
    plain_ticks(axes)
    for k in _notable(residuals)[:MOST_NOTES]:
        above = residuals[k] > 0.0
        axes.annotate(
            f"{residuals[k]:+.1f}".replace("-", "−"),
            (x[k], residuals[k]),
            ha="center",
            va="bottom" if above else "top",
            xytext=(0.0, 6.0 if above else -6.0),
            textcoords="offset points",
            fontsize=8,
        )


def _notable(residuals: Sequence[float]) -> list[int]:
    """Peaks beyond the notable number of sigmas, worst first."""
    found = [k for k, r in enumerate(residuals) if math.isfinite(r) and abs(r) > NOTABLE_SIGMA]
    return sorted(found, key=lambda k: -abs(residuals[k]))


def _worst_words(result: Result, residuals: Sequence[float]) -> str:
    known = [k for k, r in enumerate(residuals) if math.isfinite(r)]
    if not known:
        return "The standard deviations of the peaks are not known."
    worst = max(known, key=lambda k: abs(residuals[k]))
    peak = result.peaks[worst]
    value = f"{residuals[worst]:+.1f}".replace("-", "−")
    factor, unit = prefixed(peak.frequency_hz, "Hz")
    where = f"{peak.frequency_hz / factor:.9g} {unit} of {peak.experiment}"
    return f"The largest residual is {value} σ, at {where}."


def _relative_sigma(peak: Peak) -> float:
    return peak.sigma_v / peak.measured_v if peak.sigma_v > 0.0 else 0.0


def _labels(bound: BoundCampaign) -> list[str]:
    return [e.label for e in bound.experiments]


def _places(bound: BoundCampaign) -> dict[str, int]:
    return {label: i for i, label in enumerate(_labels(bound))}


def _before(marker: str) -> dict[str, Any]:
    return {
        "linestyle": "none",
        "marker": marker,
        "color": BEFORE,
        "markerfacecolor": "white",
        "markeredgecolor": BEFORE,
        "markersize": 6.5,
        "zorder": 3,
        "clip_on": False,
    }


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


def _draw_means(axes: Axes, result: Result) -> list[Artist]:
    """Dashed mean lines; their legend entries, each with the number."""
    drawn: list[Artist] = []
    both = (
        (BEFORE, result.deviations.initial, "before"),
        (AFTER, result.deviations.final, "after"),
    )
    for colour, deviations, when in both:
        axes.axhline(deviations.mean, color=colour, linestyle="--", linewidth=1.1, zorder=2)
        face = "white" if when == "before" else colour
        drawn.append(
            Line2D(
                [],
                [],
                color=colour,
                linestyle="--",
                marker="o",
                markersize=5.5,
                markerfacecolor=face,
                label=f"{when}, mean {number(deviations.mean, 3)}",
            )
        )
    return drawn


def _sigma_band() -> Artist:
    return Patch(facecolor=PALE, alpha=0.6, label="±2 σ of the measured peak")


def _scale_deviations(axes: Axes, result: Result, *, with_errors: bool = False) -> None:
    """From zero, or logarithmic where the fit made the deviations vanish on that scale."""
    before, after = result.deviations.initial, result.deviations.final
    positive = [v for v in (*before.per_peak, *after.per_peak) if v > 0.0]
    means = sorted((before.mean, after.mean))
    if positive and 0.0 < FAR_APART * means[0] < means[1]:
        log_axis(axes)
        return
    errors = max(map(_relative_sigma, result.peaks), default=0.0) if with_errors else 0.0
    axes.set_ylim(0.0, 1.1 * (max(positive, default=1.0) + errors))


def _shade_drift(
    axes: Axes, bound: BoundCampaign, along: Scaling, tones_hz: Sequence[float]
) -> dict[str, Artist]:
    """Shade the range of each drifting variable that lies among the tones; handles by name.

    Drifting variables are in the unit of the drive frequencies where they are frequencies at all;
    a temperature falls outside the picture.
    """
    margin = max(max(tones_hz) - min(tones_hz), 1e-9 * max(tones_hz))
    low, high = min(tones_hz) - margin, max(tones_hz) + margin
    shaded: dict[str, Artist] = {}
    for name, ends in bound.drift.ends.items():
        first, last = (convert(v, bound.setup.drive.frequency_unit, "Hz", where=name) for v in ends)
        if low <= min(first, last) and max(first, last) <= high:
            shaded[name] = axes.axvspan(
                along(first),
                along(last),
                color=PALE,
                alpha=0.75,
                linewidth=0.0,
                zorder=0,
                label=f"drift of {mathtext(name)}",
            )
            axes.annotate(
                "",
                (along(last), 0.97),
                (along(first), 0.97),
                xycoords=("data", "axes fraction"),
                arrowprops={"arrowstyle": "->", "color": GREY},
            )
    return shaded


def _from_to(result: Result) -> str:
    before, after = result.deviations.initial.mean, result.deviations.final.mean
    return f"{number(before, 3)} before, {number(after, 3)} after"
