"""Delimited text with units in its header: read with the place of each cell, and written.

A spreadsheet takes what begins with = + - or @ for a formula, quoted or not, and works it out. A
name like that gets an apostrophe where it is written, by which spreadsheets know text, and
`as_read` takes it off.
"""

from __future__ import annotations

import codecs
import csv
import io
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, MissingFile, did_you_mean, shown
from fitting.text.files import read_whole
from fitting.text.notation import how_many
from fitting.text.units import convert, same_kind

#: What programs write where a number is missing.
NOT_A_NUMBER = ("nan", "na", "n/a", "null", "none", "-")
#: Cells that are no numbers which a complaint names beside the first one.
MORE_NAMED = 3
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
#: Name and unit in brackets, which may hold brackets of their own: "noise (V/sqrt(Hz))".
_HEADER = re.compile(r"(?P<name>.*?)\s*[(\[]\s*(?P<unit>(?:[^()\[\]]|\([^()\[\]]*\))*?)\s*[)\]]\s*")
#: An element of an array, as "x[2]" or "der(T[1,2])".
_ELEMENT = re.compile(r"(?P<name>[^\[\]]*[^\s\[\]])\[\d+(?:,\s*\d+)*\](?P<rest>\)?)")
#: Bytes that tell UTF-16 without a mark: every second one is zero in European languages.
_SAMPLE = 8
#: Characters of a column's name and unit; the pattern takes its time over longer ones.
LONGEST_HEADER = 1000


@dataclass(frozen=True)
class Column:
    """A column by name, with the unit its header writes (None: none written)."""

    name: str
    unit: str | None
    index: int


@dataclass(frozen=True, kw_only=True)
class Table:
    """A delimited text file: ``columns``, ``cells`` (rows of text) and the line of every row."""

    path: Path
    columns: tuple[Column, ...]
    cells: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    decimal_comma: bool

    def find(self, name: str) -> Column | None:
        """The column of that name, capitals apart, or None.

        Args:
            name: of the variable.
        """
        return next((c for c in self.columns if c.name.lower() == name.lower()), None)

    def column(self, name: str) -> Column:
        """The column of that name; raises BadInput with the nearest name if there is none.

        Args:
            name: of the variable.
        """
        result = self.find(name)
        if result is None:
            present = [c.name for c in self.columns]
            raise BadInput(f"{self.path}: no column '{name}'{did_you_mean(name, present)}")
        return result

    def numbers(self, column: Column) -> FloatArray:
        """The finite numbers of a column, (n,); raises BadInput naming lines and column.

        Args:
            column: of the table.
        """
        return parse_numbers(
            self.path,
            [
                (f"row {n}", row[column.index])
                for row, n in zip(self.cells, self.lines, strict=True)
            ],
            f", column '{column.name}'",
            decimal_comma=self.decimal_comma,
        )

    def numbers_or_nan(self, column: Column) -> FloatArray:
        """The numbers of a column, (n,), NaN where a cell is none.

        Args:
            column: of the table.
        """
        result = (_finite(text, self.decimal_comma) for text in self.texts(column))
        return np.array([math.nan if value is None else value for value in result])

    def texts(self, column: Column) -> tuple[str, ...]:
        """The cells of a column as they stand.

        Args:
            column: of the table.
        """
        return tuple(row[column.index] for row in self.cells)


def read_text(path: Path) -> str:
    """The text of a file, in the encoding that `decoded` finds.

    Args:
        path: of the file.

    Raises:
        BadInput: no such file, a folder, a pipe, or not readable.
    """
    with naming_neighbours(path):
        data = read_whole(path)
    return decoded(data)


@contextmanager
def naming_neighbours(path: Path) -> Iterator[None]:
    """Where there is no file of that name, the error names the one next to it that is alike.

    Args:
        path: of the file that is read within.
    """
    try:
        yield
    except MissingFile as error:
        nearby = path.parent.iterdir() if path.parent.is_dir() else ()
        siblings = [p.name for p in nearby if not p.is_dir()]
        hint = did_you_mean(path.name, siblings, listed=False)
        name = str(path) if str(path).strip() else repr(str(path))
        raise MissingFile(f"{name}: no such file{hint}") from error


def decoded(data: bytes) -> str:
    """Text of bytes: UTF-16 by a mark or every second byte, UTF-8, else Latin-1.

    Latin-1 is how older instruments write the micro sign, and takes any bytes.

    Args:
        data: content of a file, or its beginning.
    """
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return data.decode("utf-16", "replace")
    for zeros, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        sample = data[:_SAMPLE]
        if len(sample) == _SAMPLE and not any(sample[zeros::2]) and all(sample[1 - zeros :: 2]):
            return data.decode(name, "replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def read_table(path: Path) -> Table:
    """Read a delimited table whose first line that is not a ``#`` comment is the header.

    Args:
        path: of the file.
    """
    return parse_table(path, enumerate(read_text(path).splitlines(), start=1))


def parse_table(path: Path, numbered: Iterable[tuple[int, str]]) -> Table:
    """Parse numbered lines: header, then rows with as many cells.

    Delimiter ';' or tab where the header has one, else ','. With ';' or tab a comma within a number
    is the decimal sign. Lines that are empty or start with ``#`` are passed over.

    Args:
        path: of the file.
        numbered: lines with their numbers in the file, from one.

    Raises:
        BadInput: no header, no rows, a row with another number of cells, a column name twice.
    """
    kept = [(n, text) for n, text in numbered if text.strip() and not text.startswith("#")]
    if not kept:
        raise BadInput(f"{path}: is empty; wanted a header line and rows of numbers")
    delimiter = next((d for d in (";", "\t") if d in kept[0][1]), ",")
    rows = [split_line(text, delimiter) for _, text in kept]
    header, body, lines = rows[0], rows[1:], [n for n, _ in kept[1:]]
    while header and not header[-1] and all(len(r) < len(header) or not r[-1] for r in body):
        body = [r[:-1] if len(r) == len(header) else r for r in body]
        header = header[:-1]  # a delimiter at the end of every line
    if not body:
        raise BadInput(f"{path}: row {kept[0][0]} is the last; wanted rows of numbers below it")
    for row, line in zip(body, lines, strict=True):
        if len(row) != len(header):
            raise BadInput(
                f"{path}: row {line} has {how_many(len(row), 'cell')}, the header {len(header)} "
                f"(delimiter {delimiter!r}; a decimal comma needs ';' or tab between cells)"
            )
    columns = named_columns(header)
    observed: set[str] = set()
    for column in columns:
        if column.name.lower() in observed:
            raise BadInput(f"{path}: row {kept[0][0]}: column '{column.name}' appears twice")
        observed.add(column.name.lower())
    return Table(
        path=path,
        columns=columns,
        cells=tuple(body),
        lines=tuple(lines),
        decimal_comma=delimiter != ",",
    )


def split_line(text: str, delimiter: str) -> tuple[str, ...]:
    """Cells of one line, quotes and surrounding blanks removed.

    Args:
        text: as it was written.
        delimiter: between the cells of a line.
    """
    cells = text.split(delimiter)
    if '"' in text:
        # a quotation mark that nothing closes takes in more than it bears
        with suppress(csv.Error):
            cells = next(csv.reader([text], delimiter=delimiter))
    result = tuple(cell.strip() for cell in cells)
    return tuple(map(as_read, result)) if "'" in text else result


def parse_number(text: str, where: str, *, decimal_comma: bool = False) -> float:
    """A finite number; raises BadInput that starts with ``where`` and shows what was found.

    Args:
        text: as it was written.
        where: file, row or key, for complaints.
        decimal_comma: whether numbers are written with a decimal comma.
    """
    value = _finite(text, decimal_comma)
    if value is None:
        raise not_numbers(where, text)
    return value


def parse_numbers(
    path: Path, cells: Sequence[tuple[str, str]], of: str = "", *, decimal_comma: bool = False
) -> FloatArray:
    """Finite numbers (n,) of cells; one complaint names the first that are none, counts the others.

    Args:
        path: of the file.
        cells: where each stands, as "row 7", and its text.
        of: stands behind the place of the first in a complaint, as ", column 'x'".
        decimal_comma: whether numbers are written with a decimal comma.

    Raises:
        BadInput: cells that are no finite numbers.
    """
    values = [_finite(text, decimal_comma) for _, text in cells]
    bad = [cell for cell, value in zip(cells, values, strict=True) if value is None]
    if bad:
        (place, text), *more = bad
        raise not_numbers(f"{path}: {place}{of}", text, more)
    return np.array(values, dtype=float)


def not_numbers(where: str, result: object, more: Sequence[tuple[str, object]] = ()) -> BadInput:
    """The complaint of cells that are no finite numbers.

    Args:
        where: file and place of the first, as "a.csv: row 7, column 'x'".
        result: what stands there.
        more: further places, with what stands there.
    """
    named = [f"{place} ({shown(text)})" for place, text in more[:MORE_NAMED]]
    left = len(more) - len(named)
    named += [how_many(left, "other")] if left else []
    texts = [str(each).strip().lower() for each in (result, *(text for _, text in more))]
    hint = (
        "; where nothing was measured leave the row out, or end a sampled record before it"
        if "row" in where and all(not t or t in NOT_A_NUMBER for t in texts)
        else ""
    )
    also = f"; also {', '.join(named[:-1])}{' and ' * (len(named) > 1)}{named[-1]}" if named else ""
    return BadInput(f"{where}: found {shown(result)}, wanted a finite number{also}{hint}")


def _finite(text: str, decimal_comma: bool) -> float | None:
    """The finite number of a cell; None: it is none."""
    plain = text.replace(",", ".") if decimal_comma and "." not in text else text
    value = float(plain) if _NUMBER.fullmatch(plain) else math.nan
    return value if math.isfinite(value) else None


def named_columns(header: Sequence[str]) -> tuple[Column, ...]:
    """Columns of a header: names, and units in brackets; of arrays, as x[1] and x[2], indices.

    Args:
        header: its cells.
    """
    result = [_ELEMENT.fullmatch(text) if len(text) <= LONGEST_HEADER else None for text in header]
    arrays = Counter(match["name"].lower() for match in result if match is not None)
    return tuple(
        Column(text, None, i)
        if match is not None and arrays[match["name"].lower()] > 1
        else named_column(text, i)
        for i, (text, match) in enumerate(zip(header, result, strict=True))
    )


def named_column(text: str, index: int) -> Column:
    """A column of a header's cell: name, and unit in brackets where there is one.

    Args:
        text: the cell.
        index: of the column, from zero.
    """
    match = _HEADER.fullmatch(text) if len(text) <= LONGEST_HEADER else None
    if match and match["name"]:
        return Column(match["name"], match["unit"] or None, index)
    return Column(text, None, index)


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
    if len(text) < 2 or text[0] not in MARKS:
        return False
    try:
        float(text)
    except ValueError:
        return True
    return False


def hertz_of(values: Iterable[float], unit: str, *, where: str) -> FloatArray:
    """Frequencies in Hz of a column, each rounded once: 6.94016 MHz is the tone 6940160 Hz exactly.

    Equal frequencies are then equal, whichever unit each file writes them in. Angular frequencies
    omega are omega/(2 pi): a column in rad/s means these.

    Args:
        values: of the column, shape (n,).
        unit: of the column.
        where: what complaints begin with.

    Raises:
        BadInput: another kind of unit.
    """
    if unit == "Hz":  # nothing is rounded
        return np.fromiter(values, dtype=float)
    if same_kind(unit, "rad/s"):
        return np.array([convert(float(v), unit, "rad/s", where=where) for v in values]) / math.tau
    return np.array([convert(float(v), unit, "Hz", where=where) for v in values])
