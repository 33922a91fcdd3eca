"""What a file holds, whatever wrote it: named columns of numbers, each with the unit it states.

A `Layout` reads a file as a `Recording`; a `Selection` names what is taken of it, as a `RawTrace`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray, IntArray
from fitting.text.errors import BadInput, did_you_mean, gathered
from fitting.text.files import read_whole
from fitting.text.finding import Finding, Kind, note
from fitting.text.notation import how_many
from fitting.text.once import made_once
from fitting.text.schema import Keys, Text
from fitting.text.tables import (
    Column,
    Table,
    decoded,
    named_column,
    naming_neighbours,
    not_numbers,
    parse_numbers,
)

Numbers = FloatArray | ComplexArray

#: Columns of a table of text: each is looked at, and more are a matrix that lies on its side.
MOST_COLUMNS = 10_000
#: Correlation of two columns, less than one by this, from which they are one quantity.
SAME = 1e-8
#: Columns that a note names.
MOST_NAMED = 12
#: What columns of standard errors are called.
OF_ERRORS = re.compile(
    r"noise|sigma|σ|±|\bstd|\bst\.? ?dev|standard (deviation|error)|stderr|\berrors?\b|\berr\b"
    r"|uncertainty|\bs[de]\b"
)


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

    @property
    def varies(self) -> bool:
        """Whether it holds numbers that differ."""
        try:
            values = self.lenient_values
        except BadInput:  # a column of text
            return False
        values = values[np.isfinite(values)]
        return bool(np.any(values != values[:1]))

    @property
    def lenient_values(self) -> Numbers:
        """Its values (n,), NaN where a cell is no number."""
        values: Numbers = (self.lenient or self.read)()
        return values


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """Columns of one file, all of one length.

    ``places`` states for every point where it is in the file; ``words`` state what the file is, as
    "Touchstone, 1 port, S11"; ``notes`` hold header entries worth repeating; ``headed`` whether the
    file names its columns. Where its columns were recognised, ``layout`` is its name in a campaign
    and ``remarks`` are sentences about what was guessed, and what else is there.
    """

    path: Path
    channels: tuple[Channel, ...]
    places: tuple[str, ...]
    words: str = ""
    notes: Mapping[str, str] = field(default_factory=dict)
    headed: bool = True
    layout: str = ""
    remarks: tuple[str, ...] = ()

    def role(self, name: str) -> Channel | None:
        """The column that was recognised as something, or None.

        Args:
            name: as "frequency".
        """
        return next((c for c in self.channels if c.role == name), None)

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
        wanted = requested.name.lower()
        names = ((c, c.name.lower(), f"/{c.whole.lower()}") for c in self.channels)
        # alone, or with groups that it is in, as "warm/X" or "raw/warm/X"
        ends = f"/{wanted}" if "/" in wanted else "//"
        result = next((c for c, own, whole in names if own == wanted or whole.endswith(ends)), None)
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
        values: FloatArray = self._finite(channel, float)
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
        values: ComplexArray = self._finite(channel, complex)
        return values

    def _finite(self, channel: Channel, kind: type) -> Any:
        values: Any = np.asarray(channel.read(), dtype=kind)
        bad = [(self.places[i], values[i].item()) for i in np.flatnonzero(~np.isfinite(values))]
        if bad:
            (place, value), *more = bad
            raise not_numbers(f"{self.path}: {place}, column '{channel.name}'", value, more)
        return values

    def others(self, *taken: Channel | None) -> list[Channel]:
        """Columns of numbers that vary and are not taken.

        One that is a straight function of a column that is taken, as a distance from the middle of
        a sweep, holds nothing else.

        Args:
            *taken: the columns that are; None of them none.
        """
        used = [channel for channel in taken if channel is not None]
        names = {channel.name for channel in used}
        rest = [c for c in self.channels if c.name not in names and c.varies]
        known = [channel.lenient_values.real for channel in used] if rest else []
        result = []
        for channel in rest:
            with np.errstate(all="ignore"):  # NaN of a column that is taken and does not vary
                like = np.corrcoef([channel.lenient_values.real, *known])
            if not known or not np.any(np.abs(like[0, 1:]) > 1.0 - SAME):
                result.append(channel)
        return result

    def unused(self, *taken: Channel | None, option: str = "") -> tuple[Finding, ...]:
        """A note that names columns that vary and are not taken; none where there are none.

        Args:
            *taken: the others, None of it none.
            option: of a command that takes another column; empty: there is none.
        """
        rest = self.others(*taken)
        if not rest:
            return ()
        errors = tuple(
            c.name for c in rest if OF_ERRORS.search(c.name.lower()) and not c.is_complex
        )
        named = tuple(c.name for c in rest[:MOST_NAMED])
        more = () if len(rest) <= MOST_NAMED else (how_many(len(rest) - MOST_NAMED, "other"),)
        names_of = {"columns": (*(f"'{name}'" for name in named), *more)}
        names_of |= {"file": (self.path.name,), "errors": errors, "option": (option,)}
        return (note(Kind.other_columns, "", names_of),)

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


def of_arrays(
    path: Path, channels: Iterable[Channel], count: int, words: str, **further: Any
) -> Recording:
    """The recording of a file that holds arrays: its points have no rows.

    Args:
        path: of the file.
        channels: its columns, (n,) each.
        count: n, number of points.
        words: that state what the file is.
        **further: fields of the recording.
    """
    places = tuple(f"point {k + 1}" for k in range(count))
    return Recording(path=path, channels=tuple(channels), places=places, words=words, **further)


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


MIN_POINTS = 3

#: Bytes of a file's beginning by which it is recognised.
HEAD_BYTES = 1 << 18

#: Header entries in which an instrument tells its own estimate of the line that it swept.
OWN_ESTIMATES: Mapping[str, str] = {"f_res (Hz)": "frequency_hz", "Q": "q"}


@dataclass(frozen=True, kw_only=True)
class RawTrace:
    """A trace in the units of its file.

    ``frequency``, ``amplitude``, ``phase`` and ``sigma``, standard errors of the amplitudes, (n,)
    (the last two may be None), each with its unit as written; ``places`` states for every point
    where it is in the file; ``notes`` holds header entries worth repeating, ``left_out`` states
    which rows and columns are not here.
    """

    path: Path
    frequency: FloatArray
    frequency_unit: str
    amplitude: FloatArray
    amplitude_unit: str
    places: tuple[str, ...]
    phase: FloatArray | None = None
    phase_unit: str = ""
    sigma: FloatArray | None = None
    sigma_unit: str = ""
    notes: Mapping[str, str] = field(default_factory=dict)
    left_out: tuple[Finding, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Columns(Keys):
    """Names of a trace's columns where they are not the usual ones (empty)."""

    frequency: Text = ""
    """Column of frequencies."""
    amplitude: Text = ""
    """Column of amplitudes."""
    phase: Text = ""
    """Column of phases."""


@dataclass(frozen=True, kw_only=True)
class SweepColumns(Columns):
    """Names of a sweep's columns where they are not the usual ones (empty)."""

    sigma: Text = ""
    """Column of standard errors of the amplitudes, which weigh the points; without it none."""


@dataclass(frozen=True, kw_only=True)
class ComplexColumns(Columns):
    """Names of a complex trace's columns where they are not the usual ones (empty)."""

    x: Text = ""
    """Column of X, the real part."""
    y: Text = ""
    """Column of Y, the imaginary part."""
    amplitude: Text = ""
    """Column of amplitudes, of dB, or of complex values, as S21."""
    drive: Text = ""
    """Column of the drive's amplitude, by which values are divided; without it constant."""


@dataclass(frozen=True, kw_only=True)
class Selection(ComplexColumns, SweepColumns):
    """What to take from a file that holds more: column names, trace number, chunk.

    Empty names mean the usual ones, and a name may state the unit that the file does not, as
    "column 2 (mV)"; ``time`` is of a recording over time, ``further`` of other columns that are
    wanted; ``trace`` counts from 1 (rohde-schwarz, keysight); ``chunk`` is the sweep's number as
    LabOne writes it (None: the file must hold one only); ``header_row`` is the row of the names of
    columns of text, from 1 (None: it is found).
    """

    time: str = ""
    further: tuple[str, ...] = ()
    trace: int = 1
    chunk: int | None = None
    header_row: int | None = None

    @property
    def parts(self) -> dict[str, int]:
        """Where in the file it is, by the keys of a campaign."""
        trace = self.trace if self.trace != 1 else None
        given = {"trace": trace, "chunk": self.chunk, "header_row": self.header_row}
        return {key: value for key, value in given.items() if value is not None}

    @property
    def axis(self) -> str:
        """Name of the column over which the others stand; empty: the usual one."""
        return self.time or self.frequency

    @property
    def values(self) -> tuple[str, ...]:
        """Names of all other columns that are stated."""
        nearby = self.frequency if self.time else ""
        parts = (self.x, self.y, nearby, self.drive, self.sigma)
        given = (self.amplitude, self.phase, *parts, *self.further)
        return tuple(name for name in given if name)


@dataclass(frozen=True)
class Head:
    """The beginning of a file, by which a layout recognises its own: bytes, and text if it is."""

    path: Path
    data: bytes

    @cached_property
    def text(self) -> str:
        """The beginning as text, in whole lines; empty for a file that is not text."""
        whole = len(self.data) < HEAD_BYTES
        result = decoded(self.data if whole else self.data[: self.data.rfind(b"\n") + 1])
        return "" if "\0" in result else result

    @cached_property
    def lines(self) -> tuple[str, ...]:
        """Lines of the text."""
        return tuple(self.text.splitlines())

    @cached_property
    def first_line(self) -> str:
        """The first line that is not blank."""
        return next((line for line in self.lines if line.strip()), "")


def head_of(path: Path) -> Head:
    """The beginning of a file.

    Args:
        path: of the file.

    Raises:
        BadInput: no such file, or not readable.
    """
    with naming_neighbours(path):
        return Head(path, read_whole(path, head=HEAD_BYTES))


@dataclass(frozen=True)
class Layout:
    """How an instrument writes files: the name of the layout in a campaign, and its reader.

    ``recognises`` tests by a file's beginning whether it is written so; ``read`` gives the columns
    that the file holds (or those of the one trace that is selected) and raises BadInput naming
    file and row; ``keys`` are those of ``trace``, ``chunk`` and ``header_row`` that have a
    meaning with it.
    """

    name: str
    read: Callable[[Path, Selection], Recording]
    recognises: Callable[[Head], bool]
    keys: tuple[str, ...] = ()


def own_estimates(notes: Mapping[str, str]) -> dict[str, float]:
    """What the instrument itself made of its sweep: "frequency_hz" and "q", as far as it states.

    Args:
        notes: the file's own remarks, by name.
    """
    result = {}
    for name, key in OWN_ESTIMATES.items():
        try:
            result[key] = float(notes[name])
        except (KeyError, ValueError):  # a note is not a datum: nothing hangs on it
            continue
    return result


def check_axis(path: Path, frequency: FloatArray, unit: str, places: Sequence[str]) -> None:
    """BadInput for frequencies that are too few or do not rise strictly.

    Args:
        path: of the file.
        frequency: (n,), as the file has it.
        unit: of the file.
        places: where each stands.
    """
    if frequency.size < MIN_POINTS:
        count = how_many(frequency.size, "point")
        raise BadInput(f"{path}: {count}; wanted at least {MIN_POINTS}")
    for i in np.flatnonzero(np.diff(frequency) <= 0.0)[:1]:
        before, here = frequency[i], frequency[i + 1]
        what = "appears twice" if here == before else f"follows {before:.12g}: not sorted"
        raise BadInput(
            f"{path}: {places[i + 1]}: frequency {here:.12g} {unit} "
            f"{what}; wanted strictly rising frequencies"
        )
