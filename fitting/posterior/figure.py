"""The corner figure: every value of a posterior alone, and each two against each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D

from fitting.extension.drawing import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    Axes,
    described,
    legend_below,
    new_figure,
    plain_ticks,
    save,
    style,
)
from fitting.extension.report import Figure as Described
from fitting.posterior.summary import PosteriorSummary
from fitting.text.arrays import FloatArray
from fitting.text.notation import Scaling, mathtext, scaling_for

#: Values that are drawn at most: more panels than these tell nothing any more.
MOST = 7


def save_figure(summary: PosteriorSummary, draws: FloatArray, folder: Path) -> Described:
    """Draw and write the figure.

    Args:
        summary: What the draws show.
        draws: (k, n) in the parameters' units.
        folder: Where the files go.
    """
    with style():
        return save(draw(summary, draws), folder, for_page=True)


def draw(summary: PosteriorSummary, draws: FloatArray) -> Described:
    """The corner figure.

    Args:
        summary: What the draws show.
        draws: (k, n) in the parameters' units.
    """
    names = list(summary.values)
    shared = [name for name in names if summary.values[name].shared]
    shown = (shared or names)[:MOST]
    columns = [draws[:, names.index(name)] for name in shown]
    scalings = [
        scaling_for(c.tolist(), summary.values[n].unit) for n, c in zip(shown, columns, strict=True)
    ]
    count = len(shown)
    # a column has one axis of its value, and a row has that of its
    ends = [_ends(scale, c) for c, scale in zip(columns, scalings, strict=True)]
    rest = [name for name in summary.values if name not in shown]
    words = described("posterior/corner", posterior=summary, rest=rest)
    height = 1.2 + max(1.6, 6.4 / count) * count
    figure = new_figure(words.title, summary.title, synthetic=summary.synthetic, height=height)
    grid = figure.subplots(count, count, squeeze=False)
    for i in range(count):
        for k in range(count):
            axes = grid[i][k]
            if k > i:
                axes.set_visible(False)
                continue
            if k == i:
                alone(axes, columns[i], scalings[i], summary.values[shown[i]].ci95)
            else:
                together(axes, columns[k], columns[i], (scalings[k], scalings[i]))
            which = (k,) if k == i else (k, i)
            for kind, place in _places(summary):
                marked(axes, [scalings[j](place[shown[j]]) for j in which], kind=kind)
            axes.set_xlabel(scalings[k].label(mathtext(shown[k])) if i == count - 1 else "")
            axes.set_ylabel(scalings[i].label(mathtext(shown[i])) if k == 0 < i else "")
            axes.tick_params(labelbottom=i == count - 1, labelleft=k == 0 < i)
            axes.set_xlim(*ends[k])
            if k < i:
                axes.set_ylim(*ends[i])
    legend_below(figure, _handles(summary), ncols=4)
    return replace(words, drawn=figure, number=1)


def _ends(scale: Scaling, draws: FloatArray) -> tuple[float, float]:
    """Ends of the axis of a value, about its draws."""
    low, high = scale(float(np.min(draws))), scale(float(np.max(draws)))
    margin = 0.04 * (high - low) or 1.0
    return low - margin, high + margin


def _places(summary: PosteriorSummary) -> list[tuple[str, dict[str, float]]]:
    """Kind and values of what is marked, what matters most last."""
    first, *others = summary.modes
    truth = {name: v.truth for name, v in summary.values.items()}
    return [
        *(("other", dict(m.parameters)) for m in others),
        ("fit", dict(first.parameters)),
        ("truth", truth),
    ]


def _handles(summary: PosteriorSummary) -> list[Line2D]:
    made = [
        Line2D([], [], color=BLUE, lw=0.9, label="outlines of 68 % and 95 % of the draws"),
        Line2D([], [], ls="none", marker="*", color=RED, label="most likely minimum"),
    ]
    if len(summary.modes) > 1:
        made.append(Line2D([], [], ls="none", marker="D", color=ORANGE, label="other minima"))
    if any(v.truth == v.truth for v in summary.values.values()):
        made.append(Line2D([], [], ls="none", marker="P", color=GREEN, label="truth"))
    return made


#: Least and most bins of each axis; between them a quarter of the root of the draws.
BINS = (10, 30)
#: Shares of the draws that the outlines hold.
OUTLINED = (0.95, 0.68)


def alone(axes: Axes, draws: FloatArray, scaling: Scaling, interval: tuple[float, float]) -> None:
    """Draw how often each value was drawn, its 95 % interval as a band.

    Args:
        axes: to draw into.
        draws: (k,) in their unit.
        scaling: how they are shown.
        interval: in their unit; NaN: none is stated.
    """
    axes.hist((draws - scaling.offset) / scaling.factor, _bins(draws), color=BLUE, histtype="step")
    if all(map(math.isfinite, interval)):
        axes.axvspan(*(scaling(end) for end in interval), color=GREY, alpha=0.18, lw=0)
    plain_ticks(axes, x=3)
    axes.set_yticks([])


def together(
    axes: Axes, across: FloatArray, up: FloatArray, scalings: tuple[Scaling, Scaling]
) -> None:
    """Draw two values against each other: outlines that hold 68 % and 95 % of the draws.

    Args:
        axes: to draw into.
        across: (k,) in their unit.
        up: (k,) in their unit.
        scalings: how both are shown.
    """
    x, y = ((v - s.offset) / s.factor for v, s in zip((across, up), scalings, strict=True))
    counts, x_ends, y_ends = np.histogram2d(x, y, _bins(x))
    ordered = np.sort(counts.ravel())[::-1]
    cumulated = np.cumsum(ordered) / counts.sum()
    levels = sorted({float(ordered[np.searchsorted(cumulated, share)]) for share in OUTLINED})
    middles = [0.5 * (ends[1:] + ends[:-1]) for ends in (x_ends, y_ends)]
    axes.plot(x[:: max(1, x.size // 800)], y[:: max(1, x.size // 800)], ",", color=GREY, alpha=0.5)
    if levels[-1] < np.max(counts):
        axes.contour(*middles, counts.T, levels=levels, colors=[BLUE], linewidths=0.9)
    plain_ticks(axes, x=3, y=3)


def _bins(draws: FloatArray) -> int:
    return int(np.clip(0.25 * np.sqrt(draws.size), *BINS))


def marked(axes: Axes, place: Sequence[float], *, kind: str) -> None:
    """Mark a place: a line in a panel of one value, a sign in one of two.

    Args:
        axes: to draw into.
        place: one or two values as they are shown.
        kind: "fit", "other" (minimum) or "truth".
    """
    colour, sign, dashes = {
        "fit": (RED, "*", "-"),
        "other": (ORANGE, "D", ":"),
        "truth": (GREEN, "P", "--"),
    }[kind]
    if not all(map(math.isfinite, place)):
        return
    if len(place) == 1:
        axes.axvline(place[0], color=colour, ls=dashes, lw=1.0)
    else:
        axes.plot(*place, sign, color=colour, ms=6.0, mec="white", mew=0.5)
