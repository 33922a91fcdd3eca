"""One trace of a file, what to take from a file, and what a layout has to state of itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from fitting.campaign.instruments.recording import Recording
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.files import read_head
from fitting.text.finding import Finding
from fitting.text.keys import Keys, Text
from fitting.text.notation import how_many
from fitting.text.tables import decoded, naming_neighbours

MIN_POINTS = 3

#: Bytes of a file's beginning by which it is recognised.
HEAD_BYTES = 1 << 18

#: Header entries in which an instrument tells its own estimate of the line that it swept.
OWN_ESTIMATES: Mapping[str, str] = {"f_res (Hz)": "frequency_hz", "Q": "q"}


@dataclass(frozen=True, kw_only=True)
class RawTrace:
    """A trace in the units of its file.

    ``frequency``, ``amplitude`` and ``phase`` (n,) (phase may be None), each with its unit as
    written; ``places`` states for every point where it is in the file; ``notes`` holds header
    entries worth repeating, ``left_out`` states which rows are not here, and why.
    """

    path: Path
    frequency: FloatArray
    frequency_unit: str
    amplitude: FloatArray
    amplitude_unit: str
    places: tuple[str, ...]
    phase: FloatArray | None = None
    phase_unit: str = ""
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
class ComplexColumns(Columns):
    """Names of a complex trace's columns where they are not the usual ones (empty)."""

    x: Text = ""
    """Column of X, the real part."""
    y: Text = ""
    """Column of Y, the imaginary part."""
    amplitude: Text = ""
    """Column of amplitudes, of dB, or of complex values, as S21."""
    drive: Text = ""
    """Column of the drive's amplitude, which values are divided by; without it the drive is
    constant."""


@dataclass(frozen=True, kw_only=True)
class Selection(ComplexColumns):
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
        given = {"trace": self.trace if self.trace != 1 else None, "chunk": self.chunk}
        given["header_row"] = self.header_row
        return {key: value for key, value in given.items() if value is not None}

    @property
    def axis(self) -> str:
        """Name of the column over which the others stand; empty: the usual one."""
        return self.time or self.frequency

    @property
    def values(self) -> tuple[str, ...]:
        """Names of all other columns that are stated."""
        nearby = self.frequency if self.time else ""
        given = (self.amplitude, self.phase, self.x, self.y, nearby, self.drive, *self.further)
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
        return Head(path, read_head(path, HEAD_BYTES))


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
