"""Columns of text: what people write by hand, and what a program without a format of its own does.

A head with units in brackets as the documentation has it is taken to the letter, so that a slip is
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
    text, row = read_text(path), selection.header_row
    wide = wide_table(path, text) if row is None else None
    if wide is not None and not {selection.amplitude, selection.x} & set(wide[2]):
        return of_table(wide[0], wide[1])
    kept = [t for t in text.splitlines() if t.strip() and not t.startswith("#")]
    delimiter = next((d for d in ";\t," if d in kept[0]), "") if kept else ""
    as_written = row is None and (not kept or _has_head(text, kept[:3], delimiter))
    result = None if as_written else find_table(path, text, row)
    if result is not None:
        table, words, headed = result
        return replace(of_table(_with_suffixes(table), words), headed=headed)
    if not as_written and row is not None:
        raise BadInput(
            f"{path}: holds no table of numbers below row {row}, which is declared to hold the "
            "names of columns"
        )
    if not as_written and len(kept) > 1:
        first = kept[0].strip()
        if is_number(first, decimal_comma=True):
            raise BadInput(
                f"{path}: holds one column of numbers; wanted a column of frequencies, too"
            )
        raise BadInput(
            f"{path}: holds no table of numbers; found {shown(first[:60])}, wanted a header line "
            "and rows of numbers, a frequency in each"
        )
    lines = enumerate(text.splitlines(), start=1)
    table = parse_table(path, [(n, t) for n, t in lines if t.strip().lower() not in ENDS])
    delimiter = next((d for d in ";\t" if d in kept[0]), ",")
    head = table.lines[0] - 1
    units = declared_units(text.splitlines()[:head], delimiter)
    table = replace(table, columns=with_declared_units(table.columns, units))
    return of_table(_with_suffixes(table), words_of(delimiter, head))


def _has_head(text: str, kept: Sequence[str], delimiter: str) -> bool:
    """Whether a head of names stands right above the first row: it is held to the letter then."""
    if not delimiter:
        return False

    def has_number(cells: Sequence[str]) -> bool:
        return any(is_number(c, decimal_comma=delimiter != ",") for c in cells)

    head, *rows = (cells_of(line, delimiter) for line in kept)
    if len(head) < 2 or head[0].startswith("%") or has_number(head):
        return False
    if not any(mark in cell for cell in head for mark in "[("):
        # network analysers give columns of values one name; a row of units may stand below names
        row = rows[0] if rows else ()
        units = bool(row) and all(c.lower() in UNITS or not c for c in row)
        repeated = len({c.lower() for c in head}) < len(head)
        if repeated or units or len(row) < len(head) or not has_number(row):
            return False
    if all(len(row) == len(head) and has_number(row) for row in rows):
        return True
    if rows and len(rows[0]) != len(head) and not has_number(rows[0]):
        return False
    return heads_at(text, delimiter) in (None, 0)  # else settings of an instrument look alike


def _with_suffixes(table: Table) -> Table:
    """Columns with the unit that their name ends in, as freq_hz, or is, as GHz."""
    whole = are_units([c.name for c in table.columns])

    def unit(name: str) -> str | None:
        return UNITS.get(name.lower()) if whole else suffixed_unit(name)[1] or named_unit(name)

    columns = (c if c.unit is not None else replace(c, unit=unit(c.name)) for c in table.columns)
    return replace(table, columns=tuple(columns))


LAYOUT = Layout(name="csv", read=_read_csv, recognises=lambda head: True, keys=("header_row",))
