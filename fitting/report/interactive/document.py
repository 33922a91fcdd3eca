"""A drawn figure as data for a page: Bokeh's document of its panels, their places, its legend."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from bokeh.core.json_encoder import serialize_json
from bokeh.document import Document
from bokeh.resources import Resources
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fitting.report.figures.data import bare, panels_of
from fitting.report.interactive.looks import Look, look_of
from fitting.report.interactive.panel import Curve, Ranges, plot_of
from fitting.report.plot.axes import GREY


def interactive(figure: Figure) -> dict[str, Any]:
    """A figure that can be zoomed, read off and toggled, as plain data.

    ``document`` is Bokeh's; ``panels`` are the ``root`` of each in it with its place in the grid of
    so many ``columns`` (their relative widths); ``legend`` the names and looks of what can be
    toggled: a model's tags say by which of them.

    Args:
        figure: as it is drawn, laid out.
    """
    document, ranges, curves = Document(title=""), Ranges(), list[Curve]()
    panels: list[dict[str, Any]] = []
    shown = [axes for _, axes in panels_of(figure)]
    with document.models.freeze():  # they are gathered once, not after every panel
        for axes in shown:
            plot, own = plot_of(axes, ranges)
            curves += own
            document.add_root(plot)
            panels.append({"root": plot.id, **_place(axes)})
    legend = _legend(figure, shown, curves)
    numbers: dict[str, str] = {}
    return {
        "document": _renumbered(
            json.loads(serialize_json(document.to_json(deferred=False))), numbers
        ),
        "panels": [{**panel, "root": numbers[panel["root"]]} for panel in panels],
        "columns": _columns(shown),
        "legend": legend,
    }


def as_text(data: dict[str, Any]) -> str:
    """An interactive figure as JSON.

    Args:
        data: of the figure.
    """
    return json.dumps(data, separators=(",", ":"))


def library() -> str:
    """What draws interactive figures in a browser: BokehJS without its extensions."""
    return "\n".join(Resources(mode="inline", components=["bokeh"]).js_raw)


def _place(axes: Axes) -> dict[str, int]:
    """Place in the grid, counted from one, as style sheets do."""
    spec = axes.get_subplotspec()
    if spec is None:
        return {"row": 1, "column": 1, "rows": 1, "columns": 1}
    return {
        "row": spec.rowspan.start + 1,
        "column": spec.colspan.start + 1,
        "rows": len(spec.rowspan),
        "columns": len(spec.colspan),
    }


def _columns(shown: Sequence[Axes]) -> list[float]:
    spec = shown[0].get_subplotspec() if shown else None
    if spec is None:
        return [1.0]
    grid = spec.get_gridspec()
    ratios = np.broadcast_to(np.asarray(grid.get_width_ratios(), float), grid.ncols)
    return [float(ratio) for ratio in ratios]


def _legend(figure: Figure, shown: Sequence[Axes], curves: Sequence[Curve]) -> list[dict[str, Any]]:
    """Entries of all legends, each once; every curve is tagged with those that switch it."""
    handles: dict[str, Artist] = {}
    legends = [*figure.legends, *(axes.get_legend() for axes in shown)]
    for legend in filter(None, legends):
        for handle, text in zip(legend.legend_handles, legend.get_texts(), strict=True):
            parts: list[Any] = [handle] if isinstance(handle, Artist) else [*(handle or ())]
            parts = [part for part in parts if isinstance(part, Artist)]
            if parts:
                handles.setdefault(bare(text.get_text()), parts[0])
    looks = {label: look_of(handle) for label, handle in handles.items()}
    entries = []
    for number, (label, look) in enumerate(looks.items()):
        mine = [c for c in curves if _switches(label, look, c, looks)]
        for curve in mine:
            curve.model.tags = [*curve.model.tags, number]
        entries.append(
            {
                "label": label,
                "colour": look.colour,
                "fill": look.fill,
                **_swatch(handles[label], look, next((c for c in mine if c.label == label), None)),
                "switches": bool(mine),
            }
        )
    return entries


def _swatch(handle: Artist, look: Look, named: Curve | None) -> dict[str, str]:
    """Marker and dash of an entry: those of the curve that has its name, where one has.

    Matplotlib makes a dashed line of what stands in a legend for a collection of whole ones, and
    the bars of errors for points with bars.
    """
    if isinstance(handle, Line2D):
        return {"marker": look.marker, "dash": named.look.dash if named else look.dash}
    if isinstance(handle, LineCollection):
        return {"marker": "bar", "dash": ""}
    return {"marker": "square", "dash": look.dash}


def _switches(label: str, look: Look, curve: Curve, looks: dict[str, Look]) -> bool:
    """Whether an entry stands for a curve: by its name, else by its colour, or its marker alone.

    Grey markers stand for shapes of any colour.
    """
    if curve.label in looks:
        return curve.label == label
    if curve.label or not curve.look.colour:
        return False
    if look.colour == GREY and look.marker and not look.dash:
        return curve.look.marker == look.marker
    return curve.look.colour == look.colour


def _renumbered(plain: Any, numbers: dict[str, str]) -> Any:
    """A document with its models numbered from one: Bokeh counts through a whole process."""
    if isinstance(plain, dict):
        named = dict(plain)
        if "id" in named and (named.keys() == {"id"} or named.get("type") == "object"):
            named["id"] = numbers.setdefault(named["id"], f"m{len(numbers) + 1}")
        return {k: v if k == "id" else _renumbered(v, numbers) for k, v in named.items()}
    if isinstance(plain, list | tuple):
        return [_renumbered(value, numbers) for value in plain]
    return plain
