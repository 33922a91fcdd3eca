"""Figures of a design: what the proposed measurements should do, and what others would."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from fitting.design.result import Design, Kind
from fitting.extension.drawing import (
    BLUE,
    GREY,
    ORANGE,
    RED,
    axes_of,
    described,
    handles_of,
    ink,
    legend_below,
    log_axis,
    new_figure,
    save,
    style,
)
from fitting.extension.report import Figure as Described
from fitting.extension.report import phrase
from fitting.text.notation import on_log_axis, prefixed, sign, with_unit


def save_figures(design: Design, folder: Path) -> list[Described]:
    """Draw and write the figures of a design.

    Args:
        design: the proposed next measurement.
        folder: where the files go.
    """
    kinds = 1.9 + 0.23 * len(best_kinds(design))
    drawings = (("steps", expected_errors, 3.9, 4), ("candidates", candidates, kinds, 3))
    made = []
    with style():
        for number, (name, draw, height, columns) in enumerate(drawings, 1):
            words = described(f"design/design_{name}", design=design)
            synthetic = design.synthetic
            figure = new_figure(words.title, design.title, synthetic=synthetic, height=height)
            axes = draw(design, ax=figure.subplots())
            legend_below(figure, handles_of(axes), ncols=columns)
            drawn = replace(words, drawn=figure, number=number)
            made.append(save(drawn, folder, for_page=True))
    return made


#: Kinds of candidates that a plot has room for, the best of them.
MOST_KINDS = 16
DASHED = (0, (4, 3))


def expected_errors(design: Design, *, ax: Axes | None = None) -> Axes:
    """Draw the expected standard deviation of the target over the proposed measurements.

    Args:
        design: A proposal: at the given point, geometric mean and worst over points that fit as
            well, in the target's unit.
        ax: Where to draw; None: pyplot's current axes.
    """
    axes = axes_of(ax)
    factor, unit = _unit(design)
    count = range(len(design.proposals) + 1)
    expected = [design.before, *(p.expected for p in design.proposals)]
    for values, colour, marker, depth, label in (
        ([e.at for e in expected], ink(), "s", 2.3, "at the point given"),
        ([e.mean for e in expected], BLUE, "o", 2.2, "average over equal fits"),
        ([e.worst for e in expected], RED, "v", 2.1, "worst of them"),
    ):
        shown = [v / factor for v in values]
        axes.plot(
            count, shown, color=colour, marker=marker, markersize=5, zorder=depth, label=label
        )
    for k, place in enumerate(design.places):
        axes.plot(
            count,
            [s / factor for s in place.sigmas],
            color=GREY,
            linewidth=0.7,
            alpha=0.6,
            zorder=1.9,
            label="each of them" if k == 0 else None,
        )
    log_axis(axes)
    low, high = axes.get_ylim()
    if high / low < 10.0:  # a logarithmic axis that shows two ticks at least
        middle = math.sqrt(low * high)
        axes.set_ylim(middle / 4.0, middle * 4.0)
        axes.yaxis.set_major_locator(LogLocator(10.0, subs=(1.0, 2.0, 5.0)))
    axes.set_ylabel(with_unit(f"σ({sign(design.target)})", unit))
    axes.set_xticks(
        count, ["so far", *(phrase("design/text", "tick", p) for p in design.proposals)]
    )
    axes.tick_params(axis="x", labelsize="x-small")
    axes.set_xlabel("measured one after the other")
    return axes


def candidates(design: Design, *, ax: Axes | None = None) -> Axes:
    """Draw the expected standard deviation of the target by kinds of candidates.

    Bars: the best to the worst of a kind as only measurement; diamond: its best after the other
    proposed ones.

    Args:
        design: A proposal, averaged over points that fit as well, in the target's unit.
        ax: Where to draw; None: pyplot's current axes.
    """
    axes, kinds = axes_of(ax), best_kinds(design)
    factor, unit = _unit(design)
    axes.plot([], [], color=BLUE, marker="o", label="the only measurement: best to worst tones")
    for row, kind in enumerate(kinds):
        first = row == 0
        axes.plot([kind.best / factor, kind.worst / factor], [row, row], color=BLUE, linewidth=2.2)
        axes.plot([kind.best / factor], [row], marker="o", color=BLUE)
        axes.plot(
            [kind.beside / factor],
            [row],
            marker="D",
            linestyle="none",
            color=ORANGE,
            markersize=5,
            label="as the last, with the other proposed ones" if first else None,
        )
    axes.axvline(
        design.before.mean / factor, color=ink(), linestyle=DASHED, linewidth=0.9, label="so far"
    )
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(10.0, subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: on_log_axis(float(value))))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_yticks(range(len(kinds)), [phrase("design/text", "kind", k) for k in kinds])
    what = f"expected σ({sign(design.target)}), average over equal fits"
    axes.set_xlabel(with_unit(what, unit))
    return axes


def best_kinds(design: Design) -> list[Kind]:
    """The kinds of candidates that are drawn, the best last.

    Args:
        design: the proposed next measurement.
    """
    return sorted(design.kinds, key=lambda kind: kind.beside)[:MOST_KINDS][::-1]


def _unit(design: Design) -> tuple[float, str]:
    size = design.before.mean
    return prefixed(size if math.isfinite(size) else 1.0, design.unit)
