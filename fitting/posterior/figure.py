"""The corner figure: every value of a posterior alone, and each two against each other."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D

from fitting.extension.drawing import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    described,
    legend_below,
    new_figure,
    plain_ticks,
    save,
    style,
)
from fitting.extension.report import Figure
from fitting.posterior.summary import PosteriorSummary
from fitting.text.arrays import FloatArray
from fitting.text.notation import scaling_for, sign

#: Values that are drawn at most: more panels than these show nothing any more.
MOST = 7
#: Bins of each axis, and points of a panel at most.
BINS, POINTS = 25, 800
#: Shares of the draws that the outlines contain.
OUTLINED = (0.95, 0.68)


def save_figure(summary: PosteriorSummary, draws: FloatArray, folder: Path) -> Figure:
    """Draw and write the figure.

    Args:
        summary: What the draws show.
        draws: (k, n) in the parameters' units.
        folder: Where the files go.
    """
    with style():
        return save(draw(summary, draws), folder, for_page=True)


def draw(summary: PosteriorSummary, draws: FloatArray) -> Figure:
    """The corner figure; a column has one axis of its value, and a row has that of its value.

    Args:
        summary: What the draws show.
        draws: (k, n) in the parameters' units.
    """
    values = summary.values
    shown = ([name for name in values if values[name].shared] or list(values))[:MOST]
    rest = [name for name in values if name not in shown]
    words, count = described("posterior/corner", posterior=summary, rest=rest), len(shown)
    height = 1.2 + max(1.6, 6.4 / count) * count
    figure = new_figure(words.title, summary.title, synthetic=summary.synthetic, height=height)
    grid = figure.subplots(count, count, squeeze=False, sharex="col")
    table = draws[:, [list(values).index(name) for name in shown]]
    scales = [scaling_for(c.tolist(), values[n].unit) for n, c in zip(shown, table.T, strict=True)]
    columns = [(c - s.offset) / s.factor for c, s in zip(table.T, scales, strict=True)]

    # label, colour, marker, dashes and values of what is marked, what matters most last
    first, *others = (mode.parameters for mode in summary.modes)
    marks = [("other minima", ORANGE, "D", ":", place) for place in others]
    marks.append(("most likely minimum", RED, "*", "-", first))
    if any(math.isfinite(v.truth) for v in values.values()):
        marks.append(("truth", GREEN, "P", "--", {name: v.truth for name, v in values.items()}))

    for i, k in product(range(count), repeat=2):
        axes, x, y = grid[i][k], columns[k], columns[i]
        if k > i:
            axes.set_visible(False)
            continue
        if k == i:
            axes.hist(x, BINS, color=BLUE, histtype="step")
            axes.axvspan(*(scales[k](end) for end in values[shown[k]].ci95), color=GREY, alpha=0.18)
        else:
            # outlines that contain the stated shares of the draws
            axes.plot(x[:: 1 + x.size // POINTS], y[:: 1 + x.size // POINTS], ",", color=GREY)
            counts, *ends = np.histogram2d(x, y, BINS)
            ordered = np.sort(counts.ravel())[::-1]
            levels = ordered[np.searchsorted(np.cumsum(ordered), np.array(OUTLINED) * x.size)]
            middles = [0.5 * (e[1:] + e[:-1]) for e in ends]
            axes.contour(*middles, counts.T, levels=np.unique(levels), colors=[BLUE])
            axes.set_ylim(np.min(y), np.max(y))
        for _, colour, marker, dashes, place in marks:
            across, up = (scales[j](place[shown[j]]) for j in (k, i))
            if k == i:
                axes.axvline(across, color=colour, ls=dashes, lw=1.0)
            else:
                axes.plot(across, up, marker, color=colour, ms=6.0, mec="white", mew=0.5)
        axes.set_xlim(np.min(x), np.max(x))
        plain_ticks(axes, x=3, y=3)
        axes.set_xlabel(scales[k].label(sign(shown[k])) if i == count - 1 else "")
        axes.set_ylabel(scales[i].label(sign(shown[i])) if k == 0 < i else "")
        axes.tick_params(labelleft=k == 0 < i, left=k < i)

    handles = [Line2D([], [], color=BLUE, label="outlines of 68 % and 95 % of the draws")]
    looks = {label: (colour, marker) for label, colour, marker, *_ in marks}
    for label, (colour, marker) in looks.items():
        handles.append(Line2D([], [], ls="none", marker=marker, color=colour, label=label))
    legend_below(figure, handles, ncols=4)
    return replace(words, drawn=figure, number=1)
