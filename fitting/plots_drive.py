"""Figures of one drive: the beating with its carrier, and the spectrum with its peaks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from fitting.drive import DriveResult
from fitting.notation import Scaling, listed, mathtext, number, prefixed, scaling_for
from fitting.plots_style import (
    BLUE,
    RED,
    SERIES_MARKERS,
    Drawing,
    log_axis,
    new_figure,
    plain_ticks,
    save,
    style,
)

FloatArray = NDArray[np.float64]

BUCKET = 20  # samples whose least and largest value are drawn as one stretch of the envelope
FLOOR = 1e-7  # of the largest peak: what is below is rounding and is not drawn


def save_figures(result: DriveResult, model: str, units: Sequence[str], folder: Path) -> list[Path]:
    """Draw and write both figures; the files written."""
    with style():
        saved = [
            save(drawing, folder)
            for drawing in (draw_trace(result, model, units), draw_spectrum(result, model, units))
        ]
    return [path for file in saved for path in (file.png, file.svg)]


def draw_trace(result: DriveResult, model: str, units: Sequence[str]) -> Drawing:
    """The envelope over two beats, beside it some periods at the envelope's maximum."""
    outputs = result.drive.outputs
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
    for row, (name, unit) in enumerate(zip(outputs, units, strict=True)):
        factor, shown = prefixed(float(np.max(np.abs(result.carrier.values[:, row]))), unit)
        label = f"{mathtext(name)} ({shown})" if shown else mathtext(name)
        if beating is not None:
            _draw_envelope(grid[row, 0], beating.times_s, beating.values[:, row] / factor)
            grid[row, 0].set_ylabel(label)
        _draw_carrier(grid[row, -1], result.carrier.times_s, result.carrier.values[:, row] / factor)
        grid[row, -1].set_ylabel(label)
    caption = (
        f"{', '.join(outputs)} of {model}, driven at {_tones_text(result)}; "
        + ("left the envelope, right " if beating is not None else "")
        + "some periods of the oscillation itself. "
        + " ".join(f"{reason}." for reason in result.reasons[1:])
    )
    return Drawing("trace", title, caption, caption, figure)


def draw_spectrum(result: DriveResult, model: str, units: Sequence[str]) -> Drawing:
    """Amplitudes over frequency, a panel per output, the tones labelled with their peaks."""
    outputs = result.drive.outputs
    title = "Amplitude spectrum of the response"
    figure = new_figure(
        title, _subtitle(result, model), synthetic=False, height=2.8 * len(outputs) + 0.6
    )
    axis = scaling_for(result.frequencies_hz.tolist(), "Hz")
    grid = figure.subplots(len(outputs), 1, squeeze=False, sharex=True)
    for row, (name, unit) in enumerate(zip(outputs, units, strict=True)):
        axes = grid[row, 0]
        factor, shown = prefixed(float(np.max(result.peaks[:, row])), unit)
        _draw_amplitudes(
            axes,
            axis,
            result,
            result.amplitudes[:, row] / factor,
            result.peaks[:, row] / factor,
            shown,
        )
        axes.set_ylabel(f"amplitude of {mathtext(name)} ({shown + ', ' if shown else ''}peak)")
    grid[-1, 0].set_xlabel(axis.label("frequency"))
    caption = f"{title} of {model} ({', '.join(outputs)}); {result.reasons[0]}."
    return Drawing("spectrum", title, caption, caption, figure)


def _draw_envelope(axes: Axes, times_s: FloatArray, values: FloatArray) -> None:
    n = len(times_s) // BUCKET * BUCKET
    times = times_s[:n].reshape(-1, BUCKET)
    groups = values[:n].reshape(-1, BUCKET)
    origin = float(times_s[0])
    factor, shown = prefixed(float(times_s[-1]) - origin, "s")
    middle = (times.mean(axis=1) - origin) / factor
    axes.fill_between(
        middle, groups.min(axis=1), groups.max(axis=1), color=BLUE, linewidth=0, label="oscillation"
    )
    axes.set_xlim(middle[0], middle[-1])
    axes.set_xlabel(f"time − {number(origin, 9)} s ({shown})")
    axes.set_title("two beats: least to largest value", loc="left")
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
    floor = FLOOR * float(np.max(peaks))
    what = "bins of whole periods" if result.coherent else "tapered spectrum"
    axes.plot(frequencies, np.maximum(amplitudes, floor), color=BLUE, label=what)
    for k, (tone, peak) in enumerate(zip(result.drive.tones_hz, peaks, strict=True)):
        axes.plot(
            [axis(tone)],
            [max(peak, floor)],
            linestyle="none",
            marker=SERIES_MARKERS[k % len(SERIES_MARKERS)],
            color=RED,
            label=f"{_hertz(tone)}: {number(float(peak), 5)} {unit}",
        )
    log_axis(axes)
    axes.set_ylim(floor, float(np.max(peaks)) * 5)
    axes.set_xlim(float(frequencies.min()), float(frequencies.max()))
    axes.legend(loc="upper right")


def _subtitle(result: DriveResult, model: str) -> str:
    return f"{model}, driven at {_tones_text(result)}"


def _tones_text(result: DriveResult) -> str:
    return listed(_hertz(tone) for tone in result.drive.tones_hz)


def _hertz(tone: float) -> str:
    factor, unit = prefixed(tone, "Hz")
    return f"{number(tone / factor, 10)} {unit}"
