"""Figures of a design: what the proposed measurements should do, and what others would."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from fitting.design.result import Design, Kind, Proposal
from fitting.report.figures.style import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    RED,
    Drawing,
    FigureFile,
    legend_below,
    log_axis,
    new_figure,
    save,
    style,
)
from fitting.text.notation import hertz, mathtext, on_log_axis, plain, prefixed

#: Kinds of candidates that the figure has room for, the best of them.
MOST_KINDS = 16


def save_figures(design: Design, folder: Path) -> list[FigureFile]:
    """Draw and write the figures of a design."""
    with style():
        return [save(drawing, folder) for drawing in (draw_steps(design), draw_kinds(design))]


def draw_steps(design: Design) -> Drawing:
    """Expected sigma of the target over the number of proposed measurements."""
    title = f"Expected error of {plain(design.target)} with the proposed measurements"
    figure = new_figure(title, design.title, synthetic=design.synthetic, height=3.9)
    axes = figure.subplots()
    factor, unit = _unit(design)
    count = range(len(design.proposals) + 1)
    expected = [design.before, *(p.expected for p in design.proposals)]
    for place in design.places:
        axes.plot(count, [s / factor for s in place.sigmas], color=GREY, linewidth=0.7, alpha=0.6)
    for values, colour, marker in (
        ([e.worst for e in expected], RED, "v"),
        ([e.mean for e in expected], BLUE, "o"),
        ([e.at for e in expected], BLACK, "s"),
    ):
        shown = [v / factor for v in values]
        axes.plot(count, shown, color=colour, marker=marker, markersize=5)
    log_axis(axes)
    _span_a_decade(axes)
    axes.set_ylabel(f"σ({mathtext(design.target)}) ({unit})")
    axes.set_xticks(count, ["so far", *(_what(p, design) for p in design.proposals)])
    axes.tick_params(axis="x", labelsize=6.5)
    axes.set_xlabel("measured one after the other")
    handles = [
        Line2D([], [], color=BLACK, marker="s", markersize=5, label="at the point given"),
        Line2D([], [], color=BLUE, marker="o", markersize=5, label="average over equal fits"),
        Line2D([], [], color=RED, marker="v", markersize=5, label="worst of them"),
        Line2D([], [], color=GREY, linewidth=0.7, label="each of them"),
    ]
    legend_below(figure, handles, ncols=4)
    caption = (
        f"Expected standard deviation of {plain(design.target)} with the data so far and after "
        "each proposed measurement: at the given point, and at points that fit the data as well. "
        "×: drive level; n: spectra averaged."
    )
    return Drawing("1_design_steps", title, caption, caption, figure)


def _what(p: Proposal, design: Design) -> str:
    """A proposal in three short lines."""
    offsets = ", ".join(f"{f - p.centre_hz:+.3g}" for f in p.tones_hz)
    level = f"×{p.level:g}, " if p.level != 1.0 else ""
    resonance = hertz(p.centre_hz, digits=6)
    return f"{p.output}\n{resonance}\n{offsets} Hz\n{level}n = {p.repeats}"


def draw_kinds(design: Design) -> Drawing:
    """Expected sigma of the target by kinds of candidates, alone and beside the proposed."""
    title = f"Candidates: {plain(design.target)} after one of them"
    kinds = sorted(design.kinds, key=lambda k: k.beside)[:MOST_KINDS][::-1]
    figure = new_figure(
        title, design.title, synthetic=design.synthetic, height=1.9 + 0.23 * len(kinds)
    )
    axes = figure.subplots()
    factor, unit = _unit(design)
    for row, kind in enumerate(kinds):
        axes.plot([kind.best / factor, kind.worst / factor], [row, row], color=BLUE, linewidth=2.2)
        axes.plot([kind.best / factor], [row], marker="o", color=BLUE)
        axes.plot([kind.beside / factor], [row], marker="D", color=ORANGE, markersize=5)
    axes.axvline(design.before.mean / factor, color=BLACK, linestyle=(0, (4, 3)), linewidth=0.9)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(10.0, subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: on_log_axis(float(value))))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_yticks(range(len(kinds)), [_kind(k) for k in kinds])
    axes.set_xlabel(f"expected σ({mathtext(design.target)}), average over equal fits ({unit})")
    handles = [
        Line2D([], [], color=BLUE, marker="o", label="the only measurement: best to worst tones"),
        Line2D(
            [],
            [],
            color=ORANGE,
            marker="D",
            linestyle="none",
            markersize=5,
            label="as the last beside the other proposed ones",
        ),
        Line2D([], [], color=BLACK, linestyle=(0, (4, 3)), linewidth=0.9, label="so far"),
    ]
    legend_below(figure, handles, ncols=3)
    caption = (
        "Candidates by what is observed, where and how strongly it is driven. Two measurements may "
        "be worth much only together: the diamonds show what the best of each kind adds as the "
        "last measurement."
    )
    return Drawing("2_design_candidates", title, caption, caption, figure)


def _kind(kind: Kind) -> str:
    level = f", ×{kind.level:g}" if kind.level != 1.0 else ""
    return f"{kind.output} at {hertz(kind.centre_hz, digits=6)}{level}"


def _unit(design: Design) -> tuple[float, str]:
    size = design.before.mean
    return prefixed(size if math.isfinite(size) else 1.0, design.unit)


def _span_a_decade(axes: Axes) -> None:
    """A logarithmic axis that shows two ticks at least."""
    low, high = axes.get_ylim()
    if high / low < 10.0:
        middle = math.sqrt(low * high)
        axes.set_ylim(middle / 4.0, middle * 4.0)
        axes.yaxis.set_major_locator(LogLocator(10.0, subs=(1.0, 2.0, 5.0)))
