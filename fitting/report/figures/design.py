"""Figures of a design: what the proposed measurements should do, and what others would."""

from __future__ import annotations

from pathlib import Path

from fitting.design.result import Design
from fitting.report import plot
from fitting.report.figures.file import FigureFile
from fitting.report.figures.style import (
    Drawing,
    handles_of,
    legend_below,
    new_figure,
    save,
    style,
)
from fitting.report.plot.design import best_kinds


def save_figures(design: Design, folder: Path) -> list[FigureFile]:
    """Draw and write the figures of a design.

    Args:
        design: the proposed next measurement.
        folder: where the files go.
    """
    with style():
        return [
            save(drawing, folder, for_page=True)
            for drawing in (draw_steps(design), draw_kinds(design))
        ]


def draw_steps(design: Design) -> Drawing:
    """Expected sigma of the target over the number of proposed measurements.

    Args:
        design: the proposed next measurement.
    """
    title = f"Expected error of {design.target} with the proposed measurements"
    figure = new_figure(title, design.title, synthetic=design.synthetic, height=3.9)
    axes = plot.expected_errors(design, ax=figure.subplots())
    legend_below(figure, handles_of(axes), ncols=4)
    caption = (
        f"Expected standard deviation of {design.target} with the data so far and after "
        "each proposed measurement: at the given point, and at points that fit the data as well. "
        + ("" if design.is_of_traces else "×: drive level; n: spectra averaged.")
    ).strip()
    return Drawing(
        name="design_steps", number=1, title=title, caption=caption, alt=caption, figure=figure
    )


def draw_kinds(design: Design) -> Drawing:
    """Expected sigma of the target by kinds of candidates, alone and beside the proposed.

    Args:
        design: the proposed next measurement.
    """
    title = f"Candidates: {design.target} after one of them"
    height = 1.9 + 0.23 * len(best_kinds(design))
    figure = new_figure(title, design.title, synthetic=design.synthetic, height=height)
    axes = plot.candidates(design, ax=figure.subplots())
    legend_below(figure, handles_of(axes), ncols=3)
    how = "where and how strongly it is driven"
    if design.is_of_traces:
        how = "as which trace and how finely sampled, from the best length to the worst"
    caption = (
        f"Candidates by what is observed, {how}. Two measurements may "
        "be worth much only together: the diamonds show what the best of each kind adds as the "
        "last measurement."
    )
    return Drawing(
        name="design_candidates", number=2, title=title, caption=caption, alt=caption, figure=figure
    )
