"""The sweeper's CSV of LabOne, the software of Zurich Instruments' lock-in amplifiers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from fitting.campaign.instruments.recording import Channel, Recording, of_table
from fitting.campaign.instruments.trace import Head, Layout, Selection
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import how_many
from fitting.text.tables import (
    Table,
    parse_numbers,
    parse_table,
    read_text,
    split_line,
)

#: What LabOne writes its quantities in; it does not say so in the file.
UNITS = {
    "frequency": "Hz",
    "r": "V",
    "x": "V",
    "y": "V",
    "phase": "rad",
    "bandwidth": "Hz",
    "grid": "Hz",
}
WORDS = "Zurich Instruments LabOne, sweeper"


def _read_zurich(path: Path, selection: Selection) -> Recording:
    """LabOne sweeper CSV: ``chunk;timestamp;size;fieldname;v0;v1;...``, or one line per point.

    A line holds one quantity of one sweep ("chunk"), padded with nan behind the last measured
    point; newer exports give a column per quantity. Units are LabOne's own: Hz, V (rms of the
    demodulator's R), rad.
    """
    lines = list(enumerate(read_text(path).splitlines(), start=1))
    head = next((text for _, text in lines if text.strip()), "")
    names = [name.lower() for name in split_line(head, ";" if ";" in head else ",")]
    if "fieldname" in names:
        return _zurich_by_field(path, lines, names, selection)
    table = parse_table(path, lines)
    rows = _zurich_chunk_rows(table, selection)
    part = Table(
        path=path,
        columns=tuple(
            c if c.unit else replace(c, unit=UNITS.get(c.name.lower())) for c in table.columns
        ),
        cells=tuple(table.cells[i] for i in rows),
        lines=tuple(table.lines[i] for i in rows),
        decimal_comma=False,
    )
    return of_table(part, WORDS)


def _zurich_chunk_rows(table: Table, selection: Selection) -> list[int]:
    column = table.find("chunk")
    if column is None:
        return list(range(len(table.cells)))
    chunks = table.texts(column)
    wanted = _one_chunk(table.path, chunks, selection.chunk)
    return [i for i, chunk in enumerate(chunks) if chunk == wanted]


def _one_chunk(path: Path, chunks: Sequence[str], wanted: int | None) -> str:
    present = list(dict.fromkeys(chunks))
    if not present:
        raise BadInput(f"{path}: holds no sweep (chunk), wanted one at least")
    if wanted is None and len(present) == 1:
        return present[0]
    if wanted is not None and str(wanted) in present:
        return str(wanted)
    raise BadInput(
        f"{path}: holds the sweeps (chunks) {', '.join(present)}; wanted one of them, "
        f"as 'chunk = {present[-1]}' in the campaign"
    )


def _zurich_by_field(
    path: Path, lines: Sequence[tuple[int, str]], names: Sequence[str], selection: Selection
) -> Recording:
    if "chunk" not in names:
        raise BadInput(f"{path}: no column 'chunk'; wanted one beside 'fieldname'")
    at_chunk, at_field = names.index("chunk"), names.index("fieldname")
    body = [(n, split_line(text, ";" if ";" in text else ",")) for n, text in lines if text.strip()]
    body = body[1:]
    for n, cells in body:
        if len(cells) <= max(at_chunk, at_field + 1):
            raise BadInput(f"{path}: row {n} holds no values behind its field name")
    chunk = _one_chunk(path, [cells[at_chunk] for _, cells in body], selection.chunk)
    fields = {c[at_field].lower(): (n, c[at_field + 1 :]) for n, c in body if c[at_chunk] == chunk}
    if "frequency" not in fields:
        raise BadInput(f"{path}: no field 'frequency'; there is: {', '.join(fields)}")
    row, cells = fields["frequency"]
    frequency = _values(path, "frequency", row, cells, None)
    return Recording(
        path=path,
        channels=tuple(
            Channel(
                name=name,
                unit=UNITS.get(name),
                read=partial(_values, path, name, *field, frequency.size),
            )
            for name, field in fields.items()
        ),
        places=tuple(f"row {row}, value {j + 1}" for j in range(frequency.size)),
        words=WORDS,
    )


def _values(path: Path, name: str, line: int, cells: Sequence[str], size: int | None) -> FloatArray:
    """Values of one field; ``size`` None: up to the nan padding, which ends the sweep."""
    kept = list(cells)
    while kept and (size is None or len(kept) > size) and kept[-1].lower() in ("", "nan"):
        kept.pop()
    if size is not None and len(kept) != size:
        raise BadInput(
            f"{path}: row {line}, field '{name}': {how_many(len(kept), 'value')}, wanted {size}"
        )
    numbered = [(f"row {line}, field '{name}', value {j + 1}", text) for j, text in enumerate(kept)]
    return parse_numbers(path, numbered)


def _recognises(file: Head) -> bool:
    head = file.first_line.lower()
    return "chunk" in split_line(head, ";" if ";" in head else ",")


LAYOUT = Layout(name="zurich", read=_read_zurich, recognises=_recognises, keys=("chunk",))
