"""A campaign of traces: recordings over time of an output, under an input or none, and an FMU.

What is fitted by default is what the record shows: parameters whose small change changes the
output, each otherwise than those before it. That is seen by running the FMU at its own start values
under the recorded input:

    s_k = d y/d ln p_k,     p_k is taken while |s_k - (its projection on those taken)| > 1 % |s_k|

and while |s_k| is more than 1/1000 of the largest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fitting.campaign import instruments
from fitting.campaign.instruments import Channel, read_recording
from fitting.campaign.instruments.roles import FREQUENCY, TIME, usual
from fitting.draft.closer_start import Record, closer_starts
from fitting.draft.decays import decays_of
from fitting.draft.model import Offer
from fitting.draft.questions import Answers, Question
from fitting.draft.source import Source
from fitting.draft.trace_draft import (
    OWN,
    Recording,
    TraceDraft,
    TraceFile,
    called,
    in_unit_of,
    said_of,
    start_box,
)
from fitting.fmu import Run
from fitting.measurements.traces.record import TraceRecord
from fitting.measurements.traces.waveform import HELD, LINEAR
from fitting.resonance.reading import TIME_PAGE, Columns, with_unit
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.notation import listed
from fitting.text.units import convert, same_kind

#: Columns that may be told, by what of the FMU they hold.
OUTPUT, INPUT = "output", "input"
#: Samples of a record that are looked at.
LOOKED_AT = 4000
#: Change of a logarithm, and shares of a change below which a parameter is not seen.
STEP, SEEN, APART = 1e-3, 1e-3, 1e-2
#: Share of the samples of an input at which it may change and still seem held.
CHANGES = 0.25
#: What is said of a recording without an input, of an FMU that has one.
UNDRIVEN = (
    "No column drives: the FMU runs from its start values, with what drive it has of its own. Of a "
    f'ringdown nobody knows where it starts: start = "unknown", {TIME_PAGE}.'
)


def recordings_of(
    paths: Sequence[Path], columns: Columns | None = None, *, simulated: bool = False
) -> tuple[Recording, ...]:
    """The files as recordings over time; none where one of them is something else.

    Args:
        paths: of the files.
        columns: what is told of them.
        simulated: whether an FMU is told whose variables they hold: programs that run FMUs write no
            units, and FMI counts time in seconds.

    Raises:
        BadInput: no column of the name that is told for the times.
    """
    columns, found = columns or Columns(), []
    for path in paths:
        try:
            table = read_recording(path, selection=columns.selection)
        except BadInput:
            return ()  # its reader complains, if it is none either
        time = _time(table, columns, simulated=simulated)
        units = [c.unit for c in table.channels if c.unit]
        other = any(same_kind(u, "Hz") for u in units) and not (columns.time or simulated)
        none = other or any(c.is_complex for c in table.channels)
        if time is None or len(table.channels) < 2 or none:
            return ()
        found.append(Recording(table, time))
    return tuple(found)


def _time(table: instruments.Recording, columns: Columns, *, simulated: bool) -> Channel | None:
    """The column of times, in a unit that it tells, is told, or that FMI has; None: there is none.

    A response over frequency is no recording, unless its column of times is told.
    """
    told = columns.unit_time
    if columns.time:
        return with_unit(table.column(columns.time), told or _untold(table.column(columns.time)))
    if usual(table, FREQUENCY) is not None:
        return None
    times = [c for c in table.channels if c.unit and same_kind(c.unit, "s")]
    named = usual(table, TIME)
    if len(times) == 1 or (simulated and named in times):
        return times[0] if len(times) == 1 else named
    if times or named is None or named.unit is not None or not (told or simulated):
        return None
    return with_unit(named, told or "s")


def _untold(channel: Channel) -> str:
    return "" if channel.unit else "s"


def traces_of(
    recordings: Sequence[Recording], source: Source, offer: Offer, answers: Answers
) -> TraceDraft:
    """A campaign of traces.

    Args:
        recordings: one or more.
        source: the FMU.
        offer: what it offers.
        answers: of flags, of a person, or by default.

    Raises:
        BadInput: no output, columns that suit no variable, an answer that is none.
        FmuFailure: the FMU failed with its own start values.
    """
    recordings = [_told_columns(each, answers.columns, offer) for each in recordings]
    decaying = decays_of(recordings, source, offer, answers)
    if decaying is not None:
        return decaying
    output = _output(recordings, offer, answers)
    driven = _input(recordings, offer, answers)
    files = tuple(_file(r, output, driven, offer, answers.columns) for r in recordings)
    if all(file.driven is None for file in files):
        driven = ""
    default, why, alike = _fitted(files[0], source, offer, output, driven)
    names = answers.of(
        Question(
            key="fit",
            words="Which parameters of the FMU are fitted?",
            options=offer.parameters,
            default=default,
            why=why,
            several=True,
        )
    )
    taken = {name: (value, OWN) for name, value in alike.items() if name not in names}
    closer = _closer(files[0], source, offer, output, driven, names)
    return TraceDraft(
        source=source,
        output=output,
        input=driven,
        files=files,
        boxes=tuple(start_box(offer, name, closer.get(name)) for name in names),
        start=taken,
        taken=tuple(taken),
        seen=(
            *(words for file in files for words in said_of(file, output, driven)),
            *([UNDRIVEN] if not driven and offer.inputs else []),
        ),
    )


def _named(recordings: Sequence[Recording], names: Sequence[str]) -> list[str]:
    """Those of the FMU's variables that a column of the first recording is called by."""
    return [name for name in names if recordings[0].called(name) is not None]


def _output(recordings: Sequence[Recording], offer: Offer, answers: Answers) -> str:
    outputs = offer.outputs
    if not outputs:
        raise BadInput(f"{offer.description.path}: has no continuous Real output, wanted one")
    named = _named(recordings, outputs)
    why = "named like a column" if named else "the first one with continuous values"
    [output] = answers.of(
        Question(
            key="output",
            words="Which output of the FMU was recorded?",
            options=outputs,
            default=tuple((named or list(outputs))[:1]),
            why="the only one" if len(outputs) == 1 else why,
        )
    )
    return output


def _input(recordings: Sequence[Recording], offer: Offer, answers: Answers) -> str:
    """The input that a second column drives; empty: there is none."""
    if all(len(r.others) == 1 for r in recordings) or not offer.inputs:
        return ""
    named = _named(recordings, offer.inputs)
    why = "named like a column" if named else "the first one"
    [driven] = answers.of(
        Question(
            key="input",
            words="Which input of the FMU was recorded?",
            options=offer.inputs,
            default=tuple((named or list(offer.inputs))[:1]),
            why="the only one" if len(offer.inputs) == 1 else why,
        )
    )
    return driven


def _told_columns(recording: Recording, columns: Mapping[str, str], offer: Offer) -> Recording:
    """Of a recording whose output is told the columns that are told, and those of FMU inputs."""
    if OUTPUT not in columns:
        return recording
    table = recording.table
    told = {table.column(name).name for name in columns.values()}
    told |= {c.name for c in recording.others if any(called(c, name) for name in offer.inputs)}
    kept = tuple(c for c in table.channels if c.name in {*told, recording.time.name})
    return replace(recording, table=replace(table, channels=kept))


def _file(
    recording: Recording, output: str, driven: str, offer: Offer, columns: Mapping[str, str]
) -> TraceFile:
    """Which columns are which: as told, by their names, else the input stands before the output."""
    table = recording.table
    inputs = [name for name in offer.inputs if name != driven]
    further = tuple(c for c in recording.others if driven and c.name in inputs)
    others = [c for c in recording.others if c not in further]
    seen = table.column(columns[OUTPUT]) if OUTPUT in columns else recording.called(output)
    source = recording.called(driven) if driven else None
    if driven and INPUT in columns:
        source = table.column(columns[INPUT])
    left = _left(others, (seen, source), offer)
    if (seen is None and not 1 <= len(left) <= 1 + (driven != "" and source is None)) or (
        seen is not None and driven and source is None and len(left) > 1
    ):
        raise _unmatched(recording, output if seen is None else driven, others, offer)
    seen = left.pop() if seen is None else seen
    if driven and source is None and left:
        source = left[0]
    seen = in_unit_of(seen, offer.unit(output))
    if source is None:
        return TraceFile(recording, seen, None, LINEAR)
    source = in_unit_of(source, offer.unit(driven))
    u = table.numbers(source)
    changes = np.count_nonzero(np.diff(u)) / max(1, u.size - 1)
    how = HELD if changes <= CHANGES else LINEAR
    further = tuple(in_unit_of(c, offer.unit(c.name)) for c in further)
    return TraceFile(recording, seen, source, how, further)


def _left(
    others: Sequence[Channel], taken: Sequence[Channel | None], offer: Offer
) -> list[Channel]:
    """Columns that no name tells apart: those of the FMU's other variables are what they say."""
    names = {c.name for c in taken if c is not None}
    free = [c for c in others if c.name not in names]
    return [c for c in free if not any(called(c, name) for name in offer.description.variables)]


def _unmatched(
    recording: Recording, wanted: str, others: Sequence[Channel], offer: Offer
) -> BadInput:
    """The complaint of a column that is not found, with how to name it."""
    key = OUTPUT if wanted in offer.outputs else INPUT
    names = listed(f"'{c.name}'" for c in others) or "none"
    column = others[-1].name if others else "y"
    return BadInput(
        f"{recording.table.path}: no column '{wanted}' among {names}; wanted one that is called "
        f"like the FMU's {key}, or its name by --{key} {column}={wanted}"
    )


def _fitted(
    file: TraceFile, source: Source, offer: Offer, output: str, driven: str
) -> tuple[tuple[str, ...], str, dict[str, float]]:
    """Parameters that the record shows, each by itself, why; others with their start values."""
    trace = _record(file, offer, driven)
    names = [n for n in offer.parameters if offer.description.variables[n].start]
    starts = {n: float(offer.description.variables[n].start or 0.0) for n in names}
    points: list[Mapping[str, Scalar]] = [{}]
    points += [{n: (1.0 + STEP) * starts[n]} for n in names]
    base, *seen = _simulated(trace, source, output, points)
    if base is None:  # its own start values do not run: nothing is seen of any
        return (), "the FMU fails with its own start values under the record", {}
    slopes = {n: y - base for n, y in zip(names, seen, strict=True) if y is not None}
    largest = max((float(np.linalg.norm(s)) for s in slopes.values()), default=0.0)
    taken: list[str] = []
    basis = np.empty((base.size, 0))
    for name in sorted(slopes, key=lambda n: -float(np.linalg.norm(slopes[n]))):
        size = float(np.linalg.norm(slopes[name]))
        rest = slopes[name] - basis @ (basis.T @ slopes[name])
        own = float(np.linalg.norm(rest))
        if size > SEEN * largest and own > APART * size:
            taken.append(name)
            basis = np.column_stack([basis, rest / own])
    ordered = tuple(n for n in names if n in taken)
    moved = [n for n in names if n in slopes and np.linalg.norm(slopes[n]) > SEEN * largest]
    alike = [n for n in moved if n not in taken]
    left_out = f"; not {listed(alike)}, which look like others there" if alike else ""
    why = "each changes the output otherwise than the others, at the FMU's start values" + left_out
    return ordered, why, {name: starts[name] for name in alike}


def _closer(
    file: TraceFile,
    source: Source,
    offer: Offer,
    output: str,
    driven: str,
    names: Sequence[str],
) -> dict[str, float]:
    """Start values of parameters from which the FMU follows the record closer than from its own."""
    trace, known = _record(file, offer, driven), offer.description.variables
    unit, seen = known[output].unit, file.seen.unit
    is_scaled = bool(unit and seen) and not same_kind(seen or "", unit or "")
    values = trace.y
    if seen and not is_scaled:  # as the campaign reads it: to base units where the FMU has none
        zero, one = (convert(x, seen, unit, where=str(file.path)) for x in (0.0, 1.0))
        values = zero + (one - zero) * values

    def simulated(starts: Mapping[str, float]) -> FloatArray | None:
        return _simulated(trace, source, output, [starts])[0]

    return closer_starts(Record(values, is_scaled), simulated, {n: known[n] for n in names})


def _record(file: TraceFile, offer: Offer, driven: str) -> TraceRecord:
    """The first samples of a recording, inputs in the units of the FMU."""
    table, time = file.recording.table, file.recording.time
    factor = convert(1.0, time.unit or "s", "s", where=str(table.path))
    time_s = factor * table.numbers(time)[:LOOKED_AT]

    def driving(column: Channel, name: str) -> tuple[FloatArray, FloatArray]:
        u, wanted = table.numbers(column)[:LOOKED_AT], offer.description.variables[name].unit
        if column.unit is not None:
            ends = (convert(x, column.unit, wanted, where=str(table.path)) for x in (0.0, 1.0))
            zero, one = ends
            u = zero + (one - zero) * u
        return time_s, u

    return TraceRecord(
        time_s,
        table.numbers(file.seen)[:LOOKED_AT],
        input=driven if file.driven is not None else "",
        driven=None if file.driven is None else driving(file.driven, driven),
        further={column.name: driving(column, column.name) for column in file.further},
        interpolation=file.interpolation,
        source=str(table.path),
    )


def _simulated(
    trace: TraceRecord, source: Source, output: str, points: Sequence[Mapping[str, Scalar]]
) -> list[FloatArray | None]:
    """The output at start values; None where the FMU refuses them."""
    window = trace.window()
    first = Run(
        start_values={},
        settle_s=window.settle_s,
        sample_step_s=window.step_s,
        samples=window.samples,
        outputs=(output,),
        input_signal=trace.signal(1),
    )
    found: list[FloatArray | None] = []
    for values in points:
        try:
            [seen] = source.workers.run([replace(first, start_values=dict(values))])
        except FmuFailure:
            found.append(None)
            continue
        found.append(np.asarray(seen[:, 0]))
    return found
