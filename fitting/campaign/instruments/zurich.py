"""The sweeper's CSV of LabOne, the software of Zurich Instruments' lock-in amplifiers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fitting.campaign.instruments.trace import Layout, RawTrace, Selection
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, did_you_mean
from fitting.text.tables import (
    Table,
    parse_number,
    parse_table,
    read_text,
    split_line,
)


def _read_zurich(path: Path, selection: Selection) -> RawTrace:
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
    columns = [table.column(n) for n in ("frequency", selection.amplitude or "r")]
    phase = table.find(selection.phase or "phase")
    part = Table(
        path=path,
        columns=table.columns,
        cells=tuple(table.cells[i] for i in rows),
        lines=tuple(table.lines[i] for i in rows),
        decimal_comma=False,
    )
    return RawTrace(
        path=path,
        frequency=part.numbers(columns[0]),
        frequency_unit=columns[0].unit or "Hz",
        amplitude=part.numbers(columns[1]),
        amplitude_unit=columns[1].unit or "V",
        phase=part.numbers(phase) if phase else None,
        phase_unit=(phase.unit or "rad") if phase else "",
        places=tuple(f"row {n}" for n in part.lines),
    )


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
) -> RawTrace:
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
    frequency_row, frequency = _zurich_field(path, fields, "frequency", None)
    _, amplitude = _zurich_field(path, fields, selection.amplitude or "r", frequency.size)
    phase_name = selection.phase or "phase"
    has_phase = bool(selection.phase) or phase_name in fields
    phase = _zurich_field(path, fields, phase_name, frequency.size)[1] if has_phase else None
    places = tuple(f"row {frequency_row}, value {j + 1}" for j in range(frequency.size))
    return RawTrace(
        path=path,
        frequency=frequency,
        frequency_unit="Hz",
        amplitude=amplitude,
        amplitude_unit="V",
        phase=phase,
        phase_unit="rad" if has_phase else "",
        places=places,
    )


def _zurich_field(
    path: Path, fields: Mapping[str, tuple[int, tuple[str, ...]]], name: str, size: int | None
) -> tuple[int, FloatArray]:
    """Values of one field; ``size`` None: up to the nan padding, which ends the sweep."""
    if name.lower() not in fields:
        raise BadInput(f"{path}: no field '{name}'{did_you_mean(name, list(fields))}")
    line, cells = fields[name.lower()]
    kept = list(cells)
    while kept and (size is None or len(kept) > size) and kept[-1].lower() in ("", "nan"):
        kept.pop()
    if size is not None and len(kept) != size:
        raise BadInput(f"{path}: row {line}, field '{name}': {len(kept)} values, wanted {size}")
    values = [
        parse_number(text, f"{path}: row {line}, field '{name}', value {j + 1}")
        for j, text in enumerate(kept)
    ]
    return line, np.array(values, dtype=float)


def _recognises(text: str) -> bool:
    head = next((line for line in text.splitlines() if line.strip()), "").lower()
    return "chunk" in split_line(head, ";" if ";" in head else ",")


LAYOUT = Layout(name="zurich", read=_read_zurich, recognises=_recognises, keys=("chunk",))
