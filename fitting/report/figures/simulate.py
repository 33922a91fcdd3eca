"""Figures of what an FMU answers: one drive with its beating and spectrum, one moved tone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fitting.report import plot
from fitting.report.figures.style import Drawing, new_figure, save, style
from fitting.report.plot.simulate import Named, tone_text
from fitting.simulate.frf import SweepResponse
from fitting.simulate.response import DriveResponse
from fitting.simulate.words import (
    difference_in_words,
    remainder_in_words,
    settling_in_words,
    spectrum_in_words,
)
from fitting.text.notation import listed, number

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
        saved = [save(drawing, folder) for drawing in drawings]
    return [path for file in saved for path in (file.png, file.svg)]


def draw_trace(result: DriveResponse, model: str, units: Sequence[str]) -> Drawing:
    """The envelope over two beats, beside it some periods at the envelope's maximum.

    Args:
        result: of the drive.
        model: name of the model.
        units: of the outputs, in their order.
    """
    outputs = _oscillating(result)
    beats = result.beating is not None
    title = "Beating under a two-tone drive" if beats else "Steady response to the drive"
    figure = new_figure(
        title, _subtitle(result, model), synthetic=False, height=2.6 * len(outputs) + 0.6
    )
    grid = figure.subplots(
        len(outputs),
        2 if beats else 1,
        squeeze=False,
        width_ratios=(2.0, 1.0) if beats else None,
    )
    unit_of = dict(zip(result.drive.outputs, units, strict=True))
    for row, name in enumerate(outputs):
        if beats:
            plot.beating(result, name, unit=unit_of[name], ax=grid[row, 0])
        plot.periods(result, name, unit=unit_of[name], ax=grid[row, -1])
    caption = (
        f"{', '.join(outputs)} of {model}, driven at {_tones_text(result)}; "
        + ("left the envelope, right " if beats else "")
        + "some periods of the oscillation itself. "
        + f"{settling_in_words(result.plan)}. {remainder_in_words(result.remainder)}."
    )
    return Drawing(name="trace", title=title, caption=caption, alt=caption, figure=figure)


def draw_spectrum(
    result: DriveResponse, model: str, units: Sequence[str], mixed: Named = ()
) -> Drawing:
    """Amplitudes over frequency, a panel per output, the tones labelled with their peaks.

    The first of the lines ``mixed``, at combinations of the tones, are marked by their names.

    Args:
        result: of the drive.
        model: name of the model.
        units: of the outputs, in their order.
        mixed: amplitudes at combinations of the tones, by name.
    """
    outputs = _oscillating(result)
    title = "Amplitude spectrum of the response"
    figure = new_figure(
        title, _subtitle(result, model), synthetic=False, height=2.8 * len(outputs) + 0.6
    )
    grid = figure.subplots(len(outputs), 1, squeeze=False, sharex=True)
    unit_of = dict(zip(result.drive.outputs, units, strict=True))
    for axes, name in zip(grid[:, 0], outputs, strict=True):
        shown = mixed[:MOST_MIXED]
        plot.amplitude_spectrum(result, name, unit=unit_of[name], mixed=shown, ax=axes)
        if shown:
            low, high = axes.get_ylim()
            axes.set_ylim(low, high * (high / low) ** 0.4)  # room for the longer legend
        axes.legend(loc="upper right", ncols=2 if shown else 1)
        axes.set_xlabel(axes.get_xlabel() if axes is grid[-1, 0] else "")
    caption = f"{title} of {model} ({', '.join(outputs)}); {spectrum_in_words(result.spectrum)}."
    if result.constants:
        caption += f" Constant and not drawn: {', '.join(result.constants)}."
    return Drawing(name="spectrum", title=title, caption=caption, alt=caption, figure=figure)


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
        file = save(draw_frf(result, model, unit), folder)
    return [file.png, file.svg]


def draw_frf(result: SweepResponse, model: str, unit: str) -> Drawing:
    """Amplitude over frequency, each way with a marker of its own.

    Args:
        result: of the sweep.
        model: name of the model.
        unit: of the values.
    """
    sweep = result.sweep
    title = f"Amplitude of {sweep.output} under a moved tone"
    figure = new_figure(title, model, synthetic=False, height=3.4)
    plot.swept_tone(result, unit=unit, ax=figure.subplots()).legend(loc="upper left")
    said = settling_in_words(result.plan), difference_in_words(result)
    caption = (
        f"{title}, {model}: {len(sweep.frequencies_hz)} points, phase and state carried on from "
        "point to point. " + " ".join(f"{text[0].upper()}{text[1:]}." for text in said)
    )
    caption += "".join(
        f" The {jump.direction}ward sweep jumps between {number(jump.low_hz, 10)} and "
        f"{number(jump.high_hz, 10)} Hz."
        for jump in result.jumps
    )
    return Drawing(name="sweep", title=title, caption=caption, alt=caption, figure=figure)
