"""Text that vendors write otherwise than as plain columns: a reader and a sign of each.

To add a vendor, write a reader that finds the rows of its table and names the columns (`of_rows`),
and an entry in `LAYOUTS`, with what its files begin with.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from fitting.campaign.instruments.loose_tables import UNITS, is_number
from fitting.campaign.instruments.recording import (
    Channel,
    Head,
    Layout,
    Recording,
    Selection,
    channel_of,
    of_rows,
    of_table,
)
from fitting.campaign.instruments.roles import TIME, usual
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, SeveralSweeps
from fitting.text.notation import how_many
from fitting.text.tables import parse_number, parse_numbers, parse_table, read_text, split_line

#: Columns in a complaint.
MOST_NAMES = 8
#: Rows among which the names of columns are.
HEAD_ROWS = 1000
#: A row of a file: its number, from one, and its cells.
Row = tuple[int, tuple[str, ...]]


def _rows_of(path: Path, delimiter: str) -> list[Row]:
    """The rows of a file that are not blank."""
    numbered = enumerate(read_text(path).splitlines(), start=1)
    return [(n, split_line(text, delimiter)) for n, text in numbered if text.strip()]


def _settings(rows: Sequence[Row]) -> dict[str, tuple[str, ...]]:
    """What rows state behind a name, by it in small letters."""
    return {cells[0].rstrip(":").lower(): cells[1:] for _, cells in rows if cells[0]}


def _setting(rows: Sequence[Row], name: str, default: str = "") -> str:
    """The first value behind a name."""
    return (*_settings(rows).get(name, ()), "")[0] or default


def _unit(text: str) -> str | None:
    """A unit in its usual spelling; None: none is stated."""
    return UNITS.get(text.lower(), text) or None


def _chosen(path: Path, result: Sequence[int], selection: Selection, what: str) -> int:
    """The place of the trace that is selected, of those that were found."""
    if not 0 < selection.trace <= len(result):
        kind, _, further = what.partition(" ")
        raise BadInput(
            f"{path}: {how_many(len(result), kind)} {further}, wanted {kind} {selection.trace}"
        )
    return result[selection.trace - 1]


def _names_at(path: Path, rows: Sequence[Row], first: str, maker: str) -> int:
    """The place of the row of names, by the first of them."""
    heads = (k for k, (_, cells) in enumerate(rows[:HEAD_ROWS]) if cells[0].lower() == first)
    at = next((k for k in heads if len(rows[k][1]) > 1), None)
    if at is None:
        raise BadInput(f"{path}: no row '{first},...' of names; wanted the text file of {maker}")
    return at


def _read_nanonis(path: Path, _: Selection) -> Recording:
    """Nanonis .dat: lines ``name<tab>value``, ``[DATA]``, a header with units, columns with tabs.

    The frequency is the sum of the columns "Center Frequency" and "Frequency Shift" where the
    controller writes these.
    """
    lines = list(enumerate(read_text(path).splitlines(), start=1))
    begin = next((i for i, (_, text) in enumerate(lines) if text.strip() == "[DATA]"), None)
    if begin is None:
        raise BadInput(f"{path}: no line '[DATA]'; wanted the controller's frequency sweep file")
    head = [text.split("\t") for _, text in lines[:begin]]
    notes = {cells[0]: cells[1].strip() for cells in head if len(cells) > 1 and cells[1].strip()}
    experiment = notes.get("Experiment", "experiment not stated")
    made = of_table(parse_table(path, lines[begin + 1 :]), f"Nanonis, {experiment}", notes)
    if made.find("Frequency") is not None or usual(made, TIME) is not None:
        return made
    parts = [made.find(name) for name in ("Center Frequency", "Frequency Shift")]
    known = [channel for channel in parts if channel is not None]
    if len(known) < len(parts):
        names = [c.name for c in made.channels]
        there = ", ".join(names[:MOST_NAMES]) + (", ..." if len(names) > MOST_NAMES else "")
        raise BadInput(
            f"{path}: is a Nanonis file of the experiment '{experiment}', not a sweep of the "
            "frequency; wanted columns 'Frequency', or 'Center Frequency' and 'Frequency Shift', "
            f"or 'Time' of a recording, there is: {there}"
        )
    center, shift = known
    if center.unit != shift.unit:
        raise BadInput(
            f"{path}: 'Frequency Shift' is in {shift.unit} and 'Center Frequency' in "
            f"{center.unit}; wanted the same unit, because they are added"
        )
    added = channel_of("Frequency", shift.unit, made.numbers(shift) + made.numbers(center))
    words = f"{made.words}, Frequency = Center Frequency + Frequency Shift"
    return replace(made, channels=(added, *made.channels), words=words)


def _read_rohde_schwarz(path: Path, selection: Selection) -> Recording:
    """``name;value;unit`` header lines, then ``Trace n``, ``Values;N`` and N lines ``x;y[;y2]``.

    Layout after "ASCII File Export Format" in the user manuals of R&S FSV, FSW and FPL. The second
    level that the AUTOPEAK detector adds is the smaller one and is left out.
    """
    rows = _rows_of(path, ";")
    starts = [k for k, (_, cells) in enumerate(rows) if cells[0].rstrip(":").lower() == "values"]
    start = _chosen(path, starts, selection, "trace ('Values;<number>' lines)")
    above, below = rows[:start], rows[start + 1 :]
    where = f"{path}: row {rows[start][0]}, 'Values'"
    count = int(parse_number((*rows[start][1], "")[1], where))
    if not 0 <= count <= len(below):
        raise BadInput(
            f"{where}: {how_many(count, 'point')} announced, {how_many(len(below), 'line')} below"
        )
    columns = []
    for at, (key, name) in enumerate((("x-unit", "Frequency"), ("y-unit", "Level"))):
        unit = _setting(above, key)
        if not unit:
            raise BadInput(f"{path}: no '{key}' line before the values; wanted as in 'x-Unit;Hz;'")
        columns.append(("Time" if unit == "s" else name, unit, at))
    settings = _settings(above)
    worth: tuple[str, ...] = ("type", "rbw", "detector")
    notes = {key: " ".join(settings[key]).strip() for key in worth if key in settings}
    words = ", ".join(("Rohde & Schwarz, ASCII trace", *notes.values()))
    return of_rows(path, columns, below[:count], words, notes, decimal_comma=True)


_LABVIEW, _END_OF_HEADER = "LabVIEW Measurement", "***End_of_Header***"


def _read_labview(path: Path, _: Selection) -> Recording:
    """LabVIEW .lvm: ``key<separator>value`` lines, a second head with units, then the columns.

    Each head ends with ``***End_of_Header***``. Times are the first column, or X0 and Delta_X.

    Source: NI, "Specification for the LabVIEW Measurement File (.lvm)".
    """
    rows = _rows_of(path, "\t")
    if any(cells[0].startswith("Separator,") for _, cells in rows):
        rows = _rows_of(path, ",")
    ends = [k for k, (_, cells) in enumerate(rows) if cells[0].startswith(_END_OF_HEADER)]
    if not ends or len(rows) < ends[-1] + 3:
        raise BadInput(f"{path}: no columns below '{_END_OF_HEADER}'; wanted a .lvm file with data")
    above, names, below = rows[: ends[-1]], rows[ends[-1] + 1][1], rows[ends[-1] + 2 :]
    times = _setting(above, "x_columns", "One")
    if times != "One":
        raise BadInput(
            f"{path}: X_Columns: found '{times}', wanted 'One', the times of all channels in the "
            "first column"
        )
    axis = _setting(above, "x_dimension", "Time")
    unit = _unit(_setting(above, "x_unit_label")) or {"Time": "s", "Frequency": "Hz"}.get(axis)
    units = [unit, *map(_unit, _settings(above).get("y_unit_label", ())), *[None] * len(names)]
    kept = [name for name in names if name and name != "Comment"]
    columns = [(name, units[k], k) for k, name in enumerate((axis, *kept[1:]))]
    comma = _setting(above, "decimal_separator") == ","
    return of_rows(path, columns, below, "LabVIEW measurement file", decimal_comma=comma)


#: Kinds of Keysight's columns, real and imaginary part and units, by what stands in brackets.
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
    """Network analysers (PNA, ENA, FieldFox): a block ``BEGIN`` ... ``END`` of the file.

    Real and imaginary part are one column. Names are "S11(REAL)", "S21 Log Mag(dB)", "Freq(Hz)".
    """
    lines = read_text(path).splitlines()
    starts = [k for k, line in enumerate(lines) if _BEGIN.fullmatch(line)]
    begin = _chosen(path, starts, selection, "block ('BEGIN' lines)")
    body = [(n, t) for n, t in enumerate(lines, start=1) if t.strip() and not t.startswith("!")]
    body = [(n, text) for n, text in body if n > begin + 1]
    ends = (k for k, (_, text) in enumerate(body) if text.strip().upper().startswith("END"))
    body = body[: next(ends, len(body))]
    if len(body) < 2:
        raise BadInput(f"{path}: row {begin + 1}: no rows of numbers below 'BEGIN'")
    delimiter = next((d for d in ";\t" if d in body[0][1]), ",")
    (_, names), *rows = [(n, split_line(text, delimiter)) for n, text in body]
    if all(map(is_number, names)):  # FieldFox writes them above
        rows.insert(0, (body[0][0], names))
        above = [_ABOVE.fullmatch(line.strip()) for line in lines[:begin]]
        given = {m["key"].upper(): m["value"].strip() for m in above if m is not None}
        first, *others = split_line(given.get("DATA", ""), ",")
        if not first:
            raise BadInput(
                f"{path}: row {begin + 1}: wanted the names of the columns below 'BEGIN'"
            )
        unit = given.get("DATA UNIT", "")
        names = (f"{first}({given.get('FREQ UNIT', '')})", *(f"{name}({unit})" for name in others))
    for n, row in rows:
        if len(row) != len(names):
            raise BadInput(
                f"{path}: row {n} has {how_many(len(row), 'cell')}, the names {len(names)}"
            )
    label = lines[begin].strip()[5:].strip(" ,")
    several = f"{len(starts)} blocks, trace = {selection.trace} taken" if len(starts) > 1 else ""
    words = ", ".join(filter(None, ("Keysight network analyser CSV", label, several)))
    notes = {"instrument": lines[1].lstrip("! ").strip()} if len(lines) > 1 else {}
    made = of_rows(path, [(name, None, i) for i, name in enumerate(names)], rows, words, notes)
    read: list[tuple[str, str | None, Channel]] = []
    for channel in made.channels:
        match = _NAMED.fullmatch(channel.name)
        kind = match["kind"].strip() if match is not None and match["name"] else ""
        kind = UNITS.get(kind.lower(), kind) if kind.isupper() else kind  # FREQ(HZ)
        name = match["name"] if match is not None and kind else channel.name
        read.append((name, _KINDS.get(kind.lower(), kind) or None, channel))
    imaginary = {name: c for name, kind, c in read if kind == "imag"}
    joined: dict[str, Channel] = {}
    for name, kind, channel in read:
        if kind == "real" and name in imaginary:
            x, y = made.numbers(channel), made.numbers(imaginary[name])
            joined.setdefault(name, channel_of(name, "1", x + 1j * y))
        elif kind != "imag" or name not in joined:
            own = channel.name if name in joined else name
            joined.setdefault(own, replace(channel, name=own, unit=kind))
    return replace(made, channels=tuple(joined.values()))


#: What LabOne writes its quantities in; it does not say so in the file.
_LABONE = {
    "frequency": "Hz",
    "r": "V",
    "x": "V",
    "y": "V",
    "phase": "rad",
    "bandwidth": "Hz",
    "grid": "Hz",
}
_LABONE_WORDS = "Zurich Instruments LabOne, sweeper"


def _read_zurich(path: Path, selection: Selection) -> Recording:
    """LabOne sweeper CSV: ``chunk;timestamp;size;fieldname;v0;v1;...``, or one line per point.

    A line holds one quantity of one sweep ("chunk"), padded with nan behind the last measured
    point; newer exports give a column per quantity. Units are LabOne's own: Hz, V (rms of the
    demodulator's R), rad.
    """
    lines = read_text(path).splitlines()
    first = next((text for text in lines if text.strip()), "")
    rows = _rows_of(path, ";" if ";" in first else ",")
    names = [name.lower() for name in rows[0][1]] if rows else []
    if "fieldname" not in names:
        table = parse_table(path, enumerate(lines, start=1))
        rows = list(zip(table.lines, table.cells, strict=True))
        column = table.find("chunk")
        if column is not None:
            wanted = _one_chunk(path, table.texts(column), selection.chunk)
            rows = [row for row in rows if row[1][column.index] == wanted]
        columns = [(c.name, c.unit or _LABONE.get(c.name.lower()), c.index) for c in table.columns]
        return of_rows(path, columns, rows, _LABONE_WORDS)
    if "chunk" not in names:
        raise BadInput(f"{path}: no column 'chunk'; wanted one next to 'fieldname'")
    at_chunk, at_field = names.index("chunk"), names.index("fieldname")
    for n, cells in rows[1:]:
        if len(cells) <= max(at_chunk, at_field + 1):
            raise BadInput(f"{path}: row {n} holds no values behind its field name")
    chunk = _one_chunk(path, [cells[at_chunk] for _, cells in rows[1:]], selection.chunk)
    mine = [(n, cells) for n, cells in rows[1:] if cells[at_chunk] == chunk]
    fields = {cells[at_field].lower(): (n, cells[at_field + 1 :]) for n, cells in mine}
    if "frequency" not in fields:
        raise BadInput(f"{path}: no field 'frequency'; there is: {', '.join(fields)}")

    def measured(cells: Sequence[str]) -> int:
        """Number of cells before those that fill up a row."""
        numbers = (j for j, cell in enumerate(cells, start=1) if cell.lower() not in ("", "nan"))
        return max(numbers, default=0)

    at, frequencies = fields["frequency"]
    size = measured(frequencies)

    def values(name: str) -> FloatArray:
        row, cells = fields[name]
        there = max(measured(cells), min(size, len(cells)))
        if there != size:
            raise BadInput(
                f"{path}: row {row}, field '{name}': {how_many(there, 'value')}, wanted {size}"
            )
        place = f"row {row}, field '{name}', value "
        return parse_numbers(path, [(f"{place}{j + 1}", cells[j]) for j in range(size)])

    values("frequency")  # of which the others are read only where they are needed
    return Recording(
        path=path,
        channels=tuple(
            Channel(name=name, unit=_LABONE.get(name), read=partial(values, name))
            for name in fields
        ),
        places=tuple(f"row {at}, value {j + 1}" for j in range(size)),
        words=_LABONE_WORDS,
    )


def _one_chunk(path: Path, chunks: Sequence[str], wanted: int | None) -> str:
    present = list(dict.fromkeys(chunks))
    if not present:
        raise BadInput(f"{path}: holds no sweep (chunk), wanted one at least")
    if wanted is None and len(present) == 1:
        return present[0]
    if wanted is not None and str(wanted) in present:
        return str(wanted)
    raise SeveralSweeps(
        f"{path}: holds the sweeps (chunks) {', '.join(present)}; wanted one of them, "
        f"as 'chunk = {present[-1]}' in the campaign",
        parts=[{"chunk": int(chunk)} for chunk in present if chunk.isdigit()],
    )


_LECROY = "LECROY"


def _read_lecroy(path: Path, selection: Selection) -> Recording:
    """LeCroy: ``Segments,1,SegmentSize,1002``, a line ``#k`` each, then ``Time,Ampl`` and rows.

    The segments' rows follow each other. Times are in seconds from the trigger. The file states no
    unit of its amplitudes: they are volts, unless a probe or a function of the oscilloscope made
    something else of them.
    """
    rows = _rows_of(path, ",")
    row = rows[1][1] if len(rows) > 1 else ()
    try:
        segments, size = int(row[1]), int(row[3])
    except (IndexError, ValueError):
        raise BadInput(
            f"{path}: row 2: found {','.join(row)!r}, wanted the segments of a LeCroy "
            "oscilloscope, as Segments,1,SegmentSize,1002"
        ) from None
    at = _names_at(path, rows, "time", "a LeCroy oscilloscope")
    begin = at + 1 + size * _chosen(path, range(segments), selection, "segment of the file")
    end = begin + size if segments > 1 else len(rows)
    columns = [(name, "V" if k else "s", k) for k, name in enumerate(rows[at][1]) if name]
    model = rows[0][1][0].removeprefix(_LECROY).strip()
    taken = f", trace = {selection.trace} taken" if segments > 1 else ""
    words = f"LeCroy oscilloscope {model}, {how_many(segments, 'segment')}{taken}, "
    words += "V taken as the unit, which the file does not state"
    return of_rows(path, columns, rows[begin:end], words)


_CHANNEL_UNIT = re.compile(r"(?P<channel>\w+)\s*:\s*(?P<unit>[^\s,:]+)")


def _read_siglent(path: Path, _: Selection) -> Recording:
    """Siglent: settings, ``Source,CH1,CH2``, then ``Second,Value,Value`` and rows.

    Older ones write "Second,Volt" and no units; some begin with the line of the channels.
    """
    rows = _rows_of(path, ",")
    at = _names_at(path, rows, "second", "a Siglent oscilloscope, seconds and values")
    kinds = [kind for kind in rows[at][1][1:] if kind]
    settings = _settings(rows[:at])
    names = [name for name in settings.get("source", ()) if name]
    if len(names) != len(kinds):
        names = [f"CH{k + 1}" for k in range(len(kinds))]
    units = map(_CHANNEL_UNIT.fullmatch, settings.get("vertical units", ()))
    given = {match["channel"]: match["unit"] for match in units if match is not None}
    pairs = zip(names, kinds, strict=True)
    channels = ((name, given.get(name) or UNITS.get(kind.lower())) for name, kind in pairs)
    columns = [("Time", "s", 0), *((*channel, k) for k, channel in enumerate(channels, start=1))]
    model = _setting(rows[:at], "model number")
    return of_rows(path, columns, rows[at + 1 :], f"Siglent oscilloscope {model}".strip())


def _read_oscilloscope(path: Path, _: Selection) -> Recording:
    """Oscilloscopes whose settings are next to the numbers: Tektronix and Rigol.

    Tektronix writes ``name,value,,x,y`` on every line; Rigol ``X,CH1,CH2,Start,Increment`` over
    ``Sequence,Volt,Volt,-6e-5,2e-8``, then numbered rows. Those that write them above (Keysight,
    PicoScope) are plain columns.
    """
    rows = _rows_of(path, ",")
    if not _is_rigol([cells for _, cells in rows[:2]]):
        for n, cells in rows:
            if len(cells) < 5:
                raise BadInput(
                    f"{path}: row {n} has {how_many(len(cells), 'cell')}, wanted 5 of a Tektronix "
                    "file"
                )
        over = _unit(_setting(rows, "horizontal units", "s"))
        source = _setting(rows, "source", "channel")
        axis = "Frequency" if over == "Hz" else "Time", over, 3
        values = source, _unit(_setting(rows, "vertical units")), 4
        return of_rows(path, [axis, values], rows, f"Tektronix oscilloscope, {source}")
    names, units, rows = rows[0][1], rows[1][1], rows[2:]
    places = [name.lower() for name in names]
    start, step = (
        parse_number(units[places.index(key)], f"{path}: row 2, '{key}'")
        for key in ("start", "increment")
    )
    channels = [k for k in range(1, places.index("start")) if names[k]]
    words = f"Rigol oscilloscope, {', '.join(names[k] for k in channels)}"
    made = of_rows(path, [(names[k], _unit(units[k]), k) for k in channels], rows, words)
    time = channel_of("Time", "s", start + step * np.arange(float(len(rows))))
    return replace(made, channels=(time, *made.channels))


def _is_rigol(rows: Sequence[Sequence[str]]) -> bool:
    names = [cell.lower() for cell in rows[0]] if len(rows) > 1 else []
    nearby = names and len(rows[1]) >= len([name for name in names if name])
    return bool(nearby) and names[0] == "x" and {"start", "increment"} <= set(names)


def _of_oscilloscope(head: Head) -> bool:
    cells = split_line(head.first_line, ",")
    named = cells[0].lower() == "record length" and len(cells) >= 5
    return named or _is_rigol([split_line(line, ",") for line in head.lines[:2]])


def _of_siglent(head: Head) -> bool:
    begins = head.first_line.lower().startswith(("record length,", "source,ch"))
    return begins and any(line.lower().startswith("second,") for line in head.lines[1:HEAD_ROWS])


def _of_zurich(head: Head) -> bool:
    first = head.first_line.lower()
    return "chunk" in split_line(first, ";" if ";" in first else ",")


def _of_keysight(head: Head) -> bool:
    begins = any(_BEGIN.fullmatch(line) for line in head.lines)
    return begins and head.first_line.upper().startswith(("!", "BEGIN"))


def _of_lecroy(head: Head) -> bool:
    begins = head.first_line.startswith(_LECROY)
    return begins and "".join(head.lines[1:2]).startswith("Segments")


def _of_rohde_schwarz(head: Head) -> bool:
    return any(line.lower().startswith(("values;", "values:;")) for line in head.lines)


#: Name in a campaign, reader, and what the beginning of a file of this layout looks like.
LAYOUTS = (
    Layout("afm", _read_nanonis, lambda head: "[DATA]" in map(str.strip, head.lines)),
    Layout("keysight", _read_keysight, _of_keysight, keys=("trace",)),
    Layout("labview", _read_labview, lambda head: head.first_line.startswith(_LABVIEW)),
    Layout("lecroy", _read_lecroy, _of_lecroy, keys=("trace",)),
    Layout("oscilloscope", _read_oscilloscope, _of_oscilloscope),
    Layout("rohde-schwarz", _read_rohde_schwarz, _of_rohde_schwarz, keys=("trace",)),
    Layout("siglent", _read_siglent, _of_siglent),
    Layout("zurich", _read_zurich, _of_zurich, keys=("chunk",)),
)
