"""Plain delimited text with units in its header, also ';' with decimal comma."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fitting.campaign.instruments.trace import Layout, RawTrace, Selection, unit_of
from fitting.text.tables import Column, Table, read_table

FREQUENCY_NAMES = ("frequency", "freq", "f")
AMPLITUDE_NAMES = ("amplitude", "magnitude", "level", "r", "voltage")
PHASE_NAMES = ("phase", "theta")


def _read_csv(path: Path, selection: Selection) -> RawTrace:
    table = read_table(path)
    frequency = _pick(table, selection.frequency, FREQUENCY_NAMES)
    amplitude = _pick(table, selection.amplitude, AMPLITUDE_NAMES)
    phase = _pick(table, selection.phase, PHASE_NAMES) if _has_phase(table, selection) else None
    return RawTrace(
        path=path,
        frequency=table.numbers(frequency),
        frequency_unit=unit_of(table, frequency, "frequency (MHz)"),
        amplitude=table.numbers(amplitude),
        amplitude_unit=unit_of(table, amplitude, "amplitude (uV)"),
        phase=None if phase is None else table.numbers(phase),
        phase_unit="" if phase is None else unit_of(table, phase, "phase (deg)"),
        places=tuple(f"row {n}" for n in table.lines),
    )


def _has_phase(table: Table, selection: Selection) -> bool:
    return bool(selection.phase) or any(table.find(name) for name in PHASE_NAMES)


def _pick(table: Table, wanted: str, usual: Sequence[str]) -> Column:
    if wanted:
        return table.column(wanted)
    return next((c for c in map(table.find, usual) if c is not None), None) or table.column(
        usual[0]
    )


LAYOUT = Layout(name="csv", read=_read_csv, recognises=lambda text: True)
