"""Tables of numbers as programs write them: delimiter, comments, head and unit row are found.

`fitting.text.tables` reads what the documentation tells people to write; this reads the rest:
blanks between cells, no head at all, lines that begin with # or %, a preamble of settings, a row of
units below the names.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fitting.text.errors import BadInput, shown
from fitting.text.notation import how_many
from fitting.text.tables import Column, Table, named_column, split_line

#: What a line begins with that is no row.
COMMENTS = ("#", "%", "!", "//")
#: Lines that end a table of numbers.
ENDS = ("end", "[end]", "end of data", "[/data]")
#: Rows of numbers one after another that are a table and not a preamble.
SURE_ROWS = 3
BLANKS = " "

_REAL = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf)", re.IGNORECASE)
_COMPLEX = re.compile(r"\(?[+-]?[\d.][\d.eE+-]*[ij]?[ +-]*[\d.eE+-]*[ij]?\)?")
_WORD = re.compile(r"\S*\([^)]*\)|\S*\[[^\]]*\]|\S+")

_PLAIN_UNITS = (
    *("Hz", "kHz", "MHz", "GHz", "V", "mV", "uV", "µV", "nV", "A", "mA", "uA", "nA", "m", "mm"),
    *("um", "nm", "pm", "fm", "s", "ms", "us", "ns", "deg", "rad", "dB", "dBm", "W", "mW", "N"),
    *("mN", "ohm", "m/s", "g"),
)
#: Units by their spellings in heads of columns, small letters.
UNITS = {unit.lower(): unit for unit in _PLAIN_UNITS} | {
    "μv": "uV",
    "µm": "um",
    "μm": "um",
    "µs": "us",
    "μs": "us",
    "°": "deg",
    "hertz": "Hz",
    "volt": "V",
    "volts": "V",
    "vrms": "V",
    "second": "s",
    "seconds": "s",
    "sec": "s",
    "degree": "deg",
    "degrees": "deg",
    "radian": "rad",
    "radians": "rad",
    "amp": "A",
}
_NO_UNIT = ("", "-", "1", "a.u.", "arb")
_SUFFIX = re.compile(r"(?P<name>.*[^\s/,_])(?P<mark>\s*/\s*|\s*,\s*|_|\s+)(?P<unit>[^\s/,_]+)")


@dataclass(frozen=True)
class LooseTable:
    """A table that was found, in ``words``, and whether the file names its columns."""

    table: Table
    words: str
    headed: bool


def suffixed_unit(name: str) -> tuple[str, str | None]:
    """Name and unit of a column that writes it without brackets: "freq_hz", "R/uV", "time, s".

    Args:
        name: of the column, as it stands in the head.
    """
    match = _SUFFIX.fullmatch(name) if len(name) <= 100 else None
    if match is None or match["unit"].lower() not in UNITS:
        return name, None
    if len(match["unit"]) == 1 and not match["mark"].strip(" ").strip("_") and match["mark"] != "_":
        return name, None  # "channel A" is a name
    return match["name"], UNITS[match["unit"].lower()]


def find_table(path: Path, text: str) -> LooseTable | None:
    """The table of numbers that a text holds, or None if there is none of two columns.

    Args:
        path: of the file.
        text: of the file.

    Raises:
        BadInput: a row that is no row of numbers below others that are, or with another number of
            cells.
    """
    whole = [(n, line.strip("\r\n")) for n, line in enumerate(text.splitlines(), start=1)]
    kept = [(n, t) for n, t in whole if t.strip() and not t.lstrip().startswith(COMMENTS)]
    found = _start(kept)
    if found is None:
        return None
    start, delimiter = found
    rows, lines = _rows(path, kept[start:], delimiter)
    count = len(rows[0])
    above = [(n, t) for n, t in whole if n < lines[0] and t.strip()]
    columns, head = _head(path, above, delimiter, count)
    table = Table(
        path=path,
        columns=columns,
        cells=tuple(rows),
        lines=tuple(lines),
        decimal_comma=delimiter != ",",
    )
    return LooseTable(table, words_of(delimiter, head), bool(head))


def words_of(delimiter: str, head: int) -> str:
    """What a table of text is, in words.

    Args:
        delimiter: between cells.
        head: row of the names, from one; 0: there is none.
    """
    between = {",": "a comma", ";": "a semicolon", "\t": "a tab", BLANKS: "blanks"}[delimiter]
    named = f"names in row {head}" if head else "no names"
    return f"columns of text, {between} between them, {named}"


def _start(kept: Sequence[tuple[int, str]]) -> tuple[int, str] | None:
    """Where rows of numbers begin, and what stands between their cells."""
    for i in range(len(kept)):
        sample = [text for _, text in kept[i : i + SURE_ROWS] if text.strip().lower() not in ENDS]
        for delimiter in (";", "\t", ",", BLANKS):
            rows = [cells_of(text, delimiter) for text in sample]
            if (
                rows
                and len({len(r) for r in rows}) == 1
                and all(_numeric(r, delimiter) for r in rows)
            ):
                return i, delimiter
    return None


def cells_of(text: str, delimiter: str) -> tuple[str, ...]:
    """Cells of a line, without the empty ones that a delimiter at its end makes.

    Args:
        text: the line.
        delimiter: between cells; a blank stands for any number of blanks.
    """
    cells = tuple(text.split()) if delimiter == BLANKS else split_line(text, delimiter)
    while cells and not cells[-1]:
        cells = cells[:-1]
    return cells


def _numeric(cells: Sequence[str], delimiter: str) -> bool:
    """Whether a row is one of numbers; a column of dates or remarks may stand between them."""
    numbers = sum(is_number(c, decimal_comma=delimiter != ",") for c in cells)
    if delimiter == BLANKS:
        return numbers == len(cells) >= 2
    if any(len(c.split()) > 1 and all(map(is_number, c.split())) for c in cells):
        return False  # "1,5  2,5": the comma is the decimal sign
    return numbers >= 2 and 2 * numbers >= len(cells)


def is_number(cell: str, *, decimal_comma: bool = False) -> bool:
    """Whether a cell looks like a number, real or complex.

    Args:
        cell: as it stands.
        decimal_comma: whether a comma is the decimal sign.
    """
    plain = cell.replace(",", ".") if decimal_comma else cell
    if len(plain) > 100:
        return False
    return bool(_REAL.fullmatch(plain)) or (
        plain.rstrip(")").endswith(("i", "j")) and bool(_COMPLEX.fullmatch(plain))
    )


def _rows(
    path: Path, kept: Sequence[tuple[int, str]], delimiter: str
) -> tuple[list[tuple[str, ...]], list[int]]:
    rows: list[tuple[str, ...]] = []
    lines: list[int] = []
    for n, text in kept:
        if text.strip().lower() in ENDS:
            break
        cells = cells_of(text, delimiter)
        if rows and len(cells) != len(rows[0]):
            raise BadInput(
                f"{path}: row {n} has {how_many(len(cells), 'cell')}, the rows above it "
                f"{len(rows[0])}: found {shown(text)}; wanted one table of numbers in a file"
            )
        rows.append(cells)
        lines.append(n)
    return rows, lines


def _head(
    path: Path, above: Sequence[tuple[int, str]], delimiter: str, count: int
) -> tuple[tuple[Column, ...], int]:
    """Columns by the lines above them, and the row of their names (0: there is none)."""
    last = _split(above[-1][1], delimiter, count) if above else None
    before = _split(above[-2][1], delimiter, count) if len(above) > 1 else None
    if last is not None and any(is_number(c, decimal_comma=delimiter != ",") for c in last):
        if before is not None and not any(map(is_number, before)):
            bad = next(c for c in last if not is_number(c))
            raise BadInput(f"{path}: row {above[-1][0]}: found {shown(bad)}, wanted a number")
        last = None
    if last is None:
        return tuple(Column(f"column {i + 1}", None, i) for i in range(count)), 0
    units = [c.strip("()[] ").lower() for c in last]
    if before is not None and all(u in UNITS or u in _NO_UNIT for u in units) and any(units):
        names = zip(_distinct(before), units, strict=True)
        return tuple(Column(n, UNITS.get(u), i) for i, (n, u) in enumerate(names)), above[-2][0]
    named = [named_column(text, i) for i, text in enumerate(last)]
    pairs = zip(_distinct([c.name for c in named]), named, strict=True)
    return tuple(Column(name, c.unit, c.index) for name, c in pairs), above[-1][0]


def _distinct(names: Sequence[str]) -> list[str]:
    """The names, numbered where they are empty or there twice."""
    made: list[str] = []
    for i, name in enumerate(names):
        first = name or f"column {i + 1}"
        taken = {m.lower() for m in made}
        k = 2
        distinct = first
        while distinct.lower() in taken:
            distinct, k = f"{first} {k}", k + 1
        made.append(distinct)
    return made


def _split(line: str, delimiter: str, count: int) -> tuple[str, ...] | None:
    """Cells of a line above the numbers, if it can be parted into that many."""
    text = line.strip()
    for mark in COMMENTS:
        text = text.removeprefix(mark).lstrip(mark[0]).strip()
    if not text:
        return None
    ways = (
        cells_of(text, delimiter) if delimiter != BLANKS else (),
        cells_of(text, "\t"),
        cells_of(text, ";"),
        cells_of(text, ","),
        tuple(re.split(r"\s{2,}", text)),
        tuple(text.split()),
        tuple(_WORD.findall(re.sub(r"\s+(?=[(\[])", "", text))),
    )
    return next((cells for cells in ways if len(cells) == count), None)
