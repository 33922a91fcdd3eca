"""Figures of what was measured beside what the model says, of any kind of measurement."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes

from fitting.measurements.figure import Figure, Panel
from fitting.report import plot
from fitting.report.figures.style import WIDTH, Drawing, handles_of, legend_below, new_figure
from fitting.report.shown import ShownCampaign

#: Width of a panel that is one of several, and height of a full one beside others and alone, inch.
PANEL_WIDTH, PANEL_HEIGHT, LONE_HEIGHT = 2.05, 2.15, 2.75
#: Room for title and legend, inch.
HEAD_HEIGHT = 1.4


def draw_measurement(described: Figure, data: ShownCampaign) -> Drawing:
    """A figure as a measurement describes it, under the title of its campaign.

    Args:
        described: what is on its panels, and what is said of them.
        data: what is shown of the campaign, and of each where several are fitted together.
    """
    own = data.series.get(described.series, data)
    columns = max(len(row) for row in described.rows)
    full = LONE_HEIGHT if columns == 1 else PANEL_HEIGHT
    heights = [max(panel.height for panel in row) for row in described.rows]
    figure = new_figure(
        described.title,
        own.title,
        synthetic=own.synthetic,
        height=HEAD_HEIGHT + full * sum(heights),
        width=max(WIDTH, PANEL_WIDTH * columns),
    )
    grid = figure.subplots(len(heights), columns, squeeze=False, height_ratios=heights)
    drawn: dict[tuple[int, int], Axes] = {}
    for (r, c), axes in np.ndenumerate(grid):
        panel = _at(described, r, c)
        if panel is None:
            axes.set_visible(False)
            continue
        _share(axes, panel, described, drawn)
        drawn[r, c] = plot.panel(panel, among=described.panels, ax=axes)
    for (r, c), axes in drawn.items():
        _name_once(axes, described, r, c)
    handles: dict[object, Artist] = {}
    for handle in (h for axes in drawn.values() for h in handles_of(axes)):
        handles.setdefault(handle.get_label(), handle)
    if handles:
        legend_below(figure, list(handles.values()), ncols=4)
    return Drawing(
        name=described.name,
        series=described.series,
        title=", ".join(filter(None, (described.title, described.series))),
        caption=described.caption,
        alt=described.alt,
        figure=figure,
    )


def _at(described: Figure, row: int, column: int) -> Panel | None:
    """The panel at a place of the grid; None where there is none."""
    try:
        return described.rows[row][column]
    except IndexError:
        return None


def _share(
    axes: Axes, panel: Panel, described: Figure, drawn: Mapping[tuple[int, int], Axes]
) -> None:
    """Tie axes to the first ones that show the same along x, and along y."""
    earlier = [(described.rows[r][c], known) for (r, c), known in drawn.items()]
    same_x = next((known for other, known in earlier if other.x == panel.x), None)
    same_y = next((known for other, known in earlier if other.y == panel.y), None)
    if same_x is not None:
        axes.sharex(same_x)
    if same_y is not None:
        axes.sharey(same_y)


def _name_once(axes: Axes, described: Figure, row: int, column: int) -> None:
    """What a panel shares with the one below it or to its left is written there only."""
    panel = described.rows[row][column]
    below = _at(described, row + 1, column)
    left = _at(described, row, column - 1) if column else None
    if below is not None and below.x == panel.x:
        axes.set_xlabel("")
        axes.tick_params(labelbottom=False)
    if left is not None and (left.y, left.when) == (panel.y, panel.when):
        axes.set_ylabel("")
        axes.tick_params(labelleft=False)
