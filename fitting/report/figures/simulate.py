"""Figures of what an FMU answers: one drive with its beating and spectrum, one moved tone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from fitting.measurements.figure import Figure as Described
from fitting.report.figures.style import (
    BAND,
    BLUE,
    GREEN,
    GREY,
    RED,
    SERIES_MARKERS,
    SIMULATED,
    axes_of,
    described,
    ink,
    log_axis,
    new_figure,
    plain_ticks,
    save,
    style,
)
from fitting.report.shown import ShownTones
from fitting.simulate.frf import SweepResponse
from fitting.simulate.response import COLUMN_SAMPLES, DriveResponse, MixedLine, Trace
from fitting.simulate.words import (
    difference_in_words,
    remainder_in_words,
    settling_in_words,
    spectrum_in_words,
)
from fitting.text.arrays import FloatArray
from fitting.text.notation import listed, number, power_of_ten, prefixed, scaling_for, sign

#: Lines at combinations of the tones that are marked.
MOST_MIXED = 4


def save_figures(
    result: DriveResponse, model: str, units: Sequence[str], folder: Path, mixed: Named = ()
) -> list[Path]:
    """Draw and write both figures; the files written.

    Args:
        result: of the drive.
        model: name of the model, for the titles.
        units: of the outputs, in their order.
        folder: where the files go.
        mixed: amplitudes at combinations of the tones, by name.
    """
    with style():
        drawings = draw_trace(result, model, units), draw_spectrum(result, model, units, mixed)
        saved = [save(drawing, folder, formats=("png",)) for drawing in drawings]
    return [figure.file(kind) for figure in saved for kind in ("png", "svg")]


def draw_trace(result: DriveResponse, model: str, units: Sequence[str]) -> Described:
    """The envelope over two beats, next to it some periods at the envelope's maximum.

    Args:
        result: of the drive.
        model: name of the model.
        units: of the outputs, in their order.
    """
    outputs, beats = _oscillating(result), result.beating is not None
    words = described(
        "trace",
        outputs=outputs,
        model=model,
        tones=_tones_text(result),
        beats=beats,
        words=f"{settling_in_words(result.plan)}. {remainder_in_words(result.remainder)}.",
    )
    height = 2.6 * len(outputs) + 0.6
    figure = new_figure(words.title, _subtitle(result, model), synthetic=False, height=height)
    ratios = (2.0, 1.0) if beats else None
    grid = figure.subplots(len(outputs), 1 + beats, squeeze=False, width_ratios=ratios)
    unit_of = dict(zip(result.drive.outputs, units, strict=True))
    for row, name in enumerate(outputs):
        if beats:
            beating(result, name, unit=unit_of[name], ax=grid[row, 0])
        periods(result, name, unit=unit_of[name], ax=grid[row, -1])
    return replace(words, drawn=figure)


def draw_spectrum(
    result: DriveResponse, model: str, units: Sequence[str], mixed: Named = ()
) -> Described:
    """Amplitudes over frequency, a panel per output, the tones labelled with their peaks.

    The first of the lines ``mixed``, at combinations of the tones, are marked by their names.

    Args:
        result: of the drive.
        model: name of the model.
        units: of the outputs, in their order.
        mixed: amplitudes at combinations of the tones, by name.
    """
    outputs = _oscillating(result)
    constants, spectrum = list(result.constants), spectrum_in_words(result.spectrum)
    words = described("spectrum", outputs=outputs, model=model, constants=constants, words=spectrum)
    height = 2.8 * len(outputs) + 0.6
    figure = new_figure(words.title, _subtitle(result, model), synthetic=False, height=height)
    grid = figure.subplots(len(outputs), 1, squeeze=False, sharex=True)
    unit_of = dict(zip(result.drive.outputs, units, strict=True))
    for axes, name in zip(grid[:, 0], outputs, strict=True):
        shown = mixed[:MOST_MIXED]
        amplitude_spectrum(result, name, unit=unit_of[name], mixed=shown, ax=axes)
        if shown:
            low, high = axes.get_ylim()
            axes.set_ylim(low, high * (high / low) ** 0.4)  # room for the longer legend
        axes.legend(loc="upper right", ncols=2 if shown else 1)
        axes.set_xlabel(axes.get_xlabel() if axes is grid[-1, 0] else "")
    return replace(words, drawn=figure)


def _oscillating(result: DriveResponse) -> list[str]:
    """Outputs that are drawn."""
    return [name for name in result.drive.outputs if name not in result.constants]


def _subtitle(result: DriveResponse, model: str) -> str:
    return f"{model}, driven at {_tones_text(result)}"


def _tones_text(result: DriveResponse) -> str:
    return listed(tone_text(tone) for tone in result.drive.tones_hz)


def save_frf(result: SweepResponse, model: str, unit: str, folder: Path) -> list[Path]:
    """Draw and write the figure; the files written.

    Args:
        result: of the sweep.
        model: name of the model.
        unit: of the values.
        folder: where the files go.
    """
    with style():
        figure = save(draw_frf(result, model, unit), folder, formats=("png",))
    return [figure.file("png"), figure.file("svg")]


def draw_frf(result: SweepResponse, model: str, unit: str) -> Described:
    """Amplitude over frequency, each way with a marker of its own.

    Args:
        result: of the sweep.
        model: name of the model.
        unit: of the values.
    """
    both = settling_in_words(result.plan), difference_in_words(result)
    sentences = " ".join(f"{text[0].upper()}{text[1:]}." for text in both)
    words = described("sweep", result=result, model=model, words=sentences)
    figure = new_figure(words.title, model, synthetic=False, height=3.4)
    swept_tone(result, unit=unit, ax=figure.subplots()).legend(loc="upper left")
    return replace(words, drawn=figure)


#: Lines at combinations of the tones, by name.
Named = Sequence[tuple[str, MixedLine]]

#: Beats of a drive that are shown, its periods in a close-up, points of a curve.
BEATS, CARRIERS = 2.0, 8.0
ENVELOPE_POINTS, CLOSE_UP_POINTS = 601, 401
#: A trace of fewer periods than this is drawn as a line: its periods can be seen.
MANY_PERIODS = 150
#: Lines of a spectrum up to which each is drawn as a stem.
MOST_STEMS = 1500
#: Decades of an axis above which its ticks are all powers of ten.
PLAIN_DECADES = 4.0
#: Points of a frequency response up to which each is marked.
MOST_MARKS = 81
FRF_LOOKS = {"up": (BLUE, "^", "-"), "down": (RED, "v", "--")}


def drive_envelope(
    experiment: ShownTones, *, span_s: float | None = None, ax: Axes | None = None
) -> Axes:
    """Draw the envelope |sum_k A_k exp(2 pi i (u_k - u_1) t)| of a drive over time, filled.

    Args:
        experiment: With the drive b(t) = sum_k A_k cos(2 pi u_k t), in the FMU's unit.
        span_s: Duration, s; None: two beats.
        ax: Where to draw; None: pyplot's current axes.
    """
    axes = axes_of(ax)
    span = beats_s([experiment]) if span_s is None else span_s
    factor, unit = prefixed(span, "s")
    time = np.linspace(0.0, span, ENVELOPE_POINTS)
    envelope = _envelope(experiment, time)
    axes.fill_between(time / factor, -envelope, envelope, color=SIMULATED, linewidth=0.0)
    axes.set_xlim(0.0, span / factor)
    axes.set_xlabel(f"time t ({unit})")
    axes.set_ylabel("drive, in the FMU's unit")
    return axes


def drive_periods(
    experiment: ShownTones, *, span_s: float | None = None, ax: Axes | None = None
) -> Axes:
    """Draw a drive b(t) = sum_k A_k cos(2 pi u_k t) over single periods, its envelope dashed.

    Args:
        experiment: With the drive b(t) = sum_k A_k cos(2 pi u_k t), in the FMU's unit.
        span_s: Duration, s; None: eight periods of the fastest tone.
        ax: Where to draw; None: pyplot's current axes.
    """
    axes = axes_of(ax)
    span = CARRIERS / max(experiment.tones_hz) if span_s is None else span_s
    time = np.linspace(0.0, span, CLOSE_UP_POINTS)
    pairs = zip(experiment.tones_hz, experiment.drive, strict=False)
    wave = np.sum([a * np.cos(2.0 * np.pi * tone * time) for tone, a in pairs], axis=0)
    factor, unit = prefixed(span, "s")
    axes.plot(time / factor, wave, color=SIMULATED, linewidth=1.0)
    envelope = _envelope(experiment, time)
    for side in (1.0, -1.0):
        axes.plot(time / factor, side * envelope, color=ink(), linewidth=0.9, linestyle="--")
    axes.set_xlabel(f"time t ({unit})")
    axes.set_ylabel("drive, in the FMU's unit")
    axes.set_xlim(0.0, span / factor)
    return axes


def beats_s(experiments: Sequence[ShownTones]) -> float:
    """Time of two beats of the drive that beats slowest, s; of twenty periods if none beats.

    Args:
        experiments: as they are shown.
    """
    gaps = [max(e.tones_hz) - min(e.tones_hz) for e in experiments if len(e.tones_hz) > 1]
    gaps = [gap for gap in gaps if gap > 0.0]
    return BEATS / min(gaps) if gaps else 20.0 / min(max(e.tones_hz) for e in experiments)


def _envelope(experiment: ShownTones, time_s: FloatArray) -> FloatArray:
    tones = experiment.tones_hz
    waves = [
        amplitude * np.exp(2j * np.pi * (tone - tones[0]) * time_s)
        for tone, amplitude in zip(tones, experiment.drive, strict=False)
    ]
    return np.asarray(np.abs(np.sum(waves, axis=0)), dtype=float)


def beating(result: DriveResponse, output: str, *, unit: str = "", ax: Axes | None = None) -> Axes:
    """Draw two beats of a simulated response over time; many periods as a band of all values.

    Args:
        result: Of `ff.simulate`, with two tones or more.
        output: Its name.
        unit: Of the output.
        ax: Where to draw; None: pyplot's current axes.

    Raises:
        ValueError: the drive does not beat.
    """
    axes = axes_of(ax)
    if result.beating is None:
        raise ValueError("a drive of a single tone has no beating to draw")
    values = _values(axes, result, result.beating, output, unit)
    times, periods = _times(axes, result.beating), len(values) // COLUMN_SAMPLES
    if periods < MANY_PERIODS:
        axes.plot(times, values, color=BLUE, linewidth=0.8)
        axes.set_title("two beats", loc="left")
    else:
        n = periods * COLUMN_SAMPLES
        groups = values[:n].reshape(-1, COLUMN_SAMPLES)
        axes.fill_between(
            times[:n].reshape(-1, COLUMN_SAMPLES).mean(axis=1),
            groups.min(axis=1),
            groups.max(axis=1),
            color=BLUE,
            linewidth=0.4,
        )
        axes.set_title("two beats: least to largest value", loc="left")
    axes.set_xlim(times[0], times[-1])
    plain_ticks(axes)
    return axes


def periods(result: DriveResponse, output: str, *, unit: str = "", ax: Axes | None = None) -> Axes:
    """Draw single periods of a simulated response over time.

    Args:
        result: Of `ff.simulate`.
        output: Its name.
        unit: Of the output.
        ax: Where to draw; None: pyplot's current axes.
    """
    axes = axes_of(ax)
    values = _values(axes, result, result.carrier, output, unit)
    axes.plot(_times(axes, result.carrier), values, color=BLUE)
    axes.set_title("single periods", loc="left")
    plain_ticks(axes, x=4)
    return axes


def _values(axes: Axes, result: DriveResponse, trace: Trace, output: str, unit: str) -> FloatArray:
    """Values of an output as drawn, the label of its axis set."""
    column = result.drive.outputs.index(output)
    factor, shown = prefixed(float(np.max(np.abs(result.carrier.values[:, column]))), unit)
    axes.set_ylabel(f"{sign(output)} ({shown})" if shown else sign(output))
    values: FloatArray = trace.values[:, column] / factor
    return values


def _times(axes: Axes, trace: Trace) -> FloatArray:
    """Times as drawn, from the first, the label of their axis set."""
    origin = float(trace.times_s[0])
    factor, shown = prefixed(float(trace.times_s[-1]) - origin, "s")
    axes.set_xlabel(f"time − {number(origin, 9)} s ({shown})")
    times: FloatArray = (trace.times_s - origin) / factor
    return times


def amplitude_spectrum(
    result: DriveResponse, output: str, *, unit: str = "", mixed: Named = (), ax: Axes | None = None
) -> Axes:
    """Draw amplitudes of a simulated response over frequency, the tones marked with their peaks.

    Grey: the share of the largest peak below which a line may be rounding.

    Args:
        result: Of `ff.simulate`.
        output: Its name.
        unit: Of the output.
        mixed: Combinations of the tones to mark, with names.
        ax: Where to draw; None: pyplot's current axes.
    """
    axes, spectrum = axes_of(ax), result.spectrum
    column = result.drive.outputs.index(output)
    along = scaling_for(spectrum.frequencies_hz.tolist(), "Hz")
    factor, shown = prefixed(float(np.max(result.peaks[:, column])), unit)
    amplitudes, peaks = (spectrum.amplitudes[:, column] / factor, result.peaks[:, column] / factor)
    frequencies = np.array([along(float(f)) for f in spectrum.frequencies_hz])
    least = _lower_limit(amplitudes, peaks, spectrum.rounding)
    what = "all other frequencies" if spectrum.coherent else "spectrum, lines widened by the window"
    if len(frequencies) <= MOST_STEMS:
        axes.vlines(
            frequencies, least, np.maximum(amplitudes, least), color=BLUE, lw=1.0, label=what
        )
    else:
        axes.plot(frequencies, np.maximum(amplitudes, least), color=BLUE, lw=0.6, label=what)
    tones = [along(tone) for tone in result.drive.tones_hz]
    axes.vlines(tones, least, np.maximum(peaks, least), color=RED, lw=1.6)
    for k, (tone, peak) in enumerate(zip(result.drive.tones_hz, peaks, strict=True)):
        axes.plot(
            [tones[k]],
            [max(peak, least)],
            linestyle="none",
            marker=SERIES_MARKERS[k % len(SERIES_MARKERS)],
            color=RED,
            label=f"{tone_text(tone)}: {number(float(peak), 5)} {shown}",
        )
    largest = float(np.max(peaks))
    if spectrum.rounding * largest > least:
        axes.axhspan(
            least,
            spectrum.rounding * largest,
            color=GREY,
            alpha=BAND,
            lw=0,
            zorder=0,
            label="rounding errors",
        )
    _amplitude_axis(axes, least, largest * 5)
    axes.set_xlim(float(frequencies.min()), float(frequencies.max()))
    axes.set_xlabel(along.label("frequency"))
    axes.set_ylabel(f"amplitude of {sign(output)} ({shown + ', ' if shown else ''}peak)")
    for k, (name, line) in enumerate(mixed):
        at, height = along(line.frequency_hz), float(line.amplitudes[column]) / factor
        _mark_mixed(axes, k, at, height, f"{name}: {number(height, 4)} {shown}")
    return axes


def _amplitude_axis(axes: Axes, least: float, most: float) -> None:
    log_axis(axes)
    axes.set_ylim(least, most)
    if np.log10(most / 5 / least) > PLAIN_DECADES:  # no mixture of 0.1 and powers
        axes.yaxis.set_major_formatter(lambda value, _: power_of_ten(round(np.log10(value))))


def _lower_limit(amplitudes: FloatArray, peaks: FloatArray, rounding: float) -> float:
    """A power of ten under most of the lines, but not far under what rounding leaves of them."""
    typical = max(float(np.median(amplitudes)), 1e-2 * rounding * float(np.max(peaks)))
    return float(10.0 ** np.floor(np.log10(typical) - 0.3))


def _mark_mixed(axes: Axes, k: int, at: float, height: float, label: str) -> None:
    """A marker at a line of a nonlinear response that lies within the picture."""
    low, high = axes.get_ylim()
    if low < height < high:
        axes.plot(
            [at],
            [height],
            linestyle="none",
            color=GREEN,
            marker=SERIES_MARKERS[(k + 2) % len(SERIES_MARKERS)],
            fillstyle="none",
            label=label.replace("-", "−"),
        )


def tone_text(tone_hz: float) -> str:
    """A tone in a unit that reads well: "6.94016 MHz".

    Args:
        tone_hz: frequency of the tone, Hz.
    """
    factor, unit = prefixed(tone_hz, "Hz")
    return f"{number(tone_hz / factor, 10)} {unit}"


def swept_tone(result: SweepResponse, *, unit: str = "", ax: Axes | None = None) -> Axes:
    """Draw amplitudes of a swept tone upward and downward; dotted: jumps at the end of a branch.

    Args:
        result: Of `ff.sweep`.
        unit: Of the output.
        ax: Where to draw; None: pyplot's current axes.
    """
    axes, sweep = axes_of(ax), result.sweep
    along = scaling_for(sweep.frequencies_hz, "Hz")
    f = [along(u) for u in sweep.frequencies_hz]
    factor, shown = prefixed(max(float(np.max(c.amplitudes)) for c in result.curves), unit)
    for curve in result.curves:
        colour, marker, line = FRF_LOOKS[curve.direction]
        axes.plot(
            f,
            curve.amplitudes / factor,
            color=colour,
            linestyle=line,
            linewidth=1.2,
            marker=marker if len(f) <= MOST_MARKS else "",
            markersize=4.0,
            fillstyle="none",
            label=f"{curve.direction}ward",
        )
    for jump in result.jumps:
        at = along(0.5 * (jump.low_hz + jump.high_hz))
        axes.axvline(at, color=GREY, linewidth=0.8, linestyle=":", zorder=0)
        axes.annotate(
            f"{jump.direction}ward jump",
            (at, 0.97),
            xycoords=("data", "axes fraction"),
            rotation=90,
            ha="left" if jump.direction == "up" else "right",
            va="top",
            fontsize="small",
            color=GREY,
        )
    axes.set_xlabel(along.label(f"frequency {sign(sweep.tone)}"))
    axes.set_ylabel(f"amplitude ({shown + ', ' if shown else ''}peak)")
    top = max(float(np.max(c.amplitudes)) for c in result.curves) / factor
    axes.set_ylim(0.0, (1.7 if result.jumps else 1.1) * top)  # room for the words at the jumps
    axes.set_xlim(f[0], f[-1])
    plain_ticks(axes)
    return axes
