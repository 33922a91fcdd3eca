"""Tables of what the data determine: profiles, directions, other minima, nu, bootstrap."""

from __future__ import annotations

import math
from collections.abc import Callable

from fitting.inference.likelihood.knowledge import (
    Bootstrap,
    Direction,
    Equivalent,
    Knowledge,
    NuChoice,
    NuRow,
    PartAlone,
    Percentiles,
    Values,
)
from fitting.report.table import Cell, Column, Table, symbol, tabulate
from fitting.report.tables.values import WHOLE, interval, verdict
from fitting.text.estimate import Estimate
from fitting.text.notation import (
    as_its_error,
    error_number,
    number,
    on_log_axis,
    settings_words,
    unit_text,
)

Named = tuple[str, Estimate]
#: What closes a side of an interval, by how its profile ended.
ENDS = {
    "crossed": "closed by the data",
    "prior": "closed by the prior of the drift",
    "held": "another parameter at its bound",
    "bound": "reaches the bound",
    "round": "periodic",
    "lost": "search not converged",
    "cost": "cut by the budget",
}


def knowledge_tables(found: Values, knowledge: Knowledge) -> tuple[Table, ...]:
    """Profiles, directions, equivalent minima, choice of nu, bootstrap: those that exist.

    Args:
        found: values with their profiles.
        knowledge: what was found beside them.
    """
    made = [profile_table(found), direction_table(knowledge), equivalent_table(knowledge)]
    if knowledge.nu is not None and knowledge.nu.rows:
        made.append(nu_table(knowledge.nu))
    if knowledge.bootstrap is not None and knowledge.bootstrap.values:
        made.append(bootstrap_table(found, knowledge.bootstrap))
    return tuple(table for table in made if table is not None)


def _best(value: Estimate) -> Cell:
    """The most likely value, where the data determine one, rounded as the smaller of its errors."""
    if not value.status.has_value:
        return Cell("–")
    low, high = value.ci68
    error = min(value.likely - low, high - value.likely)
    return Cell(as_its_error(value.likely, error, 8), value=value.likely)


def _median(found: Percentiles) -> Cell:
    """The median of a bootstrap, rounded as its error."""
    value = found.median if math.isfinite(found.median) else None
    return Cell(as_its_error(found.median, found.std, 8), value=value)


def _std(found: Percentiles) -> Cell:
    value = found.std if math.isfinite(found.std) else None
    return Cell(error_number(found.std), value=value)


def _interval(value: Estimate, bounds: tuple[float, float]) -> Cell:
    return Cell(WHOLE) if value.is_all_round else interval(bounds)


def _precision(value: Estimate) -> Cell:
    """Half the width over the value (or period), in per cent."""
    if not math.isfinite(value.precision):
        return Cell("–")
    return Cell(f"{number(100.0 * value.precision, 2)} %", value=value.precision)


PROFILES: tuple[Column[Named], ...] = (
    Column("value", lambda row: symbol(row[0]), role="name"),
    Column("unit", lambda row: unit_text(row[1].unit)),
    Column("most likely", lambda row: _best(row[1])),
    Column("68 %", lambda row: _interval(row[1], row[1].ci68)),
    Column("95 %", lambda row: _interval(row[1], row[1].ci95)),
    Column("without data", lambda row: interval(row[1].bounds)),
    Column("ends below", lambda row: ENDS.get(row[1].closed_by[0], row[1].closed_by[0])),
    Column("ends above", lambda row: ENDS.get(row[1].closed_by[1], row[1].closed_by[1])),
    Column("precision", lambda row: _precision(row[1])),
    Column("verdict", lambda row: verdict(row[1].status, row[1].condition)),
)


def profile_table(found: Values) -> Table:
    """A row per parameter and output: intervals, how they end, precision, verdict.

    Args:
        found: values with their profiles.
    """
    return tabulate(
        "Profile likelihood",
        PROFILES,
        found.profiled.items(),
        "Precision is half the width of the 95 % interval over the value, of an angle over its "
        "period. Verdicts follow from the ends that the data cut, inside the box or outside; where "
        "they cut none, the interval is what the box leaves, as far as it was walked.",
    )


def part_table(whole: Values, part: PartAlone) -> Table:
    """A row per value: what some of the measurements say alone, and what all say.

    Args:
        whole: what all determine.
        part: what some of them determine.
    """
    where = settings_words(part.settings)
    pairs = [(name, part.profiled[name], p) for name, p in whole.profiled.items()]
    columns: tuple[Column[tuple[str, Estimate, Estimate]], ...] = (
        Column("value", lambda row: symbol(row[0]), role="name"),
        Column("unit", lambda row: unit_text(row[2].unit)),
        Column(f"95 %, {where} alone", lambda row: interval(row[1].ci95)),
        Column(f"verdict, {where} alone", lambda row: verdict(row[1].status, row[1].condition)),
        Column("95 %, all", lambda row: interval(row[2].ci95)),
        Column("verdict, all", lambda row: verdict(row[2].status, row[2].condition)),
    )
    return tabulate(
        f"What was measured at {where} determines alone, and what all of it determines",
        columns,
        pairs,
        f"{part.places} of {part.total} places were measured there. Where data cut no end of an "
        "interval, it is what the box leaves, as far as it was walked.",
    )


def direction_table(knowledge: Knowledge) -> Table | None:
    """Singular values with their directions; what was tried along those that nothing sees.

    Args:
        knowledge: what the data determine: profiles, directions, verdicts.
    """
    if not knowledge.directions:
        return None
    columns: list[Column[tuple[int, Direction]]] = [
        Column("direction", lambda row: str(row[0]), role="name"),
        Column("σ per unit of x", lambda row: row[1].singular, digits=3),
        Column("σ per box", lambda row: row[1].share, digits=3),
    ]
    columns += [
        Column(name, _component(name), digits=3, symbol=True)
        for name in knowledge.directions[0].vector
    ]
    columns.append(
        Column("what was tried", lambda row: row[1].sentence or _tried(row[1]), role="words")
    )
    return tabulate(
        "Singular values of the sensitivities",
        columns,
        enumerate(knowledge.directions, start=1),
        "x = (p − reference)/scale. A direction whose singular value is far below one per box "
        "changes nothing that was measured; the change in the last column was simulated.",
    )


def _tried(direction: Direction) -> str:
    """Where nothing is told of a direction: seen, where the data notice it within the box."""
    return "seen" if direction.share >= 1.0 else "nothing"


def _component(name: str) -> Callable[[tuple[int, Direction]], float]:
    return lambda row: row[1].vector[name]


EQUIVALENTS: tuple[Column[tuple[int, Equivalent]], ...] = (
    Column("fit", lambda row: str(row[0]), role="name"),
    Column("found from", lambda row: row[1].origin),
    Column("Δχ²", lambda row: row[1].delta, digits=2),
    Column("where", lambda row: row[1].sentence, role="words"),
)


def equivalent_table(knowledge: Knowledge) -> Table | None:
    """Other points that fit as well; None without any.

    Args:
        knowledge: what the data determine: profiles, directions, verdicts.
    """
    if not knowledge.equivalents:
        return None
    return tabulate(
        "Other fits that are as good", EQUIVALENTS, enumerate(knowledge.equivalents, start=1)
    )


def nu_table(nu: NuChoice) -> Table:
    """The result at every nu, with what the criteria say of it.

    Args:
        nu: choices of ν, and what each is based on.
    """
    columns: list[Column[NuRow]] = [
        Column("ν", lambda row: row.nu, write=on_log_axis),
        Column("J_fit", lambda row: row.j_fit, digits=6),
        Column("|x|", lambda row: row.distance, digits=4),
        Column("χ²(ν)", lambda row: row.chi_square, digits=4),
    ]
    columns += [
        Column(name, _value(name), symbol=True)
        for name in (*nu.rows[0].parameters, *nu.rows[0].derived)
    ]
    columns.append(Column("chosen by", lambda row: _criteria(nu, row)))
    return tabulate(
        "The result at every ν, and what would choose it",
        columns,
        nu.rows,
        "χ²(ν) is that of the data where Algorithm 2 stood at that ν; χ² without ν is that at the "
        "most likely parameters, in the box or beyond it, by which the fit is judged. χ²(ν) is "
        f"held against {number(nu.allowed, 4)}, which noise stays below in 95 % of cases with as "
        "many degrees of freedom as there are data. None is taken off for the fitted parameters, "
        "as it is for χ² without ν: the discrepancy principle asks whether the parameters at that "
        "ν could be the true ones, and those are not fitted to the noise.",
    )


def _value(name: str) -> Callable[[NuRow], float]:
    return lambda row: {**row.derived, **row.parameters}.get(name, math.nan)


def _criteria(nu: NuChoice, row: NuRow) -> str:
    """What would choose this nu."""
    chosen = {"L-curve": nu.corner, "discrepancy": nu.discrepancy, "schedule": nu.last}
    return ", ".join(word for word, at in chosen.items() if row.nu == at)


def bootstrap_table(found: Values, bootstrap: Bootstrap) -> Table:
    """Percentile intervals of the bootstrap beside those of the profiles.

    Args:
        found: values with their profiles.
        bootstrap: resampled fits.
    """
    known = found.profiled
    columns: tuple[Column[tuple[str, Percentiles]], ...] = (
        Column("value", lambda row: symbol(row[0]), role="name"),
        Column("unit", lambda row: unit_text(known[row[0]].unit)),
        Column("median", lambda row: _median(row[1])),
        Column("std", lambda row: _std(row[1])),
        Column("95 %, bootstrap", lambda row: interval(row[1].interval95)),
        Column("95 %, profile", lambda row: interval(known[row[0]].ci95)),
    )
    return tabulate("Parametric bootstrap", columns, bootstrap.values.items(), bootstrap.sentence)
