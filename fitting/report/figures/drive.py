"""Figures of one drive: the beating with its carrier, and the spectrum with its peaks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from fitting.report.figures.style import (
    BLUE,
    GREEN,
    PALE,
    RED,
    SERIES_MARKERS,
    Drawing,
    log_axis,
    new_figure,
    plain_ticks,
    save,
    style,
)
from fitting.simulate.drive import COLUMN_SAMPLES, DriveResult
from fitting.simulate.lines import MixedLine
from fitting.text.arrays import FloatArray
from fitting.text.notation import (
    Scaling,
    listed,
    mathtext,
    number,
    power_of_ten,
    prefixed,
    scaling_for,
)

#: Lines at combinations of the tones, by name.
Named = Sequence[tuple[str, MixedLine]]

MOST_MIXED = 4

#: A trace of fewer periods than this is drawn as a line: its periods can be seen.
MANY_PERIODS = 150
#: Lines of a spectrum up to which each is drawn as a stem.
MOST_STEMS = 1500
#: Decades of an axis above which its ticks are all powers of ten.
PLAIN_DECADES = 4.0


def save_figures(
    result: DriveResult, model: str, units: Sequence[str], folder: Path, mixed: Named = ()
) -> list[Path]:
    """Draw and write both figures; the files written."""
    with style():
        drawings = draw_trace(result, model, units), draw_spectrum(result, model, units, mixed)
        saved = [save(drawing, folder) for drawing in drawings]
    return [path for file in saved for path in (file.png, file.svg)]


def draw_trace(result: DriveResult, model: str, units: Sequence[str]) -> Drawing:
    """The envelope over two beats, beside it some periods at the envelope's maximum."""
    outputs = _oscillating(result)
    beating = result.beating
    title = "Steady response to the drive" if beating is None else "Beating under a two-tone drive"
    figure = new_figure(
        title, _subtitle(result, model), synthetic=False, height=2.6 * len(outputs) + 0.6
    )
    columns = 1 if beating is None else 2
    grid = figure.subplots(
        len(outputs),
        columns,
        squeeze=False,
        width_ratios=(2.0, 1.0)[:columns] if columns > 1 else None,
    )
    for row, (name, column) in enumerate(outputs.items()):
        carrier = result.carrier.values[:, column]
        factor, shown = prefixed(float(np.max(np.abs(carrier))), units[column])
        label = f"{mathtext(name)} ({shown})" if shown else mathtext(name)
        if beating is not None:
            _draw_envelope(grid[row, 0], beating.times_s, beating.values[:, column] / factor)
            grid[row, 0].set_ylabel(label)
        _draw_carrier(grid[row, -1], result.carrier.times_s, carrier / factor)
        grid[row, -1].set_ylabel(label)
    caption = (
        f"{', '.join(outputs)} of {model}, driven at {_tones_text(result)}; "
        + ("left the envelope, right " if beating is not None else "")
        + "some periods of the oscillation itself. "
        + " ".join(f"{reason}." for reason in result.reasons[1:])
    )
    return Drawing("trace", title, caption, caption, figure)


def draw_spectrum(
    result: DriveResult, model: str, units: Sequence[str], mixed: Named = ()
) -> Drawing:
    """Amplitudes over frequency, a panel per output, the tones labelled with their peaks.

    The first of the lines ``mixed``, at combinations of the tones, are marked by their names.
    """
    outputs = _oscillating(result)
    title = "Amplitude spectrum of the response"
    figure = new_figure(
        title, _subtitle(result, model), synthetic=False, height=2.8 * len(outputs) + 0.6
    )
    axis = scaling_for(result.frequencies_hz.tolist(), "Hz")
    grid = figure.subplots(len(outputs), 1, squeeze=False, sharex=True)
    for row, (name, column) in enumerate(outputs.items()):
        axes = grid[row, 0]
        factor, shown = prefixed(float(np.max(result.peaks[:, column])), units[column])
        _draw_amplitudes(
            axes,
            axis,
            result,
            result.amplitudes[:, column] / factor,
            result.peaks[:, column] / factor,
            shown,
        )
        _mark_mixed(axes, axis, mixed[:MOST_MIXED], column, factor, shown)
        axes.set_ylabel(f"amplitude of {mathtext(name)} ({shown + ', ' if shown else ''}peak)")
    grid[-1, 0].set_xlabel(axis.label("frequency"))
    caption = f"{title} of {model} ({', '.join(outputs)}); {result.reasons[0]}."
    if result.constants:
        caption += f" Constant and not drawn: {', '.join(result.constants)}."
    return Drawing("spectrum", title, caption, caption, figure)


def _mark_mixed(
    axes: Axes, axis: Scaling, mixed: Named, column: int, factor: float, unit: str
) -> None:
    """Markers at lines of a nonlinear response, with their names and heights in the legend."""
    low, high = axes.get_ylim()
    for k, (name, line) in enumerate(mixed):
        height = float(line.amplitudes[column]) / factor
        if low < height < high:
            axes.plot(
                [axis(line.frequency_hz)],
                [height],
                linestyle="none",
                color=GREEN,
                marker=SERIES_MARKERS[(k + 2) % len(SERIES_MARKERS)],
                fillstyle="none",
                label=f"{name.replace('-', '−')}: {number(height, 4)} {unit}",
            )
    if mixed:
        axes.set_ylim(low, high * (high / low) ** 0.4)  # room for the longer legend
        axes.legend(loc="upper right", ncols=2)


def _oscillating(result: DriveResult) -> dict[str, int]:
    """Outputs that are drawn, with their columns."""
    names = enumerate(result.drive.outputs)
    return {name: column for column, name in names if name not in result.constants}


def _draw_envelope(axes: Axes, times_s: FloatArray, values: FloatArray) -> None:
    """Least to largest value in every column of samples, joined without a gap; or the line."""
    origin = float(times_s[0])
    factor, shown = prefixed(float(times_s[-1]) - origin, "s")
    times = (times_s - origin) / factor
    columns = len(times) // COLUMN_SAMPLES
    if columns < MANY_PERIODS:
        axes.plot(times, values, color=BLUE, linewidth=0.8)
        axes.set_title("two beats", loc="left")
    else:
        n = columns * COLUMN_SAMPLES
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
    axes.set_xlabel(f"time − {number(origin, 9)} s ({shown})")
    plain_ticks(axes)


def _draw_carrier(axes: Axes, times_s: FloatArray, values: FloatArray) -> None:
    origin = float(times_s[0])
    factor, shown = prefixed(float(times_s[-1]) - origin, "s")
    axes.plot((times_s - origin) / factor, values, color=BLUE)
    axes.set_xlabel(f"time − {number(origin, 9)} s ({shown})")
    axes.set_title("single periods", loc="left")
    plain_ticks(axes, x=4)


def _draw_amplitudes(
    axes: Axes,
    axis: Scaling,
    result: DriveResult,
    amplitudes: FloatArray,
    peaks: FloatArray,
    unit: str,
) -> None:
    frequencies = np.array([axis(float(f)) for f in result.frequencies_hz])
    tones = [axis(tone) for tone in result.drive.tones_hz]
    least = _lower_limit(amplitudes, peaks, result.rounding)
    what = "all other frequencies" if result.coherent else "spectrum, lines widened by the window"
    if len(frequencies) <= MOST_STEMS:
        axes.vlines(
            frequencies, least, np.maximum(amplitudes, least), color=BLUE, lw=1.0, label=what
        )
    else:
        axes.plot(frequencies, np.maximum(amplitudes, least), color=BLUE, lw=0.6, label=what)
    axes.vlines(tones, least, np.maximum(peaks, least), color=RED, lw=1.6)
    for k, (tone, peak) in enumerate(zip(result.drive.tones_hz, peaks, strict=True)):
        axes.plot(
            [tones[k]],
            [max(peak, least)],
            linestyle="none",
            marker=SERIES_MARKERS[k % len(SERIES_MARKERS)],
            color=RED,
            label=f"{_hertz(tone)}: {number(float(peak), 5)} {unit}",
        )
    rounding = result.rounding * float(np.max(peaks))
    if rounding > least:
        axes.axhspan(least, rounding, color=PALE, lw=0, zorder=0, label="rounding errors")
    log_axis(axes)
    axes.set_ylim(least, float(np.max(peaks)) * 5)
    if np.log10(np.max(peaks) / least) > PLAIN_DECADES:  # no mixture of 0.1 and powers
        axes.yaxis.set_major_formatter(lambda value, _: power_of_ten(round(np.log10(value))))
    axes.set_xlim(float(frequencies.min()), float(frequencies.max()))
    axes.legend(loc="upper right")


def _lower_limit(amplitudes: FloatArray, peaks: FloatArray, rounding: float) -> float:
    """A power of ten under most of the lines, but not far under what rounding leaves of them."""
    typical = max(float(np.median(amplitudes)), 1e-2 * rounding * float(np.max(peaks)))
    return float(10.0 ** np.floor(np.log10(typical) - 0.3))


def _subtitle(result: DriveResult, model: str) -> str:
    return f"{model}, driven at {_tones_text(result)}"


def _tones_text(result: DriveResult) -> str:
    return listed(_hertz(tone) for tone in result.drive.tones_hz)


def _hertz(tone: float) -> str:
    factor, unit = prefixed(tone, "Hz")
    return f"{number(tone / factor, 10)} {unit}"
