"""The CSV of Keysight's and Agilent's network analysers: PNA, ENA, FieldFox."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from fitting.campaign.instruments.recording import Channel, Recording, channel_of, of_table
from fitting.campaign.instruments.trace import Head, Layout, Selection
from fitting.text.errors import BadInput
from fitting.text.loose_tables import UNITS, is_number
from fitting.text.notation import how_many
from fitting.text.tables import Column, Table, read_text, split_line

_KINDS = {
    **dict.fromkeys(("real", "re"), "real"),
    **dict.fromkeys(("imag", "im", "imaginary"), "imag"),
    **dict.fromkeys(("db", "logmag"), "dB"),
    **dict.fromkeys(("mag", "lin mag", "linmag", "lin", "u"), "1"),
    **dict.fromkeys(("deg", "phase", "ang", "degrees", "°"), "deg"),
}
#: A block of one channel; other formats begin theirs otherwise (MDIF: "BEGIN ACDATA").
_BEGIN = re.compile(r"\s*BEGIN(\s+CH\d+_DATA)?[\s,]*", re.IGNORECASE)
_ABOVE = re.compile(r"!\s*(?P<key>FREQ UNIT|DATA UNIT|DATA)\s+(?P<value>.*)", re.IGNORECASE)
_NAMED = re.compile(r"(?P<name>[^(]*?)\s*\((?P<kind>.*)\)")


def _read_keysight(path: Path, selection: Selection) -> Recording:
    """A block ``BEGIN`` ... ``END`` of the file; real and imaginary part are one column."""
    lines = read_text(path).splitlines()
    starts = [n for n, line in enumerate(lines) if _BEGIN.fullmatch(line)]
    if not 0 < selection.trace <= len(starts):
        raise BadInput(
            f"{path}: {how_many(len(starts), 'block')} ('BEGIN' lines), wanted block "
            f"{selection.trace}; is it the CSV of a Keysight network analyser?"
        )
    begin = starts[selection.trace - 1]
    table = _block(path, lines, begin)
    made = of_table(table)
    label = lines[begin].strip()[5:].strip(" ,")
    several = f"{len(starts)} blocks, trace = {selection.trace} taken" if len(starts) > 1 else ""
    return Recording(
        path=path,
        channels=tuple(_joined(made)),
        places=made.places,
        words=", ".join(filter(None, ("Keysight network analyser CSV", label, several))),
        notes={"instrument": lines[1].lstrip("! ").strip()} if len(lines) > 1 else {},
    )


def _block(path: Path, lines: Sequence[str], begin: int) -> Table:
    body = []
    for n, line in enumerate(lines[begin + 1 :], start=begin + 2):
        if line.strip().upper().startswith("END"):
            break
        if line.strip() and not line.startswith("!"):
            body.append((n, line))
    if len(body) < 2:
        raise BadInput(f"{path}: row {begin + 1}: no rows of numbers below 'BEGIN'")
    delimiter = next((d for d in ";\t" if d in body[0][1]), ",")
    rows = [(n, split_line(text, delimiter)) for n, text in body]
    names = rows[0][1]
    if all(is_number(cell) for cell in names):
        names = _names_above(path, lines[:begin], begin)
    else:
        rows = rows[1:]
    for n, row in rows:
        if len(row) != len(names):
            raise BadInput(
                f"{path}: row {n} has {how_many(len(row), 'cell')}, the names {len(names)}"
            )
    return Table(
        path=path,
        columns=tuple(Column(name, None, i) for i, name in enumerate(names)),
        cells=tuple(row for _, row in rows),
        lines=tuple(n for n, _ in rows),
        decimal_comma=False,
    )


def _names_above(path: Path, above: Sequence[str], begin: int) -> tuple[str, ...]:
    """Names and units of a block in the lines above it, as FieldFox writes them."""
    told = {}
    for line in above:
        match = _ABOVE.fullmatch(line.strip())
        if match is not None:
            told[match["key"].upper()] = match["value"].strip()
    if "DATA" not in told:
        raise BadInput(f"{path}: row {begin + 1}: wanted the names of the columns below 'BEGIN'")
    first, *rest = split_line(told["DATA"], ",")
    units = told.get("FREQ UNIT", ""), told.get("DATA UNIT", "")
    return f"{first}({units[0]})", *(f"{name}({units[1]})" for name in rest)


def _joined(recording: Recording) -> list[Channel]:
    """Columns with the unit that their name tells; real and imaginary part as one complex one."""
    read = [(_parted(c.name), c) for c in recording.channels]
    imaginary = {name: c for (name, kind), c in read if kind == "imag"}
    made: list[Channel] = []
    for (name, kind), channel in read:
        if kind == "real" and name in imaginary:
            x, y = recording.numbers(channel), recording.numbers(imaginary[name])
            made.append(channel_of(name, "1", x + 1j * y))
        elif kind == "imag" and any(c.name == name for c in made):
            continue
        else:
            taken = any(c.name == name for c in made)
            made.append(Channel(name=channel.name if taken else name, unit=kind, read=channel.read))
    return made


def _parted(head: str) -> tuple[str, str | None]:
    """Name and unit of a column: "S11(REAL)", "S21 Log Mag(dB)", "Freq(Hz)"."""
    match = _NAMED.fullmatch(head.strip())
    if match is None or not match["name"]:
        return head.strip(), None
    kind = match["kind"].strip()
    if kind.isupper():  # FREQ(HZ)
        kind = UNITS.get(kind.lower(), kind)
    return match["name"], _KINDS.get(kind.lower(), kind)


def _recognises(head: Head) -> bool:
    first = head.first_line.upper()
    begins = any(_BEGIN.fullmatch(line) for line in head.lines)
    return begins and first.startswith(("!", "BEGIN"))


LAYOUT = Layout(name="keysight", read=_read_keysight, recognises=_recognises, keys=("trace",))
