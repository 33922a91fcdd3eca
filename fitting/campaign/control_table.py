"""Spectra at several values of control quantities, from one long table or from a list of files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from fitting.campaign.file import TraceFormat
from fitting.campaign.instruments import Channel, Recording, read_trace, unit_of
from fitting.campaign.instruments.plain import LEAST_POINTS, read_spectra_table
from fitting.campaign.instruments.recording import of_table
from fitting.campaign.instruments.roles import AMPLITUDE, FREQUENCY
from fitting.signal.amplitudes import to_peak
from fitting.text.arrays import BoolArray, FloatArray, IntArray
from fitting.text.errors import BadInput, gathered
from fitting.text.frequency import hertz_of
from fitting.text.notation import hertz, how_many
from fitting.text.tables import Table
from fitting.text.written import Written

S = TypeVar("S")

#: Column that names the file of each spectrum.
FILE = "file"
#: Columns that a spectrum's own points, or their file, stand in.
OWN_COLUMNS = ("frequency", "amplitude", FILE)
#: A line is looked for so far from its harmonic, in fundamentals: odd ones are two apart.
REACH = 0.8


@dataclass(frozen=True, kw_only=True)
class MeasuredSpectrum:
    """Peak amplitudes (n,) at ``frequency_hz`` (n,), under ``controls`` as they were written.

    ``drive`` (n,) is the amplitude of the drive over its level, None where no column states it.
    """

    label: str
    controls: Mapping[str, Written]
    frequency_hz: FloatArray
    amplitude: FloatArray
    source: Path
    drive: FloatArray | None = None


def read_spectra(
    path: Path,
    trace: TraceFormat,
    controls: Sequence[str],
    drive_column: str = "",
    fundamental_hz: float | None = None,
    range_hz: tuple[float, float] = (0.0, float("inf")),
) -> tuple[MeasuredSpectrum, ...]:
    """All spectra of a table, each by the values of its controls.

    Args:
        path: of the table, with all points or with a row for each spectrum.
        trace: how the points are read.
        controls: columns of the control quantities.
        drive_column: column of the drive's amplitude; empty: none has it.
        fundamental_hz: of a periodic drive, Hz, of which only the odd harmonics are taken.
        range_hz: first and last frequency that is taken, Hz.

    Raises:
        BadInput: no such file or column, values that are no numbers, frequencies that do not rise
            or are there twice, two spectra at the same values, fewer than two spectra.
    """
    table = read_spectra_table(path)
    places = places_of(table, controls)
    recording = of_table(table)
    taken = {each.lower() for each in (*controls, drive_column)}

    def spectrum_at(place: ControlPlace) -> MeasuredSpectrum:
        own = file_at(table, place)
        if own is not None:
            raw, drive = read_trace(own, trace.layout, trace.selection), None
            where = f"{own}: column 'frequency'"
            f = raw.frequency * _hertz(raw.frequency_unit, where)
            sizes, unit, rows = raw.amplitude, raw.amplitude_unit, raw.places
        else:
            own = table.path
            f, sizes, unit, drive = _points_of(recording, trace, taken, drive_column, place.rows)
            rows = tuple(recording.places[i] for i in place.rows)
        spectrum = MeasuredSpectrum(
            label=place.label,
            controls=place.controls,
            frequency_hz=f,
            amplitude=to_peak(sizes, unit, trace.amplitude, str(own), rows),
            source=own,
            drive=drive,
        )
        if fundamental_hz is not None:
            spectrum = with_harmonics(spectrum, fundamental_hz)
        where = f"{own}: the spectrum at {place.label}"
        kept = inside(spectrum.frequency_hz, range_hz, where)
        if not np.any(spectrum.amplitude[kept] > 0.0):
            raise BadInput(f"{where}: every amplitude is zero; wanted a resonance")
        return replace(
            spectrum,
            frequency_hz=spectrum.frequency_hz[kept],
            amplitude=spectrum.amplitude[kept],
            drive=None if spectrum.drive is None else spectrum.drive[kept],
        )

    return tuple(spectra_at(table, places, spectrum_at))


def _hertz(unit: str, where: str) -> float:
    """Hz in one of the unit: of many points at once, each rounded twice."""
    return float(hertz_of([1.0], unit, where=where)[0])


def _points_of(
    recording: Recording, trace: TraceFormat, taken: Set[str], drive_column: str, rows: IntArray
) -> tuple[FloatArray, FloatArray, str, FloatArray | None]:
    """Frequencies in Hz, amplitudes, their unit and the drive in rows of a table, (n,) each."""
    path, wanted = recording.path, trace.selection
    places = [recording.places[i] for i in rows]

    def column(name: str, usual: Sequence[str]) -> Channel:
        """The column of the wanted name, else of the first usual one that is no control."""
        if name:
            return recording.column(name)
        there = (recording.find(each) for each in usual if each not in taken)
        first = next((each for each in there if each is not None), None)
        return first or recording.column(usual[0])

    frequency = column(wanted.frequency, FREQUENCY)
    amplitude = column(wanted.amplitude, AMPLITUDE)
    unit = unit_of(recording, frequency, "frequency (Hz)")
    f = _hertz(unit, f"{path}: column '{frequency.name}'") * recording.numbers(frequency)[rows]
    for i in np.flatnonzero(f < 0.0)[:1]:
        raise BadInput(f"{path}: {places[i]}: frequency {f[i]:.12g} Hz; wanted one from zero on")
    for i in np.flatnonzero(np.diff(f) <= 0.0)[:1]:
        raise BadInput(
            f"{path}: {places[i + 1]}: frequency {f[i + 1]:.12g} Hz follows {f[i]:.12g} Hz; wanted "
            "strictly rising ones at each value of the controls"
        )
    unit = unit_of(recording, amplitude, "amplitude (uV)")
    values = recording.numbers(amplitude)[rows]
    driven = recording.find(drive_column) if drive_column else None
    drive = None if driven is None else recording.numbers(driven)[rows]
    if drive is not None and np.any(drive <= 0.0):
        bad = places[int(np.argmax(drive <= 0.0))]
        raise BadInput(f"{path}: {bad}, column '{drive_column}': wanted more than zero")
    return f, values, unit, drive


@dataclass(frozen=True, kw_only=True)
class ControlPlace:
    """One value of the controls: its label, the controls as written, its rows in the table (n,)."""

    label: str
    controls: Mapping[str, Written]
    rows: IntArray


def places_of(table: Table, controls: Sequence[str]) -> tuple[ControlPlace, ...]:
    """The values of the controls in a table, in its order: a row each, where a column names files.

    Args:
        table: with all points, or with a row for each spectrum.
        controls: columns of it.

    Raises:
        BadInput: no such column, values that are no numbers, one place alone or twice, fewer rows
            than a spectrum has.
    """
    columns = [table.column(name) for name in controls]
    units = [unit_of(table, c, f"{c.name} (V)") for c in columns]
    values = np.column_stack([table.numbers(c) for c in columns])
    listed = table.find(FILE)
    if listed is not None:
        rows = [np.array([i]) for i in range(len(values))]
    else:
        _, first, group = np.unique(values, axis=0, return_index=True, return_inverse=True)
        order = np.argsort(first)  # as the file has them
        rows = [np.flatnonzero(group.ravel() == k) for k in order]
    places = []
    for mine in rows:
        written = {
            c.name: Written(float(v), unit, f"{table.path}: row {table.lines[mine[0]]}, '{c.name}'")
            for c, v, unit in zip(columns, values[mine[0]], units, strict=True)
        }
        label = ", ".join(
            f"{v:g} {unit}".removesuffix(" 1")
            for v, unit in zip(values[mine[0]], units, strict=True)
        )
        places.append(ControlPlace(label=label, controls=written, rows=mine))
    labels = [place.label for place in places]
    for k, label in enumerate(labels):
        if label in labels[:k]:
            line = table.lines[places[k].rows[0]]
            raise BadInput(
                f"{table.path}: row {line}: is the second spectrum at {label}; wanted one"
            )
    if len(places) < 2:
        raise BadInput(
            f"{table.path}: one spectrum, at {labels[0]}; wanted several values of "
            f"{', '.join(controls)}"
        )
    most = max(place.rows.size for place in places)
    if listed is None and most < LEAST_POINTS:
        names = ", ".join(controls)
        raise BadInput(
            f"{table.path}: {len(places)} values of {names}, at each {how_many(most, 'point')} or "
            f"fewer; wanted at least {LEAST_POINTS} at each (rows of one spectrum have the very "
            f"same value of {names})"
        )
    return tuple(places)


def spectra_at(
    table: Table, places: Sequence[ControlPlace], read: Callable[[ControlPlace], S]
) -> list[S]:
    """What is read at every place, with the complaints about all files, or about one table.

    Args:
        table: whose places they are.
        places: that are read.
        read: what is measured at a place.

    Raises:
        BadInput: a place cannot be read.
    """
    try:
        return gathered([partial(read, place) for place in places])
    except BadInput as error:
        if table.find(FILE) is not None:
            raise
        # one table: what is wrong with its first spectrum is mostly wrong with all
        further = f" (and {len(error.args) - 1} more such complaints)" * (len(error.args) > 1)
        raise BadInput(f"{error.args[0]}{further}") from error


def file_at(table: Table, place: ControlPlace) -> Path | None:
    """The file of a place's own spectrum, None where its points are rows of the table.

    Args:
        table: whose place it is.
        place: one value of the controls.
    """
    listed = table.find(FILE)
    return None if listed is None else table.path.parent / table.texts(listed)[place.rows[0]]


def inside(frequency_hz: FloatArray, range_hz: tuple[float, float], where: str) -> BoolArray:
    """Which points of a spectrum lie within a range, (n,).

    Args:
        frequency_hz: of the points, (n,), Hz.
        range_hz: first and last frequency.
        where: what complaints name.

    Raises:
        BadInput: fewer than a spectrum has.
    """
    low, high = range_hz
    kept = (frequency_hz >= low) & (frequency_hz <= high)
    kept &= frequency_hz > 0.0  # spectra of Fourier transforms begin with a constant
    count = int(np.count_nonzero(kept))
    if count < LEAST_POINTS:
        between = "" if high == np.inf else f" from {hertz(low)} to {hertz(high)}"
        raise BadInput(
            f"{where} has {how_many(count, 'point')} to fit{between}; wanted at least "
            f"{LEAST_POINTS}"
        )
    return np.asarray(kept)


def with_harmonics(spectrum: MeasuredSpectrum, fundamental_hz: float) -> MeasuredSpectrum:
    """The odd harmonics of a periodic drive that a spectrum shows as lines.

    Of the points within 0.8 fundamentals of a harmonic the highest is taken if it stands above both
    its neighbours; the amplitude is that of the parabola through the logarithms of the three, which
    is the line's own where the window of the transform is smooth, not the one of the nearest bin.

    Args:
        spectrum: as it was measured.
        fundamental_hz: frequency of the drive's period, Hz.
    """
    f, a = spectrum.frequency_hz, spectrum.amplitude
    result = []
    for n in range(1, int(f[-1] / fundamental_hz) + 1, 2):
        near = np.flatnonzero(np.abs(f - n * fundamental_hz) < REACH * fundamental_hz)
        k = int(near[np.argmax(a[near])]) if near.size else 0
        if not 0 < k < f.size - 1 or min(a[k - 1 : k + 2]) <= 0.0:
            continue
        left, top, right = np.log(a[k - 1 : k + 2])
        bend = left - 2.0 * top + right
        if bend < 0.0 and top >= max(left, right):
            height = top - (left - right) ** 2 / (8.0 * bend)
            result.append((n * fundamental_hz, float(np.exp(height)), k))
    if not result:
        return replace(spectrum, frequency_hz=np.empty(0), amplitude=np.empty(0), drive=None)
    lines, amplitudes, bins = (np.array(column) for column in zip(*result, strict=True))
    drive = None if spectrum.drive is None else spectrum.drive[bins.astype(int)]
    return replace(spectrum, frequency_hz=lines, amplitude=amplitudes, drive=drive)
