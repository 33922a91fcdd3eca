"""Figures of what the data determine: profiles, values that go together, outputs, choice of nu."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from fitting.inference.checks.solutions import WORTH_SAYING
from fitting.inference.likelihood.knowledge import NuChoice, Scan, Values
from fitting.measurements.figure import Figure as Described
from fitting.report.figures.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    Planned,
    axes_of,
    described,
    handles_of,
    legend_below,
    log_axis,
    new_figure,
    panels,
    plain_ticks,
    say_empty,
    series_look,
)
from fitting.report.screen import phrase
from fitting.text.estimate import FittedEstimate, Interval, Verdict
from fitting.text.notation import on_log_axis, scaling_for, sign

PROFILES, TOGETHER, OUTPUTS, NU = "profiles", "together", "outputs", "nu"
PER_ROW = 3
#: Profiles, parameters against each other, and outputs, at most in a figure.
MOST_PROFILES, MOST_TOGETHER, MOST_OUTPUTS = 18, 4, 4
#: Δχ² from which a profile is more than a flat line.
BENT = 1.0


def _colours(verdicts: Sequence[Verdict]) -> dict[str, str]:
    """Colours of the bands that are drawn, each with the verdicts that it represents."""
    words: dict[str, list[str]] = {}
    for verdict, colour in VERDICT_COLOURS.items():
        if verdict in verdicts:
            words.setdefault(colour, []).append(str(verdict))
    return {colour: " or ".join(stated) for colour, stated in words.items()}


def knowledge_figures(result: Values, title: str, *, synthetic: bool) -> list[Planned]:
    """Every figure that there is something for, in order, yet to be drawn.

    Args:
        result: values with their profiles.
        title: of the campaign.
        synthetic: whether the data are synthetic, which the figure then prints.
    """
    draws: dict[str, Callable[..., Described]] = {}
    if _curved(result):
        draws[PROFILES] = partial(draw_profiles, result)
    if len(_together(result)) > 1:
        draws[TOGETHER] = partial(draw_together, result)
    if _along(result) is not None:
        draws[OUTPUTS] = partial(draw_outputs, result)
    # without a corner all that there is to see is said in its sentences
    nu = None if result.knowledge is None else result.knowledge.nu
    if nu is not None and not math.isnan(nu.corner):
        draws[NU] = partial(draw_nu, nu)
    return [
        Planned(name=name, draw=partial(draw, title, synthetic=synthetic))
        for name, draw in draws.items()
    ]


def _curved(result: Values) -> dict[str, FittedEstimate]:
    """Profiles that the data bend anywhere, few of them; a flat one is a line on the axis."""
    return dict(list(_bent(result).items())[:MOST_PROFILES])


def _bent(result: Values) -> dict[str, FittedEstimate]:
    highest = {name: max(scan.delta_chi2, default=0.0) for name, scan in result.scans.items()}
    return {name: p for name, p in result.profiled.items() if highest[name] >= BENT}


def _flat(result: Values) -> list[str]:
    bent = _bent(result)
    return [name for name, scan in result.scans.items() if scan.values and name not in bent]


def undrawn_sentence(result: Values, figures: Sequence[Described]) -> str:
    """Which values have a flat profile, where no figure of profiles has it in its caption.

    Args:
        result: values with their profiles.
        figures: that are drawn.
    """
    names = _flat(result)
    if not names or any(figure.name == PROFILES for figure in figures):
        return ""
    return phrase("knowledge", "flat", names)


def draw_profiles(result: Values, campaign: str, *, synthetic: bool) -> Described:
    """Profile likelihood of every value with the thresholds of its intervals.

    Args:
        result: values with their profiles.
        campaign: title of the campaign.
        synthetic: whether the data are synthetic, which the figure then prints.
    """
    shown = _curved(result)
    words = described(
        PROFILES,
        words=[f"{name} {value.status}{value.condition}" for name, value in shown.items()],
        widened=any(v.simulation > WORTH_SAYING * result.scans[n].sigma for n, v in shown.items()),
        flat=_flat(result),
        further=list(_bent(result))[MOST_PROFILES:],
        most=MOST_PROFILES,
        unscanned=[name for name, scan in result.scans.items() if not scan.values],
    )
    height = 1.3 + 1.75 * math.ceil(len(shown) / PER_ROW)
    figure = new_figure(words.title, campaign, synthetic=synthetic, height=height)
    axes = panels(figure, len(shown), PER_ROW)
    for k, (name, value) in enumerate(shown.items()):
        profile(value, result.scans[name], ax=axes[k])
        if k % PER_ROW:
            axes[k].set_ylabel("")
    handles = [
        Line2D([], [], color=BLUE, marker="o", markersize=3.5, label="profile"),
        Line2D([], [], color=GREY, linestyle="--", label="thresholds 68 % (1) and 95 % (3.84)"),
        *(
            Line2D([], [], color=colour, linewidth=5.0, alpha=0.35, label=f"95 %: {statuses}")
            for colour, statuses in _colours([value.status for value in shown.values()]).items()
        ),
    ]
    legend_below(figure, handles, ncols=3)
    return replace(words, drawn=figure)


def _drawn(result: Values, values: Mapping[str, FittedEstimate]) -> list[str]:
    """Values whose profile has points enough for a plane."""
    return [n for n in values if n in result.scans and len(result.scans[n].values) > 1]


def _together(result: Values) -> list[str]:
    """Parameters that are drawn against each other: those least determined, few of them."""
    names = _drawn(result, result.parameters)
    ranked = sorted(names, key=lambda name: result.parameters[name].shrinkage)
    return [name for name in names if name in ranked[:MOST_TOGETHER]]


def draw_together(result: Values, campaign: str, *, synthetic: bool) -> Described:
    """Parameters against each other over all fits that the profiles went through.

    Args:
        result: values with their profiles.
        campaign: title of the campaign.
        synthetic: whether the data are synthetic, which the figure then prints.
    """
    names = _together(result)
    around = [name for name in names if result.parameters[name].is_all_round]
    words = described(TOGETHER, names=names, around=around)
    pairs = list(itertools.combinations(names, 2))
    height = 1.3 + 2.3 * math.ceil(len(pairs) / PER_ROW)
    figure = new_figure(words.title, campaign, synthetic=synthetic, height=height)
    axes = panels(figure, len(pairs), PER_ROW)
    for panel, (one, other) in zip(axes, pairs, strict=True):
        together(result, one, other, ax=panel)
    legend_below(figure, handles_of(axes[0]), ncols=3)
    return replace(words, drawn=figure)


def _along(result: Values) -> tuple[str, list[str]] | None:
    """The least determined parameter and the outputs that are drawn over it."""
    outputs = _drawn(result, result.derived)
    outputs.sort(key=lambda name: result.derived[name].shrinkage)
    names = _drawn(result, result.parameters)
    if not outputs or not names:
        return None
    # one that goes round is an angle, and what hangs on an angle is best seen over it
    names.sort(
        key=lambda n: (not result.parameters[n].is_all_round, result.parameters[n].shrinkage)
    )
    kept = outputs[:MOST_OUTPUTS]
    return names[0], [name for name in result.derived if name in kept]


def draw_outputs(result: Values, campaign: str, *, synthetic: bool) -> Described:
    """Derived outputs over the least determined parameter, with their prior and data intervals.

    Args:
        result: values with their profiles.
        campaign: title of the campaign.
        synthetic: whether the data are synthetic, which the figure then prints.
    """
    chosen = _along(result)
    if chosen is None:
        raise ValueError("no output to draw over a parameter")
    parameter, outputs = chosen
    shown = {name: result.derived[name] for name in outputs}
    # points are missing where an output has no value
    paths = [scan.path for scan in result.scans.values()]
    words = described(
        OUTPUTS,
        parameter=parameter,
        words=[f"{name} {e.status}{e.condition}" for name, e in shown.items()],
        gaps=[n for n in outputs if any(math.isnan(v) for p in paths for v in p.get(n, ()))],
    )
    height = 1.3 + 2.3 * math.ceil(len(outputs) / 2)
    figure = new_figure(words.title, campaign, synthetic=synthetic, height=height)
    axes = panels(figure, len(outputs), 2)
    for panel, name in zip(axes, outputs, strict=True):
        output(result, name, parameter, ax=panel)
    legend_below(figure, handles_of(axes[0]), ncols=3)
    return replace(words, drawn=figure)


def draw_nu(nu: NuChoice, campaign: str, *, synthetic: bool) -> Described:
    """L-curve, discrepancy, and the result at every nu against the prior.

    Args:
        nu: choices of ν, and what each is based on.
        campaign: title of the campaign.
        synthetic: whether the data are synthetic, which the figure then prints.
    """
    words = described(NU, nu=nu)
    figure = new_figure(words.title, campaign, synthetic=synthetic, height=3.4)
    curve, squares, ways = figure.subplots(1, 3)
    l_curve(nu, ax=curve)
    discrepancy(nu, ax=squares)
    against_prior(nu, ax=ways)
    if handles_of(ways):
        ways.legend(loc="best")
    return replace(words, drawn=figure)


#: Dchi^2 at the ends of the 68 % and 95 % intervals, and the highest that is drawn.
AT_68, AT_95, HIGHEST = 1.0, 3.84, 8.0
VERDICT_COLOURS = {
    Verdict.DETERMINED: GREEN,
    Verdict.BOUNDED: ORANGE,
    Verdict.ABOVE: ORANGE,
    Verdict.BELOW: ORANGE,
    Verdict.SEVERAL: ORANGE,
    Verdict.UNCONSTRAINED: RED,
}
#: Series in the panel of values over nu.
MOST_SERIES = 6


def profile(result: FittedEstimate, scan: Scan, *, ax: Axes | None = None) -> Axes:
    """Draw a profile likelihood: the least Δχ² that fits reach at each value.

    Dashed lines are the thresholds of the 68 % and 95 % intervals, 1 and 3.84; the band is the 95 %
    interval, its colour and the title the verdict.

    Args:
        result: the value, drawn in its unit.
        scan: the points of its profile.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes = axes_of(ax)
    values = [v for v in (*scan.values, *result.ci95) if math.isfinite(v)]
    colour = VERDICT_COLOURS.get(result.status, GREY)
    # what it holds under would not fit beside the next title: tables and sentences tell it
    axes.set_title(
        f"{sign(result.name)}: {result.status}", color=colour, loc="left", fontsize="small"
    )
    axes.set_ylim(-0.35, HIGHEST)
    axes.set_ylabel("Δχ²")
    if not values:
        say_empty(axes, "no value")
        return axes
    scaling = scaling_for(values, result.unit)
    if all(map(math.isfinite, result.ci95)):
        low, high = (scaling(v) for v in result.ci95)
        axes.axvspan(low, high, color=colour, alpha=0.15, linewidth=0.0)
    for level in (AT_68, AT_95):
        axes.axhline(level, color=GREY, linestyle="--", linewidth=0.9)
    kept = _near(result, scan)
    xs, ys = [scaling(scan.values[k]) for k in kept], [scan.delta_chi2[k] for k in kept]
    axes.plot(
        xs,
        np.minimum(ys, 2 * HIGHEST),
        color=BLUE,
        marker="o",
        markersize=2.8,
        linewidth=1,
        label="profile",
    )
    axes.set_xlabel(scaling.label(sign(result.name)))
    plain_ticks(axes, x=3)
    axes.set_yticks([0.0, AT_68, AT_95, HIGHEST], ["0", "1", "3.84", "8"])
    return axes


def _near(result: FittedEstimate, scan: Scan) -> list[int]:
    """Points of a profile worth drawing: not those far beyond the threshold."""
    low, high = result.ci95
    if math.isnan(low):
        low, high = result.bounds
    room = 0.25 * (high - low)
    return [
        k
        for k, value in enumerate(scan.values)
        if scan.delta_chi2[k] <= 2.0 * HIGHEST and low - room <= value <= high + room
    ]


def together(result: Values, one: str, other: str, *, ax: Axes | None = None) -> Axes:
    """Draw two parameters against each other over all fits that the profiles went through.

    Filled where a point fits the data at 95 % (Δχ² ≤ 3.84), pale where it does not; the star is the
    most likely point, lines are the box where points come near it. A value that goes round has no
    such lines: its profile holds one period, wherever its box ends.

    Args:
        result: values with their profiles.
        one: name of the parameter along x, drawn in its unit.
        other: name of the parameter along y, drawn in its unit.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes, known = axes_of(ax), result.parameters
    (x, delta), (y, _) = _cloud(result, one), _cloud(result, other)
    across = scaling_for([*_range(known[one])], known[one].unit)
    up = scaling_for([*_range(known[other])], known[other].unit)
    _scatter(axes, [across(v) for v in x], [up(v) for v in y], delta)
    _star(axes, across(known[one].likely), up(known[other].likely))
    if not known[one].is_all_round:
        _frame(axes, [across(v) for v in x], [across(v) for v in known[one].bounds], vertical=False)
    if not known[other].is_all_round:
        _frame(axes, [up(v) for v in y], [up(v) for v in known[other].bounds], vertical=True)
    plain_ticks(axes, x=4)
    axes.set_xlabel(across.label(sign(one)))
    axes.set_ylabel(up.label(sign(other)))
    return axes


def output(result: Values, name: str, parameter: str, *, ax: Axes | None = None) -> Axes:
    """Draw a derived output over a parameter at every fit that the profiles went through.

    The bars at the right edge are the range of the output without data (grey) and its 95 % interval
    with them (blue).

    Args:
        result: values with their profiles.
        name: of the output, drawn in its unit.
        parameter: name of the parameter along x, drawn in its unit.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes = axes_of(ax)
    read, own = result.derived[name], result.parameters[parameter]
    (x, delta), (y, _) = _cloud(result, parameter), _cloud(result, name)
    across = scaling_for([*_range(own)], own.unit)
    up = scaling_for([*read.bounds, read.likely], read.unit)
    exists = np.isfinite(y)
    _scatter(axes, [across(v) for v in x[exists]], [up(v) for v in y[exists]], delta[exists])
    _star(axes, across(own.likely), up(read.likely))
    for at, bar, colour, label in (
        (1.02, read.bounds, GREY, "without data: range over the box"),
        (1.05, read.ci95, BLUE, "with data: 95 % interval"),
    ):
        axes.plot(
            [at, at],
            [up(v) for v in bar],
            transform=axes.get_yaxis_transform(),
            color=colour,
            linewidth=4.0,
            clip_on=False,
            solid_capstyle="butt",
            label=label,
        )
    plain_ticks(axes, x=4)
    axes.set_xlabel(across.label(sign(parameter)))
    axes.set_ylabel(up.label(sign(name)))
    return axes


def _range(value: FittedEstimate) -> Interval:
    """Where a parameter was looked for: its bounds, or the period in which its profile lies."""
    if not value.is_all_round:
        return value.bounds
    low, high = value.ci95
    return (low, high) if math.isfinite(low) else value.bounds


def _cloud(result: Values, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Values of a parameter or output at all points of all profiles, and Dchi^2 there."""
    values, deltas = [], []
    for scan in result.scans.values():
        if name in scan.path:
            values += list(scan.path[name])
            deltas += list(scan.delta_chi2)
    cloud, delta = np.array(values), np.array(deltas)
    own = result.parameters.get(name)
    if own is not None and own.is_all_round and own.period is not None:
        cloud = _range(own)[0] + np.mod(cloud - _range(own)[0], own.period)
    return cloud, delta


def _scatter(axes: Axes, x: Sequence[float], y: Sequence[float], delta: np.ndarray) -> None:
    fits = delta <= AT_95
    across, up = np.array(x), np.array(y)
    axes.plot(
        across[fits],
        up[fits],
        "o",
        color=BLUE,
        markersize=3.2,
        alpha=0.8,
        zorder=2.1,
        label="fits (Δχ² ≤ 3.84)",
    )
    axes.plot(
        across[~fits], up[~fits], "o", color=GREY, alpha=0.3, markersize=3.0, label="does not fit"
    )


def _star(axes: Axes, x: float, y: float) -> None:
    axes.plot(
        x, y, marker="*", linestyle="none", color=RED, markersize=9, zorder=2.2, label="most likely"
    )


def _frame(axes: Axes, values: Sequence[float], box: Sequence[float], *, vertical: bool) -> None:
    """The box, where the points come near it; else the axis keeps to the points."""
    finite = [v for v in values if math.isfinite(v)]
    width = box[1] - box[0]
    if not finite or max(finite) - min(finite) < 0.3 * width:
        return
    for end in box:
        line = axes.axhline if vertical else axes.axvline
        line(end, color=GREY, linewidth=0.9)


def l_curve(nu: NuChoice, *, ax: Axes | None = None) -> Axes:
    """Draw the L-curve: distance from the prior |x| over misfit J_fit, a point per ν.

    A square marks the corner where there is one.

    Args:
        nu: the fit at every ν of the schedule.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes = axes_of(ax)
    rows = [row for row in nu.rows if row.distance > 0.0 and row.j_fit > 0.0]
    axes.plot(
        [r.j_fit for r in rows], [r.distance for r in rows], color=BLUE, marker="o", markersize=3.5
    )
    for row in rows:
        if row.nu == nu.corner:
            axes.plot(row.j_fit, row.distance, "s", color=RED, markersize=8, fillstyle="none")
    still = not rows or max(r.distance for r in rows) < 1.01 * min(r.distance for r in rows)
    for row in rows[:1] if still else (rows[0], rows[-1]):
        axes.annotate(
            "all ν" if still else f"ν = {on_log_axis(row.nu)}",
            (row.j_fit, row.distance),
            fontsize="small",
            xytext=(4, 4),
            textcoords="offset points",
        )
    if rows:
        axes.set_xscale("log")
        axes.set_yscale("log")
    axes.set_xlabel("J_fit")
    axes.set_ylabel("distance from the prior |x|")
    axes.set_title("L-curve", loc="left")
    return axes


def discrepancy(nu: NuChoice, *, ax: Axes | None = None) -> Axes:
    """Draw χ²(ν), that of the data where Algorithm 2 stood at every ν; dashed: what noise explains.

    Args:
        nu: the fit at every ν of the schedule.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes = axes_of(ax)
    squares = [row.chi_square for row in nu.rows]
    axes.plot([row.nu for row in nu.rows], squares, color=BLUE, marker="o", markersize=3.5)
    axes.axhline(nu.allowed, color=GREY, linestyle="--", linewidth=1.0)
    axes.set_ylabel("χ²(ν) (dashed: what noise explains)")
    axes.set_title("Discrepancy principle", loc="left")
    _falling_nu(axes)
    log_axis(axes)
    return axes


def against_prior(nu: NuChoice, *, ax: Axes | None = None) -> Axes:
    """Draw the fitted parameters at every ν as distances from their references, in % of the box.

    Args:
        nu: the fit at every ν of the schedule.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes = axes_of(ax)
    names = [name for name in nu.rows[0].parameters if name in nu.prior][:MOST_SERIES]
    for k, name in enumerate(names):
        ways = [100.0 * (r.parameters[name] - nu.prior[name]) / nu.widths[name] for r in nu.rows]
        colour, marker = series_look(k)
        axes.plot(
            [row.nu for row in nu.rows],
            ways,
            color=colour,
            marker=marker,
            markersize=3.5,
            label=sign(name),
        )
    axes.axhline(0.0, color=GREY, linestyle="--", linewidth=1.0)
    axes.set_title("The result against the prior", loc="left")
    axes.set_ylabel("value − reference, % of the box")
    _falling_nu(axes)
    return axes


def _falling_nu(axes: Axes) -> None:
    """ν as it falls during a fit."""
    axes.set_xscale("log")
    axes.invert_xaxis()
    axes.set_xlabel("ν")
