"""Maps as laboratories write them: a column, or a row, of amplitudes for each value of a control.

    frequency (Hz), V=-3 V, V=-1.5 V, ...        V (V), 982 Hz, 983 Hz, ...
    982,            1.2e-6, 1.1e-6, ...          -3,    1.2e-6, 1.3e-6, ...

Values in the head stand with or without a name and a unit. Such a table is read as the long one
that it means, a row for each point: the control, frequency, amplitude.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fitting.campaign.instruments.roles import FREQUENCY
from fitting.text.errors import BadInput
from fitting.text.loose_tables import COMMENTS, ENDS, UNITS, cells_of, is_number, suffixed_unit
from fitting.text.notation import how_many
from fitting.text.tables import Column, Table, named_column, parse_number, parse_table, read_text
from fitting.text.units import is_frequency, same_kind

#: Name of a control that the file does not name.
CONTROL = "control"
#: Values in a head, at least, and frequencies; values where a 0 leads the head.
LEAST_VALUES, LEAST_FREQUENCIES, LEAST_BARE = 3, 8, 8
#: What stands behind a number in heads and is no unit of a control, though pint knows it.
NO_UNITS = ("peak", "pk", "rms")
#: Lines among which the head stands.
HEAD_LINES = 100

_NAME, _REAL = r"[^\W\d][\w ]*?", r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?"
_VALUE = re.compile(
    rf"(?:(?P<name>{_NAME})\s*(?:[(\[](?P<told>[^()\[\]]*)[)\]]\s*)?[=:]\s*)?"
    rf"(?P<value>{_REAL})\s*[(\[]?(?P<unit>[^\s()\[\]\d=:,;]*)[)\]]?"
)
_CORNER = re.compile(r"\s*[\\|]\s*")
_EMPTY = ("", "0", "0.0", "nan")


@dataclass(frozen=True, kw_only=True)
class WideTable:
    """The long table that a wide one means, what it is in words, and the names in its head."""

    table: Table
    words: str
    heads: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class _Axis:
    """Values of the head or of the first column, as they are written, and what they are."""

    name: str
    unit: str | None
    values: tuple[str, ...]

    @property
    def is_frequency(self) -> bool:
        named = self.name.lower() in FREQUENCY or "freq" in self.name.lower()
        return named or (self.unit is not None and is_frequency(self.unit))


@dataclass(frozen=True, kw_only=True)
class _Grid:
    """Rows of numbers, ``lines`` in the file, below a head of values that ``corner`` leads."""

    path: Path
    corner: str
    heads: tuple[str, ...]
    head: _Axis
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    decimal_comma: bool


def read_spectra_table(path: Path) -> Table:
    """A table of spectra over a control, a row for each point; a wide one as what it means.

    Args:
        path: of the file.

    Raises:
        BadInput: no such file, no table; a wide one that does not tell where its frequencies stand.
    """
    text = read_text(path)
    wide = wide_table(path, text)
    lines = enumerate(text.splitlines(), start=1)
    return parse_table(path, lines) if wide is None else wide.table


def wide_table(path: Path, text: str) -> WideTable | None:
    """The wide table that a text holds; None where it holds none.

    Args:
        path: of the file.
        text: of the file.

    Raises:
        BadInput: it does not tell where its frequencies stand, or a row has too few cells.
    """
    grid = _grid(path, text)
    if grid is None:
        return None
    beside, above = [*_CORNER.split(grid.corner), ""][:2]
    side = _axis_of(beside, tuple(row[0] for row in grid.rows))
    head = grid.head
    if above and not head.name:
        head = _axis_of(above, head.values)
    if side.is_frequency == head.is_frequency:
        if side.is_frequency or not side.name or above:
            raise _undecided(grid)
        head = _Axis(name=FREQUENCY[0], unit=head.unit, values=head.values)
    frequency, control = (side, head) if side.is_frequency else (head, side)
    if len(frequency.values) < LEAST_FREQUENCIES or len(control.values) < 2:
        return None
    return _long(grid, frequency, control, by_column=side.is_frequency)


def _undecided(grid: _Grid) -> BadInput:
    return BadInput(
        f"{grid.path}: is a matrix of amplitudes, {len(grid.rows)} rows below a head of "
        f"{len(grid.heads)} values, and does not state which are frequencies; wanted its first "
        f"cell "
        "to name the first column: 'frequency (Hz)', or the control, as 'V (V)', where the head "
        "has the frequencies"
    )


def _long(grid: _Grid, frequency: _Axis, control: _Axis, *, by_column: bool) -> WideTable:
    order = _rising(frequency.values, comma=grid.decimal_comma)
    cells, lines = [], []
    for k, value in enumerate(control.values):
        for i in order:
            row, column = (i, k) if by_column else (k, i)
            cells.append((value, frequency.values[i], grid.rows[row][column + 1]))
            lines.append(grid.lines[row])
    name = control.name or CONTROL
    table = Table(
        path=grid.path,
        columns=(
            Column(name, control.unit or "1", 0),
            Column(FREQUENCY[0], frequency.unit, 1),
            Column("amplitude", None, 2),
        ),
        cells=tuple(cells),
        lines=tuple(lines),
        decimal_comma=grid.decimal_comma,
    )
    place = "column" if by_column else "row"
    silent = "" if control.unit else ", whose unit is not stated"
    words = f"a table with a {place} of amplitudes for each of {len(control.values)} values of "
    return WideTable(table=table, words=f"{words}'{name}'{silent}", heads=grid.heads)


def _rising(values: Sequence[str], *, comma: bool) -> list[int]:
    """The order of rising frequencies; that of the file where a cell is no number."""
    try:
        numbers = [parse_number(value, "", decimal_comma=comma) for value in values]
    except BadInput:  # its reader complains, with the row
        return list(range(len(values)))
    return [int(i) for i in np.argsort(numbers, kind="stable")]


def _axis_of(text: str, values: tuple[str, ...]) -> _Axis:
    column = named_column(text, 0)
    name, unit = (column.name, column.unit) if column.unit else suffixed_unit(column.name)
    return _Axis(name="" if name.lower() in _EMPTY else name, unit=unit, values=values)


def _grid(path: Path, text: str) -> _Grid | None:
    numbered = [(n, t) for n, t in enumerate(text.splitlines(), start=1) if t.strip()]
    for k, (_, line) in enumerate(numbered[:HEAD_LINES]):
        for delimiter in (";", "\t", ",", " "):
            found = _head(_uncommented(line), delimiter)
            below = numbered[k + 1 :]
            if found is None or not _is_row(below[:1], delimiter, 1 + len(found[1].values)):
                continue
            rows, lines = _rows(path, below, delimiter, 1 + len(found[1].values))
            return _Grid(
                path=path,
                corner=found[0],
                heads=found[2],
                head=found[1],
                rows=tuple(rows),
                lines=tuple(lines),
                decimal_comma=delimiter != ",",
            )
    return None


def _uncommented(line: str) -> str:
    text = line.strip("\r\n")
    for mark in COMMENTS:
        text = text.removeprefix(mark)
    return text


def _head(line: str, delimiter: str) -> tuple[str, _Axis, tuple[str, ...]] | None:
    """First cell, values and all further cells of a head of values; None where it is none."""
    corner, *heads = (*cells_of(line, delimiter), "")[:-1] or ("",)
    first = corner.strip().lower()
    if first not in _EMPTY and is_number(first, decimal_comma=True):  # a row, maybe a long one
        return None
    found = []
    for cell in heads:
        match = _VALUE.fullmatch(cell)
        if match is None:
            return None
        found.append(match)
    if len(found) < LEAST_VALUES:
        return None
    kinds = {((m["name"] or "").strip(), _unit(m)) for m in found}
    values = tuple(m["value"] for m in found)
    if len(kinds) > 1 or not _may_lead(first, values):
        return None
    [(name, unit)] = kinds
    if unit is not None and (unit in NO_UNITS or not same_kind(unit, unit)):
        return None
    return corner.strip(), _Axis(name=name, unit=unit, values=values), tuple(heads)


def _may_lead(corner: str, values: Sequence[str]) -> bool:
    """Whether a head of these values may begin so; one of numbers alone may be the first row."""
    steps = np.diff([float(value.replace(",", ".")) for value in values])
    rising = bool(np.all(steps > 0.0) or np.all(steps < 0.0))
    if corner in _EMPTY:
        return rising and (len(values) >= LEAST_BARE or not is_number(corner) or corner == "nan")
    distinct = len({float(value.replace(",", ".")) for value in values}) == len(values)
    return distinct and not is_number(corner, decimal_comma=True)


def _unit(match: re.Match[str]) -> str | None:
    unit = match["unit"] or match["told"] or ""
    return UNITS.get(unit.lower(), unit) or None


def _is_row(below: Sequence[tuple[int, str]], delimiter: str, count: int) -> bool:
    cells = [c for _, text in below for c in cells_of(text, delimiter)]
    return len(cells) == count and all(is_number(c, decimal_comma=delimiter != ",") for c in cells)


def _rows(
    path: Path, below: Sequence[tuple[int, str]], delimiter: str, count: int
) -> tuple[list[tuple[str, ...]], list[int]]:
    rows, lines = [], []
    for n, text in below:
        if text.strip().lower() in ENDS:
            break
        if text.lstrip().startswith(COMMENTS):
            continue
        cells = cells_of(text, delimiter)
        if len(cells) != count:
            raise BadInput(
                f"{path}: row {n} has {how_many(len(cells), 'cell')}, wanted {count} as in the head"
            )
        rows.append(cells)
        lines.append(n)
    return rows, lines
