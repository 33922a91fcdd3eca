"""The CSV of Siglent's oscilloscopes: settings, the channels, then seconds and a value of each.

    Record Length,Analog:1400
    Vertical Units,CH1:V,CH2:A
    ...
    Source,CH1,CH2
    Second,Value,Value

Older ones write "Second,Volt" and no units; some begin with the line of the channels.
"""

from __future__ import annotations

import re
from pathlib import Path

from fitting.campaign.instruments.recording import Recording, of_table
from fitting.campaign.instruments.trace import Head, Layout, Selection
from fitting.text.errors import BadInput
from fitting.text.loose_tables import UNITS, cells_of
from fitting.text.tables import parse_table, read_text

#: Lines among which the head of the columns stands.
_HEAD_LINES = 40
_TIME, _UNITS, _SOURCE, _MODEL = "second", "vertical units", "source", "model number"
_UNIT = re.compile(r"(?P<channel>\w+)\s*:\s*(?P<unit>[^\s,:]+)")


def _read_siglent(path: Path, _: Selection) -> Recording:
    lines = [text.strip().rstrip(",") for text in read_text(path).splitlines()]
    at = _head_at(lines)
    if at < 0:
        raise BadInput(
            f"{path}: no row 'Second,Value'; wanted the CSV of a Siglent oscilloscope, seconds and "
            "a value of each channel"
        )
    settings = {
        cells[0].lower(): ",".join(cells[1:])
        for cells in (cells_of(text, ",") for text in lines[:at])
        if cells
    }
    kinds = cells_of(lines[at], ",")[1:]
    names = [name for name in settings.get(_SOURCE, "").split(",") if name]
    units = {m["channel"]: m["unit"] for m in _UNIT.finditer(settings.get(_UNITS, ""))}
    named = len(names) == len(kinds)
    columns = ["Time (s)"]
    for k, kind in enumerate(kinds):
        name = names[k] if named else f"CH{k + 1}"
        unit = units.get(name, "") or UNITS.get(kind.lower(), "")
        columns.append(f"{name} ({unit})" if unit else name)
    rows = list(enumerate(lines[at + 1 :], start=at + 2))
    table = parse_table(path, [(at + 1, ",".join(columns)), *rows])
    return of_table(table, f"Siglent oscilloscope {settings.get(_MODEL, '')}".strip())


def _head_at(lines: list[str] | tuple[str, ...]) -> int:
    """Where the head of the columns stands; -1: nowhere."""
    for i, text in enumerate(lines[:_HEAD_LINES]):
        cells = cells_of(text, ",")
        if len(cells) > 1 and cells[0].lower() == _TIME:
            return i
    return -1


def _recognises(head: Head) -> bool:
    first = head.first_line.lower()
    return first.startswith(("record length,", "source,ch")) and _head_at(head.lines) > 0


LAYOUT = Layout(name="siglent", read=_read_siglent, recognises=_recognises)
