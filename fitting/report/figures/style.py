"""What all figures of the report share: their style, the synthetic mark, and how they are saved.

Saving the same figure twice gives the same bytes.
"""

from __future__ import annotations

import io
import math
import re
import textwrap
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from fitting.report.figures.data import figure_csv
from fitting.report.figures.file import FigureFile
from fitting.report.plot.axes import BLACK, RED
from fitting.text.files import write_whole

SYNTHETIC = "SYNTHETIC DATA"
PNG_DPI = 160
WIDTH = 7.2
#: Room that the synthetic mark takes above a figure for print, inch.
MARK_HEIGHT = 0.17

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
    """A figure with what is said about it: short name, title, caption, text for the blind.

    ``number`` is that on the page and before the name of its files (0: it has none), of ``digits``
    digits there, so that files sort as on the page; ``series``
    the measurement's, where each of several has such a figure.
    """

    name: str
    title: str
    caption: str
    alt: str
    figure: Figure
    series: str = ""
    number: int = 0
    digits: int = 1

    @property
    def stem(self) -> str:
        """Name of its files, without an ending."""
        number = f"{self.number:0{self.digits}d}" if self.number else ""
        return "_".join(filter(None, (number, self.name, self.series)))


@dataclass(frozen=True, kw_only=True)
class Planned:
    """A figure that is yet to be drawn: what it is known by before, and what draws it."""

    name: str
    draw: Callable[[], Drawing]
    number: int = 0
    digits: int = 1

    def drawing(self) -> Drawing:
        """The figure, with its number."""
        return replace(self.draw(), number=self.number, digits=self.digits)


#: What a figure for print has otherwise: fonts as publishers want them, which takes half a second
#: a figure, and letters all of one small size.
_PAPER: Any = {
    "font.size": 8.0,
    "axes.titlesize": 8.0,
    "axes.labelsize": 8.0,
    "legend.fontsize": 7.0,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "lines.linewidth": 1.0,
    "lines.markersize": 4.0,
    "axes.grid": False,
    "pdf.fonttype": 42,
}
#: Width of figures for print, inch; zero: figures of a report.
_paper_width: ContextVar[float] = ContextVar("paper_width", default=0.0)


@contextmanager
def style(paper_width: float = 0.0) -> Iterator[None]:
    """The style of all figures; both drawing and saving belong inside.

    Args:
        paper_width: of figures for print, inch, which then have no title; zero: of a report.
    """
    with mpl.rc_context(), warnings.catch_warnings():
        mpl.rcdefaults()  # whatever style the caller draws in: a report always looks the same
        mpl.rcParams.update(_STYLE)
        if paper_width:
            mpl.rcParams.update(_PAPER)
        # a campaign may be titled in any script; a box instead of a letter is no reason to stop
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        before = _paper_width.set(paper_width)
        try:
            yield
        finally:
            _paper_width.reset(before)


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
    paper = _paper_width.get()
    if paper:
        height *= max(0.7, paper / width)
        width = paper
    figure = Figure(figsize=(width, height), layout="constrained")
    if not paper:
        _entitle(figure, title, campaign, synthetic=synthetic)
    if synthetic:
        _mark_synthetic(figure, small=bool(paper))
    engine = figure.get_layout_engine()
    if synthetic and paper and isinstance(engine, ConstrainedLayoutEngine):  # it hides nothing
        engine.set(rect=(0.0, 0.0, 1.0, 1.0 - MARK_HEIGHT / height))
    return figure


def _entitle(figure: Figure, title: str, campaign: str, *, synthetic: bool) -> None:
    room = int(figure.get_figwidth() * 13) - (24 if synthetic else 0)
    shown = textwrap.shorten(campaign, room, placeholder=" …").replace("$", r"\$")
    figure.suptitle(f"{title}\n{shown}", x=0.012, ha="left", linespacing=1.35)


def _mark_synthetic(figure: Figure, *, small: bool) -> None:
    figure.text(
        0.988,
        0.985,
        SYNTHETIC,
        ha="right",
        va="top",
        fontsize=5 if small else 8,
        weight="bold",
        color=RED,
        bbox={"boxstyle": "round,pad=0.35", "facecolor": "white", "edgecolor": RED},
        transform=figure.transFigure,
    )


def save(drawing: Drawing, folder: Path, *, for_page: bool = False) -> FigureFile:
    """Write a drawing as SVG and PNG, whole or not at all.

    Args:
        drawing: figure with its name, title and caption.
        folder: where the files go.
        for_page: whether it is shown on a page: a PDF and the numbers as CSV go with it then, and
            what makes it interactive there.

    Raises:
        BadInput: the folder cannot be written.
    """
    svg, png = folder / f"{drawing.stem}.svg", folder / f"{drawing.stem}.png"
    words = {"Title": drawing.title, "Description": drawing.alt}
    _lay_out(drawing.figure)
    image = io.BytesIO()
    drawing.figure.savefig(image, format="png", dpi=PNG_DPI, metadata={**words, "Software": None})
    vector = io.BytesIO()
    drawing.figure.savefig(vector, format="svg", metadata={**words, "Date": None, "Creator": None})
    write_whole(png, image.getvalue())
    write_whole(svg, vector.getvalue())
    saved = FigureFile(
        name=drawing.stem,
        kind=drawing.name,
        number=drawing.number,
        title=drawing.title,
        caption=drawing.caption,
        alt=drawing.alt,
        svg=svg,
        png=png,
    )
    return _for_page(saved, drawing) if for_page else saved


def _lay_out(figure: Figure) -> None:
    """Find the layout once for all formats, that of a picture of dots.

    Where a format finds it, everything is drawn twice, and asking for it takes as long.
    """
    engine = figure.get_layout_engine()
    if engine is None:
        return
    FigureCanvasAgg(figure)
    dpi = figure.dpi
    figure.set_dpi(PNG_DPI)
    engine.execute(figure)
    figure.set_dpi(dpi)
    figure.set_layout_engine(None)


def _for_page(saved: FigureFile, drawing: Drawing) -> FigureFile:
    """The same with what a page offers of it: numbers, PDF, and itself to zoom and read off."""
    # takes half a second to import: only where there is a page
    from fitting.report.interactive.document import as_text, interactive

    table, print_ = (
        saved.svg.with_name(f"{saved.name}.csv"),
        saved.svg.with_name(f"{saved.name}.pdf"),
    )
    words = {"Title": drawing.title, "Subject": drawing.alt, "CreationDate": None}
    image = io.BytesIO()
    drawing.figure.savefig(image, format="pdf", metadata=words)
    write_whole(table, figure_csv(drawing.figure))
    write_whole(print_, image.getvalue())
    live = as_text(interactive(drawing.figure))
    return replace(saved, csv=table, pdf=print_, live=live)


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
