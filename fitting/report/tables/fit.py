"""Tables of a fit: levels of the regularisation, how they ended, alternatives, starts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping

from fitting.fit.path import AlternativeResult, HistoryRow, StartResult
from fitting.report.table import Cell, Column, Table, tabulate
from fitting.result.result import Result
from fitting.text.notation import markup, number, on_log_axis, settings_words

Start = tuple[AlternativeResult, int, StartResult]
#: Status and message of levels, and the levels that ended with them.
Ending = tuple[tuple[str, str], list[str]]


def history_table(result: Result) -> Table:
    """A row per level of nu of the reported chain.

    Args:
        result: of a reconstruction.
    """
    columns: list[Column[HistoryRow]] = [
        Column("level", lambda row: "start" if row.level < 0 else str(row.level), role="name"),
        Column("ν", lambda row: row.nu, write=on_log_axis),
    ]
    columns += [
        Column(name, _parameter(name), unit=p.unit, symbol=True)
        for name, p in result.parameters.items()
    ]
    columns += [
        Column(name, _output(name), unit=d.unit, symbol=True, before="mean ")
        for name, d in result.derived.items()
    ]
    columns += [
        Column("J_fit", lambda row: row.j_fit, digits=6),
        Column("J_reg", lambda row: row.j_reg, digits=3),
        Column("E", lambda row: row.change, digits=3),
        Column("optimality", lambda row: row.optimality, digits=2),
        Column("status", lambda row: row.status),
        Column("evaluations", lambda row: row.evaluations),
        Column("s", lambda row: row.seconds, write=lambda seconds: f"{seconds:.1f}"),
    ]
    return tabulate(
        "Levels of the regularisation, reported chain",
        columns,
        result.history,
        "E is the paper's stopping measure, optimality the decrease of J that a linearised step "
        "still promises.",
    )


def _parameter(name: str) -> Callable[[HistoryRow | AlternativeResult], float]:
    return lambda row: row.parameters[name]


def _output(name: str) -> Callable[[HistoryRow], float]:
    return lambda row: row.derived.get(name, math.nan)


ENDINGS: tuple[Column[Ending], ...] = (
    Column("level", lambda ending: ", ".join(ending[1]), role="name"),
    Column("status", lambda ending: ending[0][0]),
    Column("message", lambda ending: ending[0][1], role="words"),
)


def ending_table(result: Result) -> Table:
    """How the levels ended, those with the same words together.

    Args:
        result: of a reconstruction.
    """
    groups: dict[tuple[str, str], list[str]] = {}
    for row in result.history:
        if row.level >= 0:
            groups.setdefault((row.status, row.message), []).append(str(row.level))
    return tabulate("How the levels ended", ENDINGS, groups.items())


def alternative_table(result: Result) -> Table:
    """Every discrete alternative with where it ended.

    Args:
        result: of a reconstruction.
    """
    columns: list[Column[AlternativeResult]] = [
        Column("alternative", lambda a: settings_words(a.settings) or "the only one", role="name")
    ]
    columns += [
        Column(name, _parameter(name), unit=p.unit, symbol=True)
        for name, p in result.parameters.items()
    ]
    columns += [
        Column("J_fit", lambda a: a.j_fit),
        Column("J_reg", lambda a: a.j_reg, digits=3),
        Column("status", lambda a: a.status),
        Column("verdict", _rank),
    ]
    return tabulate("Discrete alternatives", columns, result.alternatives)


def _rank(alternative: AlternativeResult) -> str:
    if alternative.reported:
        return "reported"
    return "equal to the reported one" if alternative.equal_to_best else "worse"


def start_table(result: Result) -> Table:
    """Every start of every alternative: where it began and where it led.

    Args:
        result: of a reconstruction.
    """
    names = list(result.parameters)
    columns: tuple[Column[Start], ...] = (
        Column(
            "alternative", lambda s: settings_words(s[0].settings) or "the only one", role="name"
        ),
        Column("start", lambda s: s[1]),
        Column("from", lambda s: _values(s[2].begun, names)),
        Column("to", lambda s: _values(s[2].parameters, names)),
        Column("J", lambda s: s[2].j_fit + s[2].j_reg),
        Column("J_fit", lambda s: s[2].j_fit),
        Column("J_reg", lambda s: s[2].j_reg, digits=3),
        Column("levels", lambda s: s[2].levels),
        Column("end", lambda s: s[2].ended, role="words"),
    )
    starts = [(a, k, s) for a in result.alternatives for k, s in enumerate(a.starts, start=1)]
    note = (
        "The least J = J_fit + J_reg at the last ν is reported; of starts whose J differ by no "
        "more than 10⁻⁶ of 1 + J the first. Where a derived output has no value there, a start of "
        "the same J within 0.1 % at which all have one comes before it. A start that met another "
        "one is none of the number that was asked for: a further one is followed in its place."
    )
    return tabulate("Starts of the search", columns, starts, note)


def _values(values: Mapping[str, float], names: Iterable[str]) -> Cell:
    pairs = [(name, number(values[name], 6)) for name in names]
    return Cell(
        ", ".join(f"{name} = {value}" for name, value in pairs),
        html=", ".join(f"{markup(name)} = {value}" for name, value in pairs),
    )
