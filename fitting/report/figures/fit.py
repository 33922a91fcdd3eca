"""Figures of the fitted values: their way over the regularisation, and per experiment."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from matplotlib.axes import Axes

from fitting.measurements.figure import Figure as Described
from fitting.report.figures.style import (
    AFTER,
    BAND,
    BLUE,
    GREY,
    axes_of,
    described,
    ink,
    label_experiments,
    log_axis,
    marker_of,
    new_figure,
    panels,
    plain_ticks,
    say_empty,
    series_look,
)
from fitting.report.screen import phrase
from fitting.report.shown import ShownCampaign
from fitting.result.result import Result
from fitting.text.estimate import FittedEstimate, Verdict
from fitting.text.notation import (
    number,
    on_log_axis,
    prefixed,
    range_words,
    scaling_for,
    sign,
    unit_text,
)

CONVERGENCE, DERIVED = "convergence", "derived_per_experiment"
PER_ROW = 3
#: Parameters of one unit that share a panel of corrections.
MOST_IN_PANEL = 6
#: Share of the error from which a spread over the experiments is seen.
VISIBLE = 0.1


def draw_convergence(result: Result, data: ShownCampaign) -> Described:
    """Parameters, means of the derived outputs, J_fit and J_reg over the levels of nu.

    A parameter alone in its unit is drawn as its value, several of one unit as corrections
    p - p_ref, which makes them comparable.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    groups, outputs = _groups(result), list(result.derived)
    every: dict[str, FittedEstimate] = {**result.parameters, **result.derived}
    # of withdrawn ones no verdict is left
    every = {name: e for name, e in every.items() if e.status is not Verdict.WITHDRAWN}
    unknown = [name for name, e in every.items() if e.status is Verdict.UNKNOWN]
    words = described(
        CONVERGENCE,
        result=result,
        levels=len(result.history) - 1,
        other=any(p.value != p.algorithm2 for n, p in result.parameters.items() if n in every),
        open=[n for n, e in every.items() if not e.status.has_value and n not in unknown],
        unknown=unknown,
    )
    count = len(groups) + len(outputs) + 1
    height = 0.95 + 2.15 * math.ceil(count / min(PER_ROW, count))
    figure = new_figure(words.title, data.title, synthetic=data.synthetic, height=height, width=9.4)
    axes = panels(figure, count, PER_ROW)
    for panel, names in zip(axes, groups, strict=False):
        parameter_path(result, *names, ax=panel)
        if len(names) > 1:
            panel.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, handlelength=1.6)
    for panel, name in zip(axes[len(groups) :], outputs, strict=False):
        output_path(result, name, ax=panel)
    objective_path(result, ax=axes[-1]).legend(loc="best", handlelength=2.2)
    return replace(words, drawn=figure)


def _groups(result: Result) -> list[list[str]]:
    """Parameter names, those of one unit together."""
    groups: dict[str, list[str]] = {}
    for name, parameter in result.parameters.items():
        groups.setdefault(unit_text(parameter.unit), []).append(name)
    return [
        names[k : k + MOST_IN_PANEL]
        for names in groups.values()
        for k in range(0, len(names), MOST_IN_PANEL)
    ]


def varying(result: Result) -> dict[str, FittedEstimate]:
    """Outputs that the data give and that differ between experiments by more than a line's width.

    Args:
        result: of a reconstruction.
    """
    return {
        name: d
        for name, d in result.derived.items()
        if d.status.has_value and d.spread > VISIBLE * d.std
    }


def draw_derived(result: Result, data: ShownCampaign) -> Described:
    """Derived outputs of every experiment with mean and spread, and whether the data give them.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    shown = varying(result) or result.derived
    each = ". ".join(f"{name}: {_in_words(d)}" for name, d in shown.items())
    words = described(DERIVED, point=phrase("values", "point", result), words=each)
    columns = min(PER_ROW, len(shown))
    height = 0.85 + 2.75 * math.ceil(len(shown) / columns)
    width = max(3.15 * columns if columns > 1 else 5.0, 6.4)
    figure = new_figure(
        words.title, data.title, synthetic=data.synthetic, height=height, width=width
    )
    for panel, name in zip(panels(figure, len(shown), PER_ROW), shown, strict=True):
        output_by_experiment(result, name, data.labels, ax=panel)
    return replace(words, drawn=figure)


def _in_words(derived: FittedEstimate) -> str:
    if not derived.status.has_value:
        allowed = range_words(*derived.bounds, derived.unit)
        return f"{derived.status} by these data ({allowed} within the bounds of the parameters)"
    return f"{derived.status}{derived.condition}, {phrase('values', 'reported', derived)}"


#: A start farther from the levels than this many of their ranges is not drawn.
FAR_START = 2.0
#: Ticks at levels of nu, about.
MOST_LEVELS = 5


def parameter_path(result: Result, *names: str, ax: Axes | None = None) -> Axes:
    """Draw fitted parameters over the levels of the regularisation ν, from the start point on.

    One parameter is drawn as its value in its unit, several (of one unit) as corrections p - p_ref,
    which makes them comparable. Dashed: the value at the reference. A start far outside is stated
    in words.

    Args:
        result: a reconstruction with a history.
        names: of the parameters.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes, parameters = axes_of(ax), result.parameters
    alone = len(names) == 1
    origins = {name: 0.0 if alone else parameters[name].reference for name in names}
    curves = {
        sign(name): [row.parameters[name] - origins[name] for row in result.history]
        for name in names
    }
    reference = parameters[names[0]].reference if alone else 0.0
    what = sign(names[0]) if alone else "correction p − p_ref"
    _level_curves(axes, curves, reference, parameters[names[0]].unit, what)
    _nu_axis(axes, result)
    return axes


def output_path(result: Result, name: str, *, ax: Axes | None = None) -> Axes:
    """Draw the mean of a derived output over the levels of the regularisation ν.

    Args:
        result: a reconstruction with a history.
        name: of the output, drawn in its unit; dashed: its value at the reference parameters.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes, derived = axes_of(ax), result.derived[name]
    what = f"⟨{sign(name)}⟩" if len(derived.values) > 1 else sign(name)
    curve = [row.derived.get(name, math.nan) for row in result.history]
    _level_curves(axes, {what: curve}, derived.reference, derived.unit, what)
    _nu_axis(axes, result)
    return axes


def objective_path(result: Result, *, ax: Axes | None = None) -> Axes:
    """Draw misfit J_fit and regularisation term J_reg over the levels of the regularisation ν.

    Args:
        result: a reconstruction with a history.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes = axes_of(ax)
    for values, label, colour, marker, dash in (
        ([row.j_fit for row in result.history], "J_fit", ink(), "o", "-"),
        ([row.j_reg for row in result.history], "J_reg", AFTER, "s", "--"),
    ):
        known = [(k, v) for k, v in enumerate(values) if math.isfinite(v) and v > 0.0]
        if known:
            axes.plot(
                *zip(*known, strict=True),
                color=colour,
                marker=marker,
                linestyle=dash,
                markersize=4.0,
                label=label,
            )
    log_axis(axes)
    axes.set_ylabel("terms of the objective")
    _nu_axis(axes, result)
    return axes


def output_by_experiment(
    result: Result, name: str, labels: Sequence[str] = (), *, ax: Axes | None = None
) -> Axes:
    """Draw a derived output of every experiment with its mean (dashed) and spread (band).

    The title states how well the data determine it, never a small error where they do not.

    Args:
        result: a reconstruction.
        name: of the output, drawn in its unit.
        labels: names of the experiments; numbers if not given.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes, derived = axes_of(ax), result.derived[name]
    finite = [v for v in derived.values if math.isfinite(v)]
    scaling = scaling_for(finite, derived.unit)
    if finite:
        low, high = scaling(derived.value - derived.spread), scaling(derived.value + derived.spread)
        axes.axhspan(low, high, color=GREY, alpha=BAND, linewidth=0.0, zorder=0)
        axes.axhline(scaling(derived.value), color=ink(), linestyle="--", linewidth=1.1)
    else:
        say_empty(axes)
    for i, value in enumerate(derived.values):
        if math.isfinite(value):
            axes.plot(i, scaling(value), marker=marker_of(i), color=BLUE, markersize=6.0)
    plain_ticks(axes)
    label_experiments(axes, labels or [str(i + 1) for i in range(len(derived.values))])
    _room_around(axes, [scaling(v) for v in finite])
    axes.set_ylabel(scaling.label(sign(name)))
    sure = derived.status.has_value
    first, second = f"⟨{sign(name)}⟩" if sure else sign(name), _short_words(derived)
    colour = ink() if sure else AFTER
    axes.set_title(f"{first}{second}", fontsize="small", loc="left", color=colour)
    return axes


def _level_curves(
    axes: Axes, curves: Mapping[str, Sequence[float]], reference: float, unit: str, what: str
) -> None:
    """Values over the levels; a start far from all of them is stated in words, not drawn.

    The picture then shows how far the data moved the values from their reference.
    """
    levels = [v for curve in curves.values() for v in (*curve[1:], reference) if math.isfinite(v)]
    far = {label for label, curve in curves.items() if _is_far(curve[0], levels)}
    drawn = [*levels, *(curve[0] for label, curve in curves.items() if label not in far)]
    scaling = scaling_for(drawn, unit)
    if math.isfinite(reference):
        axes.axhline(scaling(reference), color=GREY, linestyle="--", linewidth=1.0)
    for k, (label, curve) in enumerate(curves.items()):
        known = [
            (i, scaling(v))
            for i, v in enumerate(curve)
            if math.isfinite(v) and (i > 0 or label not in far)
        ]
        colour, marker = series_look(k)
        axes.plot(
            [i for i, _ in known],
            [v for _, v in known],
            color=colour,
            marker=marker,
            markersize=4.0,
            label=label,
        )
    if not any(math.isfinite(v) for curve in curves.values() for v in curve):
        say_empty(axes)
    plain_ticks(axes)
    axes.margins(y=0.2)
    axes.set_ylabel(scaling.label(what))
    for label in far:
        _tell_start(axes, curves[label][0], levels, unit, label if len(curves) > 1 else "start")


def _is_far(start: float, levels: Sequence[float]) -> bool:
    if not (levels and math.isfinite(start)):
        return False
    low, high = min(levels), max(levels)
    reach = FAR_START * (high - low)
    return high > low and not low - reach <= start <= high + reach


def _tell_start(axes: Axes, start: float, levels: Sequence[float], unit: str, label: str) -> None:
    above = start > max(levels)
    factor, shown = prefixed(abs(start), unit)
    value = f"{number(start / factor, 4)} {shown}".strip()
    axes.annotate(
        f"{'↑' if above else '↓'} {label}: {value}",
        (0.02, 0.98 if above else 0.02),
        xycoords="axes fraction",
        ha="left",
        va="top" if above else "bottom",
        fontsize="small",
        bbox={"boxstyle": "square,pad=0.2", "facecolor": axes.get_facecolor(), "edgecolor": "none"},
    )


def _nu_axis(axes: Axes, result: Result) -> None:
    """Ticks at the levels: "start", then nu itself, thinned so that labels keep apart."""
    count = len(result.history)
    step = max(1, math.ceil((count - 1) / MOST_LEVELS))
    ticks = [0, *range(count - 1, 0, -step)]
    if len(ticks) > 2 and ticks[-1] < max(1, step // 2 + 1):
        ticks.pop()
    axes.set_xticks(ticks, [_nu_text(result, k) for k in ticks])
    axes.set_xlim(-0.4, max(count - 0.6, 0.6))
    axes.set_xlabel("ν", labelpad=1.0)


def _nu_text(result: Result, row: int) -> str:
    nu = result.history[row].nu
    return "start" if math.isnan(nu) else on_log_axis(nu)


def _room_around(axes: Axes, values: Sequence[float]) -> None:
    """A quarter of the range on both sides; a percent where all values are one."""
    if not values:
        return
    low, high = min(values), max(values)
    margin = 0.25 * (high - low)
    if margin <= 1e-9 * max(abs(low), abs(high)):
        margin = 0.01 * max(abs(low), abs(high)) or 1.0
    axes.set_ylim(low - margin, high + margin)


def _short_words(derived: FittedEstimate) -> str:
    """Two lines: never a value with a small error where the data do not give one."""
    if not derived.status.has_value:
        allowed = range_words(*derived.bounds, derived.unit)
        return f": {derived.status} by these data,\nwithin its bounds {allowed}"
    verdict = f"{derived.status} by these data{derived.condition}"
    if not derived.is_most_likely:
        value = number(derived.value, 7)
        return f" = {value} {derived.unit} by Algorithm 2\n{verdict}"
    return f" = {derived.likely_words}\n{verdict}"
