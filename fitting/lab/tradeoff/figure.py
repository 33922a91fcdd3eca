"""Figure of a study: how far off every setting is over its cost."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from matplotlib.axes import Axes

from fitting.extension.drawing import (
    BLACK,
    GREY,
    ORANGE,
    SERIES,
    described,
    log_axis,
    new_figure,
    save,
    style,
)
from fitting.extension.report import Figure as Described
from fitting.lab.tradeoff.records import SUFFICIENT, Row, Study

#: What is drawn for an error of nothing, standard deviations.
NOTHING = 1e-12


def save_figures(study: Study, folder: Path) -> list[Described]:
    """Draw and write the figure of a study; none of one without a row.

    Args:
        study: what was measured.
        folder: where the files go.
    """
    if not any(_is_shown(row) for row in study.rows):
        return []
    with style():
        return [save(draw(study), folder)]


def draw(study: Study) -> Described:
    """What a setting is off by over its cost, the plan's choice as a star.

    Args:
        study: what was measured.
    """
    words = described("lab/tradeoff/tradeoff", study=study)
    figure = new_figure(words.title, study.title, synthetic=study.synthetic, height=3.4)
    axes: Axes = figure.subplots()
    for row in filter(_is_shown, study.rows):
        place, is_plan = (row.cost_s, max(row.off, NOTHING)), row is study.planned
        colour = ORANGE if is_plan else SERIES[0]
        axes.plot(
            *([x] for x in place),
            linestyle="none",
            marker="*" if is_plan else "o",
            markersize=10 if is_plan else 4,
            color=colour,
            markeredgecolor=BLACK if row is study.cheapest else colour,
        )
        axes.annotate(
            row.setting.name, place, xytext=(4, 3), textcoords="offset points", fontsize=6
        )
    axes.axhline(SUFFICIENT, color=GREY, linestyle=(0, (4, 3)), linewidth=0.8)
    axes.set_xscale("log")
    log_axis(axes)
    fitted = any(row.shifts for row in study.rows)
    axes.set_xlabel(f"processor time of {'a fit' if fitted else 'an evaluation'} (s)")
    axes.set_ylabel("largest shift (σ)" if fitted else "largest error of a datum (σ)")
    return replace(words, name="tradeoff", drawn=figure, number=1)


def _is_shown(row: Row) -> bool:
    return not row.failed and math.isfinite(row.off) and row.cost_s > 0.0
