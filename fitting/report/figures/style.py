"""What all figures share: style, colours, markers, the synthetic mark, and how they are saved.

Colours are Okabe and Ito's, told apart with any colour vision; nothing rests on colour alone:
markers and dashes say the same. Saving the same figure twice gives the same bytes.
"""

from __future__ import annotations

import io
import math
import re
import textwrap
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from fitting.text.files import write_whole
from fitting.text.notation import on_log_axis

BLACK, GREY, PALE = "#000000", "#6e6e6e", "#d9d9d9"
ORANGE, BLUE, RED, GREEN, PURPLE = "#e69f00", "#0072b2", "#d55e00", "#009e73", "#cc79a7"
#: Measured, simulated; before, after.
MEASURED, SIMULATED = ORANGE, BLUE
BEFORE, AFTER = BLACK, RED
#: Series within a panel.
SERIES = (BLUE, RED, GREEN, PURPLE, BLACK, ORANGE)
SERIES_MARKERS = ("o", "s", "^", "D", "v", "P")
#: One shape per experiment, the paper's first: bullet, triangle, pentagon, diamond, square.
MARKERS = ("o", "^", "p", "D", "s", "v", "h", "P", "X", "*", "<", ">")

SYNTHETIC = "SYNTHETIC DATA"
PNG_DPI = 160
#: Names of experiments longer than this are cut in legends and on axes.
LONGEST_NAME = 24
WIDTH = 7.2

_STYLE: Any = {  # matplotlib's stubs want every key as a literal
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial", "sans-serif"],
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 9.0,
    "figure.titlesize": 10.5,
    "legend.fontsize": 8.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.unicode_minus": True,
    "grid.color": "#ebebeb",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "lines.markersize": 6.0,
    "legend.frameon": False,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "mathtext.fontset": "dejavusans",
    "svg.fonttype": "none",
    "svg.hashsalt": "fmu-fit",
}


@dataclass(frozen=True)
class Drawing:
    """A figure with what is said about it: file name stem, title, caption, text for the blind."""

    name: str
    title: str
    caption: str
    alt: str
    figure: Figure


@dataclass(frozen=True)
class FigureFile:
    """A saved figure: what a :class:`Drawing` says, and its two files."""

    name: str
    title: str
    caption: str
    alt: str
    svg: Path
    png: Path


@contextmanager
def style() -> Iterator[None]:
    """The style of all figures; both drawing and saving belong inside."""
    with mpl.rc_context(_STYLE), warnings.catch_warnings():
        # a campaign may be titled in any script; a box instead of a letter is no reason to stop
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


def new_figure(
    title: str, campaign: str, *, synthetic: bool, height: float, width: float = WIDTH
) -> Figure:
    """An empty figure of that size in inches under its title, with the synthetic mark if due."""
    figure = Figure(figsize=(width, height), layout="constrained")
    room = int(width * 13) - (24 if synthetic else 0)
    shown = textwrap.shorten(campaign, room, placeholder=" …").replace("$", r"\$")
    figure.suptitle(f"{title}\n{shown}", x=0.012, ha="left", linespacing=1.35)
    if synthetic:
        figure.text(
            0.988,
            0.985,
            SYNTHETIC,
            ha="right",
            va="top",
            fontsize=8,
            weight="bold",
            color=RED,
            bbox={"boxstyle": "round,pad=0.35", "facecolor": "white", "edgecolor": RED},
            transform=figure.transFigure,
        )
    return figure


def save(drawing: Drawing, folder: Path) -> FigureFile:
    """Write a drawing as SVG and PNG, whole or not at all.

    Raises:
        BadInput: the folder cannot be written.
    """
    svg, png = folder / f"{drawing.name}.svg", folder / f"{drawing.name}.png"
    words = {"Title": drawing.title, "Description": drawing.alt}
    image = io.BytesIO()
    drawing.figure.savefig(image, format="png", dpi=PNG_DPI, metadata={**words, "Software": None})
    # the layout is found; finding it again takes as long as drawing
    drawing.figure.set_layout_engine("none")
    vector = io.BytesIO()
    drawing.figure.savefig(vector, format="svg", metadata={**words, "Date": None, "Creator": None})
    write_whole(png, image.getvalue())
    write_whole(svg, vector.getvalue())
    return FigureFile(drawing.name, drawing.title, drawing.caption, drawing.alt, svg, png)


def short(text: str, longest: int) -> str:
    """A name cut to so many characters, dollar signs escaped for matplotlib.

    The middle goes: names in a row mostly differ at their ends.
    """
    tail = longest // 2
    cut = text if len(text) <= longest else f"{text[: longest - 1 - tail]}…{text[-tail:]}"
    return cut.replace("$", r"\$")


def marker_of(index: int) -> str:
    """Marker shape of an experiment, the same in all figures."""
    return MARKERS[index % len(MARKERS)]


def plain_ticks(axes: Axes, *, x: int = 5, y: int = 5) -> None:
    """Few round ticks written in full: offsets and powers are named in the axis label instead."""
    axes.ticklabel_format(style="plain", useOffset=False)
    axes.xaxis.set_major_locator(MaxNLocator(x, steps=[1, 2, 2.5, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(y, steps=[1, 2, 2.5, 5, 10]))


def log_axis(axes: Axes) -> None:
    """A logarithmic y axis whose ticks are written as numbers, not as bare powers."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(10.0, subs=(1.0,), numticks=8))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: on_log_axis(float(value))))
    axes.yaxis.set_minor_formatter(NullFormatter())


def experiment_handles(labels: Sequence[str]) -> list[Line2D]:
    """Legend entries that tell which marker is which experiment."""
    return [
        Line2D(
            [],
            [],
            linestyle="none",
            marker=marker_of(i),
            markersize=5.5,
            color=GREY,
            label=short(text, LONGEST_NAME),
        )
        for i, text in enumerate(labels)
    ]


def legend_below(figure: Figure, handles: Sequence[Artist], *, ncols: int) -> None:
    """A legend of the whole figure, under its panels, where it can hide nothing.

    Long names get fewer columns, many rows a taller figure.
    """
    bare = (re.sub(r"\\mathrm|[${}_\\]", "", str(handle.get_label())) for handle in handles)
    longest = max(map(len, bare))
    width = figure.get_figwidth()
    columns = max(1, min(ncols, int(width / (0.45 + 0.065 * longest))))
    rows = -(-len(handles) // columns)
    figure.set_figheight(figure.get_figheight() + 0.17 * max(0, rows - 2))
    figure.legend(handles=list(handles), loc="outside lower center", ncols=columns)


def label_experiments(axes: Axes, labels: Sequence[str], *, share: int = 1) -> None:
    """An x axis with a tick per experiment, turned where the labels would meet.

    `share` is the number of panels side by side.
    """
    width = axes.figure.get_figure(root=True).get_size_inches()[0] / share
    step = math.ceil(0.17 * len(labels) / (width - 0.9))  # turned labels need that many inches
    shown = range(0, len(labels), max(1, step))
    axes.set_xticks(shown, [short(labels[i], LONGEST_NAME) for i in shown])
    axes.grid(visible=False, axis="x")
    axes.set_xlim(-0.6, len(labels) - 0.4)
    if sum(len(text) + 1 for text in labels) > 15.0 * (width - 0.7):
        axes.tick_params(axis="x", rotation=45)
        for text in axes.get_xticklabels():
            text.set_horizontalalignment("right")
            text.set_rotation_mode("anchor")
