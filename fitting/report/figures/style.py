"""What all figures share: colours, markers, ticks, style, the synthetic mark, how they are saved.

Colours are Okabe and Ito's, distinct for any colour vision; nothing rests on colour alone:
markers and dashes show the same. Ink and paper are those of the style that is in use. Saving the
same figure twice gives the same bytes.
"""

from __future__ import annotations

import io
import math
import textwrap
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.artist import Artist
from matplotlib.axes import Axes as Axes
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, ScalarFormatter

from fitting.measurements.figure import Figure as Described
from fitting.measurements.figure import figure_words
from fitting.report.figures.data import figure_csv
from fitting.report.screen import phrase
from fitting.text.notation import on_log_axis
from fitting.text.results_folder import write_whole

BLACK, GREY, PALE = "#000000", "#6e6e6e", "#d9d9d9"
ORANGE, BLUE, RED, GREEN, PURPLE = "#e69f00", "#0072b2", "#d55e00", "#009e73", "#cc79a7"
#: Measured, simulated; after the fit (before it: ink).
MEASURED, SIMULATED, AFTER = ORANGE, BLUE, RED
#: Series within a panel.
SERIES = (BLUE, RED, GREEN, PURPLE, GREY, ORANGE)
SERIES_MARKERS = ("o", "s", "^", "D", "v", "P")
#: One shape per experiment, the paper's first: bullet, triangle, pentagon, diamond, square.
MARKERS = ("o", "^", "p", "D", "s", "v", "h", "P", "X", "*", "<", ">")
#: Opacity of grey bands behind the data.
BAND = 0.22
#: Names of experiments longer than this are cut in legends and on axes.
LONGEST_NAME = 24


def axes_of(ax: Axes | None) -> Axes:
    """The axes that were given, else pyplot's current ones.

    Args:
        ax: axes to draw into, None for new ones.
    """
    if ax is not None:
        return ax
    from matplotlib import pyplot  # opens a window system: only where the axes are left to it

    return pyplot.gca()


def ink() -> str:
    """Colour of text in the style that is in use."""
    return str(mpl.rcParams["text.color"])


def short(text: str, longest: int) -> str:
    """A name cut to so many characters.

    The middle goes: names in a row mostly differ at their ends.

    Args:
        text: as it was written.
        longest: characters at most.
    """
    tail = longest // 2
    return text if len(text) <= longest else f"{text[: longest - 1 - tail]}…{text[-tail:]}"


def marker_of(index: int) -> str:
    """Marker shape of an experiment, the same in all figures.

    Args:
        index: place in the series of looks.
    """
    return MARKERS[index % len(MARKERS)]


def series_look(index: int) -> tuple[str, str]:
    """Colour and marker of a series within a panel.

    Args:
        index: place in the series of looks.
    """
    return SERIES[index % len(SERIES)], SERIES_MARKERS[index % len(SERIES_MARKERS)]


def plain_ticks(axes: Axes, *, x: int = 5, y: int = 5) -> None:
    """Few round ticks written in full: offsets and powers are named in the axis label instead.

    Args:
        axes: axes to draw into.
        x: ticks of the horizontal axis at most, 0: as they are.
        y: ticks of the vertical axis at most, 0: as they are.
    """
    for axis, count in ((axes.xaxis, x), (axes.yaxis, y)):
        plain = ScalarFormatter(useOffset=False)
        plain.set_scientific(False)
        axis.set_major_formatter(plain)
        axis.set_major_locator(MaxNLocator(count, steps=[1, 2, 2.5, 5, 10]))


def log_axis(axes: Axes, which: str = "y") -> None:
    """A logarithmic axis whose ticks are written as numbers, not as bare powers.

    Args:
        axes: axes to draw into.
        which: "x" or "y".
    """
    axis = axes.xaxis if which == "x" else axes.yaxis
    (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    axis.set_major_locator(LogLocator(10.0, subs=(1.0,), numticks=8))
    axis.set_major_formatter(FuncFormatter(lambda value, _: on_log_axis(float(value))))
    axis.set_minor_formatter(NullFormatter())


def say_empty(axes: Axes, words: str = "the model has no value here") -> None:
    """Say in the middle of an empty panel why it is empty.

    Args:
        axes: axes to draw into.
        words: as they are shown.
    """
    axes.text(0.5, 0.5, words, ha="center", va="center", transform=axes.transAxes, color=GREY)


def experiment_handles(labels: Sequence[str]) -> list[Line2D]:
    """Legend entries that show which marker is which experiment.

    Args:
        labels: of the experiments.
    """
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


def label_experiments(axes: Axes, labels: Sequence[str]) -> None:
    """An x axis with a tick per experiment, turned where the labels would meet.

    Args:
        axes: axes to draw into.
        labels: of the experiments.
    """
    width = width_inches(axes)
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


def width_inches(axes: Axes) -> float:
    """Width of the column of panels that axes stand in, labels included.

    Args:
        axes: axes to draw into.
    """
    whole = float(axes.figure.get_figure(root=True).get_size_inches()[0])
    spec = axes.get_subplotspec()
    if spec is None:
        return max(1.5, whole * axes.get_position().width)
    spec = spec.get_topmost_subplotspec()  # beside the bar of a map
    return max(1.5, whole * len(spec.colspan) / spec.get_gridspec().ncols)


# --- the style of a report, and files -------------------------------------------------------------

SYNTHETIC = "SYNTHETIC DATA"
PNG_DPI = 160
WIDTH = 7.2
#: Room at the edges of a figure and between its panels, in letters; of title and legend, inch.
PAD, BETWEEN = 0.4, 0.8
EDGE = 0.06

#: Style sheets of a report, and of what a figure for print has otherwise.
REPORT, PAPER = (Path(__file__).with_name(f"{name}.mplstyle") for name in ("report", "paper"))


@dataclass(frozen=True, kw_only=True)
class Planned:
    """A figure that is yet to be drawn: its name, what draws it, and what that cannot know.

    ``series``: of the campaigns that were fitted together, the one that it shows; ``remark``: at
    the end of its caption.
    """

    name: str
    draw: Callable[[], Described]
    series: str = ""
    remark: str = ""

    def drawing(self, number: int, digits: int = 1) -> Described:
        """The figure with its number.

        Args:
            number: on the page.
            digits: of the number in the names of files.
        """
        drawn = replace(self.draw(), number=number, digits=digits)
        if self.series:
            drawn = replace(drawn, series=self.series, title=f"{drawn.title}, {self.series}")
        caption, alt = (f"{t} {self.remark}".strip() for t in (drawn.caption, drawn.alt))
        return replace(drawn, caption=caption, alt=alt)


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
        for sheet in (REPORT, PAPER) if paper_width else (REPORT,):
            mpl.rcParams.update(mpl.rc_params_from_file(sheet, use_default_template=False))
        # a campaign may be titled in any script; a box instead of a letter is no reason to stop
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        before = _paper_width.set(paper_width)
        try:
            yield
        finally:
            _paper_width.reset(before)


def described(name: str, **records: Any) -> Described:
    """A figure that is not drawn yet: its title, its caption, and what is read to the blind.

    Args:
        name: of a macro of `templates/figures.txt.j2`; with the name of an optional package before
            it, as "posterior/corner", of that package's `text.txt.j2`.
        records: its arguments.
    """
    package, _, name = name.rpartition("/")
    template = f"{package}/text" if package else "figures"
    title, caption, alt = figure_words(phrase(template, name, **records))
    return Described(name=name, title=title, caption=caption, alt=alt)


def new_figure(
    title: str, campaign: str, *, synthetic: bool, height: float, width: float = WIDTH
) -> Figure:
    """An empty figure of that size in inches under its title, with the synthetic mark if due.

    Args:
        title: of the campaign.
        campaign: title of the campaign.
        synthetic: whether the data are synthetic, which the figure then prints.
        height: of the figure, inch.
        width: of the figure, inch.
    """
    paper = _paper_width.get()
    if paper:
        height *= max(0.7, paper / width)
        width = paper
    figure = Figure(figsize=(width, height))
    if not paper:
        room = int(width * 13) - (24 if synthetic else 0)
        shown = textwrap.shorten(campaign, room, placeholder=" …")
        top = 1.0 - EDGE / height
        figure.suptitle(f"{title}\n{shown}", x=0.012, y=top, ha="left", linespacing=1.35)
    if synthetic:
        look: dict[str, Any] = {"ha": "right", "va": "top", "weight": "bold", "color": RED}
        look["bbox"] = {"boxstyle": "round,pad=0.35", "facecolor": "white", "edgecolor": RED}
        if paper:  # panels are below it: it hides nothing
            figure.suptitle(SYNTHETIC, x=0.988, y=1.0 - 0.5 * EDGE / height, fontsize=5, **look)
        else:
            figure.text(0.988, 1.0 - 1.5 * EDGE / height, SYNTHETIC, fontsize=8, **look)
    return figure


def save(
    drawing: Described,
    folder: Path,
    *,
    formats: Sequence[str] = (),
    for_page: bool = False,
    interactive: bool = False,
) -> Described:
    """Write a drawing as SVG and in other formats, whole or not at all; what is known of it then.

    The same drawing gives the same bytes.

    Args:
        drawing: figure with its name, title and caption.
        folder: where the files go.
        formats: of further files, "png" and "pdf".
        for_page: whether it is shown on a page: its numbers as CSV go with it then.
        interactive: whether it can be zoomed and read off there, which needs Bokeh.

    Raises:
        BadInput: the folder cannot be written.
    """
    figure: Figure = drawing.drawn
    kinds = tuple(dict.fromkeys(("svg", *formats)))
    saved = replace(drawing, folder=folder, drawn=None, kinds=kinds)
    about = {"Title": drawing.title, "Date": None, "Creator": None, "Description": drawing.alt}
    write_whole(saved.file("svg"), _svg(figure, about))
    for kind in kinds[1:]:
        about = {"Software": None, "Title": drawing.title, "Description": drawing.alt}
        if kind == "pdf":
            about = {"CreationDate": None, "Title": drawing.title, "Subject": drawing.alt}
        image = io.BytesIO()
        figure.savefig(image, format=kind, metadata=about, dpi=PNG_DPI)
        write_whole(saved.file(kind), image.getvalue())
    if not for_page:
        return saved
    write_whole(saved.file("csv"), figure_csv(figure))
    live = ""
    if interactive:
        from fitting.report import interactive as bokeh  # takes half a second to import

        live = bokeh.document(figure)
    return replace(saved, kinds=(*kinds, "csv"), live=live)


class _Measured(FigureCanvasSVG):
    """The canvas of a figure that is laid out by the renderer that draws it."""

    def __init__(self, figure: Figure, renderer: Any) -> None:
        super().__init__(figure)
        self._renderer = renderer

    def get_renderer(self) -> Any:
        """What measures texts."""
        return self._renderer


def _svg(figure: Figure, about: Mapping[str, str | None]) -> str:
    """A figure as SVG, laid out once for all its formats.

    Matplotlib's own way measures all texts twice and draws everything twice: layout and drawing
    have a renderer each there. Here both have the same one, which remembers how long a text is.
    """
    dpi, text = figure.dpi, io.StringIO()
    width, height = figure.get_size_inches()
    figure.set_dpi(72.0)  # of SVG
    # renderers have no types
    svg = RendererSVG(72.0 * width, 72.0 * height, text, image_dpi=dpi, metadata=about)  # type: ignore[no-untyped-call]
    renderer: Any = MixedModeRenderer(figure, width, height, dpi, svg)  # type: ignore[no-untyped-call]
    _Measured(figure, renderer)
    lay_out(figure)
    figure.draw(renderer)
    renderer.finalize()
    figure.set_dpi(dpi)
    return text.getvalue()


def lay_out(figure: Figure) -> None:
    """Move panels apart, between title and legend.

    Args:
        figure: as it is drawn.
    """
    for spine in (spine for axes in figure.axes for spine in axes.spines.values()):
        spine.set_in_layout(False)  # it reaches no further than its ticks
    figure.tight_layout(pad=PAD, w_pad=BETWEEN, h_pad=BETWEEN)
    for legend in figure.legends:  # it is at the lower edge, where no panel may be
        room = legend.get_window_extent().height / figure.dpi / figure.get_figheight()
        specs = [spec for axes in figure.axes if (spec := axes.get_subplotspec())]
        kept, rows = figure.subplotpars, max(spec.get_gridspec().nrows for spec in specs)
        size = (kept.top - kept.bottom) / (rows + kept.hspace * (rows - 1))
        between = kept.hspace * size / (size - room / rows)  # as wide as before, of lower panels
        figure.subplots_adjust(bottom=kept.bottom + room, hspace=between)


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
    longest = max(len(str(handle.get_label())) for handle in handles)
    width = figure.get_figwidth()
    columns = max(1, min(ncols, int(width / (0.45 + 0.065 * longest))))
    rows = -(-len(handles) // columns)
    figure.set_figheight(figure.get_figheight() + 0.17 * max(0, rows - 2))
    figure.legend(handles=list(handles), loc="lower center", ncols=columns)
