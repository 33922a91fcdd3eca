"""Columns of text: what people write by hand, and what a program without a format of its own does.

A head with units in brackets as the documentation tells it is held to the letter, so that a slip is
named with its row. Anything else is looked at: blanks or a tab between cells, no head, lines that
begin with # or %, settings above the table, a row of units below the names.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fitting.campaign.instruments.recording import Recording, of_table
from fitting.campaign.instruments.trace import Layout, Selection
from fitting.campaign.instruments.wide import wide_table
from fitting.text.errors import BadInput, shown
from fitting.text.loose_tables import (
    ENDS,
    UNITS,
    are_units,
    cells_of,
    declared_units,
    find_table,
    heads_at,
    is_number,
    named_unit,
    suffixed_unit,
    with_declared_units,
    words_of,
)
from fitting.text.tables import Table, parse_table, read_text


def _read_csv(path: Path, selection: Selection) -> Recording:
    text = read_text(path)
    row = selection.header_row
    wide = wide_table(path, text) if row is None else None
    if wide is not None and not {selection.amplitude, selection.x} & set(wide.heads):
        return of_table(wide.table, wide.words)
    as_told = row is None and _is_as_told(text)
    found = None if as_told else find_table(path, text, row)
    if found is None and not as_told and (row is not None or len(_kept(text)) > 1):
        raise _no_table(path, text, row)
    if found is None:
        lines = enumerate(text.splitlines(), start=1)
        table = parse_table(path, [(n, t) for n, t in lines if t.strip().lower() not in ENDS])
        delimiter = next((d for d in ";\t" if d in _kept(text)[0]), ",")
        above = text.splitlines()[: table.lines[0] - 1]
        told = with_declared_units(table.columns, declared_units(above, delimiter))
        table = _with_suffixes(replace(table, columns=told))
        return of_table(table, words_of(delimiter, table.lines[0] - 1))
    return replace(of_table(_with_suffixes(found.table), found.words), headed=found.headed)


def _no_table(path: Path, text: str, header_row: int | None) -> BadInput:
    if header_row is not None:
        return BadInput(
            f"{path}: holds no table of numbers below row {header_row}, which is declared to "
            f"hold the "
            "names of columns"
        )
    first = _kept(text)[0].strip()
    if is_number(first, decimal_comma=True):
        return BadInput(f"{path}: holds one column of numbers; wanted a column of frequencies, too")
    return BadInput(
        f"{path}: holds no table of numbers; found {shown(first[:60])}, wanted a header line and "
        "rows of numbers, a frequency in each"
    )


def _kept(text: str) -> list[str]:
    return [t for t in text.splitlines() if t.strip() and not t.startswith("#")]


def _is_as_told(text: str) -> bool:
    """Whether a head of names stands right above the first row: it is held to the letter then."""
    kept = _kept(text)[:3]
    if not kept:
        return True
    delimiter = next((d for d in ";\t," if d in kept[0]), "")
    if not delimiter:
        return False
    head, *rows = (cells_of(line, delimiter) for line in kept)
    if not _may_head(head, rows[0] if rows else (), delimiter):
        return False
    if all(len(row) == len(head) and _has_number(row, delimiter) for row in rows):
        return True
    if rows and len(rows[0]) != len(head) and not _has_number(rows[0], delimiter):
        return False
    return heads_at(text, delimiter) in (None, 0)  # else settings of an instrument look alike


def _may_head(head: Sequence[str], row: Sequence[str], delimiter: str) -> bool:
    """Whether a first line holds the names of columns, by itself and the line below it."""
    if len(head) < 2 or head[0].startswith("%") or _has_number(head, delimiter):
        return False
    if any(mark in cell for cell in head for mark in "[("):
        return True
    if len({c.lower() for c in head}) < len(head):
        return False  # as network analysers do: the values' columns have one name
    units = bool(row) and all(c.lower() in UNITS or not c for c in row)
    return not units and len(row) >= len(head) and _has_number(row, delimiter)


def _has_number(cells: Sequence[str], delimiter: str) -> bool:
    return any(is_number(c, decimal_comma=delimiter != ",") for c in cells)


def _with_suffixes(table: Table) -> Table:
    """Columns with the unit that their name ends in, as freq_hz, or is, as GHz."""
    whole = are_units([c.name for c in table.columns])

    def unit(name: str) -> str | None:
        return UNITS.get(name.lower()) if whole else suffixed_unit(name)[1] or named_unit(name)

    columns = (c if c.unit is not None else replace(c, unit=unit(c.name)) for c in table.columns)
    return replace(table, columns=tuple(columns))


LAYOUT = Layout(name="csv", read=_read_csv, recognises=lambda head: True, keys=("header_row",))
