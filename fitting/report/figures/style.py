"""What all figures of the report share: their style, the synthetic mark, and how they are saved.

Saving the same figure twice gives the same bytes.
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

from fitting.report.plot.axes import BLACK, RED
from fitting.text.files import write_whole

SYNTHETIC = "SYNTHETIC DATA"
PNG_DPI = 160
WIDTH = 7.2

_STYLE: Any = {  # matplotlib's stubs want every key as a literal
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial", "sans-serif"],
    "font.size": 9.0,
    "text.color": BLACK,
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


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """A figure with what is said about it: file name stem, title, caption, text for the blind."""

    name: str
    title: str
    caption: str
    alt: str
    figure: Figure


@dataclass(frozen=True, kw_only=True)
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
    with mpl.rc_context(), warnings.catch_warnings():
        mpl.rcdefaults()  # whatever style the caller draws in: a report always looks the same
        mpl.rcParams.update(_STYLE)
        # a campaign may be titled in any script; a box instead of a letter is no reason to stop
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


def new_figure(
    title: str, campaign: str, *, synthetic: bool, height: float, width: float = WIDTH
) -> Figure:
    """An empty figure of that size in inches under its title, with the synthetic mark if due.

    Args:
        title: of the campaign.
        campaign: title of the campaign.
        synthetic: whether the data are synthetic, which the figure then says.
        height: of the figure, inch.
        width: of the figure, inch.
    """
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

    Args:
        drawing: figure with its name, title and caption.
        folder: where the files go.

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
    return FigureFile(
        name=drawing.name,
        title=drawing.title,
        caption=drawing.caption,
        alt=drawing.alt,
        svg=svg,
        png=png,
    )


def panels(figure: Figure, count: int, most: int) -> list[Axes]:
    """So many axes in rows of at most ``most``.

    Args:
        figure: to draw into.
        count: number of axes.
        most: axes in a row at most.
    """
    columns = min(most, count)
    grid = list(figure.subplots(math.ceil(count / columns), columns, squeeze=False).flat)
    for unused in grid[count:]:
        unused.set_visible(False)
    return grid[:count]


def handles_of(axes: Axes) -> list[Artist]:
    """What axes want in a legend.

    Args:
        axes: axes to draw into.
    """
    return list(axes.get_legend_handles_labels()[0])


def legend_below(figure: Figure, handles: Sequence[Artist], *, ncols: int) -> None:
    """A legend of the whole figure, under its panels, where it can hide nothing.

    Long names get fewer columns, many rows a taller figure.

    Args:
        figure: to draw into.
        handles: what the legend explains.
        ncols: columns of the legend.
    """
    bare = (re.sub(r"\\mathrm|[${}_\\]", "", str(handle.get_label())) for handle in handles)
    longest = max(map(len, bare))
    width = figure.get_figwidth()
    columns = max(1, min(ncols, int(width / (0.45 + 0.065 * longest))))
    rows = -(-len(handles) // columns)
    figure.set_figheight(figure.get_figheight() + 0.17 * max(0, rows - 2))
    figure.legend(handles=list(handles), loc="outside lower center", ncols=columns)
