"""Figures to zoom, read off and toggle on a page: the drawn ones, handed to Bokeh.

Bokeh is the extra `interactive`. Points are those of the figure's CSV file; the legend of a panel
toggles what it names.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from bokeh import models
from bokeh.embed import json_item
from bokeh.layouts import grid
from bokeh.plotting import figure as new_plot
from bokeh.resources import Resources
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection, PathCollection, PolyCollection, QuadMesh
from matplotlib.colors import LogNorm, to_hex, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation
from matplotlib.ticker import FixedLocator

from fitting.report.figures.data import Shown, along_axes, bare, panels_of, shown_in

#: Pixels of a point of print, and of an inch; least height of a panel.
POINT, INCH, LEAST = 1.35, 104.0, 170
#: Room for title, axis and legend of a panel, in pixels, and for the bar of a map.
MARGINS, BAR = 90, 60
#: Colours of a map, from its own.
SHADES = 64
#: Digits of the numbers under the pointer: as many as a double has for sure.
READ = "{%.10g}"
MARKERS = {
    "^": "triangle", "p": "square_pin", "D": "diamond", "s": "square", "v": "inverted_triangle",
    "h": "hex", "P": "cross", "X": "x", "*": "star", "<": "triangle_dot", ">": "square_dot",
    "_": "dash", "+": "cross", "x": "x",
}  # fmt: skip
DASHES = {"-": "solid", "--": "dashed", ":": "dotted", "-.": "dashdot"}

Ranges = dict[tuple[str, int], models.Range1d]


def library() -> str:
    """What draws interactive figures in a browser: BokehJS without its extensions."""
    return "\n".join(Resources(mode="inline", components=["bokeh"]).js_raw)


def document(figure: Figure) -> str:
    """A figure that can be zoomed, read off and toggled, as JSON for `Bokeh.embed.embed_item`.

    Args:
        figure: as it is drawn, laid out.
    """
    ranges: Ranges = {}
    rows: dict[int, list[Any]] = {}
    for _, axes in panels_of(figure):
        spec = axes.get_subplotspec()
        rows.setdefault(0 if spec is None else spec.rowspan.start, []).append(_panel(axes, ranges))
    item = json_item(grid([row for _, row in sorted(rows.items())], sizing_mode="stretch_width"))
    numbers: dict[str, str] = {}
    # Bokeh counts its models through a whole process: the same figure is to give the same bytes
    return re.sub(
        r'"p\d{4,}"',
        lambda match: numbers.setdefault(match[0], f'"m{len(numbers) + 1}"'),
        json.dumps(item, separators=(",", ":")),
    )


def _panel(axes: Axes, ranges: Ranges) -> Any:
    """One pair of axes as a plot, with what is drawn in it and its legend below."""
    height = INCH * float(axes.figure.get_figure(root=True).get_size_inches()[1])
    has_map = any(isinstance(artist, QuadMesh) for artist in axes.collections)
    plot = new_plot(
        height=max(LEAST, round(height * axes.get_position().height) + MARGINS) + BAR * has_map,
        x_axis_type="log" if axes.get_xscale() == "log" else "linear",
        y_axis_type="log" if axes.get_yscale() == "log" else "linear",
        x_range=_range(axes, "x", ranges),
        y_range=_range(axes, "y", ranges),
        tools=[models.BoxZoomTool(), models.WheelZoomTool(modifiers="ctrl"), models.ResetTool()],
        sizing_mode="stretch_width",
        title=_plain("\n".join([axes.get_title(loc="left"), axes.get_title()]).strip()),
    )
    for made, lines, axis in (
        (plot.xaxis[0], plot.xgrid[0], axes.xaxis),
        (plot.yaxis[0], plot.ygrid[0], axes.yaxis),
    ):
        _label(made, lines, axis)
    _levels(plot, axes)
    named: dict[str, list[Any]] = {}
    for label, model in (*_bands(plot, axes), *_series(plot, axes)):
        if label:
            named.setdefault(label, []).append(model)
    items = [models.LegendItem(label=label, renderers=drawn) for label, drawn in named.items()]
    if items:
        below = models.Legend(items=items, orientation="horizontal", click_policy="hide", ncols=4)
        plot.add_layout(below, "below")
    for note in axes.texts:
        plot.add_layout(models.Label(**_place(note, axes), text=_plain(note.get_text())))
    return plot


def _range(axes: Axes, letter: str, ranges: Ranges) -> models.Range1d:
    """The range of an axis; panels that share it have one."""
    group = axes.get_shared_x_axes() if letter == "x" else axes.get_shared_y_axes()
    key = (letter, min(id(other) for other in group.get_siblings(axes)))
    if key not in ranges:
        low, high = axes.get_xlim() if letter == "x" else axes.get_ylim()
        ranges[key] = models.Range1d(float(low), float(high))
    return ranges[key]


def _label(made: Any, lines: Any, axis: Axis) -> None:
    """Label, and ticks: named ones as they are, others as the range asks for."""
    made.axis_label = _plain(axis.get_label_text()) or None
    locator = axis.get_major_locator()
    if isinstance(locator, FixedLocator):
        places = [float(v) for v in locator()]
        texts = map(_plain, axis.get_major_formatter().format_ticks(places))
        made.ticker = lines.ticker = models.FixedTicker(ticks=places)
        made.major_label_overrides = {
            int(place) if place.is_integer() else place: text
            for place, text in zip(places, texts, strict=True)
        }
    elif axis.get_scale() == "linear":
        made.formatter = models.BasicTickFormatter(use_scientific=False)


def _series(plot: Any, axes: Axes) -> Iterator[tuple[str, Any]]:
    """Lines, markers, bars and maps with their names, those of points to be read off."""
    x, y = along_axes(axes)
    read = []
    for shown in shown_in(axes):
        artist = shown.artist
        if not shown.points.size:
            continue
        if isinstance(artist, QuadMesh):
            read.append(_map(plot, shown))
            yield "", read[-1]
            continue
        colour, look = _colour(artist), _look(artist)
        if isinstance(artist, LineCollection):
            xs, ys = ([part[:, k].tolist() for part in shown.parts] for k in (0, 1))
            made = plot.multi_line(xs, ys, color=colour, line_width=look["line_width"])
            yield shown.label, made
            continue
        source = models.ColumnDataSource(dict(zip("xy", shown.points.T.tolist(), strict=True)))
        if "line_dash" in look:
            dash = {"line_dash": look["line_dash"], "line_width": look["line_width"]}
            read.append(plot.line("x", "y", source=source, color=colour, name=shown.label, **dash))
            yield shown.label, read[-1]
        if "marker" in look:
            marker = {name: look[name] for name in ("marker", "size", "fill_color")}
            read.append(
                plot.scatter("x", "y", source=source, color=colour, name=shown.label, **marker)
            )
            yield shown.label, read[-1]
    tips = [("", "$name"), (x or "x", f"@x{READ}"), (y or "y", f"@y{READ}")]
    if any(isinstance(shown.artist, QuadMesh) for shown in shown_in(axes)):
        tips.append(("value", f"@value{READ}"))
    formatters = dict.fromkeys(("@x", "@y", "@value"), "printf")
    plot.add_tools(models.HoverTool(renderers=read, tooltips=tips, formatters=formatters))


def _colour(artist: Any) -> str:
    """The colour of a line, of markers, of bars or of an area."""
    if isinstance(artist, Line2D):
        on_line = str(artist.get_linestyle()) in DASHES
        return str(to_hex(artist.get_color() if on_line else artist.get_markeredgecolor()))
    for colours in (artist.get_edgecolor(), artist.get_facecolor()):
        rows = np.asarray(colours, float).reshape(-1, 4)
        if rows.size and rows[0, 3] > 0.0:
            return str(to_hex(rows[0]))
    return "#000000"


def _look(artist: Any) -> dict[str, Any]:
    """Dash and width of a line where there is one, marker with size and filling likewise."""
    if isinstance(artist, PathCollection):
        size = POINT * math.sqrt(float(artist.get_sizes()[0]))
        return {"marker": "circle", "size": size, "fill_color": _colour(artist)}
    width = float(np.atleast_1d(np.asarray(artist.get_linewidth(), float))[0])
    look: dict[str, Any] = {"line_width": max(1.0, POINT * width)}
    if isinstance(artist, Line2D):
        if str(artist.get_linestyle()) in DASHES:
            look["line_dash"] = DASHES[str(artist.get_linestyle())]
        marker = str(artist.get_marker())
        if marker not in ("None", "", " "):
            is_open = artist.get_fillstyle() == "none"
            fill = None if is_open else str(to_hex(artist.get_markerfacecolor()))
            shape = MARKERS.get(marker, "circle")
            look |= {"marker": shape, "size": POINT * artist.get_markersize(), "fill_color": fill}
    return look


def _map(plot: Any, shown: Shown) -> Any:
    """A column of cells, with the bar of their colours where it is the first."""
    mesh: Any = shown.artist
    corners = np.asarray(mesh.get_coordinates())
    edges = {"left": corners[:-1, 0, 0], "right": corners[:-1, -1, 0]}
    edges |= {"bottom": corners[:-1, 0, 1], "top": corners[1:, 0, 1]}
    data = {**edges, "x": shown.points[:, 0], "y": shown.points[:, 1], "value": shown.values}
    kind = models.LogColorMapper if isinstance(mesh.norm, LogNorm) else models.LinearColorMapper
    palette = [str(to_hex(mesh.get_cmap()(k / (SHADES - 1)))) for k in range(SHADES)]
    mapper = kind(palette=palette, low=mesh.norm.vmin, high=mesh.norm.vmax)
    colour = {"field": "value", "transform": mapper}
    source = models.ColumnDataSource({name: values.tolist() for name, values in data.items()})
    made = plot.quad(**{name: name for name in edges}, source=source, color=colour)
    made.level = "underlay"
    if not plot.below[1:]:
        title = shown.colours or None
        bar = models.ColorBar(color_mapper=mapper, title=title, orientation="horizontal")
        plot.add_layout(bar, "below")
    return made


def _bands(plot: Any, axes: Axes) -> Iterator[tuple[str, Any]]:
    """Areas between curves, and bands from edge to edge."""
    for area in axes.collections:
        if isinstance(area, PolyCollection):
            for path in area.get_paths():
                points = np.asarray(path.vertices, float)
                x, y = points[np.all(np.isfinite(points), axis=1)].T.tolist()
                style = {"color": _colour(area), "alpha": _alpha(area), "line_color": None}
                yield _name(area), plot.patch(x, y, **style)
    along = (axes.get_xaxis_transform(which="grid"), axes.get_yaxis_transform(which="grid"))
    for patch in axes.patches:
        corners = patch.get_patch_transform().transform(patch.get_path().vertices)
        for k, names in enumerate((("left", "right"), ("bottom", "top"))):
            if Artist.get_transform(patch) == along[k]:
                ends = dict(zip(names, (corners[:, k].min(), corners[:, k].max()), strict=True))
                style = {"fill_color": str(to_hex(patch.get_facecolor())), "line_color": None}
                box = models.BoxAnnotation(**ends, fill_alpha=_alpha(patch), **style)
                plot.add_layout(box)


def _levels(plot: Any, axes: Axes) -> None:
    """Lines from edge to edge, and bars next to the right edge, which are drawn inside of it."""
    along = (axes.get_xaxis_transform(which="grid"), axes.get_yaxis_transform(which="grid"))
    for line in axes.get_lines():
        x, y = np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)
        for values, own, dimension in ((x, along[0], "height"), (y, along[1], "width")):
            if line.get_transform() == own and np.ptp(values) == 0.0:
                style = {name: v for name, v in _look(line).items() if name.startswith("line_")}
                place = {"location": float(values[0]), "dimension": dimension}
                plot.add_layout(models.Span(**place, line_color=_colour(line), **style))
        if line.get_transform() == axes.get_yaxis_transform() and np.min(x) > 1.0:
            ends = {"bottom": float(np.min(y)), "top": float(np.max(y))}
            offset = round(-250 * (float(x[0]) - 1.0))
            near = models.Node(target="frame", symbol="right", offset=offset)
            far = models.Node(target="frame", symbol="right", offset=offset + 4)
            colour = {"fill_color": _colour(line), "fill_alpha": 1.0, "line_color": None}
            plot.add_layout(models.BoxAnnotation(left=near, right=far, **ends, **colour))


def _alpha(artist: Any) -> float:
    own = artist.get_alpha()
    face = np.asarray(artist.get_facecolor(), float).reshape(-1, 4)
    return float(to_rgba(tuple(face[0]))[3]) if own is None else float(own)


def _name(artist: Artist) -> str:
    label = str(artist.get_label())
    return "" if label.startswith("_") else bare(label)


def _plain(text: str) -> str:
    return "\n".join(bare(line) for line in text.splitlines())


def _place(note: Any, axes: Axes) -> dict[str, Any]:
    """Where words are: at a point, else at the edges of the panel."""
    at_point = note.get_transform() == axes.transData
    if isinstance(note, Annotation):
        at_point = note.xycoords == "data"
    if at_point:
        x, y = note.xy if isinstance(note, Annotation) else note.get_position()
        return {"x": float(x), "y": float(y), "x_offset": 4, "y_offset": 4}
    side, level = note.get_horizontalalignment(), note.get_verticalalignment()
    level = level if level in ("top", "bottom", "center") else "top"
    return {
        "x": models.Node(target="frame", symbol=side),
        "y": models.Node(target="frame", symbol=level),
        "text_align": side,
        "text_baseline": "middle" if level == "center" else level,
    }
