"""Plots of what the data determine: profiles, values that go together, the choice of ν."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from fitting.inference.likelihood.knowledge import NuChoice, Scan, Values
from fitting.report.plot.axes import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    axes_of,
    log_axis,
    plain_ticks,
    say_empty,
    series_look,
)
from fitting.text.estimate import Estimate, Interval, Verdict
from fitting.text.notation import mathtext, on_log_axis, scaling_for

#: Dchi^2 at the ends of the 68 % and 95 % intervals, and the highest that is drawn.
AT_68, AT_95, HIGHEST = 1.0, 3.84, 8.0
VERDICT_COLOURS = {
    Verdict.DETERMINED: GREEN,
    Verdict.BOUNDED: ORANGE,
    Verdict.ABOVE: ORANGE,
    Verdict.BELOW: ORANGE,
    Verdict.SEVERAL: ORANGE,
    Verdict.OPEN: RED,
}
#: Series in the panel of values over nu.
MOST_SERIES = 6


def profile(found: Estimate, scan: Scan, *, ax: Axes | None = None) -> Axes:
    """Draw a profile likelihood: the least Δχ² that fits reach at each value.

    Dashed lines are the thresholds of the 68 % and 95 % intervals, 1 and 3.84; the band is the 95 %
    interval, its colour and the title the verdict.

    Args:
        found: the value, drawn in its unit.
        scan: the points of its profile.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes = axes_of(ax)
    values = [v for v in (*scan.values, *found.ci95) if math.isfinite(v)]
    colour = VERDICT_COLOURS.get(found.status, GREY)
    # what it holds under would not fit beside the next title: tables and sentences tell it
    axes.set_title(
        f"{mathtext(found.name)}: {found.status}", color=colour, loc="left", fontsize="small"
    )
    axes.set_ylim(-0.35, HIGHEST)
    axes.set_ylabel("Δχ²")
    if not values:
        say_empty(axes, "no value")
        return axes
    scaling = scaling_for(values, found.unit)
    if all(map(math.isfinite, found.ci95)):
        low, high = (scaling(v) for v in found.ci95)
        axes.axvspan(low, high, color=colour, alpha=0.15, linewidth=0.0)
    for level in (AT_68, AT_95):
        axes.axhline(level, color=GREY, linestyle="--", linewidth=0.9)
    kept = _near(found, scan)
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
    axes.set_xlabel(scaling.label(mathtext(found.name)))
    plain_ticks(axes, x=3)
    axes.set_yticks([0.0, AT_68, AT_95, HIGHEST], ["0", "1", "3.84", "8"])
    return axes


def _near(found: Estimate, scan: Scan) -> list[int]:
    """Points of a profile worth drawing: not those far beyond the threshold."""
    low, high = found.ci95
    if math.isnan(low):
        low, high = found.bounds
    room = 0.25 * (high - low)
    return [
        k
        for k, value in enumerate(scan.values)
        if scan.delta_chi2[k] <= 2.0 * HIGHEST and low - room <= value <= high + room
    ]


def together(found: Values, one: str, other: str, *, ax: Axes | None = None) -> Axes:
    """Draw two parameters against each other over all fits that the profiles went through.

    Filled where a point fits the data at 95 % (Δχ² ≤ 3.84), pale where it does not; the star is the
    most likely point, lines are the box where points come near it. A value that goes round has no
    such lines: its profile holds one period, wherever its box ends.

    Args:
        found: values with their profiles.
        one: name of the parameter along x, drawn in its unit.
        other: name of the parameter along y, drawn in its unit.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes, known = axes_of(ax), found.parameters
    (x, delta), (y, _) = _cloud(found, one), _cloud(found, other)
    across = scaling_for([*_range(known[one])], known[one].unit)
    up = scaling_for([*_range(known[other])], known[other].unit)
    _scatter(axes, [across(v) for v in x], [up(v) for v in y], delta)
    _star(axes, across(known[one].likely), up(known[other].likely))
    if not known[one].is_all_round:
        _frame(axes, [across(v) for v in x], [across(v) for v in known[one].bounds], vertical=False)
    if not known[other].is_all_round:
        _frame(axes, [up(v) for v in y], [up(v) for v in known[other].bounds], vertical=True)
    plain_ticks(axes, x=4)
    axes.set_xlabel(across.label(mathtext(one)))
    axes.set_ylabel(up.label(mathtext(other)))
    return axes


def output(found: Values, name: str, parameter: str, *, ax: Axes | None = None) -> Axes:
    """Draw a derived output over a parameter at every fit that the profiles went through.

    The bars at the right edge are the range of the output without data (grey) and its 95 % interval
    with them (blue).

    Args:
        found: values with their profiles.
        name: of the output, drawn in its unit.
        parameter: name of the parameter along x, drawn in its unit.
        ax: where to draw; pyplot's current axes if not given.
    """
    axes = axes_of(ax)
    read, own = found.derived[name], found.parameters[parameter]
    (x, delta), (y, _) = _cloud(found, parameter), _cloud(found, name)
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
    axes.set_xlabel(across.label(mathtext(parameter)))
    axes.set_ylabel(up.label(mathtext(name)))
    return axes


def _range(value: Estimate) -> Interval:
    """Where a parameter was looked for: its bounds, or the period in which its profile lies."""
    if not value.is_all_round:
        return value.bounds
    low, high = value.ci95
    return (low, high) if math.isfinite(low) else value.bounds


def _cloud(found: Values, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Values of a parameter or output at all points of all profiles, and Dchi^2 there."""
    values, deltas = [], []
    for scan in found.scans.values():
        if name in scan.path:
            values += list(scan.path[name])
            deltas += list(scan.delta_chi2)
    cloud, delta = np.array(values), np.array(deltas)
    own = found.parameters.get(name)
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
        x,
        y,
        marker="*",
        linestyle="none",
        color=RED,
        markersize=9,
        zorder=2.2,
        label="most likely",
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
            label=mathtext(name),
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
