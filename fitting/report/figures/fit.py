"""Figures of the fitted values: their way over the regularisation, and per experiment."""

from __future__ import annotations

import math
from collections.abc import Mapping

from fitting.report import plot
from fitting.report.figures.numbers import CONVERGENCE, DERIVED
from fitting.report.figures.style import Drawing, new_figure, panels
from fitting.report.plot.fit import ends_elsewhere
from fitting.report.screen import phrase
from fitting.report.shown import ShownCampaign
from fitting.result.result import Result
from fitting.text.estimate import Estimate, Verdict
from fitting.text.notation import listed, number, unit_text
from fitting.text.rendering import range_words

PER_ROW = 3
#: Parameters of one unit that share a panel of corrections.
MOST_IN_PANEL = 6
#: Share of the error from which a spread over the experiments is seen.
SEEN = 0.1


def draw_convergence(result: Result, data: ShownCampaign) -> Drawing:
    """Parameters, means of the derived outputs, J_fit and J_reg over the levels of nu.

    A parameter alone in its unit is drawn as its value, several of one unit as corrections
    p - p_ref, which makes them comparable.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    title = "Convergence over the regularisation ν"
    groups, outputs = _groups(result), list(result.derived)
    count = len(groups) + len(outputs) + 1
    rows = math.ceil(count / min(PER_ROW, count))
    figure = new_figure(
        title, data.title, synthetic=data.synthetic, height=0.95 + 2.15 * rows, width=9.4
    )
    axes = panels(figure, count, PER_ROW)
    for panel, names in zip(axes, groups, strict=False):
        plot.parameter_path(result, *names, ax=panel)
        if len(names) > 1:
            panel.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=3, handlelength=1.6)
    for panel, name in zip(axes[len(groups) :], outputs, strict=False):
        plot.output_path(result, name, ax=panel)
    plot.objective_path(result, ax=axes[-1]).legend(loc="best", handlelength=2.2)
    last = result.history[-1].parameters
    values = [
        f"{name} = {number(last[name], 6)} {unit_text(p.unit)}".strip()
        for name, p in result.parameters.items()
    ]
    every: dict[str, Estimate] = {**result.parameters, **result.derived}
    warning = _warning({name: p.status for name, p in every.items()})
    levels, end = len(result.history) - 1, ""
    if ends_elsewhere(result):
        levels, end = levels - 1, " “end” is the reported end, found elsewhere, at the last ν."
    if any(p.value != p.algorithm2 for p in result.parameters.values()):
        end += " The curves are Algorithm 2's; the values of the report are the most likely ones."
    caption = (
        "Way of the reported chain over the levels of the regularisation ν, from its start point: "
        "fitted parameters (those of one unit as corrections to their reference), means of the "
        "derived outputs over the experiments, misfit and regularisation term. Dashed grey: value "
        f"at the reference parameters; a start far outside is printed in words.{end}{warning}"
    )
    alt = f"Values of Algorithm 2 over {levels} levels of ν, ending at {listed(values)}."
    return Drawing(name=CONVERGENCE, title=title, caption=caption, alt=alt, figure=figure)


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


def varying(result: Result) -> dict[str, Estimate]:
    """Outputs that the data give and that differ between experiments by more than a line's width.

    Args:
        result: of a reconstruction.
    """
    return {
        name: d
        for name, d in result.derived.items()
        if d.status.has_value and d.spread > SEEN * d.std
    }


def draw_derived(result: Result, data: ShownCampaign) -> Drawing:
    """Derived outputs of every experiment with mean and spread, and whether the data give them.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    title = "Derived quantities per experiment"
    shown = varying(result) or result.derived
    columns = min(PER_ROW, len(shown))
    rows = math.ceil(len(shown) / columns)
    width = 3.15 * columns if columns > 1 else 5.0
    figure = new_figure(
        title,
        data.title,
        synthetic=data.synthetic,
        height=0.85 + 2.75 * rows,
        width=max(width, 6.4),
    )
    axes = panels(figure, len(shown), PER_ROW)
    for panel, name in zip(axes, shown, strict=True):
        plot.output_by_experiment(result, name, data.labels, ax=panel)
    said = [f"{name}: {_in_words(d)}" for name, d in shown.items()]
    caption = (
        f"Derived outputs of the FMU at {phrase('values', 'point', result)}, for every experiment "
        "(marker shapes as in the other figures), with mean (dashed) and spread over the "
        "experiments (band, one standard deviation). The spread is the drift of the experiments, "
        f"not the uncertainty of the value. {'. '.join(said)}."
    )
    alt = "Values per experiment. " + ". ".join(said) + "."
    return Drawing(name=DERIVED, title=title, caption=caption, alt=alt, figure=figure)


def _in_words(derived: Estimate) -> str:
    if not derived.status.has_value:
        allowed = range_words(*derived.bounds, derived.unit)
        return f"{derived.status} by these data ({allowed} within the bounds of the parameters)"
    return f"{derived.status}{derived.condition}, {phrase('values', 'reported', derived)}"


def _warning(verdicts: Mapping[str, Verdict]) -> str:
    """That curves settle all the same where values are open, or where nothing is known of them."""
    unknown = [name for name, verdict in verdicts.items() if verdict is Verdict.UNKNOWN]
    left = [n for n, verdict in verdicts.items() if not verdict.has_value and n not in unknown]
    said = [
        f"{listed(names)} {'is' if len(names) == 1 else 'are'} {words}"
        for names, words in ((left, "not determined by these data"), (unknown, "not known"))
        if names
    ]
    if not said:
        return ""
    return f" A curve that settles is no sign that the data determine the value: {'; '.join(said)}."
