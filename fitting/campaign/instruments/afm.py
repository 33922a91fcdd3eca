"""The tab separated frequency sweep of a scanning probe controller."""

from __future__ import annotations

from pathlib import Path

from fitting.campaign.instruments.trace import Layout, RawTrace, Selection, unit_of
from fitting.text.errors import BadInput
from fitting.text.tables import parse_table, read_text


def _read_afm(path: Path, selection: Selection) -> RawTrace:
    """Header lines ``name<tab>value``, ``[DATA]``, a header with units, tab separated columns.

    The frequency is the sum of the columns "Center Frequency" and "Frequency Shift".
    """
    lines = list(enumerate(read_text(path).splitlines(), start=1))
    begin = next((i for i, (_, text) in enumerate(lines) if text.strip() == "[DATA]"), None)
    if begin is None:
        raise BadInput(f"{path}: no line '[DATA]'; wanted the controller's frequency sweep file")
    table = parse_table(path, lines[begin + 1 :])
    shift, center = table.column("Frequency Shift"), table.column("Center Frequency")
    unit = unit_of(table, shift, "Frequency Shift (Hz)")
    if unit_of(table, center, "Center Frequency (Hz)") != unit:
        raise BadInput(
            f"{path}: 'Frequency Shift' is in {unit} and 'Center Frequency' in {center.unit}; "
            "wanted the same unit, because they are added"
        )
    amplitude = table.column(selection.amplitude or "Amplitude")
    phase = table.find(selection.phase or "Phase")
    head = [text.split("\t") for _, text in lines[:begin]]
    notes = {cells[0]: cells[1].strip() for cells in head if len(cells) > 1 and cells[1].strip()}
    return RawTrace(
        path=path,
        frequency=table.numbers(shift) + table.numbers(center),
        frequency_unit=unit,
        amplitude=table.numbers(amplitude),
        amplitude_unit=unit_of(table, amplitude, "Amplitude (m)"),
        phase=table.numbers(phase) if phase else None,
        phase_unit=unit_of(table, phase, "Phase (deg)") if phase else "",
        places=tuple(f"row {n}" for n in table.lines),
        notes=notes,
    )


def _recognises(text: str) -> bool:
    return any(line.strip() == "[DATA]" for line in text.splitlines())


LAYOUT = Layout(name="afm", read=_read_afm, recognises=_recognises)
