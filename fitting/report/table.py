"""A table for terminal, page and file: a macro of `templates/tables.j2` that is fed with records.

Numbers keep their exact value with what is printed of them: a page carries it along, a CSV file
holds nothing else.
"""

from __future__ import annotations

import html
import math
import os
import re
import sys
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitting.text import notation, rendering, tables
from fitting.text.notation import markup, number

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).parent / "templates"
#: What a terminal prints for signs that print has.
_ASCII = str.maketrans({"\u00a0": " ", "−": "-", "–": "-", "∞": "inf"})
#: Columns of a line at most, and at least, whatever a terminal reports of itself.
COLUMNS, LEAST_COLUMNS = 100, 40
#: What a line does not break: "name = value", "value ± error", a number and its unit.
_TIED = re.compile(
    r"(?:\S+ [=<>≈] )+\S+(?: ± \S+| \+\S+ −\S+)?(?: (?:[a-zA-Zµ°Ω%]{1,3}|\(-\)|rad|deg)(?![\w]))?"
    r"|\d\S* ± \S+(?: [a-zA-Zµ°Ω%]{1,3}(?!\w))?"
    r"|\d[\d.e+−-]* (?:[numµkMG]?(?:Hz|V|s|m|A|N|W|F|rad)|%|K|dB|°C)(?!\w)"
)
_DIGITS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_POWER = re.compile(r"(?:(\d[\d.]*)\s×\s)?10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)")
#: Between cells, before a note, and between the parts of a cell, as templates render them.
CELLS, NOTE, PARTS = "¦", "¶", "␟"
_FREE = str.maketrans({CELLS: "|", NOTE: "|", PARTS: "|", "\n": " "})
#: Letters from which a column is one of sentences.
LONG = 32


@dataclass(frozen=True)
class Cell:
    """One cell: `text` as printed, `value` the exact number behind it, `html` its markup if any.

    `mark` is a style class of the page.
    """

    text: str
    value: float | None = None
    html: str = ""
    mark: str = ""

    def __str__(self) -> str:
        value = "" if self.value is None else exact_text(self.value)
        return PARTS.join(
            part.translate(_FREE) for part in (self.text, value, self.html, self.mark)
        )


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table: caption, heads of its columns, rows of as many cells, a remark."""

    caption: str
    heads: tuple[Cell, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.heads):
                raise ValueError(f"{self.caption}: {len(row)} cells under {len(self.heads)} heads")

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Which columns hold numbers; they are aligned to the right, dashes among them too."""
        count = range(len(self.heads))
        return tuple(any(row[k].value is not None for row in self.rows) for k in count)

    @property
    def wordy(self) -> tuple[bool, ...]:
        """Which columns hold sentences."""
        count = range(len(self.heads))
        return tuple(any(len(row[k].text) > LONG for row in self.rows) for k in count)

    def _repr_html_(self) -> str:
        return html_table(self)


def table(name: str, **records: Any) -> Table:
    """The table of that name; without rows where there is nothing to list.

    Args:
        name: of a macro of `templates/tables.j2`; with the name of an optional package before it,
            as "posterior/minima", of that package's `tables.j2`.
        records: its arguments.
    """
    package, _, macro = name.rpartition("/")
    rendered = getattr(_macros(f"{package}/tables.j2".lstrip("/")), macro)(**records)
    caption, *lines = [line.strip() for line in rendered.split("\n") if line.strip()] or [""]
    rows: list[str] = []
    for line in (line for line in lines if not line.startswith(NOTE)):
        if line.startswith(CELLS):  # continues the row before
            rows[-1] += line
        else:
            rows.append(line)
    heads, *body = [tuple(map(_cell, row.split(CELLS))) for row in rows or [""]]
    notes = (line.removeprefix(NOTE).strip() for line in lines if line.startswith(NOTE))
    return Table(caption=caption, heads=heads, rows=tuple(body), note=" ".join(notes))


@cache
def _macros(template: str) -> Any:
    # imported late: the filters of values need what infers them, a terminal's text does not
    from fitting.report import tables

    made = environment(escaped=False)
    made.finalize = _printed
    for module in (notation, tables):
        made.filters.update(vars(module))
        made.globals.update(vars(module))
    return made.get_template(template).module


def _printed(value: Any) -> str:
    """What an expression of a template leaves in a row: numbers keep their exact value."""
    if isinstance(value, int | float):
        value = numeric(value)
    if isinstance(value, Cell):
        return str(value)
    return str(value).translate(_FREE) if value is not None else ""


def numeric(value: float, digits: int = 8, factor: float = 1.0) -> Cell:
    """A number with so many digits, its exact value behind it.

    Args:
        value: the number; an integer is printed whole.
        digits: significant ones.
        factor: of the unit in which it is printed.
    """
    if isinstance(value, int):
        return Cell(str(value), value)
    return Cell(number(value / factor, digits), value if math.isfinite(value) else None)


def _cell(text: str) -> Cell:
    first, *parts = (part.strip(" ") for part in text.split(PARTS))
    value, markup_, mark = parts or ("", "", "")
    exact = None if not value else int(value) if value.lstrip("-").isdigit() else float(value)
    return Cell(first, exact, markup_, mark)


def terminal_text(text: str) -> str:
    """Text with the signs that every terminal has: "9.6 × 10⁻⁷" is 9.6e-7.

    Args:
        text: as it was written.
    """
    plain = _POWER.sub(lambda m: f"{m[1] or 1}e{m[2].translate(_DIGITS)}", text)
    return plain.translate(_ASCII)


def wrapped(text: str, indent: int = 0) -> list[str]:
    """Lines of a terminal; a name, its value, error and unit stay together.

    Lines are as long as the terminal is wide, and no longer than `COLUMNS`.

    Args:
        text: as it was written.
        indent: columns before further lines.
    """
    whole = _TIED.sub(lambda m: m[0].replace(" ", "\u00a0"), text)  # no break within it
    width = columns()
    lead = " " * min(indent, width // 3)
    lines = textwrap.wrap(
        whole, width, subsequent_indent=lead, break_on_hyphens=False, break_long_words=False
    )
    return [terminal_text(line) for line in lines]


def columns() -> int:
    """Columns of a line: as the terminal is wide, within limits."""
    try:
        wide = os.get_terminal_size(sys.stdout.fileno()).columns
    except (OSError, ValueError, AttributeError):
        wide = COLUMNS
    return min(COLUMNS, max(LEAST_COLUMNS, wide))


def text_lines(table: Table) -> list[str]:
    """A table for a terminal: heads and rows, numbers to the right; neither caption nor note.

    Args:
        table: any.
    """
    heads = [terminal_text(head.text) for head in table.heads]
    rows = [[terminal_text(cell.text) for cell in row] for row in table.rows]
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    return [
        "  ".join(
            text.rjust(width) if to_right else text.ljust(width)
            for text, width, to_right in zip(line, widths, table.numeric, strict=True)
        ).rstrip()
        for line in (heads, *rows)
    ]


def csv_text(table: Table) -> str:
    """A table as CSV: exact numbers in the units of the heads, words as printed, dashes left out.

    Args:
        table: without prefixed units.
    """
    cells = (
        [c.text.strip("–") if c.value is None else exact_text(c.value) for c in row]
        for row in table.rows
    )
    return tables.csv_text([[head.text for head in table.heads], *cells])


def markdown_lines(tables: Iterable[tuple[str, Table]]) -> list[str]:
    """Tables as lines of Markdown, each under its heading.

    Args:
        tables: with their headings.
    """
    lines = []
    for heading, shown in tables:
        rows = [shown.heads, tuple(Cell("---") for _ in shown.heads), *shown.rows]
        cells = ([cell.text.replace("|", "\\|") for cell in row] for row in rows)
        lines += [f"## {heading}", "", *(f"| {' | '.join(row)} |" for row in cells), ""]
        lines += [shown.note, ""] if shown.note else []
    return lines


def exact_text(value: float) -> str:
    """A number that gives itself back when it is read.

    Args:
        value: the number.
    """
    return str(value) if isinstance(value, int) else repr(float(value))


def html_table(table: Table) -> str:
    """A table as HTML by itself, with the little style it needs and no page around it.

    Args:
        table: any.
    """
    page = '{% from "table.html.j2" import alone %}{{ alone(table) }}'
    return environment().from_string(page).render(table=table)


def environment(*, escaped: bool = True) -> Environment:
    """The templates of the report, with those below it.

    Args:
        escaped: whether all text is escaped for HTML; not for a terminal.
    """
    made = rendering.environment(TEMPLATES, escaped=escaped)
    made.filters["exact"] = exact_text
    made.filters["symbol"] = markup  # HTML, escaped already: to be marked safe
    made.filters["escaped"] = html.escape
    return made
