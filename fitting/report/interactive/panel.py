"""One panel as Bokeh's plot: what the drawn axes hold, at the very numbers of their CSV file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
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
from fitting.report.interactive.model import Model, by_key, every, field, model
from fitting.report.plot.measurement import PLACES

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

Ranges = dict[tuple[str, int], Model]


@dataclass(frozen=True)
class Curve:
    """A drawn thing that can be switched: its Bokeh model, name and look."""

    model: Model
    label: str
    look: Look


@dataclass(frozen=True)
class Plot:
    """What a panel is gathered in: models in its frame, the axes beside it, below it, its tools."""

    renderers: list[Model]
    center: list[Model]
    below: list[Model]
    tools: list[Model]


def plot_of(axes: Axes, ranges: Ranges) -> tuple[Model, list[Curve]]:
    """A panel, and what can be switched in it.

    Args:
        axes: as they are drawn, laid out.
        ranges: of axes that panels share, by letter and number; new ones are added.
    """
    x, y = _axis(axes, "x"), _axis(axes, "y")
    wheel = model("WheelZoomTool", modifiers=by_key({"ctrl": True}))
    plot = Plot(
        renderers=[],
        center=[_grid(axes, "x", x), _grid(axes, "y", y)],
        below=[x],
        tools=[model("BoxZoomTool"), wheel],
    )
    curves = [*_bands(plot, axes), *_levels(plot, axes), *_series(plot, axes)]
    _notes(plot, axes)
    made = model(
        "Figure",
        height=_height(axes) + (60 if _has_bar(axes) else 0),
        sizing_mode="stretch_width",
        x_range=_range(axes, "x", ranges),
        y_range=_range(axes, "y", ranges),
        x_scale=model(_scale(axes.get_xscale(), "Scale")),
        y_scale=model(_scale(axes.get_yscale(), "Scale")),
        title=_title(axes),
        outline_line_color=None,
        renderers=plot.renderers,
        toolbar=model("Toolbar", tools=plot.tools),
        toolbar_location=None,
        left=[y],
        below=plot.below,
        center=plot.center,
        min_border=4,
        min_border_left=_left(axes),
    )
    return made, curves


def _scale(scale: str, part: str) -> str:
    """Bokeh's name of what belongs to a scale of matplotlib."""
    return f"{'Log' if scale == 'log' else 'Linear'}{part}"


def _has_bar(axes: Axes) -> bool:
    """Whether colours of a map are explained."""
    return any(m.colorbar for m in axes.collections)


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


def _range(axes: Axes, letter: str, ranges: Ranges) -> Model:
    group = axes.get_shared_x_axes() if letter == "x" else axes.get_shared_y_axes()
    key = (letter, min(id(other) for other in group.get_siblings(axes)))
    if key not in ranges:
        low, high = axes.get_xlim() if letter == "x" else axes.get_ylim()
        if letter == "y" and axes.get_yscale() == "linear" and _stand_on(axes, low):
            low -= HALF_MARKER * (high - low)
        ranges[key] = model("Range1d", start=float(low), end=float(high))
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


def _title(axes: Axes) -> Model:
    said: dict[str, Any] = {}
    for place in ("left", "center", "right"):
        title = axes.get_title(loc=place)
        if title:
            texts = (child for child in axes.get_children() if isinstance(child, Text))
            colour = next(text.get_color() for text in texts if text.get_text() == title)
            said = {"text": _plain(title), "text_color": to_hex(colour)}
    return model("Title", **said, text_font_size="11px", text_font_style="normal")


def _axis(axes: Axes, letter: str) -> Model:
    """Label, and ticks: named ones as they stand, others as the range asks for."""
    axis = axes.xaxis if letter == "x" else axes.yaxis
    label = "\n".join(bare(line) for line in axis.get_label_text().splitlines())
    return model(
        _scale(axis.get_scale(), "Axis"),
        **_ticks(axis, 4 if letter == "x" else 5),
        axis_label=label or None,
        axis_label_text_color="#000000",
        axis_label_text_font_size="11.5px",
        axis_label_text_font_style="normal",
        major_label_text_color="#000000",
        major_label_text_font_size="10.5px",
        minor_tick_line_color=None,
    )


def _ticks(axis: Axis, count: int) -> dict[str, Any]:
    locator = axis.get_major_locator()
    if isinstance(locator, FixedLocator):
        places = [float(v) for v in locator()]
        texts = axis.get_major_formatter().format_ticks(places)
        named = zip(places, texts, strict=True)
        words = {int(p) if p.is_integer() else p: _plain(t) for p, t in named}
        found = {
            "ticker": model("FixedTicker", ticks=places),
            "major_label_overrides": by_key(words),
        }
        labels = axis.get_ticklabels()
        if labels and labels[0].get_rotation():
            found["major_label_orientation"] = 0.8
        return found
    if axis.get_scale() == "linear":
        return {
            "ticker": model("BasicTicker", desired_num_ticks=count),
            "formatter": model("BasicTickFormatter", use_scientific=False),
        }
    return {"ticker": model(_scale(axis.get_scale(), "Ticker"))}


def _grid(axes: Axes, letter: str, axis: Model) -> Model:
    """Lines at the ticks of an axis; none that would cut the cells of a map."""
    return model(
        "Grid",
        axis=axis,
        dimension=0 if letter == "x" else 1,
        grid_line_color="#ebebeb",
        visible=not any(found in PLACES for found in axes.collections),
    )


def _plain(text: str) -> str:
    return "\n".join(bare(line) for line in text.splitlines())


def _series(plot: Plot, axes: Axes) -> list[Curve]:
    """Lines, markers, bars and maps; what looks alike and has one name is one."""
    found: list[Curve] = []
    read: list[Model] = []
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
                glyph = model("Line", x=field("x"), y=field("y"), **look.line)
                line = _drawn(plot, source, glyph, shown.label)
                found.append(Curve(line, shown.label, look))
                read += [] if look.marker else [line]
            if look.marker:
                marks.setdefault((shown.label, look), []).append(shown)
    if cells:
        found.append(_map(plot, cells, along_axes(axes)))
    for (label, look), alike in marks.items():
        glyph = model("Scatter", x=field("x"), y=field("y"), **every(**look.marks))
        made = _drawn(plot, _source(alike), glyph, label)
        found.append(Curve(made, label, look))
        read.append(made)
    if read:
        heads = [("", "$name")] if any(r.attributes["name"] for r in read) else []
        x, y = along_axes(axes)
        tips = [*heads, (x or "x", f"@x{READ}"), (y or "y", f"@y{READ}")]
        plot.tools.append(_reader(read, tips))
    return found


def _reader(read: list[Model], tips: list[tuple[str, str]]) -> Model:
    """What tells the numbers under the pointer."""
    columns = (shown.partition("{")[0] for _, shown in tips if shown.startswith("@"))
    exact = by_key(dict.fromkeys(columns, "printf"))
    return model("HoverTool", renderers=read, tooltips=tips, formatters=exact, sort_by=None)


def _drawn(plot: Plot, source: Model, glyph: Model, name: str = "") -> Model:
    made = model("GlyphRenderer", data_source=source, glyph=glyph, name=name or None)
    plot.renderers.append(made)
    return made


def _source(alike: Iterable[Shown]) -> Model:
    points = np.concatenate([shown.points for shown in alike])
    return _columns({"x": points[:, 0], "y": points[:, 1]})


def _columns(columns: Mapping[str, Any]) -> Model:
    return model("ColumnDataSource", data=by_key(columns))


def _bars(plot: Plot, shown: Shown, look: Look) -> Model:
    xs, ys = ([part[:, k] for part in shown.parts] for k in (0, 1))
    line = every(**{**look.line, "line_dash": look.dash or "solid"})
    glyph = model("MultiLine", xs=field("xs"), ys=field("ys"), **line)
    return _drawn(plot, _columns({"xs": xs, "ys": ys}), glyph, shown.label)


def _map(plot: Plot, cells: list[Shown], along: list[str]) -> Curve:
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
    palette = [to_hex(first.get_cmap()(k / (SHADES - 1))) for k in range(SHADES)]
    kind = "LogColorMapper" if isinstance(first.norm, LogNorm) else "LinearColorMapper"
    mapper = model(kind, palette=palette, low=first.norm.vmin, high=first.norm.vmax)
    colour = {**field("value"), "transform": mapper}
    sides = {name: field(name) for name in edges}
    glyph = model("Quad", **sides, fill_color=colour, line_color=colour)
    made = _drawn(plot, _columns(data), glyph)
    made.attributes["level"] = "underlay"
    plot.below.append(_colour_bar(mapper, cells[0].colours))
    tips = [
        (along[0] or "x", f"@x{READ}"),
        (along[1] or "y", f"@y{READ}"),
        (cells[0].colours or "value", f"@value{READ}"),
    ]
    plot.tools.append(_reader([made], tips))
    return Curve(made, "", Look("#000000"))


def _colour_bar(mapper: Model, title: str) -> Model:
    return model(
        "ColorBar",
        color_mapper=mapper,
        orientation="horizontal",
        height=10,
        margin=0,
        padding=4,
        title=title or None,
        title_text_font_size="10.5px",
        title_text_font_style="normal",
        major_label_text_font_size="10.5px",
    )


def _levels(plot: Plot, axes: Axes) -> list[Curve]:
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
        span = model("Span", **place, **look.line)
        plot.center.append(span)
        found.append(Curve(span, _name(line), look))
    return found


def _beside(plot: Plot, at: float, y: Any, line: Artist) -> Model:
    """A bar that stands outside the right edge, drawn just inside of it."""
    place = -8 * round(1 + (at - 1.0) / 0.03)
    edges = {
        "left": model("Node", target="frame", symbol="right", offset=place),
        "right": model("Node", target="frame", symbol="right", offset=place + 4),
        "bottom": float(np.min(y)),
        "top": float(np.max(y)),
    }
    return _box(plot, edges, look_of(line).colour, 1.0)


def _box(plot: Plot, edges: Mapping[str, Any], fill: str, alpha: float) -> Model:
    """A filled area between edges; where one is not named, that of the frame."""
    box = model("BoxAnnotation", **edges, fill_color=fill, fill_alpha=alpha, line_color=None)
    plot.center.append(box)
    return box


def _bands(plot: Plot, axes: Axes) -> list[Curve]:
    """Filled areas: between curves, and from edge to edge."""
    found = []
    for area in axes.collections:
        if isinstance(area, PolyCollection):
            look = look_of(area)
            for path in area.get_paths():
                x, y = np.asarray(path.vertices, float).T
                kept = np.isfinite(x) & np.isfinite(y)
                filled = {"fill_color": look.fill, "fill_alpha": look.alpha, "line_color": None}
                glyph = model("Patch", x=field("x"), y=field("y"), **filled)
                made = _drawn(plot, _columns({"x": x[kept], "y": y[kept]}), glyph)
                found.append(Curve(made, _name(area), look))
    for patch in axes.patches:
        place = _edges(patch, axes)
        if place:
            look = look_of(patch)
            box = _box(plot, place, look.fill, look.alpha)
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


def _notes(plot: Plot, axes: Axes) -> None:
    """Words within the panel, at its edges or at a point."""
    for note in axes.texts:
        text = _plain(note.get_text())
        if not text:
            continue
        plot.center.append(model("Label", **_place(note, axes), text=text, **_SMALL))


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
        "x": model("Node", target="frame", symbol=side, offset=dx),
        "y": model("Node", target="frame", symbol=level, offset=dy),
        "text_align": side,
        "text_baseline": "middle" if level == "center" else level,
    }
