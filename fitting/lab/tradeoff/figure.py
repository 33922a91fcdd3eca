"""Figures of a study of accuracy against cost: every setting, the Pareto front, the plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from fitting.extension.drawing import (
    BLACK,
    GREY,
    ORANGE,
    SERIES,
    SERIES_MARKERS,
    described,
    legend_below,
    log_axis,
    new_figure,
    save,
    style,
)
from fitting.extension.report import Figure as Described
from fitting.lab.names import QUANTITIES
from fitting.lab.tradeoff.front import pareto
from fitting.lab.tradeoff.records import COHERENT, Measurement, Study
from fitting.text.notation import number, on_log_axis

#: How the front, the reference's own error and the plan's choices look.
FRONT: dict[str, Any] = {"color": BLACK, "linewidth": 1.0}
FLOOR: dict[str, Any] = {"color": GREY, "linestyle": (0, (4, 3)), "linewidth": 0.8}
PLAN: dict[str, Any] = {
    "linestyle": "none",
    "marker": "*",
    "color": ORANGE,
    "markeredgecolor": BLACK,
}
#: An error of a reference that is none.
ROUNDING = 1e-15
#: Least ratio of the ends of the cost axis.
LEAST_SPAN = 30.0
HEADINGS = {
    "amplitudes": "two-tone amplitudes",
    "width by sweep": "line width, fit of the sweep",
    "width by amplitudes": "line width, fit of the amplitudes",
}


def save_figures(study: Study, folder: Path) -> list[Described]:
    """Draw and write the figure of a study; none of one that ended before its first setting.

    Args:
        study: errors and costs of every setting.
        folder: where the files go.
    """
    if not study.measurements:
        return []
    with style():
        return [save(draw(study), folder, for_page=True)]


def draw(study: Study) -> Described:
    """Error over cost, a panel per quantity; the plan's choices joined to what was asked.

    Args:
        study: errors and costs of every setting.
    """
    shown = [q for q in QUANTITIES if study.of(q)]
    words = described("lab/tradeoff/tradeoff", study=study)
    what = f"{study.title}: {study.description}"
    height = 3.1 + 2.1 * (len(shown) - 1)
    figure = new_figure(words.title, what, synthetic=study.synthetic, height=height)
    # the amplitudes carry the plan's marks and most of the settings: twice the height
    ratios = [2.0] + [1.2] * (len(shown) - 1)
    grid = figure.subplots(len(shown), 1, squeeze=False, height_ratios=ratios)
    solvers = list(dict.fromkeys(m.setting.solver for m in _sorted(study.measurements)))
    for row, quantity in enumerate(shown):
        axes = grid[row, 0]
        _draw_quantity(axes, study, quantity, solvers)
        axes.set_title(HEADINGS[quantity], loc="left")
    grid[-1, 0].set_xlabel(f"cost: {study.cost_kind} time (s)")
    legend_below(figure, _handles(study, solvers), ncols=4)
    return replace(words, name=f"tradeoff_{study.scene}", drawn=figure, number=1)


def _sorted(found: Sequence[Measurement]) -> list[Measurement]:
    return sorted(found, key=lambda m: m.setting.solver)


def _draw_quantity(axes: Axes, study: Study, quantity: str, solvers: list[str]) -> None:
    found = [m for m in study.of(quantity) if math.isfinite(m.error)]
    for m in found:
        axes.plot(
            [m.cost_s],
            [m.error],
            **_look(solvers.index(m.setting.solver), m.setting.reader == COHERENT),
            markersize=3.6,
            alpha=0.3 if m.extrapolated else 0.8,
            zorder=2,
        )
    front = pareto(found)
    axes.plot(
        [m.cost_s for m in front],
        [m.error for m in front],
        **FRONT,
        drawstyle="steps-post",
        zorder=3,
    )
    for reference in study.references:
        if reference.quantity == quantity and reference.error > ROUNDING:
            axes.axhline(reference.error, **FLOOR)
    for m in study.of(quantity, planned=True):
        _draw_plan(axes, m)
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    if high < LEAST_SPAN * low:  # an axis without a labelled tick says nothing
        stretch = math.sqrt(LEAST_SPAN * low / high)
        axes.set_xlim(low / stretch, high * stretch)
    axes.xaxis.set_major_locator(LogLocator(10.0, numticks=12))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: on_log_axis(float(value))))
    axes.xaxis.set_minor_formatter(NullFormatter())
    log_axis(axes)
    axes.set_ylabel("relative error")


def _draw_plan(axes: Axes, m: Measurement) -> None:
    """The plan's choice, with a line up to the accuracy that was asked of it."""
    wanted = m.planned_for
    if wanted is None or not math.isfinite(m.error):
        return
    cost = m.cost_s
    axes.plot([cost, cost], [m.error, wanted], color=ORANGE, linewidth=0.9, zorder=4)
    axes.plot([cost], [m.error], **PLAN, markersize=10, markeredgewidth=0.5, zorder=5)
    axes.annotate(
        on_log_axis(wanted),
        (cost, wanted),
        xytext=(3, 1),
        textcoords="offset points",
        fontsize=7,
        color=BLACK,
    )


def _look(place: int, filled: bool = True) -> dict[str, Any]:
    """Marker of a solver, open where its window is not whole periods."""
    colour = SERIES[place % len(SERIES)]
    return {
        "linestyle": "none",
        "marker": SERIES_MARKERS[place % len(SERIES_MARKERS)],
        "color": colour,
        "markerfacecolor": colour if filled else "white",
    }


def _handles(study: Study, solvers: list[str]) -> list[Line2D]:
    handles = [
        Line2D([], [], **_look(place), markersize=5, label=solver)
        for place, solver in enumerate(solvers)
    ]
    handles.append(Line2D([], [], **FRONT, label="Pareto front"))
    if any(m.planned_for is not None for m in study.measurements):
        handles.append(Line2D([], [], **PLAN, markersize=9, label="the plan's choice"))
    floor = max((r.error for r in study.references), default=0.0)
    if floor > ROUNDING:
        label = f"reference's own error (up to {number(floor, 1)})"
        handles.append(Line2D([], [], **FLOOR, label=label))
    if any(m.extrapolated for m in study.measurements):
        pale = Line2D([], [], ls="none", marker="o", color=GREY, markersize=5, label="extrapolated")
        pale.set_alpha(0.35)
        handles.append(pale)
    return handles
