"""What a command prints: a template for each command, with the layout that all of them share.

A screen has title and status in its first line, then entries with a head of one or two words in the
first column. Lines are as long as the terminal is wide (`fitting.report.table.columns`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fitting.campaign.laws import in_base
from fitting.inference.checks.assumptions import SHIFT
from fitting.inference.checks.solutions import ALONE
from fitting.report.table import Table, columns, environment, terminal_text, text_lines, wrapped
from fitting.result.result import Result
from fitting.text.finding import Finding
from fitting.text.notation import with_prefix
from fitting.text.once import made_once
from fitting.text.rendering import sentence

#: Columns before the text of an entry, between values in a line, and values in a line at most.
LEAD, GAP, MOST_IN_LINE = 17, 4, 3


@dataclass(frozen=True, kw_only=True)
class Printed:
    """A value as it is printed: its symbol, other symbols of the same number, and a remark."""

    name: str
    symbols: tuple[str, ...]
    text: str
    remark: str = ""


def screen(template: str, **records: Any) -> list[str]:
    """The lines of a terminal that a command prints.

    Args:
        template: its name without ".txt.j2".
        **records: that the template prints.
    """
    return _lines(_template(template).render(records))


def printed_lines(template: str, macro: str, *records: Any) -> list[str]:
    """The same, where a template has macros for several screens.

    Args:
        template: its name without ".txt.j2".
        macro: its name.
        *records: that it prints.
    """
    return _lines(str(getattr(_template(template).module, macro)(*records)))


def _lines(text: str) -> list[str]:
    return [line.replace("\u00a0", " ").rstrip() for line in text.strip("\n").splitlines()]


def phrase(template: str, macro: str, *records: Any, **named: Any) -> str:
    """What a macro of a template prints, in one line.

    Args:
        template: its name without ".txt.j2".
        macro: its name.
        *records: that it prints.
        **named: further ones.
    """
    return str(getattr(_template(template).module, macro)(*records, **named)).strip()


def phrases(template: str, macro: str, *records: Any) -> tuple[str, ...]:
    """What a macro of a template prints: a sentence in each of its lines.

    Args:
        template: its name without ".txt.j2".
        macro: its name.
        *records: that it prints.
    """
    lines = phrase(template, macro, *records).splitlines()
    return tuple(line.strip() for line in lines if line.strip())


@made_once
def _template(name: str) -> Any:
    """A template, compiled once."""
    templates = environment(escaped=False)
    templates.filters["printed"] = printed
    templates.globals.update(
        grid=grid, heading=heading, item=item, lead=LEAD, line_item=line_item, lines_of=lines_of
    )
    templates.globals.update(alone_of=alone_of, paragraph=paragraph, sentence=sentence)
    templates.globals.update(shifts_of=shifts_of)
    return templates.get_template(f"{name}.txt.j2")


def printed(value: Printed) -> str:
    """Symbols, value and remark: "λ = 647.20 ± 0.82 kHz (from the sweep)".

    Args:
        value: of a summary.
    """
    remark = f" ({value.remark})" if value.remark else ""
    return f"{' = '.join(value.symbols)} {value.text}{remark}"


def heading(title: str, status: str) -> str:
    """Title and status in one line where both fit, the status at its end; else in two.

    Args:
        title: what the screen is about.
        status: how it ended.
    """
    gap = columns() - len(title) - len(status)
    return (
        f"{title}{' ' * gap}{status}"
        if gap >= 2
        else "\n".join([*wrapped(title), *wrapped(status)])
    )


def grid(values: Sequence[Printed]) -> list[str]:
    """Values in columns, as many a line as fit, at most three.

    Args:
        values: with their symbols.
    """
    cells = [terminal_text(printed(value)) for value in values]
    for count in range(min(MOST_IN_LINE, len(cells)), 0, -1):
        widths = [max(map(len, cells[k::count])) + GAP for k in range(count)]
        if sum(widths) - GAP <= columns() - 2 or count == 1:
            break
    else:
        return []
    rows = [cells[k : k + count] for k in range(0, len(cells), count)]
    return ["".join(map(str.ljust, row, widths)).rstrip() for row in rows]


def item(head: str, text: str) -> str:
    """An entry with its head in the first column, its further lines below its text.

    Args:
        head: one or two words.
        text: of the entry.
    """
    return "\n".join(wrapped(line_item(head, text), LEAD))


def line_item(head: str, text: str) -> str:
    """The same in one line, whatever its length: a command or a path that is to be copied.

    Args:
        head: one or two words.
        text: of the entry.
    """
    return f"  {head:{LEAD - 3}} {text}"


def paragraph(text: str, indent: int = 0) -> str:
    """A sentence in lines of the terminal.

    Args:
        text: of one line.
        indent: columns before further lines.
    """
    return "\n".join(wrapped(text, indent))


def lines_of(table: Table) -> str:
    """A table in indented lines, without its caption and note.

    Args:
        table: of records.
    """
    return "\n".join(f"  {line}" for line in text_lines(table))


#: Share of a standard error from which a shift is listed.
LEAST = 0.1


def shifts_of(result: Result, finding: Finding) -> list[str]:
    """Values that an assumption would shift, derived ones first: "lambda by +32 kHz".

    Args:
        result: of a reconstruction.
        finding: an assumption with its shifts in SI units.
    """
    shifts = []
    for name, value in {**result.derived, **result.parameters}.items():
        shift = finding.numbers.get(f"{SHIFT}{name}", math.nan) / in_base(value.unit, name)[0]
        if abs(shift) >= LEAST * value.std:
            shifts.append(f"{name} by {with_prefix(shift, value.unit, 2, signed=True)}")
    return shifts


def alone_of(result: Result, finding: Finding) -> list[str]:
    """Errors of parameters with the other one of a pair known: "d1 to 1.2 Hz".

    Args:
        result: of a reconstruction.
        finding: a combination with its errors in SI units.
    """
    errors = {n: finding.numbers.get(f"{ALONE}{n}") for n in result.parameters}
    return [
        f"{n} to {with_prefix(e / in_base(p.unit, n)[0], p.unit, 2)}"
        for n, p in result.parameters.items()
        if (e := errors[n]) is not None
    ]
