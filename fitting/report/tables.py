"""Filters of the templates of tables, for estimates, profiles and shares: all functions here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from fitting.inference.likelihood.knowledge import Scan, Values
from fitting.report.same_values import same_values
from fitting.report.screen import phrase
from fitting.report.table import Cell, numeric
from fitting.simulate.budget import Decision
from fitting.text.estimate import Estimate, FittedEstimate, OutputEstimate, Verdict
from fitting.text.notation import (
    as_its_error,
    error_number,
    number,
    on_log_axis,
    quantity,
    rounded_alike,
    sign,
    span,
    unit_text,
    with_error,
)
from fitting.text.rendering import blocks

DASH, NAN = Cell("–"), math.nan
n = numeric
#: Digits of where a search stopped of a value that the data do not determine.
FEW_DIGITS = 3
#: Below tables of values where values and errors are of two estimators.
PAPERS = (
    "Values are the paper's estimate, the end of Algorithm 2, as requested. Std, interval and "
    "identifiability are the likelihood's, about its most likely values."
)
#: What closes a side of an interval, by how its profile ended.
ENDS = {
    "data": "closed by the data",
    "prior": "closed by the prior of the drift",
    "bound": "reaches the bound",
    "periodic": "periodic",
    "search": "search not converged",
    "budget": "cut by the budget",
}
#: Style class of every status.
MARKS = {
    Verdict.DETERMINED: "yes",
    Verdict.BOUNDED: "partly",
    Verdict.ABOVE: "partly",
    Verdict.BELOW: "partly",
    Verdict.SEVERAL: "partly",
    Verdict.LINEARISED: "partly",
}

# --- heads and numbers ---------------------------------------------------------------------------


def head(name: str, unit: str = "", before: str = "") -> Cell:
    """Head of a column: a quantity set as a symbol, its unit behind it.

    Args:
        name: of the quantity.
        unit: of its numbers.
        before: a word before the name.
    """
    tail = f" ({unit_text(unit)})" if unit_text(unit) else ""
    return Cell(f"{before}{name}{tail}", html=f"{before}{typeset_symbol(name)}{escape(tail)}")


def symbol(name: str) -> Cell:
    """A quantity by its name: typeset on a page, where its name is the title of the sign.

    Args:
        name: of the quantity.
    """
    return Cell(name, html=typeset_symbol(name))


def typeset_symbol(name: str) -> str:
    """A quantity as a page sets it (HTML, escaped).

    Args:
        name: of the quantity.
    """
    return f'<var title="{escape(name)}">{escape(sign(name))}</var>'


def symbols(names: Sequence[str]) -> Cell:
    """Quantities by their names, set as symbols.

    Args:
        names: of the quantities.
    """
    return Cell(", ".join(names), html=", ".join(map(typeset_symbol, names)))


def point(values: Mapping[str, float], names: Sequence[str]) -> Cell:
    """Values of parameters: "theta = 1.9, d1 = 94".

    Args:
        values: by name.
        names: those that are listed.
    """
    pairs = [(name, number(values[name], 6)) for name in names]
    return Cell(
        ", ".join(f"{name} = {value}" for name, value in pairs),
        html=", ".join(f"{typeset_symbol(name)} = {value}" for name, value in pairs),
    )


def exactly(value: float, text: str) -> Cell:
    """A text with the exact number behind it.

    Args:
        value: the number.
        text: as it is printed.
    """
    return Cell(text, value if math.isfinite(value) else None)


def on_axis(value: float) -> Cell:
    """A number as axes write it: a power of ten.

    Args:
        value: the number.
    """
    return exactly(value, on_log_axis(value))


def marked(text: str, mark: str) -> Cell:
    """A text with a style class of the page.

    Args:
        text: as it is printed.
        mark: the class.
    """
    return Cell(text, mark=mark)


def fixed(value: float, digits: int) -> Cell:
    """A number with so many digits behind the point; a dash for NaN.

    Args:
        value: the number.
        digits: behind the point.
    """
    return DASH if math.isnan(value) else Cell(f"{value:.{digits}f}", value)


def finite(value: float) -> Cell:
    """A number with all its digits; a dash where it is not finite.

    Args:
        value: the number.
    """
    return Cell(repr(value), value) if math.isfinite(value) else DASH


def with_its_error(e: Estimate | None) -> str:
    """A value with its error, a dash where there is none.

    Args:
        e: of a line, or None.
    """
    return "–" if e is None or not math.isfinite(e.value) else with_error(e.value, e.std)


def any_finite(values: Iterable[Estimate]) -> bool:
    """Whether any of some values is known.

    Args:
        values: of a column.
    """
    return any(math.isfinite(e.value) for e in values)


def interval(ends: tuple[float, float]) -> Cell:
    """An interval, a dash where it has no ends.

    Args:
        ends: lower and upper one.
    """
    return Cell(span(*ends)) if all(map(math.isfinite, ends)) else DASH


def third_digit(value: float, std: float) -> Cell:
    """A number to the third digit of its error, as far as it has one.

    Args:
        value: the number.
        std: its standard deviation.
    """
    if math.isnan(value):
        return DASH
    place = math.floor(math.log10(std)) - 2 if std > 0.0 else 0
    text = f"{value:.{-place}f}" if -12 <= place < 0 else number(value, 8)
    return Cell(text.replace("-", "−"), value)


# --- estimates -----------------------------------------------------------------------------------


def values(result: Values) -> list[tuple[str, int, FittedEstimate, str]]:
    """Every value: name, digits without an error, estimate, the other name of the same number.

    Args:
        result: of a reconstruction, or what was inferred of a fit.
    """
    same = same_values(result)
    return [
        *((name, 8, e, "") for name, e in result.parameters.items()),
        *((name, 9, e, same.get(name, "")) for name, e in result.derived.items()),
        *((phrase("values", "offset", e), 5, e, "") for e in result.offsets),
    ]


def is_reported(e: FittedEstimate) -> bool:
    """Whether a value is printed: the prior of an offset gives it one if the model fits.

    Args:
        e: any.
    """
    return e.status is not Verdict.WITHDRAWN if e.role == "offset" else e.status.has_value


def value(e: FittedEstimate, digits: int = 6) -> Cell:
    """The value as exact as the smaller of its errors; a dash where it is not reported.

    Args:
        e: any.
        digits: significant ones where it has no error.
    """
    return _rounded(e, e.value, digits) if is_reported(e) else DASH


def likely(e: FittedEstimate, digits: int) -> Cell:
    """The most likely value, which is listed next to that of another estimator.

    Args:
        e: any.
        digits: significant ones where it has no error.
    """
    return _rounded(e, e.likely, digits) if is_reported(e) else DASH


def stopped(e: FittedEstimate, end: float, digits: int) -> Cell:
    """The end of an estimator, with few digits where the data do not determine the value.

    Args:
        e: any.
        end: of the estimator.
        digits: significant ones where it has no error.
    """
    if e.status is Verdict.WITHDRAWN:
        return DASH
    if e.status.has_value or not math.isfinite(end):
        return _rounded(e, end, digits)
    return Cell(number(end, FEW_DIGITS), end)


def std(e: FittedEstimate) -> Cell:
    """The error with two digits; "+128 −89" where the sides differ, half of both behind it.

    Args:
        e: any.
    """
    bars = e.bars
    if not math.isfinite(e.std):
        return Cell(number(e.std, 2))
    if bars.is_even:
        return Cell(error_number(e.std), e.std)
    above, below = rounded_alike(bars.above, bars.below, error=min(bars.above, bars.below))
    return Cell(f"+{above}\u00a0−{below}", e.std)


def sides(e: FittedEstimate) -> tuple[float, float]:
    """Ends of the 68 % interval, NaN without a value.

    Args:
        e: any.
    """
    bars = e.bars
    if math.isnan(bars.below):
        return e.value - e.std, e.value + e.std
    return e.value - bars.below, e.value + bars.above


def verdict(status: Verdict, condition: str = "") -> Cell:
    """A status with its colour, and what it holds under.

    Args:
        status: how far the data determine the value.
        condition: " in the box of d1"; mostly empty.
    """
    return Cell(f"{status}{condition}", mark=MARKS.get(status, "no"))


def at_place(e: OutputEstimate, k: int) -> Cell:
    """The value at a place with its error; a dash where the data leave it open.

    Args:
        e: a derived output.
        k: number of the place.
    """
    known = math.isfinite(e.stds[k])
    return Cell(with_error(e.values[k], e.stds[k], ""), e.values[k]) if known else DASH


def per_experiment(result: Values, count: int) -> list[OutputEstimate]:
    """Outputs that have a value in each of so many experiments.

    Args:
        result: of a reconstruction.
        count: of the experiments.
    """
    outputs = result.derived.values()
    return [e for e in outputs if len(e.values) == count and e.status is not Verdict.WITHDRAWN]


def per_place(result: Values) -> list[OutputEstimate]:
    """Outputs that have a value with an error at some place.

    Args:
        result: of a reconstruction.
    """
    return [e for e in result.derived.values() if any(map(math.isfinite, e.stds))]


def alone(part: Any, result: Values, name: str) -> str:
    """A value by one campaign of several; a dash where its data do not determine it.

    Args:
        part: value and std, or None.
        result: of all campaigns.
        name: of the value.
    """
    if part is None or not math.isfinite(part.std):
        return "–"
    unit = {**result.parameters, **result.derived}[name].unit
    return quantity(part.value, part.std, unit)


def _rounded(e: FittedEstimate, shown: float, digits: int) -> Cell:
    bars = e.bars
    errors = (e.std,) if bars.is_even else (e.std, bars.below, bars.above)
    return exactly(shown, as_its_error(shown, min(errors), digits))


# --- profiles, levels, fits ----------------------------------------------------------------------


def best(e: FittedEstimate) -> Cell:
    """The most likely value where the data determine one, as exact as the smaller of its errors.

    Args:
        e: with a profile.
    """
    if not e.status.has_value:
        return DASH
    error = min(e.likely - e.ci68[0], e.ci68[1] - e.likely)
    return Cell(as_its_error(e.likely, error, 8), e.likely)


def closed(e: FittedEstimate, scan: Scan, side: int) -> str:
    """What closes a side of an interval, or why its scan ended before.

    Args:
        e: with a profile.
        scan: of the profile.
        side: 0 for the lower one, 1 for the upper one.
    """
    if e.closed_by[side] == "bound" and scan.held and e.ci95[side] != e.bounds[side]:
        return "another parameter at its bound"
    return ENDS.get(e.closed_by[side] or scan.stopped[side], "")


def precision(e: FittedEstimate) -> Cell:
    """Half the width over the value, or over its period, in percent.

    Args:
        e: with a profile.
    """
    exact = e.precision
    return Cell(f"{number(100.0 * exact, 2)} %", exact) if math.isfinite(exact) else DASH


def decision_words(part: str, decision: Decision) -> str:
    """The subject, the choice or the reason of a decision.

    Args:
        part: name of a macro of the plan's template.
        decision: of a plan.
    """
    return str(getattr(blocks("plan"), part)(decision))


def endings(history: Iterable[Any]) -> list[dict[str, Any]]:
    """How levels ended, those with the same status and message together.

    Args:
        history: a row each.
    """
    groups: dict[tuple[str, str], list[str]] = {}
    for row in history:
        groups.setdefault((row.status, row.message), []).append(str(row.level))
    return [
        {"status": status, "message": message, "levels": levels}
        for (status, message), levels in groups.items()
    ]


def with_all(labels: Sequence[str], before: Any, after: Any) -> list[tuple[str, float, float]]:
    """Mean deviations of each experiment, and of all where there are several.

    Args:
        labels: of the experiments.
        before: deviations at the start.
        after: at the end.
    """
    means = [*zip(labels, before.per_experiment, after.per_experiment, strict=False)]
    return [*means, ("all", before.mean, after.mean)] if len(means) > 1 else means
