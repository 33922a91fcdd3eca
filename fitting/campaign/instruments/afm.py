"""The tab separated sweep of a scanning probe controller (Nanonis .dat)."""

from __future__ import annotations

from pathlib import Path

from fitting.campaign.instruments.recording import (
    Channel,
    Recording,
    channel_of,
    of_table,
    unit_of,
)
from fitting.campaign.instruments.roles import TIME, usual
from fitting.campaign.instruments.trace import Head, Layout, Selection
from fitting.text.errors import BadInput
from fitting.text.tables import Table, parse_table, read_text

#: Columns in a complaint.
MOST_NAMES = 8


def _read_afm(path: Path, _: Selection) -> Recording:
    """Header lines ``name<tab>value``, ``[DATA]``, a header with units, tab separated columns.

    The frequency is the sum of the columns "Center Frequency" and "Frequency Shift" where the
    controller writes these.
    """
    lines = list(enumerate(read_text(path).splitlines(), start=1))
    begin = next((i for i, (_, text) in enumerate(lines) if text.strip() == "[DATA]"), None)
    if begin is None:
        raise BadInput(f"{path}: no line '[DATA]'; wanted the controller's frequency sweep file")
    table = parse_table(path, lines[begin + 1 :])
    head = [text.split("\t") for _, text in lines[:begin]]
    notes = {cells[0]: cells[1].strip() for cells in head if len(cells) > 1 and cells[1].strip()}
    made = of_table(table, f"Nanonis, {notes.get('Experiment', 'experiment not told')}", notes)
    if made.find("Frequency") is not None or usual(made, TIME) is not None:
        return made
    if not any(c.name.lower().startswith("center freq") for c in table.columns):
        names = [c.name for c in table.columns]
        there = ", ".join(names[:MOST_NAMES]) + (", ..." if len(names) > MOST_NAMES else "")
        raise BadInput(
            f"{path}: is a Nanonis file of the experiment '{notes.get('Experiment', 'not told')}', "
            "not a sweep of the frequency; wanted columns 'Frequency', or 'Center Frequency' and "
            f"'Frequency Shift', or 'Time' of a recording, there is: {there}"
        )
    return Recording(
        path=path,
        channels=(_sum_of_frequencies(table), *made.channels),
        places=made.places,
        words=made.words,
        notes=notes,
    )


def _sum_of_frequencies(table: Table) -> Channel:
    shift, center = table.column("Frequency Shift"), table.column("Center Frequency")
    unit = unit_of(table, shift, "Frequency Shift (Hz)")
    if unit_of(table, center, "Center Frequency (Hz)") != unit:
        raise BadInput(
            f"{table.path}: 'Frequency Shift' is in {unit} and 'Center Frequency' in "
            f"{center.unit}; wanted the same unit, because they are added"
        )
    return channel_of("Frequency", unit, table.numbers(shift) + table.numbers(center))


def _recognises(head: Head) -> bool:
    return any(line.strip() == "[DATA]" for line in head.lines)


LAYOUT = Layout(name="afm", read=_read_afm, recognises=_recognises)
