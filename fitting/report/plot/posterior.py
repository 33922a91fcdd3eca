"""Draws from a posterior, of one value and of two against each other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fitting.report.plot.axes import BLUE, GREEN, GREY, ORANGE, RED, Axes, plain_ticks
from fitting.text.arrays import FloatArray
from fitting.text.notation import Scaling

#: Least and most bins of each axis; between them a quarter of the root of the draws.
BINS = (10, 30)
#: Shares of the draws that the outlines hold.
HELD = (0.95, 0.68)


def alone(axes: Axes, draws: FloatArray, scaling: Scaling, interval: tuple[float, float]) -> None:
    """Draw how often each value was drawn, its 95 % interval as a band.

    Args:
        axes: to draw into.
        draws: (k,) in their unit.
        scaling: how they are shown.
        interval: in their unit; NaN: none is told.
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
    held = np.cumsum(ordered) / counts.sum()
    levels = sorted({float(ordered[np.searchsorted(held, share)]) for share in HELD})
    middles = [0.5 * (ends[1:] + ends[:-1]) for ends in (x_ends, y_ends)]
    axes.plot(x[:: max(1, x.size // 800)], y[:: max(1, x.size // 800)], ",", color=GREY, alpha=0.5)
    if levels[-1] < counts.max():
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
