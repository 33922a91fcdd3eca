"""Tables of values: fitted parameters, derived outputs, values of single experiments."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from fitting.report.same_values import Valued, same_values
from fitting.report.screen import phrase
from fitting.report.shown import ShownCampaign
from fitting.report.table import Cell, Column, Table, symbol, tabulate
from fitting.result.result import Result
from fitting.text.estimate import Estimate, Verdict
from fitting.text.notation import (
    as_its_error,
    error_number,
    listed,
    markup,
    number,
    rounded_alike,
    span,
    unit_text,
    with_error,
)

#: Said where values and errors are of two estimators.
BESIDE = (
    "Values are the paper's estimate, the end of Algorithm 2, as asked for. Std, interval and "
    "verdict are the likelihood's, about its most likely values."
)
Parameter = tuple[str, Estimate]
Output = tuple[str, Estimate]
Found = TypeVar("Found", Parameter, Output)
#: Said once of all values whose search was cut.
MORE_TELLS = "Where the search is incomplete, use a larger --budget."
#: An interval that is all of a period: its ends are one value.
WHOLE = "whole period"
#: Digits of where a search stopped of a value that the data do not determine.
FEW_DIGITS = 3
#: Head of the column of the paper's estimate.
PAPERS = "Algorithm 2"


@dataclass(frozen=True, kw_only=True)
class Value:
    """Any value of a result in a row: `low` to `high` is what it could be without data.

    `same` is the name of the parameter that is the same number, told once in its own row.
    """

    name: str
    digits: int
    low: float
    high: float
    reference: float
    found: Estimate
    same: str = ""

    @property
    def open(self) -> bool:
        """Whether the data leave it open: then no value is shown but the range."""
        if self.offset:  # its prior gives it one, where the model describes the data
            return self.found.status is Verdict.WITHDRAWN
        return not self.found.status.has_value

    @property
    def offset(self) -> bool:
        """Whether it belongs to single experiments."""
        return self.found.role == "offset"

    @property
    def value(self) -> Cell:
        """The value as shown; none where the data leave it open."""
        if self.open or self.same or not math.isfinite(self.found.value):
            return Cell("–")
        return rounded(self.found.value, self.found, self.digits)

    @property
    def most_likely(self) -> Cell:
        """The likelihood's, as shown beside the value of another estimator."""
        best = self.found.value if self.found.is_most_likely else self.found.most_likely
        if self.open or not math.isfinite(best):
            return Cell("–")
        return rounded(best, self.found, self.digits)


#: Colour of every verdict.
MARKS = {
    Verdict.DETERMINED: "yes",
    Verdict.BOUNDED: "partly",
    Verdict.ABOVE: "partly",
    Verdict.BELOW: "partly",
    Verdict.SEVERAL: "partly",
    Verdict.LINEARISED: "partly",
}


def verdict(status: Verdict, condition: str = "") -> Cell:
    """A verdict with its colour, and what it holds under.

    Args:
        status: how far the data determine it.
        condition: " in the box of d1"; mostly empty.
    """
    return Cell(f"{status}{condition}", mark=MARKS.get(status, "no"))


def error(found: Estimate) -> float | Cell:
    """The error of a value, with two digits; from side to side "+128 −89", half of both behind it.

    Args:
        found: value with its verdict.
    """
    bars = found.bars
    if not math.isfinite(found.std):
        return found.std
    if bars.is_even:
        return Cell(error_number(found.std), value=found.std)
    above, below = rounded_alike(bars.above, bars.below, error=min(bars.above, bars.below))
    return Cell(f"+{above}\u00a0−{below}", value=found.std)


def rounded(value: float, found: Estimate, digits: int = 6) -> Cell:
    """A value as exact as the smaller of its errors.

    Args:
        value: by either estimator.
        found: what is known of it.
        digits: significant ones where it has no error.
    """
    sides = (found.bars.below, found.bars.above) if not found.bars.is_even else ()
    shown = as_its_error(value, min((found.std, *sides)), digits)
    return Cell(shown, value=value if math.isfinite(value) else None)


def interval(bounds: tuple[float, float]) -> Cell:
    """An interval, a dash where it has no ends.

    Args:
        bounds: lower and upper end.
    """
    return Cell(span(*bounds)) if all(map(math.isfinite, bounds)) else Cell("–")


def values_of(result: Valued) -> list[Value]:
    """Every value of a result: parameters, derived outputs, values of single experiments.

    Args:
        result: of a reconstruction, or what was inferred of a fit.
    """
    twice = same_values(result)
    found = [
        Value(name=name, digits=8, low=p.lower, high=p.upper, reference=p.reference, found=p)
        for name, p in result.parameters.items()
    ]
    found += [
        Value(
            name=name,
            digits=9,
            low=d.lower,
            high=d.upper,
            reference=d.reference,
            found=d,
            same=twice.get(name, ""),
        )
        for name, d in result.derived.items()
    ]
    found += [
        Value(
            name=phrase("values", "offset", o),
            digits=5,
            low=math.nan,
            high=math.nan,
            reference=0.0,
            found=o,
        )
        for o in result.offsets
    ]
    return found


MOST_LIKELY: Column[Value] = Column("most likely", lambda v: v.most_likely)
VALUES: tuple[Column[Value], ...] = (
    Column("parameter", lambda v: symbol(v.name), role="name"),
    Column("value", lambda v: v.value),
    Column("unit", lambda v: unit_text(v.found.unit)),
    MOST_LIKELY,
    Column("std", lambda v: math.nan if v.same else error(v.found), digits=2),
    Column("reference", lambda v: math.nan if v.same else v.reference, digits=6),
    Column(
        "by the data",
        lambda v: f"= {v.same}" if v.same else phrase("values", "verdict", v.found),
        role="words",
    ),
)


def values_table(result: Valued, title: str) -> Table:
    """Everything that was fitted or derived, and what the data say of it, in short.

    Args:
        result: of a reconstruction, or what was inferred of a fit.
        title: over the table.
    """
    return _of_values(title, VALUES, values_of(result))


INTERVALS = (
    *VALUES[:5],
    Column[Value](
        "95 % interval", lambda v: Cell("–") if v.open or v.same else interval(v.found.ci95)
    ),
    *VALUES[5:],
)


def interval_table(result: Valued, title: str) -> Table:
    """As `values_table`, with the 95 % intervals of what the data do not leave open.

    Args:
        result: of a reconstruction, or what was inferred of a fit.
        title: over the table.
    """
    rows = values_of(result)
    is_cut = any("cost" in row.found.closed_by for row in rows)
    return _of_values(title, INTERVALS, rows, MORE_TELLS if is_cut else "")


def _of_values(
    title: str, columns: Sequence[Column[Value]], rows: Sequence[Value], note: str = ""
) -> Table:
    """The table; most likely values have a column where others are reported."""
    if all(row.found.is_most_likely for row in rows):
        return tabulate(title, [c for c in columns if c is not MOST_LIKELY], rows, note)
    return tabulate(title, columns, rows, " ".join(filter(None, (BESIDE, note))))


PARAMETERS: tuple[Column[Parameter], ...] = (
    Column("parameter", lambda row: symbol(row[0]), role="name"),
    Column("value", lambda row: _if_known(row[1], rounded(row[1].value, row[1]))),
    Column("unit", lambda row: unit_text(row[1].unit)),
    Column("std", lambda row: error(row[1]), digits=2),
    Column(
        "95 % interval",
        lambda row: Cell(WHOLE) if row[1].is_all_round else interval(row[1].ci95),
    ),
    Column("reference", lambda row: row[1].reference),
    Column("start", lambda row: row[1].start),
    Column("box", lambda row: f"{number(row[1].lower)} to {number(row[1].upper)}"),
    Column(PAPERS, lambda row: _if_rounded(row[1], row[1].algorithm2, 8)),
    Column("by the data", lambda row: verdict(row[1].status, row[1].condition)),
)


def parameter_table(result: Result) -> Table:
    """Fitted parameters with unit, error, interval, reference, and what the data say of them.

    Args:
        result: of a reconstruction.
    """
    rows = list(result.parameters.items())
    if not all(p.is_most_likely for _, p in rows):
        return tabulate("Fitted parameters", _beside(PARAMETERS, 8), rows, BESIDE)
    return tabulate(
        "Fitted parameters",
        PARAMETERS,
        rows,
        "Value, std and interval are those of the likelihood of the stated noise: the most likely "
        "value, half its 68 % interval, and its 95 % interval; where no profiles were walked both "
        "errors are linearised. Algorithm 2 minimises a sum of absolute deviations with a "
        "Tikhonov term: its own estimate stands beside them, of what the data do not determine "
        "with a few digits, as that is only where it stopped.",
    )


def correlation_table(result: Result) -> Table | None:
    """Correlations of the parameters' errors; None for a single parameter.

    Args:
        result: of a reconstruction.
    """
    names = list(result.parameters)
    if len(names) < 2 or len(result.correlation) != len(names):
        return None
    columns: list[Column[int]] = [Column("correlation", lambda i: symbol(names[i]), role="name")]
    columns += [
        Column(name, _at(result.correlation, k), digits=3, symbol=True)
        for k, name in enumerate(names)
    ]
    return tabulate("Correlations of the errors", columns, range(len(names)))


def _at(rows: tuple[tuple[float, ...], ...], column: int) -> Callable[[int], float]:
    return lambda row: rows[row][column]


def _is_withdrawn(found: Estimate) -> bool:
    """Whether the fit gives no value at all, not even where it stopped."""
    return found.status is Verdict.WITHDRAWN


def _if_known(d: Estimate, shown: float | Cell) -> float | Cell:
    """A value or an error, where the data determine the value: elsewhere it would be a lie."""
    return shown if d.status.has_value else Cell("–")


def _if_rounded(d: Estimate, value: float, digits: int = 9) -> Cell:
    """A value by either estimator, rounded as its error; a few digits where there is none."""
    if _is_withdrawn(d):
        return Cell("–")
    if d.status.has_value or not math.isfinite(value):
        return rounded(value, d, digits)
    return Cell(number(value, FEW_DIGITS), value=value)


DERIVED: tuple[Column[Output], ...] = (
    Column("output", lambda row: symbol(row[0]), role="name"),
    Column("mean", lambda row: _if_known(row[1], _if_rounded(row[1], row[1].value))),
    Column("unit", lambda row: unit_text(row[1].unit)),
    Column("spread", lambda row: row[1].spread, digits=2),
    Column("std", lambda row: _if_known(row[1], error(row[1])), digits=2),
    Column("95 % interval", lambda row: _if_known(row[1], interval(row[1].ci95))),
    Column("at the reference", lambda row: row[1].reference, digits=9),
    Column("range over the box", lambda row: interval(row[1].bounds)),
    Column(PAPERS, lambda row: _if_rounded(row[1], row[1].algorithm2)),
    Column("by the data", lambda row: verdict(row[1].status, row[1].condition)),
)


def derived_table(result: Result) -> Table:
    """Derived outputs: mean, spread over the experiments, error, reference, what the data say.

    Args:
        result: of a reconstruction.
    """
    rows = list(result.derived.items())
    note = (
        "Spread is the standard deviation over the experiments (drift), std the uncertainty of the "
        "mean. Where the data do not determine a value, none is given and no error: the range over "
        "the box of the parameters says what it could be, and the column of Algorithm 2 where that "
        "stopped."
    )
    if not all(d.is_most_likely for _, d in rows):
        return tabulate("Derived outputs", _beside(DERIVED, 9), rows, f"{BESIDE} {note}")
    return tabulate("Derived outputs", DERIVED, rows, note)


def _beside(columns: Sequence[Column[Found]], digits: int) -> list[Column[Found]]:
    """Columns with the most likely value in place of Algorithm 2's, which is the value."""
    likely: Column[Found] = Column(
        "most likely", lambda row: _if_rounded(row[1], row[1].most_likely, digits)
    )
    return [likely if column.name == PAPERS else column for column in columns]


def per_experiment_table(result: Result, data: ShownCampaign) -> Table | None:
    """Derived outputs of each experiment; None without experiments or outputs.

    Args:
        result: of a reconstruction.
        data: what is shown of the campaign.
    """
    outputs = {
        n: d
        for n, d in result.derived.items()
        if len(d.values) == len(data.labels) and not _is_withdrawn(d)
    }
    if not data.labels or not outputs:
        return None
    records = [
        (label, 10, {n: d.values[i] for n, d in outputs.items()})
        for i, label in enumerate(data.labels)
    ]
    records.append(("mean", 10, {n: d.value for n, d in outputs.items()}))
    records.append(("spread", 3, {n: d.spread for n, d in outputs.items()}))
    columns: list[Column[tuple[str, int, dict[str, float]]]] = [
        Column("experiment", lambda record: record[0], role="name")
    ]
    columns += [Column(n, _rounded(n), unit=d.unit, symbol=True) for n, d in outputs.items()]
    note = (
        f"All at one point, {phrase('values', 'point', result)}: the digits serve to compare the "
        "experiments, and are no measure of precision."
    )
    if left := [name for name, d in outputs.items() if not d.status.has_value]:
        note += f" Of {listed(left)} no value is reported: these are that point's alone."
    return tabulate("Derived outputs per experiment", columns, records, note)


def per_place_table(result: Result) -> Table | None:
    """Derived outputs of each spectrum with their errors; None where they are one for all.

    Args:
        result: of a reconstruction.
    """
    outputs = {n: d for n, d in result.derived.items() if any(map(math.isfinite, d.stds))}
    labels = next((d.places for d in outputs.values()), ())
    if not labels:
        return None
    columns: list[Column[int]] = [Column("measured at", lambda i: labels[i], role="name")]
    for name, d in outputs.items():
        columns.append(Column(name, partial(_shown, d), unit=d.unit, symbol=True))
        columns.append(Column(f"{name}, 95 %", partial(_shown_interval, d), unit=d.unit))
    note = "Errors are linearised: at each place, of all data together."
    return tabulate("Derived outputs with errors at every place", columns, range(len(labels)), note)


def _shown(d: Estimate, i: int) -> Cell:
    """A value with its error; none where the data leave it open."""
    if not math.isfinite(d.stds[i]):
        return Cell("–")
    return Cell(with_error(d.values[i], d.stds[i], ""), value=d.values[i])


def _shown_interval(d: Estimate, i: int) -> Cell:
    half = d.halves95[i]
    return interval((d.values[i] - half, d.values[i] + half))


def _rounded(name: str) -> Callable[[tuple[str, int, dict[str, float]]], Cell]:
    """The value of that name, with the digits of its row."""

    def cell(record: tuple[str, int, dict[str, float]]) -> Cell:
        value = record[2][name]
        return Cell(number(value, record[1]), value=value if math.isfinite(value) else None)

    return cell


OFFSETS: tuple[Column[Estimate], ...] = (
    Column("experiment", lambda o: ", ".join(o.experiments), role="name"),
    Column(
        "added to",
        lambda o: Cell(", ".join(o.variables), html=", ".join(markup(n) for n in o.variables)),
    ),
    Column("value", lambda o: Cell("–") if _is_withdrawn(o) else rounded(o.value, o, 5)),
    Column("unit", lambda o: unit_text(o.unit)),
    Column("std", error),
    Column("95 % interval", lambda o: interval(o.ci95)),
    Column("prior", lambda o: "–" if math.isnan(o.prior) else f"0 ± {number(o.prior, 3)}"),
    Column("shrinkage", lambda o: o.shrinkage, digits=3),
    Column("by the data", lambda o: o.status),
)


def offset_table(result: Result) -> Table | None:
    """Offset, error and prior of every state of the sample; None without fitted ones.

    Args:
        result: of a reconstruction.
    """
    if not result.offsets:
        return None
    note = (
        "Offsets are counted from the drift interpolated between the values before and after the "
        "series, those of a sweep from the values that are stated of it; the prior of a random "
        "walk is that of its last step."
    )
    if not all(o.is_most_likely for o in result.offsets):
        note = f"{BESIDE} {note}"
    return tabulate("Values of single experiments", OFFSETS, result.offsets, note)
