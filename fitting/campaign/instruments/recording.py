"""What a file holds, whatever wrote it: named columns of numbers, each with the unit it states."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray, IntArray
from fitting.text.errors import BadInput, did_you_mean, gathered
from fitting.text.once import made_once
from fitting.text.tables import Column, Table, named_column, not_numbers, parse_numbers

Numbers = FloatArray | ComplexArray

#: Columns of a table of text: each is looked at, and more are a matrix that lies on its side.
MOST_COLUMNS = 10_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """A column of a recording: its name, its unit as the file states it (None: it does not).

    ``read`` gives its values (n,), checked then and not before: it may never be needed.
    ``whole`` is its name with the groups of the file that it is in, as "warm/X"; empty: in none.
    ``role`` and ``guessed`` state what it seems to be (`fitting.campaign.recognised`). ``lenient``
    gives its values with NaN where a cell is no number, if it is a column of text.
    """

    name: str
    unit: str | None
    read: Callable[[], Numbers]
    is_complex: bool = False
    whole: str = ""
    role: str = ""
    guessed: bool = False
    lenient: Callable[[], Numbers] | None = None

    def is_called(self, name: str) -> bool:
        """Whether it has this name, capitals apart, alone or with groups that it is in.

        Args:
            name: as "X", "warm/X" or "raw/warm/X".
        """
        wanted = name.lower()
        in_group = "/" in wanted and f"/{self.whole.lower()}".endswith(f"/{wanted}")
        return self.name.lower() == wanted or in_group


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """Columns of one file, all of one length.

    ``places`` states for every point where it is in the file; ``words`` state what the file is;
    ``notes`` hold header entries worth repeating; ``headed`` whether the file names its columns.
    """

    path: Path
    channels: tuple[Channel, ...]
    places: tuple[str, ...]
    words: str = ""
    notes: Mapping[str, str] = field(default_factory=dict)
    headed: bool = True

    def find(self, name: str) -> Channel | None:
        """The column of that name, capitals apart, or None; a unit in brackets states its unit.

        Args:
            name: of the column, as "R", or as "R (uV)" for a file without units, or as "group/R".

        Raises:
            BadInput: the file states another unit.
        """
        exact = next((c for c in self.channels if c.name.lower() == name.lower()), None)
        if exact is not None:
            return exact
        requested = named_column(name, 0)
        result = next((c for c in self.channels if c.is_called(requested.name)), None)
        if result is None or requested.unit is None:
            return result
        if result.unit not in (None, requested.unit):
            raise BadInput(
                f"{self.path}: column '{result.name}' is in {result.unit}; the campaign states "
                f"{requested.unit}"
            )
        return replace(result, unit=requested.unit)

    def column(self, name: str) -> Channel:
        """The column of that name; raises BadInput with the nearest name if there is none.

        Args:
            name: of the column.
        """
        result = self.find(name)
        if result is None:
            present = [c.name for c in self.channels]
            raise BadInput(f"{self.path}: no column '{name}'{did_you_mean(name, present)}")
        return result

    def numbers(self, channel: Channel) -> FloatArray:
        """The finite real numbers of a column, (n,).

        Args:
            channel: of this recording.

        Raises:
            BadInput: complex values, or a value that is no finite number; names its place.
        """
        if channel.is_complex:
            raise BadInput(
                f"{self.path}: column '{channel.name}' holds complex values; wanted real ones"
            )
        values = np.asarray(channel.read(), dtype=float)
        self._check(channel, values)
        return values

    def check(self, channels: Iterable[Channel]) -> None:
        """Complain of every cell of some columns that is no finite number, of all at once.

        Args:
            channels: of this recording.

        Raises:
            BadInput: a line for each column that has such cells.
        """
        gathered(partial(self.values, channel) for channel in channels)

    def values(self, channel: Channel) -> ComplexArray:
        """The finite complex numbers of a column, (n,).

        Args:
            channel: of this recording.
        """
        values = np.asarray(channel.read(), dtype=complex)
        self._check(channel, values)
        return values

    def part(self, rows: IntArray) -> Recording:
        """Some of its points.

        Args:
            rows: their numbers, from 0.
        """

        def taken(channel: Channel) -> Channel:
            return replace(channel, read=lambda: channel.read()[rows])

        return replace(
            self,
            channels=tuple(map(taken, self.channels)),
            places=tuple(self.places[i] for i in rows),
        )

    def _check(self, channel: Channel, values: Numbers) -> None:
        bad = [(self.places[i], values[i].item()) for i in np.flatnonzero(~np.isfinite(values))]
        if bad:
            (place, value), *more = bad
            raise not_numbers(f"{self.path}: {place}, column '{channel.name}'", value, more)


def unit_of(recording: Recording | Table, column: Channel | Column, example: str) -> str:
    """The unit written in a column's header; raises BadInput if there is none.

    Args:
        recording: what was read.
        column: of it.
        example: a unit that would do, for the complaint.
    """
    if column.unit is None:
        hint = ""
        if isinstance(recording, Recording):
            unit = named_column(example, 0).unit
            hint = f", there or in the campaign's columns: '{column.name} ({unit})'"
        raise BadInput(
            f"{recording.path}: column '{column.name}' has no unit in its header; "
            f"wanted it in brackets, as in '{example}'{hint}"
        )
    return column.unit


def channel_of(name: str, unit: str | None, values: Numbers) -> Channel:
    """A column whose values are there already.

    Args:
        name: of the column.
        unit: as the file states it; None: it does not.
        values: (n,).
    """
    return Channel(
        name=name, unit=unit or None, read=lambda: values, is_complex=np.iscomplexobj(values)
    )


def numbered_points(count: int) -> tuple[str, ...]:
    """Places of points that stand in no row.

    Args:
        count: of them.
    """
    return tuple(f"point {k + 1}" for k in range(count))


def of_table(table: Table, words: str = "", notes: Mapping[str, str] | None = None) -> Recording:
    """The recording that a table of text holds.

    Args:
        table: as it was read.
        words: that state what the file is.
        notes: of the file's header.

    Raises:
        BadInput: more columns than anybody names.
    """
    count = len(table.columns)
    if count > MOST_COLUMNS:
        raise BadInput(
            f"{table.path}: has {count} columns; wanted at most {MOST_COLUMNS}: one for each "
            "quantity (are rows and columns exchanged?), or a map whose head has the values of a "
            "control or the frequencies"
        )
    return Recording(
        path=table.path,
        channels=tuple(_of_column(table, column) for column in table.columns),
        places=tuple(f"row {n}" for n in table.lines),
        words=words,
        notes=notes or {},
    )


def of_rows(
    path: Path,
    columns: Sequence[tuple[str, str | None, int]],
    rows: Sequence[tuple[int, Sequence[str]]],
    words: str,
    notes: Mapping[str, str] | None = None,
    *,
    decimal_comma: bool = False,
) -> Recording:
    """The recording that rows of cells hold; one that is too short holds empty cells.

    Args:
        path: of the file.
        columns: name, unit (None: the file does not state it) and place, from 0, of each.
        rows: number in the file and cells of each.
        words: that state what the file is.
        notes: of the file's header.
        decimal_comma: whether numbers are written with a decimal comma.
    """
    width = 1 + max((at for *_, at in columns), default=0)
    table = Table(
        path=path,
        columns=tuple(Column(*column) for column in columns),
        cells=tuple((*cells, *[""] * (width - len(cells))) for _, cells in rows),
        lines=tuple(n for n, _ in rows),
        decimal_comma=decimal_comma,
    )
    return of_table(table, words, notes)


def _of_column(table: Table, column: Column) -> Channel:
    first = table.cells[0][column.index] if table.cells else ""
    is_complex = as_complex(first) is not None

    @made_once  # parts of a recording share its columns
    def read() -> Numbers:
        return _complex_cells(table, column) if is_complex else table.numbers(column)

    return Channel(
        name=column.name,
        unit=column.unit,
        read=read,
        is_complex=is_complex,
        lenient=None if is_complex else partial(table.numbers_or_nan, column),
    )


def _complex_cells(table: Table, column: Column) -> ComplexArray:
    cells = zip(table.texts(column), table.lines, strict=True)
    read = [(text, n, as_complex(text)) for text, n in cells]
    real = [(f"row {n}", text) for text, n, value in read if value is None]
    others = iter(parse_numbers(table.path, real, f", column '{column.name}'"))
    return np.array([next(others) if v is None else v for *_, v in read], dtype=complex)


def as_complex(text: str) -> complex | None:
    """The complex number of a cell, as "1+2j", "(1 - 2i)" or "3j"; None: it is none.

    Args:
        text: the cell.
    """
    plain = text.strip().removeprefix("(").removesuffix(")").replace(" ", "").lower()
    if not plain.endswith(("i", "j")) or "_" in plain or plain[:-1].endswith(("n", "in")):
        return None
    try:
        return complex(plain[:-1].replace("*", "") + "j")
    except ValueError:
        return None
