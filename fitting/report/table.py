"""One description of a table for terminal, page and file: columns, and rows made from records.

A column says what stands in it, in which unit, and how its numbers are written. Numbers keep their
exact value beside what is shown of them: a page carries it along, a CSV file holds nothing else.
"""

from __future__ import annotations

import html
import math
import os
import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Generic, TypeVar

from fitting.text import csv_cells, rendering
from fitting.text.notation import markup, number, prefixed, unit_text

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).parent / "templates"
#: What a terminal is shown for signs that print has.
_ASCII = str.maketrans({"\u00a0": " ", "−": "-", "–": "-", "∞": "inf"})
#: Columns of a line at most, and at least, whatever a terminal says of itself.
COLUMNS, LEAST_COLUMNS = 100, 40
#: What a line does not break: "name = value", "value ± error", a number and its unit.
_TIED = re.compile(
    r"(?:\S+ [=<>≈] )+\S+(?: ± \S+| \+\S+ −\S+)?(?: (?:[a-zA-Zµ°Ω%]{1,3}|\(-\)|rad|deg)(?![\w]))?"
    r"|\d\S* ± \S+(?: [a-zA-Zµ°Ω%]{1,3}(?!\w))?"
    r"|\d[\d.e+−-]* (?:[numµkMG]?(?:Hz|V|s|m|A|N|W|F|rad)|%|K|dB|°C)(?!\w)"
)
_DIGITS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_POWER = re.compile(r"(?:(\d[\d.]*)\s×\s)?10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)")

Row = TypeVar("Row")


@dataclass(frozen=True)
class Cell:
    """One cell: `text` as shown, `value` the exact number behind it, `html` its markup if any.

    `head` marks a cell that names its row; `mark` is a style class of the page.
    """

    text: str
    _: KW_ONLY
    value: float | None = None
    html: str = ""
    head: bool = False
    mark: str = ""


@dataclass(frozen=True)
class Head:
    """Head of a column: its name, the `unit` of its numbers, the unit in which they are `shown`.

    `symbol`: the name is that of a quantity and is set as one, with the word `before` it.
    """

    name: str
    _: KW_ONLY
    unit: str = ""
    shown: str = ""
    symbol: bool = False
    before: str = ""

    @property
    def text(self) -> str:
        """The head as plain text."""
        return f"{self.before}{self.name}{f' ({self.shown})' if self.shown else ''}"

    @property
    def html(self) -> str:
        """The head as markup."""
        name = markup(self.name) if self.symbol else html.escape(self.name)
        shown = f" ({html.escape(self.shown)})" if self.shown else ""
        return f"{html.escape(self.before)}{name}{shown}"


@dataclass(frozen=True)
class Column(Generic[Row]):
    """What stands in a column: `of` a record its number, words or cell.

    Numbers are in `unit` and written with so many `digits`, in the prefix that suits `size`, or by
    the function `write`. `role` "name" marks the column that names the rows, "words" one of
    sentences; `symbol` and `before` are those of the head.
    """

    name: str
    of: Callable[[Row], float | str | Cell]
    _: KW_ONLY
    unit: str = ""
    digits: int = 8
    size: float | None = None
    write: Callable[[float], str] | None = None
    role: str = ""
    symbol: bool = False
    before: str = ""

    @property
    def scale(self) -> tuple[float, str]:
        """Factor and unit in which the numbers are shown."""
        return (1.0, unit_text(self.unit)) if self.size is None else prefixed(self.size, self.unit)

    @property
    def head(self) -> Head:
        """The head of the column."""
        return Head(
            self.name,
            unit=unit_text(self.unit),
            shown=self.scale[1],
            symbol=self.symbol,
            before=self.before,
        )

    def cell(self, row: Row) -> Cell:
        """The cell of a record.

        Args:
            row: the record.
        """
        found = self.of(row)
        if isinstance(found, Cell):
            cell = found
        elif isinstance(found, str):
            cell = Cell(found)
        else:
            cell = self._number(found)
        if self.role == "name":
            return replace(cell, head=True)
        return replace(cell, mark=cell.mark or self.role)

    def _number(self, value: float) -> Cell:
        if isinstance(value, int):
            return Cell(str(value), value=value)
        shown = value / self.scale[0]
        text = number(shown, self.digits) if self.write is None else self.write(shown)
        return Cell(text, value=value) if math.isfinite(value) else Cell(number(value))


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table: what it shows, the heads of its columns, rows of as many cells, a remark."""

    caption: str
    heads: tuple[Head, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.heads):
                raise ValueError(f"{self.caption}: {len(row)} cells under {len(self.heads)} heads")

    @property
    def numeric(self) -> tuple[bool, ...]:
        """Which columns hold numbers; they stand to the right, dashes among them too."""
        count = range(len(self.heads))
        return tuple(any(row[k].value is not None for row in self.rows) for k in count)

    def without(self, *names: str) -> Table:
        """The table without the columns of these names.

        Args:
            names: as they are declared, in their order.
        """
        kept = [k for k, head in enumerate(self.heads) if head.name not in names]
        return replace(
            self,
            heads=tuple(self.heads[k] for k in kept),
            rows=tuple(tuple(row[k] for k in kept) for row in self.rows),
        )

    def _repr_html_(self) -> str:
        return html_table(self)


def tabulate(
    caption: str, columns: Sequence[Column[Row]], records: Iterable[Row], note: str = ""
) -> Table:
    """The table of records, a row each.

    Args:
        caption: of the table.
        columns: of the table.
        records: one per row.
        note: below the table.
    """
    return Table(
        caption=caption,
        heads=tuple(column.head for column in columns),
        rows=tuple(tuple(column.cell(record) for column in columns) for record in records),
        note=note,
    )


def pairs_table(caption: str, heads: tuple[str, str], pairs: Mapping[str, str]) -> Table:
    """Names and what belongs to them.

    Args:
        caption: of the table.
        heads: of the two columns.
        pairs: words by their names.
    """
    columns: tuple[Column[tuple[str, str]], ...] = (
        Column(heads[0], lambda pair: pair[0], role="name"),
        Column(heads[1], lambda pair: pair[1], role="words"),
    )
    return tabulate(caption, columns, pairs.items())


def symbol(name: str) -> Cell:
    """A quantity by its name: set as a symbol on a page.

    Args:
        name: of the quantity.
    """
    return Cell(name, html=markup(name))


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
        indent: columns that further lines stand in.
    """
    whole = _TIED.sub(lambda m: m[0].replace(" ", "\u00a0"), text)  # no break where it stands
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
        table: as it was read.
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
    """A table as CSV: exact numbers in the units of the heads, words as shown, dashes left out.

    Args:
        table: as it was read.
    """
    heads = [f"{h.before}{h.name}{f' ({h.unit})' if h.unit else ''}" for h in table.heads]
    cells = (
        [c.text.strip("–") if c.value is None else exact_text(c.value) for c in row]
        for row in table.rows
    )
    return csv_cells.csv_text([heads, *cells])


def exact_text(value: float) -> str:
    """A number that gives itself back when it is read.

    Args:
        value: the number.
    """
    return str(value) if isinstance(value, int) else repr(float(value))


def html_table(table: Table) -> str:
    """A table as HTML by itself, with the little style it needs and no page around it.

    Args:
        table: as it was read.
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
    return made
