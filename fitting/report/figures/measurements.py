"""Figures of what was measured next to the model's values, of any kind of measurement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize

from fitting.lines.form import LineFit
from fitting.measurements.figure import Axis, Figure, Form, Layer, Panel, Role
from fitting.measurements.sweep import response_panel
from fitting.report.figures.data import PLACES
from fitting.report.figures.style import (
    BAND,
    GREY,
    MEASURED,
    SIMULATED,
    WIDTH,
    axes_of,
    handles_of,
    ink,
    legend_below,
    log_axis,
    marker_of,
    new_figure,
    plain_ticks,
    short,
    width_inches,
)
from fitting.report.shown import ShownCampaign
from fitting.result.result import SweepCurves
from fitting.text.arrays import FloatArray
from fitting.text.notation import Scaling, prefixed, scaling_for

#: Width of a panel that is one of several, and height of a full one beside others and alone, inch.
PANEL_WIDTH, PANEL_HEIGHT, LONE_HEIGHT = 2.05, 2.15, 2.75
#: Room for title and legend, inch.
HEAD_HEIGHT = 1.4


def draw_measurement(described: Figure, data: ShownCampaign) -> Figure:
    """A figure as a measurement describes it, under the title of its campaign.

    Args:
        described: what is on its panels, and the text below.
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
        shown = _at(described, r, c)
        if shown is None:
            axes.set_visible(False)
            continue
        _share(axes, shown, described, drawn)
        drawn[r, c] = panel(shown, among=described.panels, ax=axes)
    for (r, c), axes in drawn.items():
        _name_once(axes, described, r, c)
    handles: dict[object, Artist] = {}
    for handle in (h for axes in drawn.values() for h in handles_of(axes)):
        handles.setdefault(handle.get_label(), handle)
    if handles:
        legend_below(figure, list(handles.values()), ncols=4)
    title = ", ".join(filter(None, (described.title, described.series)))
    return replace(described, rows=(), title=title, drawn=figure)


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


DASHES = (0, (4, 2))
LONG_DASHES = (0, (5, 2))
#: Room above the highest value, as a share of it.
ABOVE = 0.08
#: Panels that are narrower have room for few ticks.
NARROW_INCHES = 3.5
#: Letters of a title in an inch.
LETTERS_PER_INCH = 10.8


#: How the values of both axes of a panel are written, along x and along y.
Scales = tuple[Scaling, Scaling]


def panel(shown: Panel, *, among: Sequence[Panel] = (), ax: Axes | None = None) -> Axes:
    """Draw one panel of a measurement: what was measured next to the model's values.

    Args:
        shown: the panel, as a kind of measurement describes it.
        among: panels next to it; those with an equal axis choose its prefix together.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes = axes_of(ax)
    panels = among or (shown,)
    along_x = _scaling(shown.x, _along_x(shown.x, panels))
    along_y = _scaling(shown.y, _along_y(shown.y, panels))
    scales = along_x, along_y
    for place in shown.marked:
        axes.axvline(along_x(place), color=GREY, alpha=0.4, linewidth=0.8, zorder=0)
    if np.isfinite(shown.level):
        axes.axhline(along_y(shown.level), color=GREY, linewidth=0.8, zorder=1)
    if np.isfinite(shown.rms):  # 95 of 100 residuals that are noise are within it
        ends = (along_y(shown.level - 2.0 * shown.rms), along_y(shown.level + 2.0 * shown.rms))
        label = "±2σ" if shown.y.unit == "σ" else "±2 rms"
        axes.axhspan(*ends, color=GREY, alpha=BAND, linewidth=0, zorder=0, label=label)
    for layer in shown.layers:
        if layer.form is Form.MAP:
            _map(axes, layer, scales, shown.z or Axis(""))
        elif shown.z is not None and layer.form is Form.POINTS:
            _marks(axes, layer, scales)
        else:
            _LOOKS[layer.form](axes, layer, scales, shown)
    if shown.joined:
        _join(axes, shown, scales)
    if shown.notes:
        _note(axes, shown.notes)
    if shown.title:
        longest = int(LETTERS_PER_INCH * width_inches(axes))
        lines = (short(line, longest) for line in shown.title.splitlines())
        axes.set_title("\n".join(lines), fontsize="small")
    _label(axes, shown, scales)
    _limit(axes, shown, panels, scales)
    return axes


def _scaling(axis: Axis, values: FloatArray) -> Scaling:
    """A prefix; where values lie close together, from a round number near by."""
    if axis.log or axis.low == 0.0:
        size = max(np.abs(values), default=0.0)
        if axis.log and np.any(values > 0.0):  # its middle, or all but the end would be powers
            size = float(np.exp(np.mean(np.log([size, np.min(values[values > 0.0])]))))
        factor, unit = prefixed(size, axis.unit)
        return Scaling(offset=0.0, factor=factor, unit=unit)
    return scaling_for(values, axis.unit)


def _along_x(axis: Axis, panels: Sequence[Panel]) -> FloatArray:
    """Finite values along x of panels that have this axis; its ends, where both are given."""
    if axis.low is not None and axis.high is not None:
        return np.array([axis.low, axis.high])
    mine = [p for p in panels if p.x == axis]
    return _finite([p.marked for p in mine] + [y.x for p in mine for y in p.layers])


def _along_y(axis: Axis, panels: Sequence[Panel]) -> FloatArray:
    """The same along y, without what the axes do not stretch for."""
    if axis.low is not None and axis.high is not None:
        return np.array([axis.low, axis.high])
    layers = [layer for p in panels if p.y == axis for layer in p.layers]
    kept = [layer.y for layer in layers if layer.role is not Role.START]
    return _finite(kept or [layer.y for layer in layers])


def _finite(parts: Sequence[Any]) -> FloatArray:
    values = np.concatenate([np.empty(0), *(np.asarray(part, dtype=float) for part in parts)])
    return np.asarray(values[np.isfinite(values)])


def _scaled(layer: Layer, scales: Scales) -> tuple[FloatArray, FloatArray, FloatArray]:
    """x, y and standard deviations (zero: not known) of a layer, as they are drawn."""
    sigma = layer.sigma if layer.sigma.size else np.zeros(layer.y.size)
    along_x, along_y = scales
    x = (layer.x - along_x.offset) / along_x.factor
    y = (layer.y - along_y.offset) / along_y.factor
    return x, y, np.nan_to_num(sigma, nan=0.0) / along_y.factor


def _colour(layer: Layer) -> str:
    return {
        Role.MEASURED: MEASURED,
        Role.SIMULATED: SIMULATED,
        Role.START: GREY,
        Role.OTHER: ink(),
    }[layer.role]


def _points(axes: Axes, layer: Layer, scales: Scales, shown: Panel) -> None:
    """Small circles, open where they were measured, with bars of known standard deviations."""
    x, y, sigma = _scaled(layer, scales)
    look: dict[str, Any] = {"color": _colour(layer), "linestyle": "none", "marker": "o"}
    look |= {"markersize": 2.6}
    if layer.role is Role.MEASURED:
        look |= {"markersize": 3.6, "markerfacecolor": axes.get_facecolor(), "markeredgewidth": 0.9}
    if np.any(sigma > 0.0):
        axes.errorbar(x, y, yerr=sigma, fmt="none", ecolor=_colour(layer), elinewidth=0.8)
    axes.plot(x, y, label=layer.label, **look)


def _curve(axes: Axes, layer: Layer, scales: Scales, shown: Panel) -> None:
    """A line, distinguished from the others by its dashes and its width as well.

    The model's is whole through measured points, and dashed where what was measured is a line.
    """
    x, y, sigma = _scaled(layer, scales)
    lines = any(other.form is Form.CURVE for other in shown.of(Role.MEASURED))
    looks: dict[Role, dict[str, Any]] = {
        Role.MEASURED: {"linewidth": 1.4},
        Role.SIMULATED: {"linestyle": LONG_DASHES, "linewidth": 1.8} if lines else {"zorder": 3},
        Role.START: {"linestyle": ":", "linewidth": 1.5},
        Role.OTHER: {"linewidth": 1.0},
    }
    if np.any(sigma > 0.0):
        axes.fill_between(x, y - sigma, y + sigma, color=_colour(layer), alpha=0.2, linewidth=0.0)
    axes.plot(x, y, color=_colour(layer), label=layer.label, **looks[layer.role])


def _stems(axes: Axes, layer: Layer, scales: Scales, shown: Panel) -> None:
    """Dashed stems with an open marker, whose shape marks the experiment."""
    x, y, _ = _scaled(layer, scales)
    colour = _colour(layer)
    axes.vlines(x, 0.0, y, color=colour, linestyle=DASHES, linewidth=1.3)
    look: dict[str, Any] = {
        "marker": marker_of(shown.shape),
        "markersize": 5.0,
        "markerfacecolor": axes.get_facecolor(),
        "markeredgecolor": colour,
    }
    axes.plot(x, y, linestyle="none", zorder=6, **look)
    axes.plot([], [], linestyle=DASHES, color=colour, label=layer.label, **look)


def _levels(axes: Axes, layer: Layer, scales: Scales, shown: Panel) -> None:
    """Short bars in ink with their errors: they stand out on whatever lies below."""
    x, y, sigma = _scaled(layer, scales)
    axes.errorbar(
        x,
        y,
        yerr=sigma,
        fmt="_",
        color=ink(),
        markersize=9,
        elinewidth=0.9,
        capsize=2.5,
        zorder=5,
        label=layer.label,
    )


def _map(axes: Axes, layer: Layer, scales: Scales, z: Axis) -> None:
    """A column of cells for each place along x, and the bar with the meaning of their colours."""
    scaling = _scaling(z, _finite([layer.z]))
    x, y, _ = _scaled(layer, scales)
    values = (layer.z - scaling.offset) / scaling.factor
    low = float(np.min(values)) if z.low is None else scaling(z.low)
    high = float(np.max(values)) if z.high is None else scaling(z.high)
    both = z.low is not None and z.low == -(z.high or 0.0)
    norm = Normalize(low, high)
    if z.log:
        norm = LogNorm(max(low, float(np.min(values[values > 0.0], initial=high))), high)
    columns = np.unique(x)
    edges = _edges(columns)
    drawn = None
    for k, place in enumerate(columns):
        mine = np.flatnonzero(x == place)
        mine = mine[np.argsort(y[mine])]
        drawn = axes.pcolormesh(
            edges[k : k + 2],
            _edges(y[mine]),
            values[mine][:, np.newaxis],
            norm=norm,
            cmap="RdBu_r" if both else "viridis",
            rasterized=True,  # thousands of cells
            zorder=0,
        )
        PLACES[drawn] = np.column_stack([x[mine], y[mine]])
    axes.grid(visible=False)  # lines of a grid would cut the cells
    if drawn is not None:
        axes.figure.colorbar(drawn, ax=axes, label=scaling.label(z.label))


def _marks(axes: Axes, layer: Layer, scales: Scales) -> None:
    """Light dots with a dark rim: they stand out on every colour of a map."""
    x, y, _ = _scaled(layer, scales)
    axes.plot(
        x,
        y,
        linestyle="none",
        marker="o",
        markersize=3.4,
        markerfacecolor="white",
        markeredgecolor="black",
        markeredgewidth=0.6,
        label=layer.label,
    )


def _edges(places: FloatArray) -> FloatArray:
    """Edges (n + 1,) of cells about places (n,) that rise."""
    if places.size == 1:
        return np.array([places[0] - 0.5, places[0] + 0.5])
    middle = 0.5 * (places[1:] + places[:-1])
    ends = (places[0] - (middle[0] - places[0]), places[-1] + (places[-1] - middle[-1]))
    return np.concatenate([ends[:1], middle, ends[1:]])


_LOOKS = {Form.POINTS: _points, Form.CURVE: _curve, Form.STEMS: _stems, Form.LEVELS: _levels}


def _join(axes: Axes, shown: Panel, scales: Scales) -> None:
    """Bars from measured to simulated values that stand at the same places."""
    simulated = shown.of(Role.SIMULATED)[-1]
    pairs = [m for m in shown.of(Role.MEASURED) if np.array_equal(m.x, simulated.x)]
    x, y, _ = _scaled(simulated, scales)
    for layer in pairs:
        measured = _scaled(layer, scales)[1]
        axes.vlines(x, measured, y, color=ink(), linewidth=1.8, zorder=7, label="difference")


def _note(axes: Axes, lines: Sequence[str]) -> None:
    axes.text(
        0.985,
        0.96,
        "\n".join(lines),
        ha="right",
        va="top",
        transform=axes.transAxes,
        fontsize="small",
        linespacing=1.5,
    )


def _label(axes: Axes, shown: Panel, scales: Scales) -> None:
    along_x, along_y = scales
    axes.set_xlabel(along_x.label(shown.x.label))
    label = along_y.label(shown.y.label)
    if shown.height < 1.0 and along_y.unit:  # a low panel has no room for a long label
        label = f"{shown.y.label}\n({along_y.unit})"
    axes.set_ylabel(f"{shown.when}: {label}" if shown.when else label)


def _limit(axes: Axes, shown: Panel, panels: Sequence[Panel], scales: Scales) -> None:
    """Ends and ticks of both axes."""
    along_x, along_y = scales
    narrow = width_inches(axes) < NARROW_INCHES
    plain_ticks(axes, x=4 if narrow else 8, y=5 if shown.height >= 1.0 else 4)
    if shown.x.ticks:
        places, texts = zip(*shown.x.ticks, strict=True)
        axes.set_xticks([along_x(place) for place in places], texts, fontsize="x-small")
    if shown.x.log:
        log_axis(axes, "x")
    if shown.y.log:
        log_axis(axes)
    if shown.x.low is not None:
        axes.set_xlim(left=along_x(shown.x.low))
    if shown.x.high is not None:
        axes.set_xlim(right=along_x(shown.x.high))
    if shown.y.low is not None:
        top = max(_along_y(shown.y, panels), default=0.0)
        if shown.y.high is None and top > shown.y.low:
            axes.set_ylim(top=along_y(top + ABOVE * (top - shown.y.low)))
        axes.set_ylim(bottom=along_y(shown.y.low))
    if shown.y.high is not None:
        axes.set_ylim(top=along_y(shown.y.high))


def frequency_response(
    curves: SweepCurves,
    *,
    resonance: LineFit | None = None,
    unit: str = "V",
    ax: Axes | None = None,
) -> Axes:
    """Draw amplitudes over drive frequency: measured points, simulated curves before and after.

    Args:
        curves: the sweep of a result, Hz and V peak (or `unit`).
        resonance: one damped mode fitted to the same points; its curve and numbers are drawn too.
        unit: of the amplitudes.
        ax: where to draw; pyplot's current axes if not given.
    """
    each = (curves.measured_v, curves.initial_v, curves.final_v)
    measured, before, after = (np.array(values) for values in each)
    f = np.array(curves.frequency_hz)
    return panel(response_panel(f, (measured, before, after), unit, resonance), ax=ax)
