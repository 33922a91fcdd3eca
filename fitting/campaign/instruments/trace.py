"""A trace as an instrument wrote it, and what a layout of files has to say of itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.tables import Column, Table

MIN_POINTS = 3

#: Header entries in which an instrument tells its own estimate of the line that it swept.
OWN_ESTIMATES: Mapping[str, str] = {"f_res (Hz)": "frequency_hz", "Q": "q"}


@dataclass(frozen=True, kw_only=True)
class RawTrace:
    """A trace in the units of its file.

    ``frequency``, ``amplitude`` and ``phase`` (n,) (phase may be None), each with its unit as
    written; ``places`` says for every point where it stands in the file; ``notes`` holds header
    entries worth repeating.
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


@dataclass(frozen=True, kw_only=True)
class Selection:
    """What to take from a file that holds more: column names, trace number, chunk.

    Empty names mean the usual ones; ``trace`` counts from 1 (rohde-schwarz); ``chunk`` is the
    sweep's number as LabOne writes it (None: the file must hold one only).
    """

    frequency: str = ""
    amplitude: str = ""
    phase: str = ""
    trace: int = 1
    chunk: int | None = None


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How an instrument writes files: the name of the layout in a campaign, and its reader.

    ``recognises`` says of a file's text whether it is written so; ``read`` takes one trace from it
    (its frequency axis is checked afterwards) and raises BadInput naming file and row; ``keys`` are
    those of ``trace`` and ``chunk`` that have a meaning with it.
    """

    name: str
    read: Callable[[Path, Selection], RawTrace]
    recognises: Callable[[str], bool]
    keys: tuple[str, ...] = ()


def own_estimates(notes: Mapping[str, str]) -> dict[str, float]:
    """What the instrument itself made of its sweep: "frequency_hz" and "q", as far as it says.

    Args:
        notes: the file's own remarks, by name.
    """
    found = {}
    for name, key in OWN_ESTIMATES.items():
        try:
            found[key] = float(notes[name])
        except (KeyError, ValueError):  # a note is not a datum: nothing hangs on it
            continue
    return found


def check_axis(trace: RawTrace) -> None:
    """BadInput for frequencies that are too few or do not rise strictly.

    Args:
        trace: as the file has it.
    """
    if trace.frequency.size < MIN_POINTS:
        raise BadInput(f"{trace.path}: {trace.frequency.size} points; wanted at least {MIN_POINTS}")
    for i in np.flatnonzero(np.diff(trace.frequency) <= 0.0)[:1]:
        before, here = trace.frequency[i], trace.frequency[i + 1]
        what = "appears twice" if here == before else f"follows {before:.12g}: not sorted"
        raise BadInput(
            f"{trace.path}: {trace.places[i + 1]}: frequency {here:.12g} {trace.frequency_unit} "
            f"{what}; wanted strictly rising frequencies"
        )


def unit_of(table: Table, column: Column, example: str) -> str:
    """The unit written in a column's header; raises BadInput if there is none.

    Args:
        table: as it was read.
        column: of the table.
        example: a unit that would do, for the complaint.
    """
    if column.unit is None:
        raise BadInput(
            f"{table.path}: column '{column.name}' has no unit in its header; "
            f"wanted it in brackets, as in '{example}'"
        )
    return column.unit
