"""Figures of what the data determine: profiles, values that go together, outputs, choice of nu."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from matplotlib.lines import Line2D

from fitting.inference.findings import WORTH_SAYING
from fitting.inference.likelihood.knowledge import NuChoice, Values
from fitting.report import plot
from fitting.report.figures.numbers import NU, OUTPUTS, PROFILES, TOGETHER
from fitting.report.figures.style import (
    Drawing,
    Planned,
    handles_of,
    legend_below,
    new_figure,
    panels,
)
from fitting.report.plot.axes import BLUE, GREY
from fitting.report.plot.inference import VERDICT_COLOURS
from fitting.text.estimate import Estimate, Verdict
from fitting.text.notation import listed

PER_ROW = 3
#: Profiles, parameters against each other, and outputs, at most in a figure.
MOST_PROFILES, MOST_TOGETHER, MOST_OUTPUTS = 18, 4, 4
#: Δχ² from which a profile is more than a flat line.
BENT = 1.0


def _colours(verdicts: Sequence[Verdict]) -> dict[str, str]:
    """Colours of the bands that are drawn, each with the verdicts that it stands for."""
    words: dict[str, list[str]] = {}
    for verdict, colour in VERDICT_COLOURS.items():
        if verdict in verdicts:
            words.setdefault(colour, []).append(str(verdict))
    return {colour: " or ".join(said) for colour, said in words.items()}


def knowledge_figures(found: Values, title: str, *, synthetic: bool) -> list[Planned]:
    """Every figure that there is something for, in order, yet to be drawn.

    Args:
        found: values with their profiles.
        title: of the campaign.
        synthetic: whether the data are synthetic, which the figure then says.
    """
    draws: dict[str, Callable[..., Drawing]] = {}
    if _curved(found):
        draws[PROFILES] = partial(draw_profiles, found)
    if len(_together(found)) > 1:
        draws[TOGETHER] = partial(draw_together, found)
    if _along(found) is not None:
        draws[OUTPUTS] = partial(draw_outputs, found)
    # without a corner all that there is to see is said in its sentences
    nu = None if found.knowledge is None else found.knowledge.nu
    if nu is not None and not math.isnan(nu.corner):
        draws[NU] = partial(draw_nu, nu)
    return [
        Planned(name=name, draw=partial(draw, title, synthetic=synthetic))
        for name, draw in draws.items()
    ]


def _curved(found: Values) -> dict[str, Estimate]:
    """Profiles that the data bend anywhere, few of them; a flat one is a line on the axis."""
    return dict(list(_bent(found).items())[:MOST_PROFILES])


def _bent(found: Values) -> dict[str, Estimate]:
    highest = {name: max(scan.delta_chi2, default=0.0) for name, scan in found.scans.items()}
    return {name: p for name, p in found.profiled.items() if highest[name] >= BENT}


def _flat(found: Values) -> list[str]:
    bent = _bent(found)
    return [name for name, scan in found.scans.items() if scan.values and name not in bent]


def flat_sentence(found: Values) -> str:
    """Which values have a profile that is flat, and is not drawn; empty where all are bent.

    Args:
        found: values with their profiles.
    """
    names = _flat(found)
    if not names:
        return ""
    return f"Flat, with Δχ² below 1 at every value that was tried: {listed(names)}."


def _left_out(found: Values) -> str:
    """Which profiles are not drawn, and why; empty where all are."""
    groups = (
        (_flat(found), "flat: Δχ² is below 1 at every value that was tried"),
        (list(_bent(found))[MOST_PROFILES:], f"{MOST_PROFILES} profiles are drawn at most"),
        (
            [name for name, scan in found.scans.items() if not scan.values],
            "no profile was scanned",
        ),
    )
    said = [f"{listed(names)} ({why})" for names, why in groups if names]
    return f" Not drawn: {'; '.join(said)}." if said else ""


def draw_profiles(found: Values, campaign: str, *, synthetic: bool) -> Drawing:
    """Profile likelihood of every value with the thresholds of its intervals.

    Args:
        found: values with their profiles.
        campaign: title of the campaign.
        synthetic: whether the data are synthetic, which the figure then says.
    """
    title = "Profile likelihood: how far each value can go"
    shown = _curved(found)
    rows = math.ceil(len(shown) / PER_ROW)
    figure = new_figure(title, campaign, synthetic=synthetic, height=1.3 + 1.75 * rows)
    for k, (panel, (name, value)) in enumerate(
        zip(panels(figure, len(shown), PER_ROW), shown.items(), strict=True)
    ):
        plot.profile(value, found.scans[name], ax=panel)
        if k % PER_ROW:
            panel.set_ylabel("")
    handles = [
        Line2D([], [], color=BLUE, marker="o", markersize=3.5, label="profile"),
        Line2D([], [], color=GREY, linestyle="--", label="thresholds 68 % (1) and 95 % (3.84)"),
        *(
            Line2D([], [], color=colour, linewidth=5.0, alpha=0.35, label=f"95 %: {words}")
            for colour, words in _colours([value.status for value in shown.values()]).items()
        ),
    ]
    legend_below(figure, handles, ncols=3)
    words = [f"{name} {value.status}{value.condition}" for name, value in shown.items()]
    caption = (
        "Least Δχ² that fits of all other parameters reach at each value. Where the curve stays "
        "below 3.84 the value fits the data at 95 %; a curve that stays there from end to end says "
        "that the data do not determine the value. The band is the 95 % interval, drawn over the "
        "range that the box leaves where the data end it nowhere."
    )
    if any(v.simulation > WORTH_SAYING * found.scans[n].sigma for n, v in shown.items()):
        caption += (
            " It is wider than the curve says: what the simulation may be off by is in it, and not "
            "in the curve."
        )
    caption += _left_out(found)
    return Drawing(
        name=PROFILES,
        title=title,
        caption=caption,
        alt=f"Verdicts: {listed(words)}.",
        figure=figure,
    )


def _drawn(found: Values, values: Mapping[str, Estimate]) -> list[str]:
    """Values whose profile has points enough for a plane."""
    return [n for n in values if n in found.scans and len(found.scans[n].values) > 1]


def _together(found: Values) -> list[str]:
    """Parameters that are drawn against each other: those least determined, few of them."""
    names = _drawn(found, found.parameters)
    ranked = sorted(names, key=lambda name: found.parameters[name].shrinkage)
    return [name for name in names if name in ranked[:MOST_TOGETHER]]


def draw_together(found: Values, campaign: str, *, synthetic: bool) -> Drawing:
    """Parameters against each other over all fits that the profiles went through.

    Args:
        found: values with their profiles.
        campaign: title of the campaign.
        synthetic: whether the data are synthetic, which the figure then says.
    """
    title = "Which parameter values go together"
    pairs = list(itertools.combinations(_together(found), 2))
    rows = math.ceil(len(pairs) / PER_ROW)
    figure = new_figure(title, campaign, synthetic=synthetic, height=1.3 + 2.3 * rows)
    axes = panels(figure, len(pairs), PER_ROW)
    for panel, (one, other) in zip(axes, pairs, strict=True):
        plot.together(found, one, other, ax=panel)
    legend_below(figure, handles_of(axes[0]), ncols=3)
    names = list(_together(found))
    around = [name for name in names if found.parameters[name].is_all_round]
    period = f", of {listed(around)} one period is drawn" if around else ""
    caption = (
        "Every point of every profile: filled where it fits the data at 95 % (Δχ² ≤ 3.84), pale "
        f"where it does not; grey lines are ends of the box{period}. Filled points along a line or "
        "curve are a combination that the data hold while its parts are free; filled points "
        "everywhere are no knowledge at all."
    )
    alt = f"Fits in the planes of {listed(names)}."
    return Drawing(name=TOGETHER, title=title, caption=caption, alt=alt, figure=figure)


def _along(found: Values) -> tuple[str, list[str]] | None:
    """The least determined parameter and the outputs that are drawn over it."""
    outputs = _drawn(found, found.derived)
    outputs.sort(key=lambda name: found.derived[name].shrinkage)
    names = _drawn(found, found.parameters)
    if not outputs or not names:
        return None
    # one that goes round is an angle, and what hangs on an angle is best seen over it
    names.sort(
        key=lambda n: (
            not found.parameters[n].is_all_round,
            found.parameters[n].shrinkage,
        )
    )
    kept = outputs[:MOST_OUTPUTS]
    return names[0], [name for name in found.derived if name in kept]


def draw_outputs(found: Values, campaign: str, *, synthetic: bool) -> Drawing:
    """Derived outputs over the least determined parameter, with their prior and data intervals.

    Args:
        found: values with their profiles.
        campaign: title of the campaign.
        synthetic: whether the data are synthetic, which the figure then says.
    """
    title = "What the least determined parameter leaves open"
    chosen = _along(found)
    if chosen is None:
        raise ValueError("no output to draw over a parameter")
    parameter, outputs = chosen
    rows = math.ceil(len(outputs) / 2)
    figure = new_figure(title, campaign, synthetic=synthetic, height=1.3 + 2.3 * rows)
    axes = panels(figure, len(outputs), 2)
    for panel, name in zip(axes, outputs, strict=True):
        plot.output(found, name, parameter, ax=panel)
    legend_below(figure, handles_of(axes[0]), ncols=3)
    shown = {name: found.derived[name] for name in outputs}
    words = [f"{name} {p.status}{p.condition}" for name, p in shown.items()]
    caption = (
        f"Outputs over {parameter} at every point of every profile{_no_value(found, outputs)}. "
        "The bars at the right edge are the range without data (grey) and the 95 % interval with "
        "them (blue): where both are alike, the data say nothing of that output. A side that no "
        "data end is told to the end of the box; points beyond it fit as well."
    )
    return Drawing(
        name=OUTPUTS, title=title, caption=caption, alt=f"{listed(words)}.", figure=figure
    )


def _no_value(found: Values, outputs: Sequence[str]) -> str:
    """Of which outputs points are missing, as they have no value there; mostly empty."""
    paths = [scan.path for scan in found.scans.values()]
    gaps = [n for n in outputs if any(math.isnan(v) for path in paths for v in path.get(n, ()))]
    return f", of {listed(gaps)} where there is a value" if gaps else ""


def draw_nu(nu: NuChoice, campaign: str, *, synthetic: bool) -> Drawing:
    """L-curve, discrepancy, and the result at every nu against the prior.

    Args:
        nu: choices of ν, and what each is based on.
        campaign: title of the campaign.
        synthetic: whether the data are synthetic, which the figure then says.
    """
    title = "The regularisation ν that the data would choose"
    figure = new_figure(title, campaign, synthetic=synthetic, height=3.4)
    curve, squares, ways = figure.subplots(1, 3)
    plot.l_curve(nu, ax=curve)
    plot.discrepancy(nu, ax=squares)
    plot.against_prior(nu, ax=ways)
    if handles_of(ways):
        ways.legend(loc="best")
    caption = (
        "Left: misfit against distance from the prior, the square marks the corner where there is "
        "one. Middle: χ²(ν), that of the data where Algorithm 2 stood at every ν. Right: how far "
        "the data moved the solution from the prior (dashed) at every ν. " + " ".join(nu.sentences)
    )
    return Drawing(name=NU, title=title, caption=caption, alt=" ".join(nu.sentences), figure=figure)
