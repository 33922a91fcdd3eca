"""Figures of what the data determine: profiles, values that go together, outputs, choice of nu."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from fitting.fit.result import IDENTIFIABLE
from fitting.inference.knowledge import Knowledge, NuChoice, Profile
from fitting.report.figures.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    RED,
    SERIES,
    SERIES_MARKERS,
    Drawing,
    legend_below,
    log_axis,
    new_figure,
    plain_ticks,
)
from fitting.text.notation import listed, mathtext, on_log_axis, plain, scaling_for

PER_ROW = 3
#: Dchi^2 at the ends of the 68 % and 95 % intervals, and the highest that is drawn.
AT_68, AT_95, HIGHEST = 1.0, 3.84, 8.0
#: Profiles, parameters against each other, and outputs, at most in a figure.
MOST_PROFILES, MOST_TOGETHER, MOST_OUTPUTS = 18, 4, 4
VERDICT_COLOURS = dict(zip(IDENTIFIABLE, (GREEN, ORANGE, RED), strict=True))


def knowledge_figures(knowledge: Knowledge, title: str, *, synthetic: bool) -> list[Drawing]:
    """Every figure that there is something for, in order."""
    drawn = [draw_profiles(knowledge, title, synthetic=synthetic)]
    if len(_together(knowledge)) > 1:
        drawn.append(draw_together(knowledge, title, synthetic=synthetic))
    if _along(knowledge) is not None:
        drawn.append(draw_outputs(knowledge, title, synthetic=synthetic))
    if knowledge.nu is not None and len(knowledge.nu.rows) > 1:
        drawn.append(draw_nu(knowledge.nu, title, synthetic=synthetic))
    return drawn


def draw_profiles(knowledge: Knowledge, campaign: str, *, synthetic: bool) -> Drawing:
    """Profile likelihood of every value with the thresholds of its intervals."""
    title = "Profile likelihood: how far each value can go"
    shown = dict(list(knowledge.profiles.items())[:MOST_PROFILES])
    columns = min(PER_ROW, len(shown))
    rows = math.ceil(len(shown) / columns)
    figure = new_figure(title, campaign, synthetic=synthetic, height=1.3 + 1.75 * rows)
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for panel, (name, profile) in zip(axes, shown.items(), strict=False):
        _profile_panel(panel, name, profile)
    for panel in axes[len(shown) :]:
        panel.set_visible(False)
    for row in range(rows):
        axes[row * columns].set_ylabel("Δχ²")
    handles = [
        Line2D([], [], color=BLUE, marker="o", markersize=3.5, label="profile"),
        Line2D([], [], color=GREY, linestyle="--", label="thresholds 68 % (1) and 95 % (3.84)"),
        *(
            Line2D([], [], color=colour, linewidth=5.0, alpha=0.35, label=f"95 %: {word}")
            for word, colour in VERDICT_COLOURS.items()
        ),
    ]
    legend_below(figure, handles, ncols=3)
    words = [f"{plain(name)} {profile.verdict}" for name, profile in shown.items()]
    caption = (
        "Least Δχ² that fits of all other parameters reach at each value. Where the curve stays "
        "below 3.84 the value fits the data at 95 %; a curve that stays there from end to end says "
        "that the data do not determine the value. The band is the 95 % interval, drawn over the "
        "range that the box leaves where the data end it nowhere."
    )
    return Drawing("9_profiles", title, caption, f"Verdicts: {listed(words)}.", figure)


def _profile_panel(axes: Axes, name: str, profile: Profile) -> None:
    values = [v for v in (*profile.values, *profile.interval95) if math.isfinite(v)]
    colour = VERDICT_COLOURS.get(profile.verdict, GREY)
    axes.set_title(f"{mathtext(name)}: {profile.verdict}", color=colour, loc="left", fontsize=8.0)
    axes.set_ylim(-0.35, HIGHEST)
    if not values:
        axes.text(0.5, 0.5, "no value", transform=axes.transAxes, ha="center", color=GREY)
        return
    scaling = scaling_for(values, profile.unit)
    low, high = (scaling(v) for v in profile.interval95)
    axes.axvspan(low, high, color=colour, alpha=0.15, linewidth=0.0)
    for level in (AT_68, AT_95):
        axes.axhline(level, color=GREY, linestyle="--", linewidth=0.9)
    kept = _near(profile)
    xs, ys = ([scaling(profile.values[k]) for k in kept], [profile.delta[k] for k in kept])
    axes.plot(xs, np.minimum(ys, 2 * HIGHEST), color=BLUE, marker="o", markersize=2.8, linewidth=1)
    axes.set_xlabel(scaling.label(mathtext(name)))
    plain_ticks(axes, x=3)
    axes.set_yticks([0.0, AT_68, AT_95, HIGHEST], ["0", "1", "3.84", "8"])


def _near(profile: Profile) -> list[int]:
    """Points of a profile worth drawing: not those far beyond the threshold."""
    low, high = profile.interval95
    room = 0.25 * (high - low)
    return [
        k
        for k, value in enumerate(profile.values)
        if profile.delta[k] <= 2.0 * HIGHEST and low - room <= value <= high + room
    ]


def _together(knowledge: Knowledge) -> list[str]:
    """Parameters that are drawn against each other: those least determined, few of them."""
    names = [n for n, p in knowledge.parameters.items() if len(p.values) > 1]
    ranked = sorted(names, key=lambda name: knowledge.parameters[name].shrinkage)
    return [name for name in names if name in ranked[:MOST_TOGETHER]]


def _cloud(knowledge: Knowledge, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Values of a parameter or output at all points of all profiles, and Dchi^2 there."""
    values, deltas = [], []
    for profile in knowledge.profiles.values():
        if name in profile.path:
            values += list(profile.path[name])
            deltas += list(profile.delta)
    found, delta = np.array(values), np.array(deltas)
    own = knowledge.parameters.get(name)
    if own is not None and own.ends[0] == "round":
        low, high = own.box
        found = low + np.mod(found - low, high - low)
    return found, delta


def draw_together(knowledge: Knowledge, campaign: str, *, synthetic: bool) -> Drawing:
    """Parameters against each other over all fits that the profiles went through."""
    title = "Which parameter values go together"
    pairs = list(itertools.combinations(_together(knowledge), 2))
    columns = min(PER_ROW, len(pairs))
    rows = math.ceil(len(pairs) / columns)
    figure = new_figure(title, campaign, synthetic=synthetic, height=1.3 + 2.3 * rows)
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for panel, (one, other) in zip(axes, pairs, strict=False):
        _pair_panel(panel, knowledge, one, other)
    for panel in axes[len(pairs) :]:
        panel.set_visible(False)
    legend_below(figure, _cloud_handles(), ncols=3)
    names = [plain(name) for name in _together(knowledge)]
    caption = (
        "Every point of every profile: filled where it fits the data at 95 % (Δχ² ≤ 3.84), pale "
        "where it does not; frames are the box. Filled points along a line or curve are a "
        "combination that the data hold while its parts are free; filled points everywhere are no "
        "knowledge at all."
    )
    alt = f"Fits in the planes of {listed(names)}."
    return Drawing("10_together", title, caption, alt, figure)


def _pair_panel(axes: Axes, knowledge: Knowledge, one: str, other: str) -> None:
    profiles = knowledge.parameters
    (x, delta), (y, _) = _cloud(knowledge, one), _cloud(knowledge, other)
    across = scaling_for([*profiles[one].box], profiles[one].unit)
    up = scaling_for([*profiles[other].box], profiles[other].unit)
    _scatter(axes, [across(v) for v in x], [up(v) for v in y], delta)
    axes.plot(across(profiles[one].best), up(profiles[other].best), "*", color=RED, markersize=9)
    _frame(axes, [across(v) for v in x], [across(v) for v in profiles[one].box], vertical=False)
    _frame(axes, [up(v) for v in y], [up(v) for v in profiles[other].box], vertical=True)
    plain_ticks(axes, x=4)
    axes.set_xlabel(across.label(mathtext(one)))
    axes.set_ylabel(up.label(mathtext(other)))


def _scatter(axes: Axes, x: Sequence[float], y: Sequence[float], delta: np.ndarray) -> None:
    fits = delta <= AT_95
    across, up = np.array(x), np.array(y)
    axes.plot(across[~fits], up[~fits], "o", color=PALE, markersize=3.0)
    axes.plot(across[fits], up[fits], "o", color=BLUE, markersize=3.2, alpha=0.8)


def _frame(axes: Axes, values: Sequence[float], box: Sequence[float], *, vertical: bool) -> None:
    """The box, where the points come near it; else the axis keeps to the points."""
    finite = [v for v in values if math.isfinite(v)]
    width = box[1] - box[0]
    if not finite or max(finite) - min(finite) < 0.3 * width:
        return
    for end in box:
        line = axes.axhline if vertical else axes.axvline
        line(end, color=GREY, linewidth=0.9)


def _cloud_handles() -> list[Line2D]:
    return [
        Line2D([], [], linestyle="none", marker="o", color=BLUE, label="fits (Δχ² ≤ 3.84)"),
        Line2D([], [], linestyle="none", marker="o", color=PALE, label="does not fit"),
        Line2D([], [], linestyle="none", marker="*", color=RED, markersize=9, label="most likely"),
    ]


def _along(knowledge: Knowledge) -> tuple[str, list[str]] | None:
    """The least determined parameter and the outputs that are drawn over it."""
    outputs = [n for n, p in knowledge.derived.items() if len(p.values) > 1]
    outputs.sort(key=lambda name: knowledge.derived[name].shrinkage)
    names = [n for n, p in knowledge.parameters.items() if len(p.values) > 1]
    if not outputs or not names:
        return None
    # one that goes round is an angle, and what hangs on an angle is best seen over it
    names.sort(
        key=lambda n: (
            knowledge.parameters[n].ends[0] != "round",
            knowledge.parameters[n].shrinkage,
        )
    )
    kept = outputs[:MOST_OUTPUTS]
    return names[0], [name for name in knowledge.derived if name in kept]


def draw_outputs(knowledge: Knowledge, campaign: str, *, synthetic: bool) -> Drawing:
    """Derived outputs over the least determined parameter, with their prior and data intervals."""
    title = "What the least determined parameter leaves open"
    chosen = _along(knowledge)
    if chosen is None:
        raise ValueError("no output to draw over a parameter")
    parameter, outputs = chosen
    columns = min(2, len(outputs))
    rows = math.ceil(len(outputs) / columns)
    figure = new_figure(title, campaign, synthetic=synthetic, height=1.3 + 2.3 * rows)
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for panel, output in zip(axes, outputs, strict=False):
        _output_panel(panel, knowledge, parameter, output)
    for panel in axes[len(outputs) :]:
        panel.set_visible(False)
    bars = [
        Line2D([], [], color=GREY, linewidth=4.0, label="without data: range over the box"),
        Line2D([], [], color=BLUE, linewidth=4.0, label="with data: 95 % interval"),
    ]
    legend_below(figure, [*_cloud_handles(), *bars], ncols=3)
    words = [f"{plain(name)} {knowledge.derived[name].verdict}" for name in outputs]
    caption = (
        f"Outputs over {plain(parameter)} at every point of every profile. The bars at the right "
        "edge are the range without data (grey) and the 95 % interval with them (blue): where both "
        "are alike, the data say nothing of that output."
    )
    return Drawing("11_outputs", title, caption, f"{listed(words)}.", figure)


def _output_panel(axes: Axes, knowledge: Knowledge, parameter: str, output: str) -> None:
    profile, own = knowledge.derived[output], knowledge.parameters[parameter]
    (x, delta), (y, _) = _cloud(knowledge, parameter), _cloud(knowledge, output)
    across = scaling_for([*own.box], own.unit)
    up = scaling_for([*profile.box, profile.best], profile.unit)
    exists = np.isfinite(y)
    _scatter(axes, [across(v) for v in x[exists]], [up(v) for v in y[exists]], delta[exists])
    axes.plot(across(own.best), up(profile.best), "*", color=RED, markersize=9)
    for at, bar, colour in ((1.02, profile.box, GREY), (1.05, profile.interval95, BLUE)):
        ends = [up(v) for v in bar]
        axes.plot(
            [at, at],
            ends,
            transform=axes.get_yaxis_transform(),
            color=colour,
            linewidth=4.0,
            clip_on=False,
            solid_capstyle="butt",
        )
    plain_ticks(axes, x=4)
    axes.set_xlabel(across.label(mathtext(parameter)))
    axes.set_ylabel(up.label(mathtext(output)))


def draw_nu(nu: NuChoice, campaign: str, *, synthetic: bool) -> Drawing:
    """L-curve, discrepancy, and the result at every nu against the prior."""
    title = "The regularisation ν that the data would choose"
    figure = new_figure(title, campaign, synthetic=synthetic, height=3.4)
    curve, squares, ways = figure.subplots(1, 3)
    rows = [row for row in nu.rows if row.distance > 0.0 and row.j_fit > 0.0]
    curve.plot(
        [r.j_fit for r in rows], [r.distance for r in rows], color=BLUE, marker="o", markersize=3.5
    )
    for row in rows:
        if row.nu == nu.corner:
            curve.plot(row.j_fit, row.distance, "s", color=RED, markersize=8, fillstyle="none")
    still = not rows or max(r.distance for r in rows) < 1.01 * min(r.distance for r in rows)
    for row in rows[:1] if still else (rows[0], rows[-1]):
        label = "all ν" if still else f"ν = {on_log_axis(row.nu)}"
        curve.annotate(
            label,
            (row.j_fit, row.distance),
            fontsize=7.0,
            xytext=(4, 4),
            textcoords="offset points",
        )
    if rows:
        curve.set_xscale("log")
        curve.set_yscale("log")
    curve.set_xlabel("J_fit")
    curve.set_ylabel("distance from the prior |x|")
    curve.set_title("L-curve", loc="left")
    at = [row.nu for row in nu.rows]
    squares.plot(at, [row.chi_square for row in nu.rows], color=BLUE, marker="o", markersize=3.5)
    squares.axhline(nu.allowed, color=GREY, linestyle="--", linewidth=1.0)
    squares.set_ylabel("χ² (dashed: what noise explains)")
    squares.set_title("Discrepancy principle", loc="left")
    _ways_panel(ways, nu)
    for panel in (squares, ways):
        panel.set_xscale("log")
        panel.invert_xaxis()
        panel.set_xlabel("ν")
    log_axis(squares)
    caption = (
        "Left: misfit against distance from the prior, the square marks the corner where there is "
        "one. Middle: χ² of the solution at every ν. Right: how far the data moved the "
        "solution from the prior (dashed) at every ν. " + " ".join(nu.sentences)
    )
    return Drawing("12_nu", title, caption, " ".join(nu.sentences), figure)


def _ways_panel(axes: Axes, nu: NuChoice) -> None:
    """Parameters at every nu as distances from the prior, in shares of the box."""
    names = [name for name in nu.rows[0].parameters if name in nu.prior][: len(SERIES)]
    for k, name in enumerate(names):
        ways = [100.0 * (r.parameters[name] - nu.prior[name]) / nu.widths[name] for r in nu.rows]
        axes.plot(
            [row.nu for row in nu.rows],
            ways,
            color=SERIES[k % len(SERIES)],
            marker=SERIES_MARKERS[k % len(SERIES_MARKERS)],
            markersize=3.5,
            label=mathtext(name),
        )
    axes.axhline(0.0, color=GREY, linestyle="--", linewidth=1.0)
    axes.set_title("The result against the prior", loc="left")
    axes.set_ylabel("value − reference, % of the box")
    if names:
        axes.legend(loc="best")
