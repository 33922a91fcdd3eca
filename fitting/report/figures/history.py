"""Figures of the fitted values: their way over the regularisation, and per experiment."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes

from fitting.campaign import BoundCampaign
from fitting.fit.result import IDENTIFIABLE, DerivedResult, ParameterResult, Result
from fitting.report.figures.style import (
    AFTER,
    BLACK,
    BLUE,
    GREY,
    PALE,
    SERIES,
    SERIES_MARKERS,
    Drawing,
    label_experiments,
    log_axis,
    marker_of,
    new_figure,
    plain_ticks,
)
from fitting.text.notation import (
    listed,
    mathtext,
    mean_of,
    number,
    on_log_axis,
    plain,
    prefixed,
    quantity,
    scaling_for,
    span,
    unit_text,
)

PER_ROW = 3
#: Parameters of one unit that share a panel of corrections.
MOST_IN_PANEL = 6
#: A start farther from the levels than this many of their ranges is not drawn.
FAR_START = 2.0


def draw_convergence(result: Result, bound: BoundCampaign) -> Drawing:
    """Parameters, means of the derived outputs, J_fit and J_reg over the levels of nu.

    A parameter alone in its unit is drawn as its value, several of one unit as corrections
    p - p_ref, which makes them comparable.
    """
    title = "Convergence over the regularisation ν"
    groups = _groups(result)
    panels = len(groups) + len(result.derived) + 1
    columns = min(PER_ROW, panels)
    rows = math.ceil(panels / columns)
    figure = new_figure(
        title, bound.title, synthetic=bound.synthetic, height=0.95 + 2.15 * rows, width=9.4
    )
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for panel, names in zip(axes, groups, strict=False):
        _parameter_panel(panel, result, names)
    for panel, name in zip(axes[len(groups) :], result.derived, strict=False):
        _derived_panel(panel, result, name)
    _misfit_panel(axes[panels - 1], result)
    for panel in axes[panels:]:
        panel.set_visible(False)
    for panel in axes[:panels]:
        _nu_axis(panel, result)
    values = [
        f"{plain(name)} = {number(p.value, 6)} {unit_text(p.unit)}".strip()
        for name, p in result.parameters.items()
    ]
    every: dict[str, ParameterResult | DerivedResult] = {**result.parameters, **result.derived}
    unsure = [plain(name) for name, p in every.items() if p.identifiable == IDENTIFIABLE[2]]
    warning = ""
    if unsure:
        warning = (
            f" A curve that settles is no sign that the data determine the value: {listed(unsure)} "
            f"{'is' if len(unsure) == 1 else 'are'} not determined by these data."
        )
    caption = (
        "Way of the reported chain over the levels of the regularisation ν, from its start point: "
        "fitted parameters (those of one unit as corrections to their reference), means of the "
        "derived outputs over the experiments, misfit and regularisation term. Dashed grey: value "
        f"at the reference parameters; a start far outside is told in words.{warning}"
    )
    alt = f"Values over {len(result.history) - 1} levels of ν, ending at {listed(values)}."
    return Drawing("5_convergence", title, caption, alt, figure)


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


def _parameter_panel(axes: Axes, result: Result, names: Sequence[str]) -> None:
    alone = len(names) == 1
    parameters = result.parameters
    origins = {name: 0.0 if alone else parameters[name].reference for name in names}
    curves = {
        mathtext(name): [row.parameters[name] - origins[name] for row in result.history]
        for name in names
    }
    reference = parameters[names[0]].reference if alone else 0.0
    what = mathtext(names[0]) if alone else "correction $p$ − $p_{\\mathrm{ref}}$"
    _level_curves(axes, curves, reference, parameters[names[0]].unit, what)
    if not alone:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, handlelength=1.6)


def _derived_panel(axes: Axes, result: Result, name: str) -> None:
    derived = result.derived[name]
    what = mean_of(name) if len(derived.values) > 1 else mathtext(name)
    curve = [row.derived.get(name, math.nan) for row in result.history]
    _level_curves(axes, {what: curve}, derived.reference, derived.unit, what)


def _level_curves(
    axes: Axes, curves: Mapping[str, Sequence[float]], reference: float, unit: str, what: str
) -> None:
    """Values over the levels; a start far from all of them is told in words, not drawn.

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
        axes.plot(
            [i for i, _ in known],
            [v for _, v in known],
            color=SERIES[k % len(SERIES)],
            marker=SERIES_MARKERS[k % len(SERIES_MARKERS)],
            markersize=4.0,
            label=label,
        )
    if not any(math.isfinite(v) for curve in curves.values() for v in curve):
        axes.text(
            0.5,
            0.5,
            "the model has no value here",
            ha="center",
            va="center",
            transform=axes.transAxes,
            color=GREY,
        )
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
        fontsize=7.5,
        bbox={"boxstyle": "square,pad=0.2", "facecolor": "white", "edgecolor": "none"},
    )


def _misfit_panel(axes: Axes, result: Result) -> None:
    for values, label, colour, marker, dash in (
        ([row.j_fit for row in result.history], r"$J_{\mathrm{fit}}$", BLACK, "o", "-"),
        ([row.j_reg for row in result.history], r"$J_{\mathrm{reg}}$", AFTER, "s", "--"),
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
    axes.legend(loc="best", handlelength=2.2)


def _nu_axis(axes: Axes, result: Result) -> None:
    """Ticks at the levels: "start", then nu itself, thinned so that labels keep apart."""
    count = len(result.history)
    step = max(1, math.ceil((count - 1) / 5))
    ticks = [0, *range(count - 1, 0, -step)]
    if len(ticks) > 2 and ticks[-1] < max(1, step // 2 + 1):
        ticks.pop()
    axes.set_xticks(ticks, [_nu_text(result.history[k].nu) for k in ticks])
    axes.set_xlim(-0.4, max(count - 0.6, 0.6))
    axes.set_xlabel("ν", labelpad=1.0)


def _nu_text(nu: float) -> str:
    return "start" if math.isnan(nu) else on_log_axis(nu)


def draw_derived(result: Result, bound: BoundCampaign) -> Drawing:
    """Derived outputs of every experiment with mean and spread, and whether the data give them."""
    title = "Derived quantities per experiment"
    columns = min(PER_ROW, len(result.derived))
    rows = math.ceil(len(result.derived) / columns)
    width = 3.15 * columns if columns > 1 else 5.0
    figure = new_figure(
        title,
        bound.title,
        synthetic=bound.synthetic,
        height=0.85 + 2.75 * rows,
        width=max(width, 6.4),
    )
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    labels = [e.label for e in bound.experiments]
    for panel, (name, derived) in zip(axes, result.derived.items(), strict=False):
        _experiment_panel(panel, name, derived, labels, columns)
    for panel in axes[len(result.derived) :]:
        panel.set_visible(False)
    said = [f"{plain(name)}: {_in_words(d)}" for name, d in result.derived.items()]
    caption = (
        "Derived outputs of the FMU at the fitted parameters, for every experiment (marker shapes "
        "as in the other figures), with mean (dashed) and spread over the experiments (band, one "
        "standard deviation). The spread is the drift of the experiments, not the uncertainty of "
        f"the value. {'. '.join(said)}."
    )
    alt = (
        "Values per experiment. "
        + ". ".join(f"{plain(name)}: {_in_words(d)}" for name, d in result.derived.items())
        + "."
    )
    return Drawing("6_derived_per_experiment", title, caption, alt, figure)


def _experiment_panel(
    axes: Axes, name: str, derived: DerivedResult, labels: Sequence[str], columns: int
) -> None:
    finite = [v for v in derived.values if math.isfinite(v)]
    scaling = scaling_for(finite, derived.unit)
    if finite:
        low, high = scaling(derived.mean - derived.spread), scaling(derived.mean + derived.spread)
        axes.axhspan(low, high, color=PALE, alpha=0.6, linewidth=0.0, zorder=0)
        axes.axhline(scaling(derived.mean), color=BLACK, linestyle="--", linewidth=1.1)
    else:
        axes.text(
            0.5,
            0.5,
            "the model has no value here",
            ha="center",
            va="center",
            transform=axes.transAxes,
            color=GREY,
        )
    for i, value in enumerate(derived.values):
        if math.isfinite(value):
            axes.plot(i, scaling(value), marker=marker_of(i), color=BLUE, markersize=6.0)
    plain_ticks(axes)
    label_experiments(axes, labels, share=columns)
    _room_around(axes, [scaling(v) for v in finite])
    axes.set_ylabel(scaling.label(mathtext(name)))
    sure = derived.identifiable != IDENTIFIABLE[2]
    first, second = mean_of(name) if sure else mathtext(name), _short_words(derived)
    axes.set_title(f"{first}{second}", fontsize=8, loc="left", color=BLACK if sure else AFTER)


def _room_around(axes: Axes, values: Sequence[float]) -> None:
    """A quarter of the range on both sides; a percent where all values are one."""
    if not values:
        return
    low, high = min(values), max(values)
    margin = 0.25 * (high - low)
    if margin <= 1e-9 * max(abs(low), abs(high)):
        margin = 0.01 * max(abs(low), abs(high)) or 1.0
    axes.set_ylim(low - margin, high + margin)


def _short_words(derived: DerivedResult) -> str:
    """Two lines: never a value with a small error where the data do not give one."""
    if derived.identifiable == IDENTIFIABLE[2]:
        return f": {derived.identifiable} by these data,\nanything from {_box_words(derived)}"
    return f" = {_value_words(derived)}\n{derived.identifiable} by these data"


def _in_words(derived: DerivedResult) -> str:
    if derived.identifiable == IDENTIFIABLE[2]:
        words = f"{derived.identifiable} by these data (anything from {_box_words(derived)} within"
        return f"{words} the box of the parameters)"
    return f"{derived.identifiable}, {_value_words(derived)}"


def _value_words(derived: DerivedResult) -> str:
    return quantity(derived.value, derived.std, derived.unit)


def _box_words(derived: DerivedResult) -> str:
    low, high = derived.box
    if not (math.isfinite(low) and math.isfinite(high)):
        return "any value to any other"
    factor, unit = prefixed(max(abs(low), abs(high)), derived.unit)
    return span(low / factor, high / factor, unit)
