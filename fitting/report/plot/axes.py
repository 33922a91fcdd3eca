"""What all plots share: colours, markers, ticks; none of it changes matplotlib's settings.

Colours are Okabe and Ito's, told apart with any colour vision; nothing rests on colour alone:
markers and dashes say the same. Ink and paper are those of the style that is in use.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import matplotlib as mpl
from matplotlib.axes import Axes as Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, ScalarFormatter

from fitting.text.notation import on_log_axis

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
    """A name cut to so many characters, dollar signs escaped for matplotlib.

    The middle goes: names in a row mostly differ at their ends.

    Args:
        text: as it was written.
        longest: characters at most.
    """
    tail = longest // 2
    cut = text if len(text) <= longest else f"{text[: longest - 1 - tail]}…{text[-tail:]}"
    return cut.replace("$", r"\$")


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
    """Legend entries that tell which marker is which experiment.

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
    return max(1.5, whole * len(spec.colspan) / spec.get_gridspec().ncols)
