"""A file over time as what was recorded of a free decay: its columns are recognised, or stated."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from fitting.campaign.instruments.recording import Channel, Recording
from fitting.campaign.recognised import recognised
from fitting.lines.trace import AMPLITUDES, PHASORS, DecayRecord, decay_record_of
from fitting.resonance.reading import (
    Columns,
    Roles,
    column_of,
    columns_there,
    phase_complaints,
    read_note,
    value_names,
    value_roles_of,
    values_in,
    with_unit,
)
from fitting.signal.time_grid import spacing_s
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind, note
from fitting.text.tables import hertz_of
from fitting.text.units import convert, is_frequency

#: Names of columns that hold amplitudes, in small letters.
OF_AMPLITUDES = ("r", "amplitude", "magnitude", "mag", "amp", "level", "envelope")


def is_over_time(path: Path, columns: Columns) -> bool:
    """Whether a file holds a recording over time, and no sweep of the frequency.

    Args:
        path: of the file.
        columns: what is stated of its columns.

    Raises:
        BadInput: the file is not readable.
    """
    if columns.time or columns.frequency:
        return bool(columns.time)
    known = recognised(path, columns.selection)
    return known.role("time") is not None and known.role("frequency") is None


def decay_roles_of(path: Path, columns: Columns) -> Roles:
    """The columns of a file over time by what they are taken for.

    Args:
        path: of the file.
        columns: what is stated of its columns.

    Raises:
        BadInput: no column of times or values, one without a unit, a cell that is no number.
    """
    columns = columns.checked()
    recording = recognised(path, columns.selection)
    time = column_of(recording, columns.time, "time")
    if time is None:
        raise BadInput(
            f"{path}: has no column that seems the time; there is: {columns_there(recording)}; "
            "wanted its name by --time"
        )
    time = with_unit(time, columns.unit_time)
    roles = value_roles_of(recording, columns, time)
    errors = phase_complaints(roles)
    if time.unit is None:
        errors.append(
            f"{path}: states no unit of its times, column '{time.name}'; wanted it by --unit-time, "
            "as s or ms"
        )
    if errors:
        raise BadInput(*errors)
    recording.check(roles.all)
    return roles


def read_decay_of(path: Path, columns: Columns) -> DecayRecord:
    """The record that a file over time holds, and how it was read.

    Args:
        path: of the file.
        columns: what is stated of its columns.

    Raises:
        BadInput: as `decay_roles_of`; times that are not even.
    """
    roles = decay_roles_of(path, columns)
    recording, time = roles.recording, roles.axis
    where = f"{path}: column '{time.name}'"
    time_s = convert(1.0, str(time.unit), "s", where=where) * recording.numbers(time)
    spacing_s(time_s, str(path), recording.places)
    values, unit, converted = values_in(roles)
    # names or units show what was recorded: levels and powers are no samples
    kind, sizes = PHASORS if roles.is_complex else "", roles.sizes
    if sizes is not None and not kind:
        changed = unit != (sizes.unit or "1")
        kind = AMPLITUDES if changed or sizes.name.lower() in OF_AMPLITUDES else ""
    # one column by itself may hold samples as well as amplitudes
    names = value_names(roles) if kind else {"values": sizes}
    reference_hz, demodulated = _reference(recording, columns)
    # columns that may have been meant as well, where nothing shows which one is
    guessed = any(c.guessed for c in recording.channels if c.name in {t.name for t in roles.all})
    others = recording.unused(*roles.all, option="--amplitude" if guessed else "")
    return replace(
        decay_record_of(time_s, values, unit, str(path)),
        kind=kind,
        reference_hz=reference_hz,
        reading=(read_note(roles, {"time": time, **names}), *converted, *demodulated, *others),
    )


def _reference(recording: Recording, columns: Columns) -> tuple[float, tuple[Finding, ...]]:
    """What was demodulated at, Hz, where a column that does not change states it; else NaN.

    Raises:
        BadInput: the column that is named changes.
    """
    named = recording.column(columns.frequency) if columns.frequency else None
    named = None if named is None else with_unit(named, columns.unit_frequency)
    tried = [named] if named is not None else filter(_is_frequency, recording.channels)
    for channel in tried:
        values = recording.numbers(channel)
        where = f"{recording.path}: column '{channel.name}'"
        if np.ptp(values) > 0.0:
            if named is None:
                continue
            raise BadInput(
                f"{where}: changes from {np.min(values):.9g} to {np.max(values):.9g}; wanted the "
                "one frequency at which the record was demodulated"
            )
        if channel.unit is None:
            raise BadInput(f"{where}: states no unit; wanted it by --unit-frequency, as Hz or MHz")
        at_hz = float(hertz_of(values[:1], channel.unit, where=where)[0])
        return at_hz, (note(Kind.demodulated_at, channel.name, frequency_hz=at_hz),)
    return math.nan, ()


def _is_frequency(channel: Channel) -> bool:
    return bool(channel.unit) and not channel.is_complex and is_frequency(str(channel.unit))
