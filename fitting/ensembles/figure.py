"""The figure of an ensemble: pulls of every value, and how often intervals hold the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from fitting.ensembles.result import Coverage, Ensemble
from fitting.extension.drawing import (
    BLUE,
    GREY,
    RED,
    described,
    legend_below,
    new_figure,
    save,
    style,
)
from fitting.extension.report import Figure as Described
from fitting.text.notation import sign

#: Level, its place above or below the line of a value, colour and marker.
LEVELS = ((0.68, -0.14, BLUE, "o"), (0.95, 0.14, RED, "s"))
#: Pulls beyond it stand at the edge.
MOST_PULL = 5.0


def save_figures(ensemble: Ensemble, folder: Path) -> list[Described]:
    """Draw and write the figure; none where nothing is known to be true.

    Args:
        ensemble: many fits.
        folder: where the files go.
    """
    if not ensemble.coverage:
        return []
    with style():
        return [save(draw(ensemble), folder, for_page=True)]


def draw(ensemble: Ensemble) -> Described:
    """Pulls on the left, shares with their binomial intervals on the right, a line per value.

    Args:
        ensemble: many fits with known truth.
    """
    words, values = described("ensembles/ensemble", most=MOST_PULL), ensemble.coverage
    height = 1.7 + 0.42 * len(values)
    figure = new_figure(words.title, ensemble.title, synthetic=ensemble.synthetic, height=height)
    left, right = figure.subplots(1, 2, sharey=True)
    _draw_pulls(left, values)
    _draw_shares(right, values)
    left.set_yticks(range(len(values)), [sign(c.name) for c in values])
    left.set_ylim(len(values) - 0.5, -0.5)
    legend_below(figure, _handles(), ncols=3)
    return replace(words, drawn=figure, number=1)


def _draw_pulls(axes: Axes, values: tuple[Coverage, ...]) -> None:
    for place, c in enumerate(values):
        pulls = np.clip(np.array(c.pulls), -MOST_PULL, MOST_PULL)
        # spread by their order: the same picture every time
        spread = 0.5 * (np.arange(pulls.size) * 0.618034 % 1.0) - 0.25
        axes.plot(pulls, place + spread, ls="none", marker=".", ms=3, color=GREY, alpha=0.6)
        if pulls.size > 1:
            axes.errorbar([c.pull_mean], [place], xerr=[c.pull_std], fmt="D", ms=4, color=BLUE)
    for pull in (-1.0, 0.0, 1.0):
        axes.axvline(pull, color=GREY, ls="--", lw=0.8)
    axes.set_xlim(-MOST_PULL - 0.3, MOST_PULL + 0.3)
    axes.set_xlabel("pull: (value − truth)/error")


def _draw_shares(axes: Axes, values: tuple[Coverage, ...]) -> None:
    for level, off, colour, marker in LEVELS:
        for place, c in enumerate(values):
            share = c.held95 if level == 0.95 else c.held68
            if not share.total:
                continue
            low, high = share.interval
            ends = [[100.0 * (share.part - low)], [100.0 * (high - share.part)]]
            part = [100.0 * share.part]
            axes.errorbar(part, [place + off], xerr=ends, fmt=marker, ms=4, color=colour)
        axes.axvline(100.0 * level, color=colour, ls="--", lw=0.8)
    axes.set_xlim(0.0, 101.0)
    axes.set_xlabel("intervals that hold the truth (%)")


def _handles() -> list[Line2D]:
    pull = Line2D([], [], ls="none", marker="D", ms=4, color=BLUE, label="mean and spread of pulls")
    return [
        pull,
        *(
            Line2D([], [], ls="none", marker=m, ms=4, color=c, label=f"{100.0 * v:g} % intervals")
            for v, _, c, m in LEVELS
        ),
    ]
