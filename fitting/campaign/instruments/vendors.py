"""Text that vendors write otherwise than as plain columns: a reader and a sign of each.

To add a vendor, write a reader that finds the rows of its table and names the columns (`of_rows`,
or `parse_table` for rows below a head), and an entry in `LAYOUTS`, with what its files begin with.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from fitting.campaign.instruments.loose_tables import UNITS, cells_of, is_number
from fitting.campaign.instruments.recording import (
    Channel,
    Head,
    Layout,
    Recording,
    Selection,
    channel_of,
    of_rows,
    of_table,
    unit_of,
)
from fitting.campaign.instruments.roles import TIME, usual
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, SeveralSweeps
from fitting.text.notation import how_many
from fitting.text.tables import (
    parse_number,
    parse_numbers,
    parse_table,
    read_text,
    split_line,
)

#: Columns in a complaint.
MOST_NAMES = 8


def _numbered(path: Path) -> list[tuple[int, str]]:
    """The lines of a file with their numbers."""
    return list(enumerate(read_text(path).splitlines(), start=1))


def _unit(text: str) -> str | None:
    """A unit in its usual spelling; None: none is stated."""
    return UNITS.get(text.lower(), text) or None


def _chosen(path: Path, result: Sequence[int], selection: Selection, what: str, hint: str) -> int:
    """The place of the trace that is selected, of those that were found."""
    if not 0 < selection.trace <= len(result):
        kind = what.split()[0]
        raise BadInput(
            f"{path}: {how_many(len(result), kind)}{what[len(kind) :]}, wanted {kind} "
            f"{selection.trace}{hint}"
        )
    return result[selection.trace - 1]


def _read_nanonis(path: Path, _: Selection) -> Recording:
    """Nanonis .dat: lines ``name<tab>value``, ``[DATA]``, a header with units, columns with tabs.

    The frequency is the sum of the columns "Center Frequency" and "Frequency Shift" where the
    controller writes these.
    """
    lines = _numbered(path)
    begin = next((i for i, (_, text) in enumerate(lines) if text.strip() == "[DATA]"), None)
    if begin is None:
        raise BadInput(f"{path}: no line '[DATA]'; wanted the controller's frequency sweep file")
    table = parse_table(path, lines[begin + 1 :])
    head = [text.split("\t") for _, text in lines[:begin]]
    notes = {cells[0]: cells[1].strip() for cells in head if len(cells) > 1 and cells[1].strip()}
    made = of_table(table, f"Nanonis, {notes.get('Experiment', 'experiment not stated')}", notes)
    if made.find("Frequency") is not None or usual(made, TIME) is not None:
        return made
    names = [c.name for c in table.columns]
    if not any(name.lower().startswith("center freq") for name in names):
        there = ", ".join(names[:MOST_NAMES]) + (", ..." if len(names) > MOST_NAMES else "")
        raise BadInput(
            f"{path}: is a Nanonis file of the experiment '{notes.get('Experiment', 'not stated')}'"
            ", not a sweep of the frequency; wanted columns 'Frequency', or 'Center Frequency' and "
            f"'Frequency Shift', or 'Time' of a recording, there is: {there}"
        )
    shift, center = table.column("Frequency Shift"), table.column("Center Frequency")
    unit = unit_of(table, shift, "Frequency Shift (Hz)")
    if unit_of(table, center, "Center Frequency (Hz)") != unit:
        raise BadInput(
            f"{path}: 'Frequency Shift' is in {unit} and 'Center Frequency' in {center.unit}; "
            "wanted the same unit, because they are added"
        )
    added = channel_of("Frequency", unit, table.numbers(shift) + table.numbers(center))
    words = f"{made.words}, Frequency = Center Frequency + Frequency Shift"
    return replace(made, channels=(added, *made.channels), words=words)


def _read_rohde_schwarz(path: Path, selection: Selection) -> Recording:
    """``name;value;unit`` header lines, then ``Trace n``, ``Values;N`` and N lines ``x;y[;y2]``.

    Layout after "ASCII File Export Format" in the user manuals of R&S FSV, FSW and FPL. The second
    level that the AUTOPEAK detector adds is the smaller one and is left out.
    """
    lines = [split_line(t, ";") if t.strip() else ("",) for _, t in _numbered(path)]
    keys = [cells[0].rstrip(":").lower() for cells in lines]
    hint = "; is it the ASCII trace export of a Rohde & Schwarz analyser?"
    result = [i for i, key in enumerate(keys) if key == "values"]
    start = _chosen(path, result, selection, "trace ('Values;<number>' lines)", hint)
    header = {key: cells[1:] for key, cells in zip(keys[: start + 1], lines, strict=False)}
    where = f"{path}: row {start + 1}, 'Values'"
    count, below = int(parse_number((*lines[start], "")[1], where)), len(lines) - start - 1
    if not 0 <= count <= below:
        raise BadInput(
            f"{where}: {how_many(count, 'point')} announced, {how_many(below, 'line')} below"
        )
    rows = list(enumerate(lines, start=1))[start + 1 : start + 1 + count]
    for key in ("x-unit", "y-unit"):
        if not header.get(key, ("",))[0]:
            raise BadInput(f"{path}: no '{key}' line before the values; wanted as in 'x-Unit;Hz;'")
    over, unit = header["x-unit"][0], header["y-unit"][0]
    worth: tuple[str, ...] = ("type", "rbw", "detector")
    notes = {key: " ".join(header[key]).strip() for key in worth if key in header}
    words = ", ".join(("Rohde & Schwarz, ASCII trace", *notes.values()))
    columns = [("Time" if over == "s" else "Frequency", over, 0), ("Level", unit, 1)]
    return of_rows(path, columns, rows, words, notes, decimal_comma=True)


_LABVIEW, _END_OF_HEADER = "LabVIEW Measurement", "***End_of_Header***"


def _read_labview(path: Path, _: Selection) -> Recording:
    """LabVIEW .lvm: ``key<separator>value`` lines, a second head with units, then the columns.

    Each head ends with ``***End_of_Header***``. Times are the first column, or X0 and Delta_X.

    Source: NI, "Specification for the LabVIEW Measurement File (.lvm)".
    """
    lines = _numbered(path)
    ends = [k for k, (_, text) in enumerate(lines) if text.startswith(_END_OF_HEADER)]
    separator = "," if any(text.startswith("Separator,") for _, text in lines) else "\t"
    cells = [(n, split_line(text, separator)) for n, text in lines]
    if not ends or len(cells) < ends[-1] + 3:
        raise BadInput(f"{path}: no columns below '{_END_OF_HEADER}'; wanted a .lvm file with data")
    head = {row[0]: [c.strip() for c in row[1:]] for _, row in cells[: ends[-1]] if row[0]}
    if head.get("X_Columns", ["One"])[0] != "One":
        raise BadInput(
            f"{path}: X_Columns: found '{head['X_Columns'][0]}', wanted 'One', the times of all "
            "channels in the first column"
        )
    names = [c.strip() for c in cells[ends[-1] + 1][1] if c.strip() and c.strip() != "Comment"]
    units = [_unit(c) for c in head.get("Y_Unit_Label", [])]
    axis = head.get("X_Dimension", ["Time"])[0]
    x_unit = _unit(head.get("X_Unit_Label", [""])[0]) or {"Time": "s", "Frequency": "Hz"}.get(axis)
    named = zip([axis, *names[1:]], [x_unit, *units, *[None] * len(names)], strict=False)
    columns = [(name, unit, at) for at, (name, unit) in enumerate(named)]
    rows = [(n, row) for n, row in cells[ends[-1] + 2 :] if any(c.strip() for c in row)]
    comma = head.get("Decimal_Separator", ["."])[0] == ","
    return of_rows(path, columns, rows, "LabVIEW measurement file", decimal_comma=comma)


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

    Real and imaginary part are one column.
    """
    lines = _numbered(path)
    starts = [i for i, (_, line) in enumerate(lines) if _BEGIN.fullmatch(line)]
    hint = "; is it the CSV of a Keysight network analyser?"
    begin = _chosen(path, starts, selection, "block ('BEGIN' lines)", hint)
    below = lines[begin + 1 :]
    ends = (i for i, (_, line) in enumerate(below) if line.strip().upper().startswith("END"))
    body = below[: next(ends, len(below))]
    body = [(n, line) for n, line in body if line.strip() and not line.startswith("!")]
    if len(body) < 2:
        raise BadInput(f"{path}: row {begin + 1}: no rows of numbers below 'BEGIN'")
    delimiter = next((d for d in ";\t" if d in body[0][1]), ",")
    rows = [(n, split_line(text, delimiter)) for n, text in body]
    names = rows[0][1]
    if all(is_number(cell) for cell in names):  # FieldFox writes them above
        above = [_ABOVE.fullmatch(line.strip()) for _, line in lines[:begin]]
        given = {m["key"].upper(): m["value"].strip() for m in above if m is not None}
        if "DATA" not in given:
            raise BadInput(
                f"{path}: row {begin + 1}: wanted the names of the columns below 'BEGIN'"
            )
        first, *others = split_line(given["DATA"], ",")
        unit = given.get("DATA UNIT", "")
        names = (f"{first}({given.get('FREQ UNIT', '')})", *(f"{name}({unit})" for name in others))
    else:
        rows = rows[1:]
    for n, row in rows:
        if len(row) != len(names):
            raise BadInput(
                f"{path}: row {n} has {how_many(len(row), 'cell')}, the names {len(names)}"
            )
    label = lines[begin][1].strip()[5:].strip(" ,")
    several = f"{len(starts)} blocks, trace = {selection.trace} taken" if len(starts) > 1 else ""
    words = ", ".join(filter(None, ("Keysight network analyser CSV", label, several)))
    notes = {"instrument": lines[1][1].lstrip("! ").strip()} if len(lines) > 1 else {}
    made = of_rows(path, [(name, None, i) for i, name in enumerate(names)], rows, words, notes)
    return replace(made, channels=tuple(_joined(made)))


def _joined(recording: Recording) -> list[Channel]:
    """Columns with the unit that their name states; real and imaginary part as one complex one.

    Names are "S11(REAL)", "S21 Log Mag(dB)", "Freq(Hz)".
    """
    read: list[tuple[str, str | None, Channel]] = []
    for channel in recording.channels:
        match = _NAMED.fullmatch(channel.name.strip())
        if match is None or not match["name"]:
            read.append((channel.name.strip(), None, channel))
            continue
        kind = match["kind"].strip()
        kind = UNITS.get(kind.lower(), kind) if kind.isupper() else kind  # FREQ(HZ)
        read.append((match["name"], _KINDS.get(kind.lower(), kind), channel))
    imaginary = {name: c for name, kind, c in read if kind == "imag"}
    made: dict[str, Channel] = {}
    for name, unit, channel in read:
        if unit == "real" and name in imaginary:
            x, y = recording.numbers(channel), recording.numbers(imaginary[name])
            made.setdefault(name, channel_of(name, "1", x + 1j * y))
        elif unit != "imag" or name not in made:
            own = channel.name if name in made else name
            made.setdefault(own, Channel(name=own, unit=unit, read=channel.read))
    return list(made.values())


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
    lines = _numbered(path)
    head = next((text for _, text in lines if text.strip()), "")
    names = [name.lower() for name in split_line(head, ";" if ";" in head else ",")]
    if "fieldname" not in names:
        table = parse_table(path, lines)
        rows = list(zip(table.cells, table.lines, strict=True))
        column = table.find("chunk")
        if column is not None:
            wanted = _one_chunk(path, table.texts(column), selection.chunk)
            rows = [row for row in rows if row[0][column.index] == wanted]
        columns = [(c.name, c.unit or _LABONE.get(c.name.lower()), c.index) for c in table.columns]
        return of_rows(path, columns, [(n, cells) for cells, n in rows], _LABONE_WORDS)
    if "chunk" not in names:
        raise BadInput(f"{path}: no column 'chunk'; wanted one next to 'fieldname'")
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
    at, frequencies = fields["frequency"]
    size = _without_padding(frequencies)

    def values(name: str) -> FloatArray:
        row, cells = fields[name]
        there = max(_without_padding(cells), min(size, len(cells)))
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


def _without_padding(cells: Sequence[str]) -> int:
    """Number of cells before those that fill up a row."""
    numbers = [j for j, cell in enumerate(cells, start=1) if cell.lower() not in ("", "nan")]
    return max(numbers, default=0)


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


#: LeCroy's first word, and lines among which its head of columns stands, below the segments'.
_LECROY, _LINES_ABOVE = "LECROY", 4


def _read_lecroy(path: Path, selection: Selection) -> Recording:
    """LeCroy: ``Segments,1,SegmentSize,1002``, a line ``#k`` each, then ``Time,Ampl`` and rows.

    The segments' rows follow each other. Times are in seconds from the trigger. The file states no
    unit of its amplitudes: they are volts, unless a probe or a function of the oscilloscope made
    something else of them.
    """
    numbered = [(n, t) for n, t in _numbered(path) if t.strip()]
    cells = [split_line(text, ",") for _, text in numbered]
    row = cells[1] if len(cells) > 1 else ()
    try:
        segments, size = int(row[1]), int(row[3])
    except (IndexError, ValueError):
        raise BadInput(
            f"{path}: row 2: found {','.join(row)!r}, wanted the segments of a LeCroy "
            "oscilloscope, as Segments,1,SegmentSize,1002"
        ) from None
    end = _LINES_ABOVE + segments + 1
    at = next((i for i, row in enumerate(cells[:end]) if row[0] == "Time" and i), None)
    if at is None:
        raise BadInput(f"{path}: no row 'Time,Ampl'; wanted the text file of a LeCroy oscilloscope")
    begin = at + 1 + size * _chosen(path, range(segments), selection, "segment", "")
    rows = numbered[begin : begin + size] if segments > 1 else numbered[at + 1 :]
    names = [f"{name} (V)" for name in cells[at][1:] if name]
    table = parse_table(path, [(numbered[at][0], ",".join(["Time (s)", *names])), *rows])
    model = cells[0][0].removeprefix(_LECROY).strip()
    taken = f", trace = {selection.trace} taken" if segments > 1 else ""
    words = f"LeCroy oscilloscope {model}, {how_many(segments, 'segment')}{taken}, "
    return of_table(table, words + "V taken as the unit, which the file does not state")


#: Lines among which the head of Siglent's columns stands, and a channel's unit in its settings.
_HEAD_LINES = 40
_CHANNEL_UNIT = re.compile(r"(?P<channel>\w+)\s*:\s*(?P<unit>[^\s,:]+)")


def _read_siglent(path: Path, _: Selection) -> Recording:
    """Siglent: settings, ``Source,CH1,CH2``, then ``Second,Value,Value`` and rows.

    Older ones write "Second,Volt" and no units; some begin with the line of the channels.
    """
    lines = [text.strip().rstrip(",") for _, text in _numbered(path)]
    at = _siglent_head(lines)
    if at < 0:
        raise BadInput(
            f"{path}: no row 'Second,Value'; wanted the CSV of a Siglent oscilloscope, seconds and "
            "a value of each channel"
        )
    above = [cells_of(text, ",") for text in lines[:at]]
    settings = {cells[0].lower(): ",".join(cells[1:]) for cells in above if cells}
    kinds = cells_of(lines[at], ",")[1:]
    names = [name for name in settings.get("source", "").split(",") if name]
    units = settings.get("vertical units", "")
    given = {m["channel"]: m["unit"] for m in _CHANNEL_UNIT.finditer(units)}
    columns = ["Time (s)"]
    for k, kind in enumerate(kinds):
        name = names[k] if len(names) == len(kinds) else f"CH{k + 1}"
        unit = given.get(name, "") or UNITS.get(kind.lower(), "")
        columns.append(f"{name} ({unit})" if unit else name)
    rows = list(enumerate(lines[at + 1 :], start=at + 2))
    table = parse_table(path, [(at + 1, ",".join(columns)), *rows])
    return of_table(table, f"Siglent oscilloscope {settings.get('model number', '')}".strip())


def _siglent_head(lines: Sequence[str]) -> int:
    """Where the head of the columns stands; -1: nowhere."""
    heads = (cells_of(text, ",") for text in lines[:_HEAD_LINES])
    result = (i for i, cells in enumerate(heads) if len(cells) > 1 and cells[0].lower() == "second")
    return next(result, -1)


def _read_oscilloscope(path: Path, _: Selection) -> Recording:
    """Oscilloscopes whose settings are next to the numbers: Tektronix and Rigol.

    Tektronix writes ``name,value,,x,y`` on every line; Rigol ``X,CH1,CH2,Start,Increment`` over
    ``Sequence,Volt,Volt,-6e-5,2e-8``, then numbered rows. Those that write them above (Keysight,
    PicoScope) are plain columns.
    """
    lines = _numbered(path)
    rows = [(n, split_line(t, ",")) for n, t in lines if t.strip()]
    if not _is_rigol([text for _, text in lines[:2]]):
        settings = {cells[0]: cells[1] for _, cells in rows if len(cells) > 1 and cells[0]}
        for n, cells in rows:
            if len(cells) < 5:
                raise BadInput(
                    f"{path}: row {n} has {how_many(len(cells), 'cell')}, wanted 5 of a Tektronix "
                    "file"
                )
        over, source = _unit(settings.get("Horizontal Units", "s")), settings.get("Source")
        axis = "Frequency" if over == "Hz" else "Time", over, 3
        values = source or "channel", _unit(settings.get("Vertical Units", "")), 4
        return of_rows(path, [axis, values], rows, f"Tektronix oscilloscope, {values[0]}", settings)
    names, units = (split_line(text, ",") for _, text in lines[:2])
    rows = [row for row in rows if row[0] > 2]
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


def _is_rigol(lines: Sequence[str]) -> bool:
    if len(lines) < 2:
        return False
    names = [cell.lower() for cell in split_line(lines[0], ",")]
    nearby = len(split_line(lines[1], ",")) >= len([n for n in names if n])
    return names[:1] == ["x"] and {"start", "increment"} <= set(names) and nearby


def _of_oscilloscope(head: Head) -> bool:
    first = head.first_line
    named = first.lower().startswith(("record length,", '"record length",'))
    return (named and len(split_line(first, ",")) >= 5) or _is_rigol(head.lines)


def _of_zurich(head: Head) -> bool:
    first = head.first_line.lower()
    return "chunk" in split_line(first, ";" if ";" in first else ",")


def _of_keysight(head: Head) -> bool:
    begins = any(_BEGIN.fullmatch(line) for line in head.lines)
    return begins and head.first_line.upper().startswith(("!", "BEGIN"))


#: Name in a campaign, reader, and what the beginning of a file of this layout looks like.
LAYOUTS = (
    Layout("afm", _read_nanonis, lambda head: "[DATA]" in map(str.strip, head.lines)),
    Layout("keysight", _read_keysight, _of_keysight, keys=("trace",)),
    Layout("labview", _read_labview, lambda head: head.first_line.startswith(_LABVIEW)),
    Layout(
        "lecroy",
        _read_lecroy,
        lambda head: (
            head.first_line.startswith(_LECROY) and "".join(head.lines[1:2]).startswith("Segments")
        ),
        keys=("trace",),
    ),
    Layout("oscilloscope", _read_oscilloscope, _of_oscilloscope),
    Layout(
        "rohde-schwarz",
        _read_rohde_schwarz,
        lambda head: any(x.lower().startswith(("values;", "values:;")) for x in head.lines),
        keys=("trace",),
    ),
    Layout(
        "siglent",
        _read_siglent,
        lambda head: (
            head.first_line.lower().startswith(("record length,", "source,ch"))
            and _siglent_head(head.lines) > 0
        ),
    ),
    Layout("zurich", _read_zurich, _of_zurich, keys=("chunk",)),
)
