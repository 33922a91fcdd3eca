"""Files as instruments write them: column layouts -> one raw trace, units as written.

Layouts: "csv" (plain, units in the header, also ';' with decimal comma), "rohde-schwarz" (ASCII
trace export of the FSV/FSW/FPL spectrum analysers), "zurich" (sweeper CSV of LabOne) and "afm" (the
tab separated frequency sweep of a scanning probe controller).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.tables import (
    Column,
    Table,
    did_you_mean,
    parse_number,
    parse_table,
    read_table,
    read_text,
    split_line,
)

FREQUENCY_NAMES = ("frequency", "freq", "f")
AMPLITUDE_NAMES = ("amplitude", "magnitude", "level", "r", "voltage")
PHASE_NAMES = ("phase", "theta")

MIN_POINTS = 3

#: Header entries in which an instrument tells its own estimate of the line that it swept.
OWN_ESTIMATES: Mapping[str, str] = {"f_res (Hz)": "frequency_hz", "Q": "q"}


@dataclass(frozen=True)
class RawTrace:
    """A trace in the units of its file.

    ``frequency``, ``amplitude`` and ``phase`` (n,) (phase may be None), each with its unit as
    written; ``places`` says for every point where it stands in the file; ``notes`` holds header
    entries worth repeating.
    """

    path: Path
    frequency: FloatArray
    frequency_unit: str
    amplitude: FloatArray
    amplitude_unit: str
    phase: FloatArray | None
    phase_unit: str
    places: tuple[str, ...]
    notes: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Selection:
    """What to take from a file that holds more: column names, trace number, chunk.

    Empty names mean the usual ones; ``trace`` counts from 1 (rohde-schwarz); ``chunk`` is the
    sweep's number as LabOne writes it (None: the file must hold one only).
    """

    frequency: str = ""
    amplitude: str = ""
    phase: str = ""
    trace: int = 1
    chunk: int | None = None


def read_trace(path: Path, layout: str, selection: Selection | None = None) -> RawTrace:
    """Read one trace and check its frequency axis: finite, strictly rising, enough points.

    Raises:
        BadInput: unreadable, missing column or unit, text or NaN in a cell, frequencies unsorted or
            twice, fewer than 3 points.
    """
    if layout not in LAYOUTS:
        raise BadInput(f"{path}: unknown layout '{layout}'{did_you_mean(layout, list(LAYOUTS))}")
    trace = LAYOUTS[layout](path, selection or Selection())
    _check_axis(trace)
    return trace


def own_estimates(notes: Mapping[str, str]) -> dict[str, float]:
    """What the instrument itself made of its sweep: "frequency_hz" and "q", as far as it says."""
    found = {}
    for name, key in OWN_ESTIMATES.items():
        try:
            found[key] = float(notes[name])
        except (KeyError, ValueError):  # a note is not a datum: nothing hangs on it
            continue
    return found


def _check_axis(trace: RawTrace) -> None:
    if trace.frequency.size < MIN_POINTS:
        raise BadInput(f"{trace.path}: {trace.frequency.size} points; wanted at least {MIN_POINTS}")
    for i in np.flatnonzero(np.diff(trace.frequency) <= 0.0)[:1]:
        before, here = trace.frequency[i], trace.frequency[i + 1]
        what = "appears twice" if here == before else f"follows {before:.12g}: not sorted"
        raise BadInput(
            f"{trace.path}: {trace.places[i + 1]}: frequency {here:.12g} {trace.frequency_unit} "
            f"{what}; wanted strictly rising frequencies"
        )


def _read_csv(path: Path, selection: Selection) -> RawTrace:
    table = read_table(path)
    frequency = _pick(table, selection.frequency, FREQUENCY_NAMES)
    amplitude = _pick(table, selection.amplitude, AMPLITUDE_NAMES)
    phase = _pick(table, selection.phase, PHASE_NAMES) if _has_phase(table, selection) else None
    return RawTrace(
        path,
        table.numbers(frequency),
        unit_of(table, frequency, "frequency (MHz)"),
        table.numbers(amplitude),
        unit_of(table, amplitude, "amplitude (uV)"),
        None if phase is None else table.numbers(phase),
        "" if phase is None else unit_of(table, phase, "phase (deg)"),
        tuple(f"row {n}" for n in table.lines),
    )


def _has_phase(table: Table, selection: Selection) -> bool:
    return bool(selection.phase) or any(table.find(name) for name in PHASE_NAMES)


def _pick(table: Table, wanted: str, usual: Sequence[str]) -> Column:
    if wanted:
        return table.column(wanted)
    return next((c for c in map(table.find, usual) if c is not None), None) or table.column(
        usual[0]
    )


def unit_of(table: Table, column: Column, example: str) -> str:
    """The unit written in a column's header; raises BadInput if there is none."""
    if column.unit is None:
        raise BadInput(
            f"{table.path}: column '{column.name}' has no unit in its header; "
            f"wanted it in brackets, as in '{example}'"
        )
    return column.unit


def _read_rohde_schwarz(path: Path, selection: Selection) -> RawTrace:
    """``name;value;unit`` header lines, then ``Trace n``, ``Values;N`` and N lines ``x;y[;y2]``.

    Layout after "ASCII File Export Format" in the user manuals of R&S FSV, FSW and FPL. The second
    level that the AUTOPEAK detector adds is the smaller one and is left out.
    """
    lines = [split_line(t, ";") if t.strip() else ("",) for t in read_text(path).splitlines()]
    header: dict[str, tuple[str, ...]] = {}
    found = 0
    for i, cells in enumerate(lines):
        key = cells[0].rstrip(":").lower()
        header[key] = cells[1:]
        if key != "values":
            continue
        found += 1
        if found == selection.trace:
            return _rohde_schwarz_trace(path, lines, i, header)
    raise BadInput(
        f"{path}: {found} traces ('Values;<number>' lines), wanted trace {selection.trace}; "
        "is it the ASCII trace export of a Rohde & Schwarz analyser?"
    )


def _rohde_schwarz_trace(
    path: Path, lines: Sequence[tuple[str, ...]], start: int, header: Mapping[str, tuple[str, ...]]
) -> RawTrace:
    where = f"{path}: row {start + 1}, 'Values'"
    count = int(parse_number((lines[start] + ("",))[1], where))
    rows = lines[start + 1 : start + 1 + count]
    if len(rows) < count:
        raise BadInput(f"{where}: {count} points announced, {len(rows)} lines follow")
    points = np.empty((count, 2))
    for j, cells in enumerate(rows):
        for k, name in enumerate(("frequency", "level")):
            text = cells[k] if k < len(cells) else ""
            place = f"{path}: row {start + 2 + j}, {name}"
            points[j, k] = parse_number(text, place, decimal_comma=True)
    units = []
    for key in ("x-unit", "y-unit"):
        unit = header.get(key, ("",))[0]
        if not unit:
            raise BadInput(f"{path}: no '{key}' line before the values; wanted as in 'x-Unit;Hz;'")
        units.append(unit)
    notes = {k: " ".join(header[k]).strip() for k in ("type", "rbw", "detector") if k in header}
    places = tuple(f"row {start + 2 + j}" for j in range(count))
    return RawTrace(path, points[:, 0], units[0], points[:, 1], units[1], None, "", places, notes)


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
        path,
        table.columns,
        tuple(table.cells[i] for i in rows),
        tuple(table.lines[i] for i in rows),
        False,
    )
    return RawTrace(
        path,
        part.numbers(columns[0]),
        columns[0].unit or "Hz",
        part.numbers(columns[1]),
        columns[1].unit or "V",
        part.numbers(phase) if phase else None,
        (phase.unit or "rad") if phase else "",
        tuple(f"row {n}" for n in part.lines),
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
    at_chunk, at_field = names.index("chunk"), names.index("fieldname")
    body = [(n, split_line(text, ";" if ";" in text else ",")) for n, text in lines if text.strip()]
    body = body[1:]
    for n, cells in body:
        if len(cells) <= at_field + 1:
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
        path, frequency, "Hz", amplitude, "V", phase, "rad" if has_phase else "", places
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
        path,
        table.numbers(shift) + table.numbers(center),
        unit,
        table.numbers(amplitude),
        unit_of(table, amplitude, "Amplitude (m)"),
        table.numbers(phase) if phase else None,
        unit_of(table, phase, "Phase (deg)") if phase else "",
        tuple(f"row {n}" for n in table.lines),
        notes,
    )


LAYOUTS: Mapping[str, Callable[[Path, Selection], RawTrace]] = {
    "csv": _read_csv,
    "rohde-schwarz": _read_rohde_schwarz,
    "zurich": _read_zurich,
    "afm": _read_afm,
}
