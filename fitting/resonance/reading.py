"""A file of any instrument as a trace: what its columns are is recognised, or stated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign.instruments.recording import Channel, Recording, Selection, own_estimates
from fitting.campaign.instruments.roles import without_zero
from fitting.campaign.recognised import recognised
from fitting.lines.names import TIME_WAY
from fitting.lines.trace import Trace, swapped, trace_of
from fitting.resonance.control_map import ControlMap, map_of
from fitting.signal.amplitudes import POWERS
from fitting.text.arguments import checked
from fitting.text.arrays import ComplexArray, FloatArray, IntArray
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind, note
from fitting.text.notation import listed
from fitting.text.tables import hertz_of
from fitting.text.units import convert, same_kind

#: Units of squares of amplitudes, with and without the density over frequency.
SQUARES = (*POWERS, *(f"{power}/Hz" for power in POWERS))

#: Names of columns that a complaint lists.
MOST_SHOWN = 12
#: Roles of columns of a sweep whose values are amplitudes; of a noise spectrum it is another.
AMPLITUDE = "amplitude"
#: Unit of amplitudes that were levels over a milliwatt.
ROOT_MW = "(mW)^0.5"


@checked
@dataclass(frozen=True, kw_only=True)
class Columns:
    """Columns and units of a file, as far as it does not state them; empty: recognised.

    Args:
        frequency: Column of frequencies.
        amplitude: Column of amplitudes or complex values; a phase is then used if it is named.
        phase: Column of phases.
        real: Column of real parts, X.
        imaginary: Column of imaginary parts, Y.
        time: Column of times.
        unit_frequency: Unit of frequencies, as "MHz".
        unit_amplitude: Unit of amplitudes or parts, as "mV".
        unit_phase: "deg" or "rad".
        unit_time: Unit of times, as "ms".
        trace: Which of the file's traces, from 1.
        chunk: Which of the file's sweeps, as LabOne numbers them.
        header_row: Row of the columns' names, from 1; None: the last above the numbers.
        drop_missing: Whether rows of a sweep that lack a number are left out.
        average: Whether readings at one frequency are averaged.
    """

    frequency: str = ""
    amplitude: str = ""
    phase: str = ""
    real: str = ""
    imaginary: str = ""
    time: str = ""
    unit_frequency: str = ""
    unit_amplitude: str = ""
    unit_phase: str = ""
    unit_time: str = ""
    trace: int = 1
    chunk: int | None = None
    header_row: int | None = None
    drop_missing: bool = False
    average: bool = False

    @property
    def selection(self) -> Selection:
        """Which part of the file, and the names of columns: a file may hold several sweeps."""
        return Selection(
            frequency=self.frequency,
            amplitude=self.amplitude,
            phase=self.phase,
            x=self.real,
            y=self.imaginary,
            time=self.time,
            trace=self.trace,
            chunk=self.chunk,
            header_row=self.header_row,
        )

    def checked(self) -> Columns:
        """The same columns, if their names do not contradict each other.

        Raises:
            BadInput: names that contradict each other.
        """
        if bool(self.real) != bool(self.imaginary):
            given, wanted = ("real", "imaginary") if self.real else ("imaginary", "real")
            raise BadInput(f"{given}: names a column alone, wanted {wanted}, too")
        if self.real and (self.amplitude or self.phase):
            other = "amplitude" if self.amplitude else "phase"
            raise BadInput(
                f"{other}: is named together with real and imaginary, wanted one or the other"
            )
        return self


@dataclass(frozen=True, kw_only=True, eq=False)
class Roles:
    """The columns of a file by what they are; None where there is none.

    ``axis`` holds frequencies, or times, ``sizes`` amplitudes, or complex values; ``recording``
    states what the file is; ``left_out`` which of its rows are not here, ``part`` where in it they
    are, by the keys of a campaign.
    """

    recording: Recording
    axis: Channel
    sizes: Channel | None = None
    phase: Channel | None = None
    real: Channel | None = None
    imaginary: Channel | None = None
    left_out: tuple[Finding, ...] = ()
    part: Mapping[str, int] = field(default_factory=dict)

    @property
    def frequency(self) -> Channel:
        """The axis of a sweep."""
        return self.axis

    @property
    def is_complex(self) -> bool:
        """Whether there are phases."""
        whole = self.sizes is not None and self.sizes.is_complex
        return whole or self.real is not None or self.phase is not None

    @property
    def values(self) -> tuple[Channel, ...]:
        """Every column of values that is taken."""
        channels = (self.sizes, self.phase, self.real, self.imaginary)
        return tuple(channel for channel in channels if channel is not None)

    @property
    def all(self) -> tuple[Channel, ...]:
        """Every column that is taken."""
        return (self.axis, *self.values)


def roles_of(path: Path, columns: Columns) -> Roles:
    """Which columns of a file are taken for what.

    Args:
        path: of the file.
        columns: what is stated of them.

    Raises:
        BadInput: the file is not readable, holds no response over frequency, or states no unit; a
            line for each column and unit that is wanted.
    """
    roles = sweep_roles(path, columns)
    errors = []
    if roles.axis.unit is None:
        over_time = f'; of a recording over time --time "{roles.axis.name}" --unit-time s'
        errors.append(
            f"{path}: states no unit of its frequencies, column '{roles.axis.name}'; wanted it "
            f"by --unit-frequency, as Hz or MHz{over_time * (not roles.recording.headed)}"
        )
    errors += phase_complaints(roles)
    if errors:
        raise BadInput(*errors)
    return roles


def sweep_roles(path: Path, columns: Columns) -> Roles:
    """The columns of frequencies and of values, in the units that are stated, if any is.

    Args:
        path: of the file.
        columns: what is stated of them.

    Raises:
        BadInput: as `roles_of`, but for units.
    """
    columns = columns.checked()
    recording = recognised(path, columns.selection)
    frequency = column_of(recording, columns.frequency, "frequency")
    if frequency is None:
        what, way = "has no column that seems the frequency", ""
        if recording.role("time") is not None:
            what = "is a recording over time"
            way = f", or fmu-fit line (ff.ringdown) for a free decay, or {TIME_WAY}"
        there = columns_there(recording)
        raise BadInput(
            f"{path}: {what}; there is: {there}; wanted the frequency's name by --frequency{way}"
        )
    recording, frequency, left_out = without_zero(recording, frequency)
    frequency = with_unit(frequency, columns.unit_frequency)
    return replace(value_roles_of(recording, columns, frequency), left_out=left_out)


def column_of(recording: Recording, name: str, *roles: str) -> Channel | None:
    """The column that is named, or else the first one that seems to play one of some roles.

    Args:
        recording: what was read of the file.
        name: of the column; empty: it is not stated.
        roles: which ones.

    Raises:
        BadInput: there is no column of this name.
    """
    if name:
        return recording.column(name)
    return next((c for c in map(recording.role, roles) if c is not None), None)


def value_roles_of(recording: Recording, columns: Columns, axis: Channel) -> Roles:
    """Which columns of a file are taken for its values, in the units that are stated.

    Args:
        recording: what was read of the file.
        columns: what is stated of them.
        axis: the column of frequencies or times.

    Raises:
        BadInput: there is none.
    """
    sizes = phase = real = imaginary = None
    if columns.amplitude or columns.phase:
        sizes = column_of(recording, columns.amplitude, "amplitude")
        phase = recording.column(columns.phase) if columns.phase else None
    else:
        real, whole = column_of(recording, columns.real, "re"), recording.role("complex")
        if columns.real or (real is not None and whole is None):
            imaginary = column_of(recording, columns.imaginary, "im")
        else:
            real, sizes = None, whole or recording.role("amplitude")
            phase = None if whole is not None else recording.role("phase")

    def in_unit(channel: Channel | None, unit: str) -> Channel | None:
        return None if channel is None else with_unit(channel, unit)

    unit = columns.unit_amplitude
    roles = Roles(
        recording=recording,
        axis=axis,
        sizes=in_unit(sizes, unit),
        phase=in_unit(phase, columns.unit_phase),
        real=in_unit(real, unit),
        imaginary=in_unit(imaginary, unit),
        part=columns.selection.parts,
    )
    if roles.sizes is None and (roles.real is None or roles.imaginary is None):
        # cells that are no numbers in the only column that could be an amplitude are named first
        names = {c.name for c in roles.all}
        free = [c for c in recording.channels if c.name not in names and not c.is_complex]
        if len(free) == 1:
            recording.check((*roles.all, free[0]))
        raise BadInput(
            f"{recording.path}: has no column that seems an amplitude; there is: "
            f"{columns_there(recording)}; wanted its name by --amplitude, or --real and --imaginary"
        )
    return roles


def columns_there(recording: Recording) -> str:
    """Names of all columns, for complaints.

    Args:
        recording: what was read of a file.
    """
    names = [f"'{c.name}'" for c in recording.channels]
    return ", ".join((*names[:MOST_SHOWN], *(["..."] * (len(names) > MOST_SHOWN))))


def unused_columns(recording: Recording, taken: Sequence[Channel]) -> tuple[str, ...]:
    """Columns of numbers that vary and are not taken, with their units, as "'T' (K)".

    One that is a straight function of a column that is taken, as a distance from the middle of a
    sweep, holds nothing else.

    Args:
        recording: what was read of a file.
        taken: the columns that are.
    """
    others = recording.others(*taken)
    return tuple(f"'{c.name}'" + f" ({c.unit})" * bool(c.unit) for c in others)


def with_unit(channel: Channel, unit: str) -> Channel:
    """A column in the unit that is stated.

    Args:
        channel: the column.
        unit: that is stated; empty: it is not.
    """
    return replace(channel, unit=unit) if unit else channel


def phase_complaints(roles: Roles) -> list[str]:
    """What is wanted where phases have no unit.

    Args:
        roles: columns of the values.
    """
    if roles.phase is None or roles.phase.unit is not None:
        return []
    return [
        f"{roles.recording.path}: states no unit of its phases, column '{roles.phase.name}'; "
        "wanted it by --unit-phase, deg or rad"
    ]


def read_trace_of(path: Path, columns: Columns) -> Trace:
    """The trace that a file holds, and how it was read.

    Args:
        path: of the file.
        columns: what is stated of its columns.

    Raises:
        BadInput: see `roles_of`; a cell that is no number, a unit of another kind.
    """
    roles = roles_of(path, columns)
    repeated: list[Finding] = []
    if columns.drop_missing:
        finite = np.all([np.isfinite(channel.lenient_values) for channel in roles.all], axis=0)
        if not np.all(finite):
            repeated.append(note(Kind.rows_dropped, count=float(np.sum(~finite))))
            roles = _some_rows(roles, np.flatnonzero(finite))
    recording, sizes = roles.recording, roles.sizes
    try:
        control_map = map_in(roles)
    except BadInput:  # of frequencies that are none all cells are named, of all columns
        recording.check(roles.all)
        raise
    if control_map is not None:
        way = control_map.way(phases=roles.is_complex, drafted=True)
        raise BadInput(f"{path}: is a map, {control_map.words}; wanted one sweep. {way}")
    recording.check(roles.all)
    if (
        sizes is not None
        and not sizes.is_complex
        and swapped(recording.numbers(roles.axis), recording.numbers(sizes))
    ):
        raise BadInput(
            f"{path}: column '{roles.axis.name}', read as the frequency, runs neither up nor down, "
            f"but '{sizes.name}', read as the amplitude, runs evenly: they look swapped; wanted "
            "their names exchanged"
        )
    frequency_hz = hertz_in(roles)
    named = {"frequency": roles.axis, **value_names(roles)}
    read = listed(
        f"{what} '{c.name}' ({c.unit or 'no unit stated'})"
        for what, c in named.items()
        if c is not None
    )
    values, unit, converted = values_in(roles)
    unused = recording.unused(*roles.all)
    reading = [*lead(roles), *unused, *_guesses(roles, columns), *converted]
    steps = np.diff(frequency_hz)
    if np.any(steps < 0.0):
        reading.append(note(Kind.rows_sorted, reversed=float(np.all(steps < 0.0))))
    places = recording.places
    if columns.average:
        count = frequency_hz.size
        frequency_hz, first, group = np.unique(frequency_hz, return_index=True, return_inverse=True)
        means = np.zeros(frequency_hz.size, dtype=np.result_type(values))
        np.add.at(means, group.ravel(), values)
        means /= np.bincount(group.ravel())
        values = means
        places = tuple(places[i] for i in first)
        repeated.append(note(Kind.rows_averaged, count=count, points=frequency_hz.size))
    made = trace_of(frequency_hz, values, unit, source=str(path), places=places)
    reading += repeated
    return replace(
        made, read=read, reading=tuple(reading), instrument=own_estimates(dict(recording.notes))
    )


def _some_rows(roles: Roles, rows: IntArray) -> Roles:
    """The columns of a file with some of its rows, numbered from 0."""

    def taken(channel: Channel) -> Channel:
        return replace(channel, read=lambda: channel.lenient_values[rows], lenient=None)

    names = ("axis", "sizes", "phase", "real", "imaginary")
    parts: dict[str, Any] = {
        name: taken(channel) for name in names if (channel := getattr(roles, name)) is not None
    }
    return replace(roles, recording=roles.recording.part(rows), **parts)


def map_in(roles: Roles) -> ControlMap | None:
    """The map that a file is, where it holds several spectra over a control; else None.

    Args:
        roles: of its columns.

    Raises:
        BadInput: a frequency that is no number.
    """
    frequencies = roles.recording.numbers(roles.frequency)
    return map_of(roles.recording, frequencies, [channel.name for channel in roles.all])


def lead(roles: Roles, sizes: str = AMPLITUDE) -> tuple[Finding, ...]:
    """What a file is, and as what its columns were read.

    Args:
        roles: of its columns.
        sizes: role of the column of sizes.
    """
    names = {"frequency": roles.frequency, **value_names(roles, sizes)}
    left_out = (replace(f, severity="note") for f in roles.left_out)
    return read_note(roles, names), *left_out


def read_note(roles: Roles, names: Mapping[str, Channel | None]) -> Finding:
    """What a file is, and which of its columns is read as what.

    Args:
        roles: of its columns.
        names: columns by what they are.
    """
    known = {role: channel for role, channel in names.items() if channel is not None}
    return note(
        Kind.file_read,
        roles.recording.path.name,
        {
            "format": (roles.recording.words,),
            "roles": tuple(known),
            "columns": tuple(channel.name for channel in known.values()),
            "units": tuple(channel.unit or "" for channel in known.values()),
        },
    )


def values_in(roles: Roles) -> tuple[FloatArray | ComplexArray, str, list[Finding]]:
    """Amplitudes or complex values (n,) of a file, their unit, and what was made of them.

    Args:
        roles: of its columns.

    Raises:
        BadInput: a cell that is no number, a unit of another kind.
    """
    path, recording = roles.recording.path, roles.recording
    if roles.real is not None and roles.imaginary is not None:
        unit = roles.real.unit or "1"
        factor = 1.0
        if roles.imaginary.unit not in (None, roles.real.unit):
            where = f"{path}: column '{roles.imaginary.name}'"
            factor = convert(1.0, str(roles.imaginary.unit), unit, where=where)
        parts = recording.numbers(roles.real) + 1j * factor * recording.numbers(roles.imaginary)
        return parts, unit, []
    assert roles.sizes is not None  # noqa: S101 - roles_of has complained otherwise
    if roles.sizes.is_complex:
        return recording.values(roles.sizes), roles.sizes.unit or "1", []
    sizes, unit, converted = _amplitudes(recording, roles.sizes)
    if roles.phase is None:
        return sizes, unit, converted
    where = f"{path}: column '{roles.phase.name}'"
    radians = convert(1.0, str(roles.phase.unit), "rad", where=where)
    return sizes * np.exp(1j * radians * recording.numbers(roles.phase)), unit, converted


def hertz_in(roles: Roles) -> FloatArray:
    """The frequencies (n,) of a file, Hz.

    Args:
        roles: of its columns.

    Raises:
        BadInput: a cell that is no number, a unit of another kind.
    """
    channel = roles.frequency
    where = f"{roles.recording.path}: column '{channel.name}'"
    unit = str(channel.unit)
    return hertz_of(roles.recording.numbers(channel), unit, where=where)


def _amplitudes(recording: Recording, channel: Channel) -> tuple[FloatArray, str, list[Finding]]:
    """Amplitudes of a column, their unit, and what was made of them."""
    values, unit = recording.numbers(channel), channel.unit or "1"
    converted = note(Kind.values_converted, channel.name, {"unit": (unit,)})
    if unit.startswith("dB"):
        root = ROOT_MW if unit == "dBm" else "1"
        return np.asarray(10.0 ** (values / 20.0)), root, [converted]
    if any(same_kind(unit, power) for power in SQUARES):
        for i in np.flatnonzero(values < 0.0)[:1]:
            raise BadInput(
                f"{recording.path}: {recording.places[i]}, column '{channel.name}': "
                f"{values[i]:.6g} {unit}, wanted a power of zero or more"
            )
        return np.sqrt(values), f"({unit})^0.5", [converted]
    return values, unit, []


def value_names(roles: Roles, sizes: str = AMPLITUDE) -> dict[str, Channel | None]:
    """What each column of values is.

    Args:
        roles: of the columns.
        sizes: role of the column of sizes.
    """
    return {
        sizes: roles.sizes,
        "phase": roles.phase,
        "real part": roles.real,
        "imaginary part": roles.imaginary,
    }


def _guesses(roles: Roles, columns: Columns) -> list[Finding]:
    """Remarks about the columns, where one of those that are taken was guessed.

    What was guessed of a column that is stated, or is not taken then, is not printed.
    """
    given = {columns.frequency, columns.amplitude, columns.phase, columns.real, columns.imaginary}
    taken = {c.name for c in roles.all} - given
    guessed = {c.name for c in roles.recording.channels if c.guessed}
    if not guessed & taken:
        return []
    silent = tuple(f"column '{c.name}' " for c in roles.recording.channels if c.name not in taken)
    remarks = [remark for remark in roles.recording.remarks if not remark.startswith(silent)]
    return [
        note(Kind.file_remark, "", {"text": (f"{remark[0].upper()}{remark[1:]}.",)})
        for remark in remarks
    ]
