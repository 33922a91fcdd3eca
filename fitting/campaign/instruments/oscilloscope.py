"""The CSV of oscilloscopes whose settings stand beside the numbers: Tektronix, Rigol.

Those that write them above (Keysight, PicoScope) are plain columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from fitting.campaign.instruments.recording import Recording, channel_of
from fitting.campaign.instruments.trace import Head, Layout, Selection
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, gathered
from fitting.text.loose_tables import UNITS
from fitting.text.notation import how_many
from fitting.text.tables import parse_number, parse_numbers, read_text, split_line


def _read_oscilloscope(path: Path, _: Selection) -> Recording:
    lines = read_text(path).splitlines()
    head = Head(path, "\n".join(lines[:2]).encode())
    return _rigol(path, lines) if _is_rigol(head) else _tektronix(path, lines)


def _tektronix(path: Path, lines: list[str]) -> Recording:
    """``name,value,,x,y`` on every line: settings in the first three cells, numbers in the next."""
    rows = [(n, split_line(t, ",")) for n, t in enumerate(lines, start=1) if t.strip()]
    settings = {cells[0]: cells[1] for _, cells in rows if len(cells) > 1 and cells[0]}
    for n, cells in rows:
        if len(cells) < 5:
            raise BadInput(
                f"{path}: row {n} has {how_many(len(cells), 'cell')}, wanted 5 of a Tektronix file"
            )
    x, y = gathered(partial(_column, path, rows, at, f", column {at + 1}") for at in (3, 4))
    unit = settings.get("Horizontal Units", "s")
    x_unit = UNITS.get(unit.lower(), unit)
    y_unit = settings.get("Vertical Units", "")
    source = settings.get("Source", "channel")
    return Recording(
        path=path,
        channels=(
            channel_of("Frequency" if x_unit == "Hz" else "Time", x_unit, x),
            channel_of(source, UNITS.get(y_unit.lower(), y_unit) or None, y),
        ),
        places=tuple(f"row {n}" for n, _ in rows),
        words=f"Tektronix oscilloscope, {source}",
        notes=settings,
    )


def _rigol(path: Path, lines: list[str]) -> Recording:
    """``X,CH1,CH2,Start,Increment`` over ``Sequence,Volt,Volt,-6e-5,2e-8``, then numbered rows."""
    names, units = (split_line(line, ",") for line in lines[:2])
    places = [name.lower() for name in names]
    start, step = (
        parse_number(units[places.index(key)], f"{path}: row 2, '{key}'")
        for key in ("start", "increment")
    )
    channels = [k for k in range(1, places.index("start")) if names[k]]
    rows = [(n, split_line(t, ",")) for n, t in enumerate(lines[2:], start=3) if t.strip()]
    values = gathered(
        partial(_column, path, rows, at, f", column '{names[at]}'") for at in channels
    )
    return Recording(
        path=path,
        channels=(
            channel_of("Time", "s", start + step * np.arange(float(len(rows)))),
            *(
                channel_of(names[at], UNITS.get(units[at].lower(), units[at]), values[j])
                for j, at in enumerate(channels)
            ),
        ),
        places=tuple(f"row {n}" for n, _ in rows),
        words=f"Rigol oscilloscope, {', '.join(names[at] for at in channels)}",
    )


def _column(
    path: Path, rows: Sequence[tuple[int, tuple[str, ...]]], at: int, of: str
) -> FloatArray:
    """Numbers of a column, ``at`` its number from 0; ``of`` names it in complaints."""
    cells = [(f"row {n}", row[at] if at < len(row) else "") for n, row in rows]
    return parse_numbers(path, cells, of)


def _is_rigol(head: Head) -> bool:
    if len(head.lines) < 2:
        return False
    names = [cell.lower() for cell in split_line(head.lines[0], ",")]
    beside = len(split_line(head.lines[1], ",")) >= len([n for n in names if n])
    return names[:1] == ["x"] and {"start", "increment"} <= set(names) and beside


def _recognises(head: Head) -> bool:
    return (
        head.first_line.lower().startswith(("record length,", '"record length",'))
        and (len(split_line(head.first_line, ",")) >= 5)
    ) or _is_rigol(head)


LAYOUT = Layout(name="oscilloscope", read=_read_oscilloscope, recognises=_recognises)
