"""Figures of two-tone experiments: the drive, how far simulated peaks are off."""

from __future__ import annotations

import math

from matplotlib.axes import Axes

from fitting.report import plot
from fitting.report.figures.numbers import DRIVE, IMPROVEMENT, OVER_FREQUENCY, PER_EXPERIMENT
from fitting.report.figures.style import (
    Drawing,
    handles_of,
    legend_below,
    new_figure,
)
from fitting.report.plot.axes import experiment_handles, short
from fitting.report.plot.simulate import CARRIERS, beats_s
from fitting.report.plot.tones import (
    NOTABLE_SIGMA,
    drift_among,
    improvement_percent,
    mean_improvement_percent,
    notable,
    residuals_in_sigmas,
)
from fitting.report.shown import ShownCampaign, ShownTones
from fitting.result.result import Compared, Deviations
from fitting.text.notation import listed, number, prefixed, signed

#: Drives drawn one below the other: a figure is to stay readable.
MOST_DRIVES = 8
LONGEST_LABEL = 10


def draw_drive(result: Compared, data: ShownCampaign) -> Drawing:
    """The drive of every experiment over time: envelope of its beating, and a close-up of it.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    shown = data.tones[:MOST_DRIVES]
    title = "Drive over time"
    height = 1.6 + max(2.2, 0.72 * len(shown))
    figure = new_figure(title, data.title, synthetic=data.synthetic, height=height)
    grid = figure.add_gridspec(len(shown), 2, width_ratios=(2.1, 1.0))
    first: Axes | None = None
    for i, experiment in enumerate(shown):
        axes = figure.add_subplot(grid[i, 0], sharex=first, sharey=first)
        first = first or axes
        plot.drive_envelope(experiment, span_s=beats_s(shown), ax=axes)
        label = short(experiment.label, LONGEST_LABEL)
        axes.set_title(f"{label}: {_beat_words(experiment)}", loc="left", fontsize=8, pad=3)
        axes.set_ylabel("")
        if i < len(shown) - 1:
            axes.set_xlabel("")
            axes.tick_params(labelbottom=False)
    figure.supylabel(f"drive {data.drive}(t), in the FMU's unit".replace("$", r"\$"), fontsize=9)
    close = plot.drive_periods(shown[0], ax=figure.add_subplot(grid[:, 1]))
    close.set_ylabel("")
    label = short(shown[0].label, LONGEST_LABEL)
    close.set_title(f"close-up of {label}", loc="left", fontsize=8)
    rest = len(data.tones) - len(shown)
    left_out = f" The first {len(shown)} of {len(data.tones)} are shown." if rest else ""
    caption = (
        "Drive of each experiment. Left: envelope of its oscillation, filled because the carrier "
        f"is far too fast to be seen; right: the first {CARRIERS:g} periods of {shown[0].label}. "
        "Tones of equal amplitude beat with their frequency difference: whole beats must fit into "
        "the observation window. Phases are drawn as zero at t = 0." + left_out
    )
    alt = (
        "Envelopes of the drive: " + "; ".join(f"{e.label}: {_beat_words(e)}" for e in shown) + "."
    )
    return Drawing(name=DRIVE, title=title, caption=caption, alt=alt, figure=figure)


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


def draw_over_frequency(result: Compared, data: ShownCampaign) -> Drawing:
    """Relative deviation |chi z - z*|/z* of every peak over its frequency, before and after.

    The range through which a drifting variable moved is shaded where it lies among the drive
    frequencies.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    title = "Deviation over drive frequency"
    figure = new_figure(title, data.title, synthetic=data.synthetic, height=4.7)
    axes = plot.deviations(result, drift_hz=data.drift_hz, ax=figure.subplots())
    legend_below(figure, [*handles_of(axes), *experiment_handles(data.labels)], ncols=4)
    shaded = drift_among([p.frequency_hz for p in result.peaks], data.drift_hz)
    drift = ""
    if shaded:
        drift = f" Shaded: range of {listed(shaded)} during the series."
    caption = (
        "Relative deviation of simulated from measured amplitude at every drive frequency, with "
        "the start parameters (open) and the fitted ones (filled); dashed: means "
        f"{_from_to(result.deviations)}. The marker shape tells the experiment.{drift}"
    )
    alt = (
        f"Relative deviations at {len(result.peaks)} drive frequencies before and after the fit; "
        f"means {_from_to(result.deviations)}."
    )
    return Drawing(name=OVER_FREQUENCY, title=title, caption=caption, alt=alt, figure=figure)


def draw_improvement(result: Compared, data: ShownCampaign) -> Drawing:
    """Final deviation in percent of the initial one, for every tone.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    title = "Improvement: deviation after the fit, in % of the one before"
    figure = new_figure(title, data.title, synthetic=data.synthetic, height=4.3)
    axes = plot.improvement(result, ax=figure.subplots())
    legend_below(figure, [*handles_of(axes), *experiment_handles(data.labels)], ncols=4)
    shares, overall = improvement_percent(result), mean_improvement_percent(result)
    worse = sum(1 for s in shares if math.isfinite(s) and s > 100.0)
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
    return Drawing(name=IMPROVEMENT, title=title, caption=caption, alt=alt, figure=figure)


def draw_per_experiment(result: Compared, data: ShownCampaign) -> Drawing:
    """Deviation of every peak by experiment, with error bars, and the residuals in their sigmas.

    Error bars are sigma/z*; the lower panel is (chi z - z*)/sigma, so that one wrong peak stands
    out however large the deviations are.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    title = "Deviation per experiment"
    figure = new_figure(title, data.title, synthetic=data.synthetic, height=5.8)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1.0))
    plot.deviations_by_experiment(result, ax=upper)
    plot.residuals(result, ax=lower)
    upper.tick_params(labelbottom=False)
    legend_below(figure, [*handles_of(upper), *handles_of(lower)], ncols=3)
    residuals = residuals_in_sigmas(result)
    beyond, worst = notable(residuals), _worst_words(result, residuals)
    caption = (
        "Deviation of every peak, tones in the order of the experiments file (left to right within "
        "an experiment): before the fit (open) and after it (filled), error bars one "
        "standard deviation of the measured peak. Below: what is left after the fit in units of "
        f"that standard deviation; band ±2. {worst}"
    )
    alt = (
        f"Deviations by experiment, means {_from_to(result.deviations)}; {len(beyond)} of "
        f"{len(residuals)} residuals beyond {NOTABLE_SIGMA:g} standard deviations. {worst}"
    )
    return Drawing(name=PER_EXPERIMENT, title=title, caption=caption, alt=alt, figure=figure)


def _worst_words(result: Compared, residuals: list[float]) -> str:
    known = [k for k, r in enumerate(residuals) if math.isfinite(r)]
    if not known:
        return "The standard deviations of the peaks are not known."
    worst = max(known, key=lambda k: abs(residuals[k]))
    peak = result.peaks[worst]
    value = signed(residuals[worst], 1)
    factor, unit = prefixed(peak.frequency_hz, "Hz")
    where = f"{peak.frequency_hz / factor:.9g} {unit} of {peak.experiment}"
    return f"The largest residual is {value} σ, at {where}."


def _from_to(deviations: Deviations) -> str:
    before, after = deviations.initial.mean, deviations.final.mean
    return f"{number(before, 3)} before, {number(after, 3)} after"
