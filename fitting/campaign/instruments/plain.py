"""Columns of text: what people write by hand, and what a program without a format of its own does.

`fitting.campaign.instruments.loose_tables` finds the table: blanks or a tab between cells, no head,
lines that begin with # or %, settings above the table, a row of units below the names.

A map has a column, or a row, of amplitudes for each value of a control:

    frequency (Hz), V=-3 V, V=-1.5 V, ...        V (V), 982 Hz, 983 Hz, ...
    982,            1.2e-6, 1.1e-6, ...          -3,    1.2e-6, 1.3e-6, ...

Values in the head have a name and a unit, or neither. Such a table is read as the long one that it
means, a row for each point: the control, frequency, amplitude.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from fitting.campaign.instruments.loose_tables import (
    COMMENTS,
    ENDS,
    UNITS,
    cells_of,
    find_table,
    is_number,
    suffixed_unit,
)
from fitting.campaign.instruments.recording import Layout, Recording, Selection, of_table
from fitting.campaign.instruments.roles import FREQUENCY
from fitting.text.errors import BadInput, shown
from fitting.text.notation import how_many
from fitting.text.tables import Column, Table, named_column, parse_number, parse_table, read_text
from fitting.text.units import is_frequency, same_kind

#: Points of a spectrum, at least.
LEAST_POINTS = 8
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
    rf"(?:(?P<name>{_NAME})\s*(?:[(\[](?P<stated>[^()\[\]]*)[)\]]\s*)?[=:]\s*)?"
    rf"(?P<value>{_REAL})\s*[(\[]?(?P<unit>[^\s()\[\]\d=:,;]*)[)\]]?"
)
_CORNER = re.compile(r"\s*[\\|]\s*")
_EMPTY = ("", "0", "0.0", "nan")


#: The quantity of a head or of the first column, and its values as they are written.
_Axis = tuple[Column, tuple[str, ...]]


def _is_frequency(axis: Column) -> bool:
    named = axis.name.lower() in FREQUENCY or "freq" in axis.name.lower()
    return named or (axis.unit is not None and is_frequency(axis.unit))


def read_spectra_table(path: Path) -> Table:
    """A table of spectra over a control, a row for each point; a wide one as what it means.

    Args:
        path: of the file.

    Raises:
        BadInput: no such file, no table; a wide one that does not state where its frequencies are.
    """
    text = read_text(path)
    wide = wide_table(path, text)
    lines = enumerate(text.splitlines(), start=1)
    return parse_table(path, lines) if wide is None else wide[0]


def wide_table(path: Path, text: str) -> tuple[Table, str, tuple[str, ...]] | None:
    """The long table that a wide one means, what it is in words, and the names in its head.

    Args:
        path: of the file.
        text: of the file; None is the answer where it holds no such table.

    Raises:
        BadInput: it does not state which are its frequencies, or a row has too few cells.
    """
    numbered = [(n, t) for n, t in enumerate(text.splitlines(), start=1) if t.strip()]
    for k, (_, line) in enumerate(numbered[:HEAD_LINES]):
        plain = line.strip("\r\n")
        for mark in COMMENTS:
            plain = plain.removeprefix(mark)
        for delimiter in (";", "\t", ",", " "):
            cells, below = cells_of(plain, delimiter) or ("",), numbered[k + 1 :]
            head = _head(cells)
            row = cells_of(below[0][1], delimiter) if head is not None and below else ()
            numbers = all(is_number(cell, decimal_comma=delimiter != ",") for cell in row)
            if head is not None and len(row) == len(cells) and numbers:
                return _long(path, cells, head, delimiter, below)
    return None


def _long(
    path: Path,
    cells: Sequence[str],
    head: _Axis,
    delimiter: str,
    below: Sequence[tuple[int, str]],
) -> tuple[Table, str, tuple[str, ...]] | None:
    """The long table that rows below a head of values mean; None where they are too few."""
    rows, lines = [], []
    for n, text in below:
        if text.strip().lower() in ENDS:
            break
        if text.lstrip().startswith(COMMENTS):
            continue
        row = cells_of(text, delimiter)
        if len(row) != len(cells):
            raise BadInput(
                f"{path}: row {n} has {how_many(len(row), 'cell')}, wanted {len(cells)} as in the "
                "head"
            )
        rows.append(row)
        lines.append(n)
    nearby, above = [*_CORNER.split(cells[0]), ""][:2]
    side, top = _column(nearby), _column(above) if above and not head[0].name else head[0]
    left, across = tuple(row[0] for row in rows), head[1]
    if _is_frequency(side) == _is_frequency(top):
        if _is_frequency(side) or not side.name or above:
            raise BadInput(
                f"{path}: is a matrix of amplitudes, {len(rows)} rows below a head of "
                f"{len(across)} values, and does not state which are frequencies; wanted its "
                "first cell to name the first column: 'frequency (Hz)', or the control, as "
                "'V (V)', where the head has the frequencies"
            )
        top = replace(top, name=FREQUENCY[0])
    by_column = _is_frequency(side)
    frequency, control = (side, top) if by_column else (top, side)
    points, values = (left, across) if by_column else (across, left)
    if len(points) < LEAST_FREQUENCIES or len(values) < 2:
        return None
    comma, order = delimiter != ",", list(range(len(points)))
    with suppress(BadInput):  # its reader refuses a cell that is no number, with the row
        numbers = [parse_number(value, "", decimal_comma=comma) for value in points]
        order = np.argsort(numbers, kind="stable").tolist()
    result, places = [], []
    for k, value in enumerate(values):
        for i in order:
            at, column = (i, k) if by_column else (k, i)
            result.append((value, points[i], rows[at][column + 1]))
            places.append(lines[at])
    name = control.name or CONTROL
    table = Table(
        path=path,
        columns=(
            Column(name, control.unit or "1", 0),
            Column(FREQUENCY[0], frequency.unit, 1),
            Column("amplitude", None, 2),
        ),
        cells=tuple(result),
        lines=tuple(places),
        decimal_comma=comma,
    )
    place = "column" if by_column else "row"
    silent = "" if control.unit else ", whose unit is not stated"
    words = f"a table with a {place} of amplitudes for each of {len(values)} values of "
    return table, f"{words}'{name}'{silent}", tuple(cells[1:])


def _column(text: str) -> Column:
    column = named_column(text, 0)
    name, unit = (column.name, column.unit) if column.unit else suffixed_unit(column.name)
    return Column("" if name.lower() in _EMPTY else name, unit, 0)


def _head(cells: Sequence[str]) -> _Axis | None:
    """The values of a head behind its first cell; None where it is none."""
    first = cells[0].lower()
    if first not in _EMPTY and is_number(first, decimal_comma=True):  # a row, maybe a long one
        return None
    result = [match for match in map(_VALUE.fullmatch, cells[1:]) if match is not None]
    if len(result) < max(LEAST_VALUES, len(cells) - 1):
        return None
    units = (m["unit"] or m["stated"] or "" for m in result)
    names = ((m["name"] or "").strip() for m in result)
    kinds = {(name, UNITS.get(u.lower(), u) or None) for name, u in zip(names, units, strict=True)}
    values = tuple(m["value"] for m in result)
    numbers = [float(value.replace(",", ".")) for value in values]
    # a head of numbers alone may be the first row
    if first in _EMPTY:
        steps = np.diff(numbers)
        leads = bool(np.all(steps > 0.0) or np.all(steps < 0.0))
        leads &= len(values) >= LEAST_BARE or not is_number(first) or first == "nan"
    else:
        leads = len(set(numbers)) == len(values) and not is_number(first, decimal_comma=True)
    if len(kinds) > 1 or not leads:
        return None
    [(name, unit)] = kinds
    if unit is not None and (unit in NO_UNITS or not same_kind(unit, unit)):
        return None
    return Column(name, unit, 0), values


def _read_csv(path: Path, selection: Selection) -> Recording:
    text, row = read_text(path), selection.header_row
    wide = wide_table(path, text) if row is None else None
    if wide is not None and not {selection.amplitude, selection.x} & set(wide[2]):
        return of_table(wide[0], wide[1])
    result = find_table(path, text, row)
    if result is not None:
        table, words, headed = result
        return replace(of_table(table, words), headed=headed)
    whole = enumerate(text.splitlines(), start=1)
    kept = [(n, t) for n, t in whole if t.strip() and not t.startswith("#")]
    if not kept:
        raise BadInput(f"{path}: is empty; wanted a header line and rows of numbers")
    at, first = kept[0][0], kept[0][1].strip()
    if row is not None:
        raise BadInput(
            f"{path}: holds no table of numbers below row {row}, which is declared to hold the "
            "names of columns"
        )
    if is_number(first, decimal_comma=True):
        raise BadInput(f"{path}: holds one column of numbers; wanted a column of frequencies, too")
    if len(kept) == 1:
        raise BadInput(f"{path}: row {at} is the last; wanted rows of numbers below it")
    raise BadInput(
        f"{path}: holds no table of numbers; found {shown(first[:60])}, wanted a header line "
        "and rows of numbers, a frequency in each"
    )


LAYOUT = Layout(name="csv", read=_read_csv, recognises=lambda head: True, keys=("header_row",))
