"""One panel as Bokeh's plot: what the drawn axes hold, at the very numbers of their CSV file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from bokeh.models import (
    BasicTickFormatter,
    BoxAnnotation,
    BoxZoomTool,
    ColorBar,
    ColumnDataSource,
    FixedTicker,
    Glyph,
    GlyphRenderer,
    HoverTool,
    Label,
    Line,
    LinearColorMapper,
    LogColorMapper,
    MultiLine,
    Node,
    Quad,
    Range1d,
    Scatter,
    Span,
    WheelZoomTool,
)
from bokeh.models import Patch as Area
from bokeh.plotting import figure as new_plot
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection, PathCollection, PolyCollection, QuadMesh
from matplotlib.colors import LogNorm, to_hex
from matplotlib.patches import Patch
from matplotlib.text import Annotation, Text
from matplotlib.ticker import FixedLocator

from fitting.report.figures.data import Shown, along_axes, bare, shown_in
from fitting.report.interactive.looks import Look, look_of

#: Pixels of an inch of the drawing; least height of a panel.
PER_INCH, LEAST = 104.0, 130
#: Room for an axis at the left, in pixels: with its label, and beside many others.
ROOM, CROWDED = 78, 36
#: Room below a lower edge on which markers stand, as a share of the axis.
HALF_MARKER = 0.02
#: Colours of a map, from its own.
SHADES = 64
#: Digits of the numbers under the pointer: as many as a double has for sure.
READ = "{%.10g}"
_SMALL = {"text_font_size": "11px", "text_color": "#000000"}

Ranges = dict[tuple[str, int], Any]


@dataclass(frozen=True)
class Curve:
    """A drawn thing that can be switched: its Bokeh model, name and look."""

    model: Any
    label: str
    look: Look


def plot_of(axes: Axes, ranges: Ranges) -> tuple[Any, list[Curve]]:
    """A panel, and what can be switched in it.

    Args:
        axes: as they are drawn, laid out.
        ranges: of axes that panels share, by letter and number; new ones are added.
    """
    plot = new_plot(
        height=_height(axes) + (60 if any(m.colorbar for m in axes.collections) else 0),
        sizing_mode="stretch_width",
        x_axis_type=axes.get_xscale() if axes.get_xscale() == "log" else "linear",
        y_axis_type=axes.get_yscale() if axes.get_yscale() == "log" else "linear",
        x_range=_range(axes, "x", ranges),
        y_range=_range(axes, "y", ranges),
        tools=[BoxZoomTool(), WheelZoomTool(modifiers="ctrl")],
        toolbar_location=None,
        min_border=4,
        min_border_left=_left(axes),
    )
    plot.outline_line_color = None
    _entitle(plot, axes)
    for letter, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        _ticks(plot, letter, axis)
    curves = [*_bands(plot, axes), *_levels(plot, axes), *_series(plot, axes)]
    _notes(plot, axes)
    return plot, curves


def _height(axes: Axes) -> int:
    """Height in pixels with room for what stands above and below the frame."""
    whole = float(axes.figure.get_figure(root=True).get_size_inches()[1])
    lines = sum(1 + axes.get_title(loc=p).count("\n") for p in ("left", "center", "right"))
    below = 24 + 18 * bool(axes.get_xlabel())
    frame = PER_INCH * whole * axes.get_position().height
    return max(LEAST, round(frame + 16 * (lines - 2) + below))


def _left(axes: Axes) -> int:
    """Room for the axis at the left, the same in a column, so that frames stand in line."""
    spec = axes.get_subplotspec()
    return (
        CROWDED
        if spec is not None and spec.colspan.start and spec.get_gridspec().ncols > 3
        else ROOM
    )


def _range(axes: Axes, letter: str, ranges: Ranges) -> Any:
    group = axes.get_shared_x_axes() if letter == "x" else axes.get_shared_y_axes()
    key = (letter, min(id(other) for other in group.get_siblings(axes)))
    if key not in ranges:
        low, high = axes.get_xlim() if letter == "x" else axes.get_ylim()
        if letter == "y" and axes.get_yscale() == "linear" and _stand_on(axes, low):
            low -= HALF_MARKER * (high - low)
        ranges[key] = Range1d(float(low), float(high))
    return ranges[key]


def _stand_on(axes: Axes, low: float) -> bool:
    """Whether markers that the drawing does not cut stand on the lower edge: Bokeh would cut them.

    Those of a peak that is matched to a millionth of the axis stand on it, too.
    """
    near = 1e-6 * abs(axes.get_ylim()[1] - low)
    return any(
        bool(np.any(np.abs(np.asarray(line.get_ydata(), float) - low) <= near))
        for line in axes.get_lines()
        if not line.get_clip_on() and str(line.get_marker()) not in ("None", "", " ")
    )


def _entitle(plot: Any, axes: Axes) -> None:
    for place in ("left", "center", "right"):
        title = axes.get_title(loc=place)
        if title:
            texts = (child for child in axes.get_children() if isinstance(child, Text))
            colour = next(text.get_color() for text in texts if text.get_text() == title)
            plot.title.text, plot.title.text_color = _plain(title), to_hex(colour)
    plot.title.text_font_size = "11px"
    plot.title.text_font_style = "normal"


def _ticks(plot: Any, letter: str, axis: Axis) -> None:
    """Label, and ticks: named ones as they stand, others as the range asks for."""
    made = plot.xaxis[0] if letter == "x" else plot.yaxis[0]
    made.axis_label = "\n".join(bare(line) for line in axis.get_label_text().splitlines()) or None
    made.axis_label_text_font_style = "normal"
    made.axis_label_text_font_size = "11.5px"
    made.axis_label_text_color = made.major_label_text_color = "#000000"
    made.major_label_text_font_size = "10.5px"
    made.minor_tick_line_color = None
    grid = plot.xgrid[0] if letter == "x" else plot.ygrid[0]
    grid.grid_line_color = "#ebebeb"
    locator = axis.get_major_locator()
    if isinstance(locator, FixedLocator):
        places = [float(v) for v in locator()]
        texts = axis.get_major_formatter().format_ticks(places)
        made.ticker = grid.ticker = FixedTicker(ticks=places)
        named = zip(places, texts, strict=True)
        made.major_label_overrides = {int(p) if p.is_integer() else p: _plain(t) for p, t in named}
        labels = axis.get_ticklabels()
        if labels and labels[0].get_rotation():
            made.major_label_orientation = 0.8
    elif axis.get_scale() == "linear":
        made.formatter = BasicTickFormatter(use_scientific=False)
        made.ticker.desired_num_ticks = 4 if letter == "x" else 5


def _plain(text: str) -> str:
    return "\n".join(bare(line) for line in text.splitlines())


def _series(plot: Any, axes: Axes) -> list[Curve]:
    """Lines, markers, bars and maps; what looks alike and has one name is one."""
    found: list[Curve] = []
    read: list[Any] = []
    marks: dict[tuple[str, Look], list[Shown]] = {}
    cells: list[Shown] = []
    for shown in shown_in(axes):
        look = look_of(shown.artist)
        if shown.points.size == 0:
            continue
        if isinstance(shown.artist, QuadMesh):
            cells.append(shown)
        elif isinstance(shown.artist, LineCollection):
            found.append(Curve(_bars(plot, shown, look), shown.label, look))
        else:
            if look.dash and not isinstance(shown.artist, PathCollection):
                source = _source([shown])
                line = _drawn(plot, source, Line(x="x", y="y", **look.line), shown.label)
                found.append(Curve(line, shown.label, look))
                read += [] if look.marker else [line]
            if look.marker:
                marks.setdefault((shown.label, look), []).append(shown)
    if cells:
        found.append(_map(plot, cells, along_axes(axes)))
    for (label, look), alike in marks.items():
        made = _drawn(plot, _source(alike), Scatter(x="x", y="y", **look.marks), label)
        found.append(Curve(made, label, look))
        read.append(made)
    if read:
        heads = [("", "$name")] if any(r.name for r in read) else []
        x, y = along_axes(axes)
        tips = [*heads, (x or "x", f"@x{READ}"), (y or "y", f"@y{READ}")]
        exact = {"@x": "printf", "@y": "printf"}
        plot.add_tools(HoverTool(renderers=read, tooltips=tips, formatters=exact))
    return found


def _drawn(plot: Any, source: Any, glyph: Glyph, name: str = "") -> Any:
    """What draws it. Methods of a plot make two more looks, for what nobody selects or mutes."""
    made = GlyphRenderer(data_source=source, glyph=glyph, name=name or None)
    plot.renderers.append(made)
    return made


def _source(alike: Iterable[Shown]) -> Any:
    points = np.concatenate([shown.points for shown in alike])
    # lists, not arrays: Bokeh packs these with the time of day
    return ColumnDataSource({"x": points[:, 0].tolist(), "y": points[:, 1].tolist()})


def _bars(plot: Any, shown: Shown, look: Look) -> Any:
    xs = [part[:, 0].tolist() for part in shown.parts]
    ys = [part[:, 1].tolist() for part in shown.parts]
    source = ColumnDataSource({"xs": xs, "ys": ys})
    return _drawn(plot, source, MultiLine(xs="xs", ys="ys", **look.line), shown.label)


def _map(plot: Any, cells: list[Shown], along: list[str]) -> Curve:
    """Cells of all columns with the bar of their colours."""
    edges: dict[str, list[np.ndarray]] = {k: [] for k in ("left", "right", "bottom", "top")}
    for shown in cells:
        mesh = shown.artist
        assert isinstance(mesh, QuadMesh)  # noqa: S101  # for the type checker
        corners = np.asarray(mesh.get_coordinates())
        edges["left"].append(corners[:-1, 0, 0])
        edges["right"].append(corners[:-1, -1, 0])
        edges["bottom"].append(corners[:-1, 0, 1])
        edges["top"].append(corners[1:, 0, 1])
    first = cells[0].artist
    assert isinstance(first, QuadMesh)  # noqa: S101
    points = np.concatenate([shown.points for shown in cells])
    values = np.concatenate([shown.values for shown in cells])
    data = {k: np.concatenate(v) for k, v in edges.items()}
    data |= {"x": points[:, 0], "y": points[:, 1], "value": values}
    source = ColumnDataSource({k: v.tolist() for k, v in data.items()})
    palette = [to_hex(first.get_cmap()(k / (SHADES - 1))) for k in range(SHADES)]
    kind = LogColorMapper if isinstance(first.norm, LogNorm) else LinearColorMapper
    mapper = kind(palette=palette, low=first.norm.vmin, high=first.norm.vmax)
    colour = {"field": "value", "transform": mapper}
    sides = {name: name for name in edges}
    made = _drawn(plot, source, Quad(**sides, fill_color=colour, line_color=colour))
    made.level = "underlay"
    plot.xgrid.visible = plot.ygrid.visible = False
    bar = ColorBar(color_mapper=mapper, title=cells[0].colours or None, height=10, padding=4)
    bar.orientation, bar.margin = "horizontal", 0
    bar.title_text_font_size = bar.major_label_text_font_size = "10.5px"
    bar.title_text_font_style = "normal"
    plot.add_layout(bar, "below")
    tips = [
        (along[0] or "x", f"@x{READ}"),
        (along[1] or "y", f"@y{READ}"),
        (cells[0].colours or "value", f"@value{READ}"),
    ]
    exact = {"@x": "printf", "@y": "printf", "@value": "printf"}
    plot.add_tools(HoverTool(renderers=[made], tooltips=tips, formatters=exact))
    return Curve(made, "", Look("#000000"))


def _levels(plot: Any, axes: Axes) -> list[Curve]:
    """Lines from edge to edge, and bars beside the right edge."""
    found = []
    for line in axes.get_lines():
        x, y = np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)
        if line.get_transform() == axes.get_yaxis_transform() and np.min(x) > 1.0:
            found.append(Curve(_beside(plot, float(x[0]), y, line), _name(line), look_of(line)))
            continue
        if line.get_transform() == axes.get_yaxis_transform(which="grid") and np.ptp(y) == 0.0:
            place = {"location": float(y[0]), "dimension": "width"}
        elif line.get_transform() == axes.get_xaxis_transform(which="grid") and np.ptp(x) == 0.0:
            place = {"location": float(x[0]), "dimension": "height"}
        else:
            continue
        look = look_of(line)
        span = Span(**place, **look.line)
        plot.add_layout(span)
        found.append(Curve(span, _name(line), look))
    return found


def _beside(plot: Any, at: float, y: Any, line: Artist) -> Any:
    """A bar that stands outside the right edge, drawn just inside of it."""
    place = -8 * round(1 + (at - 1.0) / 0.03)
    box = BoxAnnotation(
        left=Node(target="frame", symbol="right", offset=place),
        right=Node(target="frame", symbol="right", offset=place + 4),
        bottom=float(np.min(y)),
        top=float(np.max(y)),
        fill_color=look_of(line).colour,
        fill_alpha=1.0,
    )
    box.line_color = None
    plot.add_layout(box)
    return box


def _bands(plot: Any, axes: Axes) -> list[Curve]:
    """Filled areas: between curves, and from edge to edge."""
    found = []
    for area in axes.collections:
        if isinstance(area, PolyCollection):
            look = look_of(area)
            for path in area.get_paths():
                x, y = np.asarray(path.vertices, float).T
                kept = np.isfinite(x) & np.isfinite(y)
                source = ColumnDataSource({"x": x[kept].tolist(), "y": y[kept].tolist()})
                filled = {"fill_color": look.fill, "fill_alpha": look.alpha, "line_color": None}
                made = _drawn(plot, source, Area(x="x", y="y", **filled))
                found.append(Curve(made, _name(area), look))
    for patch in axes.patches:
        place = _edges(patch, axes)
        if place:
            look = look_of(patch)
            box = BoxAnnotation(**place, fill_color=look.fill, fill_alpha=look.alpha)
            box.line_color = None
            plot.add_layout(box)
            found.append(Curve(box, _name(patch), look))
    return found


def _name(artist: Artist) -> str:
    label = str(artist.get_label())
    return "" if label.startswith("_") else bare(label)


def _edges(patch: Patch, axes: Axes) -> Mapping[str, float]:
    """Edges of a band from edge to edge; nothing for any other patch."""
    corners = patch.get_patch_transform().transform(patch.get_path().vertices)
    own = Artist.get_transform(patch)
    if own == axes.get_xaxis_transform(which="grid"):
        return {"left": float(corners[:, 0].min()), "right": float(corners[:, 0].max())}
    if own == axes.get_yaxis_transform(which="grid"):
        return {"bottom": float(corners[:, 1].min()), "top": float(corners[:, 1].max())}
    return {}


def _notes(plot: Any, axes: Axes) -> None:
    """Words within the panel, at its edges or at a point."""
    for note in axes.texts:
        text = _plain(note.get_text())
        if not text:
            continue
        plot.add_layout(Label(**_place(note, axes), text=text, **_SMALL))


def _place(note: Text, axes: Axes) -> dict[str, Any]:
    at_point = note.get_transform() == axes.transData
    if isinstance(note, Annotation):
        at_point = note.xycoords == "data"
    if at_point:
        x, y = note.xy if isinstance(note, Annotation) else note.get_position()
        return {"x": float(x), "y": float(y), "x_offset": 4, "y_offset": 4}
    across, up = note.get_horizontalalignment(), note.get_verticalalignment()
    sides = {"left": (4, "left"), "right": (-4, "right"), "center": (0, "center")}
    levels = {"top": (4, "top"), "bottom": (-4, "bottom"), "center": (0, "center")}
    dx, side = sides.get(across, sides["left"])
    dy, level = levels.get(up, levels["top"])
    return {
        "x": Node(target="frame", symbol=side, offset=dx),
        "y": Node(target="frame", symbol=level, offset=dy),
        "text_align": side,
        "text_baseline": "middle" if level == "center" else level,
    }
