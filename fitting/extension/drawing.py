"""How figures look; loads matplotlib."""

from __future__ import annotations

from fitting.report.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    SERIES,
    SERIES_MARKERS,
    Axes,
    axes_of,
    described,
    handles_of,
    ink,
    legend_below,
    log_axis,
    new_figure,
    plain_ticks,
    save,
    style,
)

__all__ = [
    "BLACK",
    "BLUE",
    "GREEN",
    "GREY",
    "ORANGE",
    "RED",
    "SERIES",
    "SERIES_MARKERS",
    "Axes",
    "axes_of",
    "described",
    "handles_of",
    "ink",
    "legend_below",
    "log_axis",
    "new_figure",
    "plain_ticks",
    "save",
    "style",
]
