"""The files of a plan as the laboratory hands them back: its table filled, its campaign marked."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, MutableMapping, Sequence
from pathlib import Path

import numpy as np

from fitting.extension.records import WrittenSweep
from fitting.lab.writer import csv_text
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.files import path_from
from fitting.text.tables import Column, Table
from fitting.text.toml import Tables, rewritten
from fitting.text.units import convert


class FilledTable:
    """A table of a plan, with what was measured in columns that wait for it."""

    def __init__(self, table: Table) -> None:
        self._columns = {_head(c): list(table.texts(c)) for c in table.columns}

    def put(self, column: Column, row: int, value: float) -> None:
        """Fill a cell.

        Args:
            column: of the table.
            row: from 0.
            value: in the column's unit.
        """
        self._columns[_head(column)][row] = repr(value)

    def text(self, head: Sequence[str]) -> str:
        """The file's text.

        Args:
            head: its first lines.
        """
        return csv_text(self._columns, head)


def _head(column: Column) -> str:
    return column.name if column.unit is None else f"{column.name} ({column.unit})"


def numbers_in(table: Table, column: Column, unit: str) -> FloatArray:
    """A column in a unit, (n,); as it stands where its header has none.

    Args:
        table: whose column it is.
        column: of numbers.
        unit: that is wanted.

    Raises:
        BadInput: cells that are no numbers, a unit of another kind.
    """
    factor = convert(1.0, column.unit, unit, where=_where(table, column)) if column.unit else 1.0
    return np.asarray(table.numbers(column) * factor)


def of_volts(table: Table, column: Column) -> float:
    """What volts are multiplied by to stand in a column.

    Args:
        table: whose column it is.
        column: of amplitudes.

    Raises:
        BadInput: its unit is of another kind.
    """
    return convert(1.0, "V", column.unit or "V", where=_where(table, column))


def _where(table: Table, column: Column) -> str:
    return f"{table.path}: column '{column.name}'"


def mark_synthetic(tables: Tables) -> None:
    """Mark a campaign as synthetic, in its title, too.

    Args:
        tables: of the campaign, changed in place.
    """
    tables["synthetic"] = True
    if "synthetic" not in tables.get("title", "synthetic"):
        tables["title"] = f"{tables['title']} (synthetic)"


def carried(text: str, source: Path, folder: Path, written: Collection[str]) -> str:
    """A campaign's text whose paths lead from another folder to where they led.

    What is written next to it is named by its own name; every other file, as the FMU, stays where
    it is.

    Args:
        text: of the campaign.
        source: folder that its paths are seen from.
        folder: that it will stand in.
        written: names of the files that are written next to it.
    """

    def there(table: str, value: str) -> str:
        nearby = table != "fmu" and Path(value).name in written
        return Path(value).name if nearby else path_from(folder, source / value)

    def edit(tables: Tables) -> None:
        for name, table in tables.items():
            for one in table if isinstance(table, list) else [table]:
                value = one.get("file") if isinstance(one, MutableMapping) else None
                if isinstance(value, str) and there(name, value) != value:
                    one["file"] = there(name, value)

    plain = tomllib.loads(text)
    edit(plain)
    return text if plain == tomllib.loads(text) else rewritten(text, edit)


def sweep_beside(path: Path, sweep: WrittenSweep | None) -> dict[str, bytes]:
    """The sweep that a plan takes its scale from, as it is, by its file's name.

    Args:
        path: of the plan.
        sweep: its table [sweep], None without one.

    Raises:
        BadInput: no such file.
    """
    if sweep is None:
        return {}
    if not sweep.file.is_file():
        raise BadInput(f"{path}: [sweep] file: {sweep.file}: no such file")
    return {sweep.file.name: sweep.file.read_bytes()}
