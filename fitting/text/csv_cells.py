"""Cells of CSV files as every one of them is written: names stay names in a spreadsheet, too.

A spreadsheet takes what begins with = + - or @ for a formula, quoted or not, and works it out. Such
a name gets an apostrophe, by which spreadsheets know text, and `as_read` takes it off.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable

#: What a formula begins with, and what a name begins with that already has an apostrophe.
MARKS, APOSTROPHE = "=+-@", "'"


def csv_text(rows: Iterable[Iterable[str]]) -> str:
    """Rows as the text of a CSV file.

    Args:
        rows: of cells, numbers as text.
    """
    made = io.StringIO()
    csv.writer(made, lineterminator="\n").writerows(map(_guarded, row) for row in rows)
    return made.getvalue()


def csv_line(cells: Iterable[str]) -> str:
    """One row, without its end.

    Args:
        cells: numbers as text.
    """
    return csv_text([cells]).removesuffix("\n")


def as_read(cell: str) -> str:
    """A cell of a file as it was before it was written.

    Args:
        cell: without blanks around it.
    """
    return cell[1:].strip() if cell[:1] == APOSTROPHE and _is_mistaken(cell[1:]) else cell


def _guarded(cell: str) -> str:
    return APOSTROPHE + cell if _is_mistaken(cell) else cell


def _is_mistaken(cell: str) -> bool:
    """Whether a spreadsheet would take a text for a formula, or this program for a guarded one."""
    text = cell.lstrip()
    if text[:1] == APOSTROPHE:
        return _is_mistaken(text[1:])
    return len(text) > 1 and text[0] in MARKS and not _is_number(text)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
