"""A campaign of traces: recordings over time of an output, under an input or none, and an FMU.

Of ringdowns the lines are fitted (`fitting.draft.decays`). Else what is fitted by default is what
the record shows: parameters whose small change changes the output, each otherwise than those before
it, by runs of the FMU at its own start values under the recorded input:

    s_k = d y/d ln p_k,     p_k is taken while |s_k - (its projection on those taken)| > 1 % |s_k|

and while |s_k| is more than 1/1000 of the largest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign import instruments
from fitting.campaign.instruments.roles import TIME, usual, usual_frequency
from fitting.draft.boxes import Box, Shown, decade_box, decay_boxes
from fitting.draft.closer_start import closer_starts
from fitting.draft.decays import (
    OWN,
    decay_boxes_chosen,
    decay_start,
    qualities,
    ringdown_of,
    showing,
    undetermined,
)
from fitting.draft.document import (
    Draft,
    draft_from,
    fitted_tables,
    fmu_table,
    in_file,
    noted,
    starts_words,
)
from fitting.draft.model import Offer
from fitting.draft.questions import Answers, Question
from fitting.extension.fmu import Run
from fitting.extension.records import Channel, TraceRecord, read_recording
from fitting.lines.decay_begin import decay_start as first_of_decay
from fitting.lines.names import TIME_PAGE
from fitting.measurements.traces.record import FIT, STATES_OF_ONE, UNKNOWN
from fitting.measurements.traces.time_record import FOUND
from fitting.measurements.traces.waveform import HELD, LINEAR
from fitting.resonance.reading import Columns, with_unit
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.notation import listed
from fitting.text.rendering import blocks
from fitting.text.units import convert, same_kind

#: Columns that may be told, by what of the FMU they hold.
OUTPUT, INPUT = "output", "input"
#: Samples of a record that are looked at, and for what an output shows of a ringdown.
MOST_SAMPLES, AFTER_PULSE = 4000, 2000
#: Change of a logarithm, and shares of a change below which a parameter has no effect of its own.
STEP, LEAST_EFFECT, APART = 1e-3, 1e-3, 1e-2
#: Share of the samples of an input at which it may change and still seem held.
CHANGES = 0.25
#: Share of a record behind which its decay begins late.
LATEST = 0.02
EARLIER = "earlier samples, of a drive or a blow, are not used"
SPANS = "a pulse at it spans the states that ring down"
#: Remarks on how an input moves between samples.
MOVES = {
    HELD: 'a guess: it stands still and jumps; or "linear" between samples',
    LINEAR: 'a guess: it moves from sample to sample; or "held" from each to the next',
}


@dataclass(frozen=True)
class Recording:
    """Columns over time, and which of them holds the times."""

    table: instruments.Recording
    time: Channel

    @property
    def path(self) -> Path:
        """Of the file."""
        return self.table.path

    @property
    def others(self) -> tuple[Channel, ...]:
        """All columns but that of times."""
        return tuple(c for c in self.table.channels if c.name != self.time.name)

    def time_s(self, most: int | None = None) -> FloatArray:
        """Times of the first samples, s.

        Args:
            most: samples; None: all.
        """
        factor = convert(1.0, self.time.unit or "s", "s", where=str(self.path))
        return np.asarray(factor * self.table.numbers(self.time)[:most])

    def called(self, name: str) -> Channel | None:
        """The column that is called like a variable, capitals apart; None where none is.

        Args:
            name: of the variable; brackets in it are those of an array, and no unit.
        """
        matches = [c for c in self.others if _called(c, name)]
        exact = [c for c in matches if c.name.lower() == name.lower()]
        return exact[0] if exact else matches[0] if len(matches) == 1 else None


@dataclass(frozen=True)
class TraceFile(Recording):
    """A recording whose columns are known: of the output, and of the input, None: none drives.

    ``further`` are columns of further inputs, by their names.
    """

    observed: Channel
    driven: Channel | None = None
    interpolation: str = LINEAR
    further: tuple[Channel, ...] = ()

    def is_silent(self, column: Channel) -> bool:
        """Whether the file has no unit of a column.

        Args:
            column: of the file.
        """
        return all(c.unit is None for c in self.table.channels if c.name == column.name)


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
    columns, matches = columns or Columns(), []
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
        matches.append(Recording(table, time))
    return tuple(matches)


def _time(table: instruments.Recording, columns: Columns, *, simulated: bool) -> Channel | None:
    """The column of times, in its own unit, one that is told, or that of FMI; None: there is none.

    A response over frequency is no recording, unless its column of times is told.
    """
    requested = columns.unit_time
    if columns.time:
        column = table.column(columns.time)
        return with_unit(column, requested or ("" if column.unit else "s"))
    if usual_frequency(table) is not None:
        return None
    times = [c for c in table.channels if c.unit and same_kind(c.unit, "s")]
    named = usual(table, TIME)
    if len(times) == 1 or (simulated and named in times):
        return times[0] if len(times) == 1 else named
    if times or named is None or named.unit is not None or not (requested or simulated):
        return None
    return with_unit(named, requested or "s")


def lines_of_recording(recording: Recording) -> tuple[Shown, ...]:
    """The lines of a recording of nothing but one free decay; none of another.

    Args:
        recording: over time.
    """
    if len(recording.others) != 1:
        return ()
    return ringdown_of(recording.time_s(), recording.table.numbers(recording.others[0]))


def traces_draft(
    recordings: Sequence[Recording], offer: Offer, answers: Answers, folder: Path
) -> Draft:
    """A campaign of traces.

    Args:
        recordings: one or more.
        offer: what the FMU offers.
        answers: of flags, of a person, or by default.
        folder: of the campaign.

    Raises:
        BadInput: no output, columns that suit no variable, an answer that is none; or the draft
            does not suit, by the campaign's reader.
        FmuFailure: the FMU failed with its own start values.
    """
    recordings = [_requested_columns(each, answers.columns, offer) for each in recordings]
    if offer.inputs and offer.outputs and all(len(each.others) == 1 for each in recordings):
        shown = lines = lines_of_recording(recordings[0])
        if len(offer.places) == len(offer.widths) == 1 < len(shown):
            lines = (max(shown, key=lambda line: line.amplitude),)
        if boxes := decay_boxes(lines, offer):
            return _ringdowns(recordings, offer, answers, folder, (shown, lines, boxes))
    if not offer.outputs:
        raise BadInput(f"{offer.description.path}: has no continuous Real output, wanted one")
    output = _variable(OUTPUT, recordings[0], offer.outputs, answers)
    driven = ""  # the input that a second column drives
    if offer.inputs and any(len(each.others) != 1 for each in recordings):
        driven = _variable(INPUT, recordings[0], offer.inputs, answers)
    files = [_file(r, output, driven, offer, answers.columns) for r in recordings]
    if all(file.driven is None for file in files):
        driven = ""
    default, why, alike = _fitted(files[0], offer, output, driven)
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
    closer = _closer(files[0], offer, output, driven, names)
    made = [decade_box(offer, name, closer.get(name)) for name in names]
    traces = [_trace(file, offer, output, driven) for file in files]
    tables = _tables(files, offer, output, traces) | fitted_tables(made)
    tables["fmu"] = fmu_table(offer, taken, tuple(taken))
    notes = _described(files, output, driven)
    if not driven and offer.inputs:
        notes.append(str(blocks("draft/text").undriven(TIME_PAGE)))
    return draft_from(tables, offer, folder, (*notes, *answers.said, *starts_words(made)))


def _ringdowns(
    recordings: Sequence[Recording],
    offer: Offer,
    answers: Answers,
    folder: Path,
    decay: tuple[tuple[Shown, ...], tuple[Shown, ...], tuple[Box, ...]],
) -> Draft:
    """A campaign of ringdowns from an unknown state, which a pulse at the input spans."""
    shown, lines, boxes = decay
    default, why = offer.outputs[0], "the first one with continuous values"
    named = [name for name in offer.outputs if recordings[0].called(name) is not None]
    if named:
        default, why = named[0], "named like a column"
    elif len(offer.outputs) > 1 and len(lines) > 1:
        time_s = recordings[0].time_s(AFTER_PULSE)
        default = showing(offer, lines, boxes, time_s, str(recordings[0].path))
        why = "shows both lines after a pulse"
    words = "Which output of the FMU was recorded?"
    output = answers.one_of(OUTPUT, words, offer.outputs, default, why)
    chosen = decay_boxes_chosen(offer, answers, lines, boxes)
    names = {box.name for box in chosen}
    files, late = [], False
    for each in recordings:
        observed = _in_unit_of(each.others[0], offer.unit(output))
        files.append(TraceFile(each.table, each.time, observed))
        values = each.table.numbers(observed)  # of two lines at most
        starts = [first_of_decay(values, states) for states in (2, 4)]
        late = late or all(k is not None and k > LATEST * values.size for k in starts)
    traces = []
    for file in files:
        made: dict[str, Any] = {
            "file": file.path,
            "input": noted(offer.inputs[0], SPANS),
            "start": noted(UNKNOWN, "solved for: the start of a ringdown is not known"),
        }
        if len(lines) > 1:
            made["states"] = noted(STATES_OF_ONE * len(lines), "two for each mode")
        if late:
            made["begin"] = noted(FOUND, EARLIER)
        traces.append(made | _columns(file, output, ""))
    start = decay_start(offer, lines, boxes)
    start = {name: value for name, value in start.items() if name not in names}
    left = undetermined(offer, lines, boxes)
    tables = _tables(files, offer, output, traces)
    tables |= fitted_tables(chosen, qualities(offer, lines))
    tables["fmu"] = fmu_table(offer, start, [name for name in left if name not in names])
    notes = _described(files, output, "") + ([str(blocks("draft/text").late())] if late else [])
    lead = "A ringdown: no column drives, and "
    notes += str(blocks("draft/text").decay(lead, shown, lines, offer, left)).splitlines()
    return draft_from(tables, offer, folder, (*notes, *answers.said, *starts_words(chosen)))


def _tables(
    files: Sequence[TraceFile], offer: Offer, output: str, traces: list[dict[str, Any]]
) -> dict[str, Any]:
    """Tables of a campaign before those of what is fitted."""
    return {
        "title": ", ".join(file.path.stem for file in files),
        "fmu": fmu_table(offer, {}),
        "observe": {"output": output},
        "trace": traces,
    }


def _trace(file: TraceFile, offer: Offer, output: str, driven: str) -> dict[str, Any]:
    """The table of a trace: how its input moves, and whether its detector has a gain."""
    made: dict[str, Any] = {"file": file.path}
    if file.driven is not None:
        how = noted(file.interpolation, MOVES[file.interpolation])
        made |= {"input": driven, "interpolation": how}
    if _is_scaled(file, offer, output):
        words = f"{file.observed.unit} for the FMU's output: in proportion"
        made["gain"] = noted(FIT, words)
    if file.further:
        made["further_inputs"] = [column.name for column in file.further]
    return made | _columns(file, output, driven)


def _columns(file: TraceFile, output: str, driven: str) -> dict[str, Any]:
    """Names of columns that are not the usual ones, with units where the file has none."""
    named = {"time": (file.time, "time"), "output": (file.observed, output)}
    if file.driven is not None:
        named["input"] = file.driven, driven
    columns = {}
    for key, (column, usual_name) in named.items():
        name = in_file(column) + (f" ({column.unit})" if file.is_silent(column) else "")
        if name != usual_name:
            columns[key] = name
    return {"columns": columns} if columns else {}


def _is_scaled(file: TraceFile, offer: Offer, output: str) -> bool:
    """Whether a detector is between the output and what was recorded, by their units."""
    unit, observed = offer.description.variables[output].unit, file.observed.unit
    return bool(observed and unit) and not same_kind(observed or "", unit or "")


def _described(files: Sequence[TraceFile], output: str, driven: str) -> list[str]:
    """What files were taken for, in sentences."""
    words, notes = blocks("draft/text"), []
    for file in files:
        notes.append(str(words.recording(file, output, driven)))
        columns = [file.time, file.observed, *([file.driven] if file.driven else []), *file.further]
        taken = [f"'{c.name}' in {c.unit}" for c in columns if file.is_silent(c)]
        notes += [str(words.assumed(taken))] if taken else []
    return notes


def _called(channel: Channel, name: str) -> bool:
    """Whether a column is called like a variable, alone or within a model, as "model.fmu.y"."""
    return f".{channel.name.lower()}".endswith(f".{name.lower()}")


def _in_unit_of(channel: Channel, unit: str) -> Channel:
    """A column in the unit of the FMU's variable where it has none."""
    return channel if channel.unit is not None else replace(channel, unit=unit)


def _variable(key: str, recording: Recording, options: tuple[str, ...], answers: Answers) -> str:
    """The output, or the input, that was recorded: the one that a column is called by."""
    named = [name for name in options if recording.called(name) is not None]
    first = "the first one with continuous values" if key == OUTPUT else "the first one"
    why = "named like a column" if named else first
    words = f"Which {key} of the FMU was recorded?"
    return answers.one_of(key, words, options, (named or list(options))[0], why)


def _requested_columns(recording: Recording, columns: Mapping[str, str], offer: Offer) -> Recording:
    """Of a recording whose output is told the columns that are told, and those of FMU inputs."""
    if OUTPUT not in columns:
        return recording
    table = recording.table
    requested = {table.column(name).name for name in columns.values()}
    requested |= {
        c.name for c in recording.others if any(_called(c, name) for name in offer.inputs)
    }
    kept = tuple(c for c in table.channels if c.name in {*requested, recording.time.name})
    return replace(recording, table=replace(table, channels=kept))


def _file(
    recording: Recording, output: str, driven: str, offer: Offer, columns: Mapping[str, str]
) -> TraceFile:
    """Which columns are which: as told, by their names, else the input is before the output."""
    table, known = recording.table, offer.description.variables
    inputs = [name for name in offer.inputs if name != driven]
    further = tuple(c for c in recording.others if driven and c.name in inputs)
    others = [c for c in recording.others if c not in further]
    observed = table.column(columns[OUTPUT]) if OUTPUT in columns else recording.called(output)
    source = recording.called(driven) if driven else None
    if driven and INPUT in columns:
        source = table.column(columns[INPUT])
    # columns of the FMU's other variables are what they are called
    free = [
        c for c in others if c.name not in [t.name for t in (observed, source) if t is not None]
    ]
    free = [c for c in free if not any(_called(c, name) for name in known)]
    wants_input = driven != "" and source is None
    if (observed is None and not 1 <= len(free) <= 1 + wants_input) or (
        observed is not None and wants_input and len(free) > 1
    ):
        wanted = output if observed is None else driven
        key = OUTPUT if wanted in offer.outputs else INPUT
        names = listed(f"'{c.name}'" for c in others) or "none"
        column = others[-1].name if others else "y"
        raise BadInput(
            f"{table.path}: no column '{wanted}' among {names}; wanted one that is called like the "
            f"FMU's {key}, or its name by --{key} {column}={wanted}"
        )
    observed = free.pop() if observed is None else observed
    if wants_input and free:
        source = free[0]
    observed = _in_unit_of(observed, offer.unit(output))
    if source is None:
        return TraceFile(table, recording.time, observed)
    u = table.numbers(source)
    changes = np.count_nonzero(np.diff(u)) / max(1, u.size - 1)
    return TraceFile(
        table,
        recording.time,
        observed,
        _in_unit_of(source, offer.unit(driven)),
        HELD if changes <= CHANGES else LINEAR,
        tuple(_in_unit_of(c, offer.unit(c.name)) for c in further),
    )


def _fitted(
    file: TraceFile, offer: Offer, output: str, driven: str
) -> tuple[tuple[str, ...], str, dict[str, float]]:
    """Parameters that the record shows, each by itself, why; others with their start values."""
    trace = _record(file, offer, driven)
    names = [n for n in offer.parameters if offer.description.variables[n].start]
    base = _simulated(trace, offer, output, {})
    if base is None:  # its own start values do not run
        return (), "the FMU fails with its own start values under the record", {}
    slopes, sizes = {}, {}
    for name in names:
        y = _simulated(trace, offer, output, {name: (1.0 + STEP) * offer.start(name)})
        if y is not None:
            slopes[name] = y - base
            sizes[name] = float(np.linalg.norm(slopes[name]))
    moved = [n for n in slopes if sizes[n] > LEAST_EFFECT * max(sizes.values())]
    taken: list[str] = []
    basis = np.empty((base.size, 0))
    for name in sorted(moved, key=lambda n: -sizes[n]):
        rest = slopes[name] - basis @ (basis.T @ slopes[name])
        own = float(np.linalg.norm(rest))
        if own > APART * sizes[name]:
            taken.append(name)
            basis = np.column_stack([basis, rest / own])
    alike = [n for n in moved if n not in taken]
    why = "each changes the output otherwise than the others, at the FMU's start values"
    why += f"; not {listed(alike)}, which look like others there" if alike else ""
    return tuple(n for n in names if n in taken), why, {n: offer.start(n) for n in alike}


def _closer(
    file: TraceFile, offer: Offer, output: str, driven: str, names: Sequence[str]
) -> dict[str, float]:
    """Start values of parameters from which the FMU follows the record closer than from its own."""
    trace, known = _record(file, offer, driven), offer.description.variables
    is_scaled, unit, values = _is_scaled(file, offer, output), file.observed.unit, trace.y
    if unit and not is_scaled:  # as the campaign reads it: to base units where the FMU has none
        values = _converted(values, unit, known[output].unit, str(file.path))
    return closer_starts(
        values,
        lambda starts: _simulated(trace, offer, output, starts),
        {n: known[n] for n in names},
        is_scaled=is_scaled,
    )


def _converted(values: FloatArray, unit: str, wanted: str | None, where: str) -> FloatArray:
    zero, one = (convert(x, unit, wanted, where=where) for x in (0.0, 1.0))
    return np.asarray(zero + (one - zero) * values)


def _record(file: TraceFile, offer: Offer, driven: str) -> TraceRecord:
    """The first samples of a recording, inputs in the units of the FMU."""
    time_s = file.time_s(MOST_SAMPLES)

    def driving(column: Channel, name: str) -> tuple[FloatArray, FloatArray]:
        u, wanted = (
            file.table.numbers(column)[:MOST_SAMPLES],
            offer.description.variables[name].unit,
        )
        if column.unit is not None:
            u = _converted(u, column.unit, wanted, str(file.path))
        return time_s, u

    return TraceRecord(
        time_s,
        file.table.numbers(file.observed)[:MOST_SAMPLES],
        input=driven if file.driven is not None else "",
        driven=None if file.driven is None else driving(file.driven, driven),
        further={column.name: driving(column, column.name) for column in file.further},
        interpolation=file.interpolation,
        source=str(file.path),
    )


def _simulated(
    trace: TraceRecord, offer: Offer, output: str, values: Mapping[str, Scalar]
) -> FloatArray | None:
    """The output at start values; None where the FMU refuses them."""
    window = trace.window()
    run = Run(
        start_values=dict(values),
        settle_s=window.settle_s,
        sample_step_s=window.step_s,
        samples=window.samples,
        outputs=(output,),
        input_signal=trace.signal(1),
    )
    try:
        [observed] = offer.workers.run([run])
    except FmuFailure:
        return None
    return np.asarray(observed[:, 0])
