"""Many fits as tables: a row per item and value, and what all of them say of each value."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from fitting.report.table import Cell, Column, Table, csv_text, symbol, tabulate, text_lines
from fitting.result.ensemble import Coverage, Ensemble, EnsembleRow, EnsembleValue, Share
from fitting.text.notation import number
from fitting.text.records import to_plain

#: Items without a fit that are named one by one.
MOST_FAILURES = 20
NOTE = (
    "In brackets the 95 % interval of Clopper and Pearson for the share. A pull is (value − "
    "truth)/error, of the fits that report a value; its mean is 0 without bias, its standard "
    "deviation 1 where errors are as large as is said."
)


@dataclass(frozen=True)
class _Line:
    """A value of an item, or an item without any."""

    row: EnsembleRow
    value: EnsembleValue | None


def document(found: Ensemble) -> dict[str, Any]:
    """The record with the coverage of its values, for other programs.

    Args:
        found: many fits.
    """
    coverage = [
        {
            **{k: v for k, v in to_plain(c).items() if k not in ("pulls", "held68", "held95")},
            "pull_mean": c.pull_mean,
            "pull_std": c.pull_std,
            **{f"held{n}": _share(s) for n, s in ((68, c.held68), (95, c.held95))},
        }
        for c in found.coverage
    ]
    return {
        "title": found.title,
        "synthetic": found.synthetic,
        "status": found.status,
        "message": found.message,
        "total": found.total,
        "statuses": found.statuses,
        "coverage": coverage,
        "rows": found.rows,
        "provenance": found.provenance,
    }


def _share(share: Share) -> dict[str, Any]:
    low, high = share.interval
    return {"count": share.count, "total": share.total, "low95": low, "high95": high}


def csv_of(found: Ensemble) -> str:
    """A row per item and value; an item without a fit has a row that says why.

    Args:
        found: many fits.
    """

    def of(name: str) -> Column[_Line]:
        return Column(name, lambda line: _number(line, name))

    columns: tuple[Column[_Line], ...] = (
        Column("item", lambda line: line.row.index),
        Column("label", lambda line: line.row.label),
        Column("status", lambda line: line.row.status),
        Column("name", lambda line: line.value.name if line.value else ""),
        Column("unit", lambda line: line.value.unit if line.value else ""),
        Column("verdict", lambda line: str(line.value.verdict) if line.value else ""),
        *(of(name) for name in ("value", "std", "low68", "high68", "low95", "high95")),
        *(of(name) for name in ("truth", "pull")),
        Column("message", lambda line: line.row.message if line.row.failed else ""),
    )
    lines = [_Line(row, value) for row in found.rows for value in row.values or (None,)]
    return csv_text(tabulate("", columns, lines))


def _number(line: _Line, name: str) -> float | str:
    value = math.nan if line.value is None else float(getattr(line.value, name))
    return "" if math.isnan(value) else value


COVERAGE: tuple[Column[Coverage], ...] = (
    Column("value", lambda c: symbol(c.name), role="name"),
    Column("fits", lambda c: _count(c.judged)),
    Column("determined", lambda c: _count(c.determined)),
    Column("no interval", lambda c: _count(c.withheld)),
    Column("truth in 68 %", lambda c: share_text(c.held68)),
    Column("truth in 95 %", lambda c: share_text(c.held95)),
    Column("mean pull", lambda c: _pull(c.pull_mean)),
    Column("std of pulls", lambda c: _pull(c.pull_std)),
)
FAILURE: tuple[Column[EnsembleRow], ...] = (
    Column("item", lambda row: row.label, role="name"),
    Column("why there is no fit", lambda row: row.message, role="words"),
)
STATUS: tuple[Column[tuple[str, int]], ...] = (
    Column("how the fit ended", lambda pair: pair[0], role="name"),
    Column("items", lambda pair: _count(pair[1])),
)


def _count(count: int) -> Cell:
    return Cell(str(count), value=count)


def _pull(value: float) -> Cell:
    return Cell("–") if math.isnan(value) else Cell(f"{value:.2f}", value=value)


def share_text(share: Share) -> str:
    """So many of so many, as a share with its interval.

    Args:
        share: of fits.
    """
    if not share.total:
        return "–"
    low, high = (f"{100.0 * end:.1f}" for end in share.interval)
    return f"{share.count}/{share.total} = {100.0 * share.part:.1f} % ({low} to {high})"


def coverage_table(found: Ensemble) -> Table:
    """How often the intervals of each value hold the truth.

    Args:
        found: many fits.
    """
    return tabulate("Do the intervals hold the truth?", COVERAGE, found.coverage, NOTE)


def status_table(found: Ensemble) -> Table:
    """How many items ended how.

    Args:
        found: many fits.
    """
    return tabulate("How the fits ended", STATUS, found.statuses.items())


def failure_table(found: Ensemble) -> Table:
    """Items without a fit, and why; of many the first ones.

    Args:
        found: many fits.
    """
    more = len(found.failures) - MOST_FAILURES
    note = f"and {more} more, see ensemble.csv" if more > 0 else ""
    return tabulate("Items without a fit", FAILURE, found.failures[:MOST_FAILURES], note)


def value_table(found: Ensemble) -> Table:
    """What was found of each value, over all fits that report it.

    Args:
        found: many fits.
    """
    names: dict[str, list[EnsembleValue]] = {}
    for row in found.rows:
        for value in row.values:
            names.setdefault(value.name, []).append(value)
    columns: tuple[Column[list[EnsembleValue]], ...] = (
        Column("value", lambda values: symbol(values[0].name), role="name"),
        Column("unit", lambda values: values[0].unit),
        Column("fits", lambda values: _count(len(values))),
        Column("with a value", lambda values: _count(len(_reported(values)))),
        Column("least", lambda values: _end(min, values)),
        Column("median", _median),
        Column("largest", lambda values: _end(max, values)),
    )
    return tabulate("What was found", columns, names.values())


def _reported(values: list[EnsembleValue]) -> list[float]:
    return sorted(v.value for v in values if math.isfinite(v.value))


def _end(which: Any, values: list[EnsembleValue]) -> Cell:
    reported = _reported(values)
    return Cell(number(which(reported), 7), value=which(reported)) if reported else Cell("–")


def _median(values: list[EnsembleValue]) -> Cell:
    reported = _reported(values)
    if not reported:
        return Cell("–")
    half = len(reported) // 2
    middle = 0.5 * (reported[half] + reported[-half - 1])
    return Cell(number(middle, 7), value=middle)


def tables_of(found: Ensemble) -> list[Table]:
    """All tables that there is something for, coverage first.

    Args:
        found: many fits.
    """
    tables = [coverage_table(found), value_table(found), status_table(found), failure_table(found)]
    return [table for table in tables if table.rows]


def markdown(found: Ensemble) -> str:
    """All tables as Markdown.

    Args:
        found: many fits.
    """
    lines = [f"# {found.title}", "", f"{found.message}.", ""]
    if found.synthetic:
        lines += ["Synthetic: simulated, not measured on a device.", ""]
    for table in tables_of(found):
        lines += [f"## {table.caption}", ""]
        lines += [f"| {' | '.join(h.text for h in table.heads)} |", f"|{'---|' * len(table.heads)}"]
        lines += [
            f"| {' | '.join(cell.text.replace('|', chr(92) + '|') for cell in row)} |"
            for row in table.rows
        ]
        lines += ["", *([table.note, ""] if table.note else [])]
    return "\n".join(lines)


def terminal(found: Ensemble) -> list[str]:
    """The tables in lines of text: coverage where something is known to be true, else values.

    Args:
        found: many fits.
    """
    lines = [f"{found.title}: {found.message}"]
    first = coverage_table(found) if found.coverage else value_table(found)
    shown = [table for table in (first, status_table(found), failure_table(found)) if table.rows]
    for table in shown:
        lines += ["", *text_lines(table)]
        lines += [table.note] if table.note and table is not first else []
    return lines
