"""Figures of a study of accuracy against cost: every setting, the Pareto front, the plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from fitting.lab.tradeoff.front import pareto
from fitting.lab.tradeoff.records import COHERENT, QUANTITIES, Measurement, Study
from fitting.report.figures.style import (
    Drawing,
    FigureFile,
    legend_below,
    new_figure,
    save,
    style,
)
from fitting.report.plot.axes import (
    BLACK,
    GREY,
    ORANGE,
    SERIES,
    SERIES_MARKERS,
    log_axis,
)
from fitting.text.notation import number, on_log_axis

#: Least ratio of the ends of the cost axis.
LEAST_SPAN = 30.0
HEADINGS = {
    "amplitudes": "two-tone amplitudes",
    "width by sweep": "line width, fit of the sweep",
    "width by amplitudes": "line width, fit of the amplitudes",
}


def save_figures(study: Study, folder: Path) -> list[FigureFile]:
    """Draw and write the figure of a study."""
    with style():
        return [save(draw(study), folder)]


def draw(study: Study) -> Drawing:
    """Error over cost, a panel per quantity; the plan's choices joined to what was asked."""
    shown = [q for q in QUANTITIES if study.of(q)]
    title = "Accuracy against cost"
    figure = new_figure(
        title,
        f"{study.title}: {study.description}",
        synthetic=study.synthetic,
        height=3.1 + 2.1 * (len(shown) - 1),
    )
    # the amplitudes carry the plan's marks and most of the settings: twice the height
    grid = figure.subplots(
        len(shown), 1, squeeze=False, height_ratios=[2.0] + [1.2] * (len(shown) - 1)
    )
    solvers = list(dict.fromkeys(m.setting.solver for m in _sorted(study.measurements)))
    for row, quantity in enumerate(shown):
        axes = grid[row, 0]
        _draw_quantity(axes, study, quantity, solvers)
        axes.set_title(HEADINGS[quantity], loc="left")
    cpu = all(math.isfinite(m.cpu_s) for m in study.measurements)
    grid[-1, 0].set_xlabel(f"cost: {'processor' if cpu else 'wall'} time (s)")
    legend_below(figure, _handles(study, solvers), ncols=4)
    caption = (
        "Largest relative error of every setting over its cost; the line is the Pareto front: "
        "settings that none beats in both. "
        + "Open markers: windows that are not whole periods (flat-top or none). "
        + "Stars: what the plan chose for the accuracy written beside it. "
        + "Errors below the dashed line are the reference's own."
    )
    if any(m.extrapolated for m in study.measurements):
        caption += " Pale markers: not run, cost extrapolated from a shorter run."
    return Drawing(f"tradeoff_{study.scene}", title, caption, caption, figure)


def _sorted(found: Sequence[Measurement]) -> list[Measurement]:
    return sorted(found, key=lambda m: m.setting.solver)


def _draw_quantity(axes: Axes, study: Study, quantity: str, solvers: list[str]) -> None:
    found = [m for m in study.of(quantity) if math.isfinite(m.error)]
    for place, solver in enumerate(solvers):
        colour, marker = _look(place)
        for coherent in (True, False):
            for extrapolated in (False, True):
                some = [
                    m
                    for m in found
                    if m.setting.solver == solver
                    and m.extrapolated == extrapolated
                    and (m.setting.reader == COHERENT) == coherent
                ]
                axes.plot(
                    [m.cost_s for m in some],
                    [m.error for m in some],
                    linestyle="none",
                    marker=marker,
                    markersize=3.6,
                    color=colour,
                    markerfacecolor=colour if coherent else "white",
                    alpha=0.3 if extrapolated else 0.8,
                    zorder=2,
                )
    _draw_front(axes, pareto(found))
    for reference in study.references:
        if reference.quantity == quantity and reference.error > 1e-15:
            axes.axhline(reference.error, color=GREY, linestyle=(0, (4, 3)), linewidth=0.8)
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


def _draw_front(axes: Axes, front: Sequence[Measurement]) -> None:
    if not front:
        return
    axes.plot(
        [m.cost_s for m in front],
        [m.error for m in front],
        color=BLACK,
        linewidth=1.0,
        drawstyle="steps-post",
        zorder=3,
    )


def _draw_plan(axes: Axes, m: Measurement) -> None:
    """The plan's choice, with a line up to the accuracy that was asked of it."""
    wanted = m.planned_for
    if wanted is None or not math.isfinite(m.error):
        return
    cost = m.cost_s
    axes.plot([cost, cost], [m.error, wanted], color=ORANGE, linewidth=0.9, zorder=4)
    axes.plot(
        [cost],
        [m.error],
        marker="*",
        markersize=10,
        color=ORANGE,
        markeredgecolor=BLACK,
        markeredgewidth=0.5,
        linestyle="none",
        zorder=5,
    )
    axes.annotate(
        on_log_axis(wanted),
        (cost, wanted),
        xytext=(3, 1),
        textcoords="offset points",
        fontsize=7,
        color=BLACK,
    )


def _look(place: int) -> tuple[str, str]:
    return SERIES[place % len(SERIES)], SERIES_MARKERS[place % len(SERIES_MARKERS)]


def _handles(study: Study, solvers: list[str]) -> list[Line2D]:
    handles = []
    for place, solver in enumerate(solvers):
        colour, marker = _look(place)
        handles.append(
            Line2D([], [], ls="none", marker=marker, color=colour, markersize=5, label=solver)
        )
    handles.append(Line2D([], [], color=BLACK, linewidth=1.0, label="Pareto front"))
    if any(m.planned_for is not None for m in study.measurements):
        handles.append(
            Line2D(
                [],
                [],
                linestyle="none",
                marker="*",
                markersize=9,
                color=ORANGE,
                markeredgecolor=BLACK,
                label="the plan's choice",
            )
        )
    if any(r.error > 1e-15 for r in study.references):
        floor = max(r.error for r in study.references)
        handles.append(
            Line2D(
                [],
                [],
                color=GREY,
                linestyle=(0, (4, 3)),
                linewidth=0.8,
                label=f"reference's own error (up to {number(floor, 1)})",
            )
        )
    if any(m.extrapolated for m in study.measurements):
        handles.append(
            Line2D(
                [],
                [],
                linestyle="none",
                marker="o",
                color=GREY,
                alpha=0.35,
                markersize=5,
                label="extrapolated",
            )
        )
    return handles
