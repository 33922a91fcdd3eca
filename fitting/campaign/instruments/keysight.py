"""The CSV of Keysight's and Agilent's network analysers: PNA, ENA, FieldFox."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from fitting.campaign.instruments.recording import Channel, Recording, channel_of, of_table
from fitting.campaign.instruments.trace import Head, Layout, Selection
from fitting.text.errors import BadInput
from fitting.text.tables import Column, Table, parse_number, read_text, split_line

_KINDS = {
    **dict.fromkeys(("real", "re"), "real"),
    **dict.fromkeys(("imag", "im", "imaginary"), "imag"),
    **dict.fromkeys(("db", "logmag"), "dB"),
    **dict.fromkeys(("mag", "lin mag", "linmag", "lin", "u"), "1"),
    **dict.fromkeys(("deg", "phase", "ang", "degrees", "°"), "deg"),
}
_NAMED = re.compile(r"(?P<name>[^(]*?)\s*\((?P<kind>.*)\)")


def _read_keysight(path: Path, selection: Selection) -> Recording:
    """A block ``BEGIN`` ... ``END`` of the file; real and imaginary part are one column."""
    lines = read_text(path).splitlines()
    starts = [n for n, line in enumerate(lines) if line.strip().upper().startswith("BEGIN")]
    if not 0 < selection.trace <= len(starts):
        raise BadInput(
            f"{path}: {len(starts)} blocks ('BEGIN' lines), wanted block {selection.trace}; is it "
            "the CSV of a Keysight network analyser?"
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
    names, rows = split_line(body[0][1], delimiter), [split_line(t, delimiter) for _, t in body[1:]]
    for (n, _), row in zip(body[1:], rows, strict=True):
        if len(row) != len(names):
            raise BadInput(f"{path}: row {n} has {len(row)} cells, the names {len(names)}")
    headed = [name for name in names if parse_is_text(name)]
    if len(headed) < len(names):
        raise BadInput(f"{path}: row {body[0][0]}: wanted the names of the columns")
    return Table(
        path=path,
        columns=tuple(Column(name, None, i) for i, name in enumerate(names)),
        cells=tuple(rows),
        lines=tuple(n for n, _ in body[1:]),
        decimal_comma=False,
    )


def parse_is_text(cell: str) -> bool:
    """Whether a cell is a name and no number.

    Args:
        cell: of a head.
    """
    try:
        parse_number(cell, "")
    except BadInput:
        return bool(cell)
    return False


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
    return match["name"], _KINDS.get(kind.lower(), kind)


def _recognises(head: Head) -> bool:
    first = head.first_line.upper()
    begins = any(line.strip().upper().startswith("BEGIN") for line in head.lines)
    return begins and first.startswith(("!", "BEGIN"))


LAYOUT = Layout(name="keysight", read=_read_keysight, recognises=_recognises, keys=("trace",))
