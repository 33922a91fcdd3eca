"""Figures of what was done and measured: the drive, the spectra, the frequency response."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from fitting.campaign import BoundCampaign, Experiment, SweepData
from fitting.fit.result import Peak, Result, SweepCurves
from fitting.report.figures.style import (
    BLACK,
    GREY,
    MEASURED,
    PALE,
    SIMULATED,
    Drawing,
    marker_of,
    new_figure,
    plain_ticks,
    short,
)
from fitting.signal.peaks import Resonance, fit_resonance
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import (
    Scaling,
    listed,
    number,
    percent,
    prefixed,
    scaling_for,
    with_error,
)

#: Drives drawn one below the other, and spectra side by side; a figure is to stay readable.
MOST_DRIVES, MOST_SPECTRA, SPECTRA_PER_ROW = 8, 20, 5
#: Beats of the slowest drive that are shown, and carrier periods in the close-up.
LONGEST_LABEL = 10
BEATS, CARRIERS = 2.0, 8.0
ENVELOPE_POINTS = 1500


def draw_drive(result: Result, bound: BoundCampaign) -> Drawing:
    """The drive of every experiment over time: envelope of its beating, and a close-up of it.

    b(t) = sum_k A_k cos 2 pi u_k t has the envelope |sum_k A_k exp(2 pi i (u_k - u_1) t)|.
    """
    shown = bound.experiments[:MOST_DRIVES]
    title = "Drive over time"
    height = 1.6 + max(2.2, 0.72 * len(shown))
    figure = new_figure(title, bound.title, synthetic=bound.synthetic, height=height)
    span, carrier = _drive_span_s(shown), CARRIERS / max(shown[0].tones_hz)
    grid = figure.add_gridspec(len(shown), 2, width_ratios=(2.1, 1.0))
    factor, unit = prefixed(span, "s")
    time = np.linspace(0.0, span, ENVELOPE_POINTS)
    first: Axes | None = None
    for i, experiment in enumerate(shown):
        axes = figure.add_subplot(grid[i, 0], sharex=first, sharey=first)
        first = first or axes
        envelope = _envelope(experiment, bound, time)
        axes.fill_between(time / factor, -envelope, envelope, color=SIMULATED, linewidth=0.0)
        label = short(experiment.label, LONGEST_LABEL)
        axes.set_title(f"{label}: {_beat_words(experiment)}", loc="left", fontsize=8, pad=3)
        axes.set_xlim(0.0, span / factor)
        axes.tick_params(labelbottom=i == len(shown) - 1)
    if first is not None:
        first.figure.axes[-1].set_xlabel(f"time t ({unit})")
    figure.supylabel(_drive_label(bound), fontsize=9)
    _close_up(figure.add_subplot(grid[:, 1]), shown[0], bound, carrier)
    rest = len(bound.experiments) - len(shown)
    left_out = f" The first {len(shown)} of {len(bound.experiments)} are shown." if rest else ""
    caption = (
        "Drive of each experiment. Left: envelope of its oscillation, filled because the carrier "
        f"is far too fast to be seen; right: the first {CARRIERS:g} periods of {shown[0].label}. "
        "Tones of equal amplitude beat with their frequency difference: whole beats must fit into "
        "the observation window. Phases are drawn as zero at t = 0." + left_out
    )
    alt = (
        "Envelopes of the drive: " + "; ".join(f"{e.label}: {_beat_words(e)}" for e in shown) + "."
    )
    return Drawing("1_drive", title, caption, alt, figure)


def _drive_span_s(experiments: Sequence[Experiment]) -> float:
    gaps = [max(e.tones_hz) - min(e.tones_hz) for e in experiments if len(e.tones_hz) > 1]
    gaps = [gap for gap in gaps if gap > 0.0]
    return BEATS / min(gaps) if gaps else 20.0 / min(max(e.tones_hz) for e in experiments)


def _amplitudes(experiment: Experiment, bound: BoundCampaign) -> list[float]:
    names = bound.setup.drive.amplitudes or ("",) * len(experiment.tones_hz)
    named = zip(names, experiment.tones_hz, strict=False)
    return [float(experiment.settings.get(name, bound.setup.drive.level)) for name, _ in named]


def _envelope(experiment: Experiment, bound: BoundCampaign, time_s: FloatArray) -> FloatArray:
    tones = experiment.tones_hz
    waves = [
        amplitude * np.exp(2j * np.pi * (tone - tones[0]) * time_s)
        for tone, amplitude in zip(tones, _amplitudes(experiment, bound), strict=False)
    ]
    return np.asarray(np.abs(np.sum(waves, axis=0)), dtype=float)


def _close_up(axes: Axes, experiment: Experiment, bound: BoundCampaign, span_s: float) -> None:
    time = np.linspace(0.0, span_s, 1200)
    pairs = zip(experiment.tones_hz, _amplitudes(experiment, bound), strict=False)
    wave = np.sum([a * np.cos(2.0 * np.pi * tone * time) for tone, a in pairs], axis=0)
    factor, unit = prefixed(span_s, "s")
    axes.plot(time / factor, wave, color=SIMULATED, linewidth=1.0)
    envelope = _envelope(experiment, bound, time)
    axes.plot(time / factor, envelope, color=BLACK, linewidth=0.9, linestyle="--")
    axes.plot(time / factor, -envelope, color=BLACK, linewidth=0.9, linestyle="--")
    label = short(experiment.label, LONGEST_LABEL)
    axes.set_title(f"close-up of {label}", loc="left", fontsize=8)
    axes.set_xlabel(f"time t ({unit})")
    axes.set_xlim(0.0, span_s / factor)


def _drive_label(bound: BoundCampaign) -> str:
    name = bound.setup.drive.input or "b"
    return f"drive {name}(t), in the FMU's unit".replace("$", r"\$")


def _beat_words(experiment: Experiment) -> str:
    tones = experiment.tones_hz
    factor, unit = prefixed(max(tones), "Hz")
    decimals = max(len(f"{tone / factor:.9g}".partition(".")[2]) for tone in tones)
    words = f"{listed(f'{tone / factor:.{decimals}f}' for tone in tones)} {unit}"
    if len(tones) != 2 or tones[0] == tones[1]:
        return words
    gap = abs(tones[1] - tones[0])
    period, period_unit = prefixed(1.0 / gap, "s")
    return f"{words}, beats every {1.0 / gap / period:.4g} {period_unit} ({gap:.6g} Hz)"


def draw_spectra(result: Result, bound: BoundCampaign) -> Drawing:
    """Spectra as measured, and simulated amplitudes at the tones, before and after the fit."""
    shown = bound.experiments[:MOST_SPECTRA]
    columns = min(len(shown), SPECTRA_PER_ROW)
    blocks = math.ceil(len(shown) / columns)
    title = "Spectra, measured and simulated"
    figure = new_figure(
        title,
        bound.title,
        synthetic=bound.synthetic,
        height=1.3 + 4.3 * blocks,
        width=max(7.2, 2.05 * columns),
    )
    tones = [tone for e in shown for tone in e.read_hz]
    along = scaling_for(tones, "Hz")
    peaks = _peaks_by_experiment(result)
    top = _highest(shown, peaks, bound)
    up_factor, up_unit = prefixed(top, bound.amplitude_unit)
    up = Scaling(0.0, up_factor, up_unit)
    panels = figure.subplots(2 * blocks, columns, sharex=True, sharey=True, squeeze=False)
    for i, experiment in enumerate(shown):
        block, column = divmod(i, columns)
        for row, when in enumerate(("before", "after")):
            axes = panels[2 * block + row, column]
            _spectrum_panel(axes, experiment, peaks[experiment.label], i, when, (along, up))
            if row == 1:
                axes.set_xlabel(along.label("f"))
            if column == 0:
                axes.set_ylabel(up.label(f"{when}: amplitude"))
    _hide_unused(panels, len(shown), columns)
    low, high = min(tones), max(tones)
    margin = max(0.2 * (high - low), 1e-9 * high)
    panels[0, 0].set_xlim(along(low - margin), along(high + margin))
    panels[0, 0].set_ylim(0.0, up(1.12 * top))
    _spectra_legend(panels[0, 0])
    caption = _spectra_caption(result, bound, len(shown))
    first, last = result.deviations.initial.mean, result.deviations.final.mean
    alt = (
        f"A column per experiment ({listed(e.label for e in shown)}), above with the start "
        "parameters, below with the fitted ones: measured spectrum, simulated line at every drive "
        f"frequency. The mean deviation goes from {number(first, 3)} to {number(last, 3)}."
    )
    return Drawing("2_spectra", title, caption, alt, figure)


def _peaks_by_experiment(result: Result) -> dict[str, list[Peak]]:
    found: dict[str, list[Peak]] = {}
    for peak in result.peaks:
        found.setdefault(peak.experiment, []).append(peak)
    return found


def _highest(
    shown: Sequence[Experiment], peaks: dict[str, list[Peak]], bound: BoundCampaign
) -> float:
    heights = [
        value
        for experiment in shown
        for p in peaks[experiment.label]
        for value in (p.measured_v, p.initial_v, p.final_v)
    ]
    heights += [float(np.max(e.spectrum.amplitude_v)) for e in shown if e.spectrum is not None]
    return max(h for h in heights if math.isfinite(h))


def _spectrum_panel(
    axes: Axes,
    experiment: Experiment,
    peaks: Sequence[Peak],
    index: int,
    when: str,
    scales: tuple[Scaling, Scaling],
) -> None:
    """One experiment: trace, simulated stems, the difference at each peak as a black bar."""
    along, up = scales
    for tone in experiment.read_hz:
        axes.axvline(along(tone), color=PALE, linewidth=0.8, zorder=0)
    if experiment.spectrum is not None:
        trace = experiment.spectrum
        axes.plot(
            (trace.frequency_hz - along.offset) / along.factor,
            trace.amplitude_v / up.factor,
            color=MEASURED,
            linewidth=1.4,
        )
    x = [along(p.frequency_hz) for p in peaks]
    measured = [up(p.measured_v) for p in peaks]
    sigma = [up(p.sigma_v) if math.isfinite(p.sigma_v) else 0.0 for p in peaks]
    raw = [p.initial_v if when == "before" else p.final_v for p in peaks]
    simulated = [up(value) for value in raw]
    axes.vlines(x, 0.0, simulated, color=SIMULATED, linestyle=(0, (4, 2)), linewidth=1.3)
    axes.vlines(x, measured, simulated, color=BLACK, linewidth=1.8, zorder=7)
    axes.errorbar(
        x,
        measured,
        yerr=sigma,
        fmt="_",
        color=BLACK,
        markersize=9,
        elinewidth=0.9,
        capsize=2.5,
        zorder=5,
    )
    axes.plot(
        x,
        simulated,
        linestyle="none",
        marker=marker_of(index),
        markersize=5.0,
        markerfacecolor="white",
        markeredgecolor=SIMULATED,
        zorder=6,
    )
    gaps = [(s - p.measured_v) / p.measured_v for s, p in zip(raw, peaks, strict=True)]
    label = short(experiment.label, 22)
    words = [percent(g) for g in gaps]
    rows = [", ".join(words[k : k + 2]) for k in range(0, len(words), 2)]
    axes.set_title("\n".join([label, *rows]), fontsize=8)
    plain_ticks(axes, x=4)


def _hide_unused(panels: npt.NDArray[np.object_], used: int, columns: int) -> None:
    blocks = panels.shape[0] // 2
    for i in range(used, blocks * columns):
        block, column = divmod(i, columns)
        for row in (0, 1):
            panels[2 * block + row, column].set_visible(False)


def _spectra_legend(axes: Axes) -> None:
    style = {"linestyle": "none", "markersize": 6}
    trace = axes.plot([], [], color=MEASURED, linewidth=1.6)[0]
    line = axes.plot(
        [],
        [],
        color=SIMULATED,
        linestyle=(0, (4, 2)),
        linewidth=1.4,
        marker="o",
        markerfacecolor="white",
        markersize=5,
    )[0]
    gap = axes.plot([], [], color=BLACK, linewidth=2.6)[0]
    peak = axes.plot([], [], color=BLACK, marker="_", **style)[0]  # type: ignore[arg-type]
    axes.figure.legend(
        [trace, peak, line, gap],
        ["measured spectrum", "measured peak ± σ, floor removed", "simulated × χ", "difference"],
        loc="outside lower center",
        ncols=4,
    )


def _spectra_caption(result: Result, bound: BoundCampaign, shown: int) -> str:
    floors = [e.floor_v for e in bound.experiments if math.isfinite(e.floor_v) and e.floor_v > 0]
    floor = ""
    if floors:
        factor, unit = prefixed(max(floors), bound.amplitude_unit)
        low, high = min(floors) / factor, max(floors) / factor
        span = f"{number(low, 2)} to {number(high, 2)} {unit}"
        floor = f" The noise floor (mean magnitude {span}) is in the trace."
    left_out = ""
    if shown < len(bound.experiments):
        left_out = f" The first {shown} of {len(bound.experiments)} experiments are shown."
    return (
        "Spectra measured (solid) and amplitudes simulated at the drive frequencies (dashed), "
        "scaled by χ of Algorithm 1: above with the start parameters, below with the fitted ones. "
        "Black bars join measured and simulated peak; the difference relative to the measured peak "
        "stands above each panel, in the order of the tones. Vertical lines are the drive "
        f"frequencies.{floor}{left_out}"
    )


def draw_response(result: Result, bound: BoundCampaign) -> Drawing:
    """The laboratory's frequency response with its resonance fit, and the simulated sweep."""
    sweep, curves = bound.sweep, result.sweep
    if sweep is None or curves is None:
        raise ValueError("a campaign without a sweep has no frequency response to draw")
    fit, why = _lorentzian(sweep)
    title = "Frequency response: laboratory, resonance fit, simulation"
    figure = new_figure(title, bound.title, synthetic=bound.synthetic, height=5.2)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.6, 1.0))
    along = scaling_for(curves.frequency_hz, "Hz")
    factor, unit = prefixed(max(curves.measured_v), sweep.unit)
    f = (np.array(curves.frequency_hz) - along.offset) / along.factor
    measured = np.array(curves.measured_v) / factor
    upper.plot(f, measured, "o", color=MEASURED, markersize=3.2, label="laboratory")
    upper.plot(
        f,
        np.array(curves.initial_v) / factor,
        color=GREY,
        linestyle=":",
        linewidth=1.5,
        label="simulated × χ, start parameters",
    )
    if fit is not None:
        upper.plot(f, fit.curve / factor, color=BLACK, linewidth=1.0, label="resonance fit")
    upper.plot(
        f,
        np.array(curves.final_v) / factor,
        color=SIMULATED,
        linestyle=(0, (5, 2)),
        linewidth=1.8,
        label="simulated × χ, fitted parameters",
    )
    upper.set_ylabel(f"amplitude ({unit})" if unit else "amplitude")
    upper.set_ylim(0.0, 1.08 * max(*curves.measured_v, *curves.final_v) / factor)
    upper.legend(loc="upper left")
    if fit is not None:
        upper.text(
            0.985,
            0.96,
            "\n".join(["resonance fit:", *_fit_words(fit)]),
            ha="right",
            va="top",
            transform=upper.transAxes,
            fontsize=8,
            linespacing=1.5,
        )
    _residual_panel(lower, f, curves, fit)
    lower.set_xlabel(along.label("drive frequency f"))
    plain_ticks(upper, x=8)
    plain_ticks(lower, x=8, y=4)
    caption, alt = _response_words(result, sweep, curves, fit, why)
    return Drawing("8_frequency_response", title, caption, alt, figure)


def _lorentzian(sweep: SweepData) -> tuple[Resonance | None, str]:
    """The fit of one damped mode, or why there is none."""
    try:
        return fit_resonance(
            sweep.frequency_hz,
            sweep.amplitude_v,
            background=sweep.background,
            source=sweep.source.name,
        ), ""
    except BadInput as error:
        return None, str(error)


def _fit_words(fit: Resonance) -> list[str]:
    return [
        f"η = {with_error(fit.eta_hz, fit.eta_std_hz, 'Hz')}",
        f"full width = {with_error(fit.width_hz, fit.width_std_hz, 'Hz')}",
        f"Q = {with_error(fit.q, fit.q_std)}",
    ]


def _residual_panel(axes: Axes, f: FloatArray, curves: SweepCurves, fit: Resonance | None) -> None:
    measured = np.array(curves.measured_v)
    top = float(np.max(measured))
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    if fit is not None:
        axes.plot(
            f,
            100.0 * (fit.curve - measured) / top,
            color=BLACK,
            linewidth=0.9,
            label="resonance fit",
        )
    axes.plot(
        f,
        100.0 * (np.array(curves.final_v) - measured) / top,
        color=SIMULATED,
        marker="o",
        markersize=2.6,
        linestyle="none",
        label="simulated",
    )
    axes.set_ylabel("minus laboratory\n(% of maximum)")


def _response_words(
    result: Result, sweep: SweepData, curves: SweepCurves, fit: Resonance | None, why: str
) -> tuple[str, str]:
    measured, final = np.array(curves.measured_v), np.array(curves.final_v)
    rms = float(np.sqrt(np.mean(((final - measured) / np.max(measured)) ** 2)))
    role = "is fitted point by point" if sweep.use == "fit" else "sets the scale χ only"
    kind = {
        "maximum": "from the ratio of the maxima",
        "fit": "by least squares",
        "robust": "by Huber's estimate",
        "free": "fitted with the rest",
    }
    how = kind.get(result.scale.kind, "not scaled")
    caption = (
        f"Frequency response as measured ({len(measured)} points), which {role} (χ {how}), and as "
        "simulated with the start and with the fitted parameters. Below: differences from the "
        f"laboratory; those of the simulation have an rms of {100 * rms:.2g} % of the maximum."
    )
    if fit is None:
        caption += f" One damped mode could not be fitted to it: {why}."
    else:
        caption += (
            " The fit of one damped mode to the laboratory points gives "
            f"{', '.join(_fit_words(fit))}; its residual is {100 * fit.residual_rms:.2g} % of its "
            "amplitude."
        )
    alt = f"Resonance curve with {len(measured)} measured points and the simulated curve" + (
        f"; {', '.join(_fit_words(fit))}." if fit is not None else "."
    )
    return caption, alt
