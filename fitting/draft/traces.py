"""A campaign of traces: recordings over time of an output, under an input or none, and an FMU.

What is fitted by default is what the record shows: parameters whose small change changes the
output, each otherwise than those before it, by runs of the FMU at its own start values under the
recorded input:

    s_k = d y/d ln p_k,     p_k is taken while |s_k - (its projection on those taken)| > 1 % |s_k|

and while |s_k| is more than 1/1000 of the largest. An FMU comes with the values of its author: a
time constant of one second is no start for a step of milliseconds. Parameters therefore start where

    least over p of  |y - c s(p)|^2,   p_k times 10^(-3), ..., 10^3, in turn

with the best factor c: a time constant shows whatever the gain. Values that c takes up, as a gain,
then follow with c = 1, where no detector is between.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign import instruments
from fitting.campaign.instruments.roles import TIME, usual, usual_frequency
from fitting.draft.boxes import decade_box
from fitting.draft.document import (
    Draft,
    draft_from,
    fitted_tables,
    fmu_table,
    in_file,
    noted,
    starts_words,
)
from fitting.draft.model import FIRST_OUTPUT, OWN, Offer
from fitting.draft.questions import Answers
from fitting.extension.fmu import FmuVariable, Run
from fitting.extension.records import Channel, TraceRecord, read_recording
from fitting.lines.names import TIME_PAGE
from fitting.measurements.traces import FIT
from fitting.measurements.waveform import HELD, LINEAR
from fitting.resonance.reading import Columns, with_unit
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.notation import listed
from fitting.text.rendering import blocks
from fitting.text.units import convert, same_kind

#: Columns that may be told, by what of the FMU they hold.
OUTPUT, INPUT = "output", "input"
#: Samples of a record that are looked at.
MOST_SAMPLES = 4000
#: Change of a logarithm, and shares of a change below which a parameter has no effect of its own.
STEP, LEAST_EFFECT, APART = 1e-3, 1e-3, 1e-2
#: Share of the samples of an input at which it may change and still seem held.
CHANGES = 0.25
#: Remarks on how an input moves between samples.
MOVES = {
    HELD: 'a guess: it stands still and jumps; or "linear" between samples',
    LINEAR: 'a guess: it moves from sample to sample; or "held" from each to the next',
}
#: Factors on a value that are tried for a closer start, how often all values are gone through, and
#: how many are moved at most: each costs a run for every factor and round.
FACTORS, ROUNDS, MOST_MOVED = tuple(10.0 ** (0.5 * k) for k in range(-6, 7) if k), 2, 6
#: Share of the squares below which another start is closer; their change below which a value has no
#: effect on the shape.
CLOSER, NO_EFFECT = 0.9, 1e-6

#: The output (n,) at start values by name; None where the FMU refuses them.
Simulated = Callable[[Mapping[str, Scalar]], FloatArray | None]


@dataclass(frozen=True)
class Recording:
    """Columns over time, and which of them holds the times."""

    table: instruments.Recording
    time: Channel

    @property
    def others(self) -> tuple[Channel, ...]:
        """All columns but that of times."""
        return tuple(c for c in self.table.channels if c.name != self.time.name)

    def time_s(self, most: int | None = None) -> FloatArray:
        """Times of the first samples, s.

        Args:
            most: samples; None: all.
        """
        factor = convert(1.0, self.time.unit or "s", "s", where=str(self.table.path))
        return np.asarray(factor * self.table.numbers(self.time)[:most])

    def called(self, name: str) -> Channel | None:
        """The column that is called like a variable, capitals apart; None where none is.

        Args:
            name: of the variable; brackets in it are those of an array, and no unit.
        """
        matches = [c for c in self.others if _is_called(c, name)]
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

    def has_no_unit(self, column: Channel) -> bool:
        """Whether the file has no unit of a column.

        Args:
            column: of the file.
        """
        return all(c.unit is None for c in self.table.channels if c.name == column.name)


def recordings_of(
    paths: Sequence[Path], columns: Columns, *, simulated: bool
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
    matches = []
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


def requested_columns(recording: Recording, columns: Mapping[str, str], offer: Offer) -> Recording:
    """Of a recording whose output is told the columns that are told, and those of FMU inputs.

    Args:
        recording: over time.
        columns: names of columns that are told, by what of the FMU they hold.
        offer: what the FMU offers.

    Raises:
        BadInput: no column of such a name.
    """
    if OUTPUT not in columns:
        return recording
    table = recording.table
    kept = {recording.time.name, *(table.column(name).name for name in columns.values())}
    kept |= {c.name for c in recording.others if any(_is_called(c, n) for n in offer.inputs)}
    channels = tuple(c for c in table.channels if c.name in kept)
    return replace(recording, table=replace(table, channels=channels))


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
    if not offer.outputs:
        raise BadInput(f"{offer.description.path}: has no continuous Real output, wanted one")
    output = _variable(OUTPUT, recordings[0], offer.outputs, answers)
    driven = ""  # the input that a second column drives
    if offer.inputs and any(len(each.others) != 1 for each in recordings):
        driven = _variable(INPUT, recordings[0], offer.inputs, answers)
    files = [_file(each, output, driven, offer, answers.columns) for each in recordings]
    if all(file.driven is None for file in files):
        driven = ""
    # the first record decides what is fitted, and from where
    known, first_file = offer.description.variables, files[0]
    record = _record(first_file, offer, driven)
    simulated = _simulation(record, offer, output)
    default, why, alike = _fitted(simulated, offer)
    names = answers.fitted(offer.parameters, default, why)
    unit, values = first_file.observed.unit, record.y
    is_scaled = _is_scaled(first_file, offer, output)
    if unit and not is_scaled:  # as the campaign reads it: to base units where the FMU has none
        values = _converted(values, unit, known[output].unit, str(first_file.table.path))
    closer = _closer_starts(values, simulated, {n: known[n] for n in names}, is_scaled=is_scaled)
    boxes = [decade_box(offer, name, closer.get(name)) for name in names]
    taken = {name: (offer.start(name), OWN) for name in alike if name not in names}
    traces = []
    for file in files:
        made: dict[str, Any] = {"file": file.table.path}
        if file.driven is not None:
            how = noted(file.interpolation, MOVES[file.interpolation])
            made |= {"input": driven, "interpolation": how}
        if _is_scaled(file, offer, output):
            words = f"{file.observed.unit} for the FMU's output: in proportion"
            made["gain"] = noted(FIT, words)
        if file.further:
            made["further_inputs"] = [column.name for column in file.further]
        traces.append(made | trace_columns(file, output, driven))
    tables = {
        "title": ", ".join(file.table.path.stem for file in files),
        "fmu": fmu_table(offer, taken, tuple(taken)),
        "observe": {"output": output},
        "trace": traces,
        **fitted_tables(boxes),
    }
    notes = described(files, output, driven)
    if not driven and offer.inputs:
        notes.append(str(blocks("draft/text").undriven(TIME_PAGE)))
    return draft_from(tables, offer, folder, (*notes, *answers.notes, *starts_words(boxes)))


def _variable(key: str, recording: Recording, options: tuple[str, ...], answers: Answers) -> str:
    """The output, or the input, that was recorded: the one that a column is called by."""
    named = [name for name in options if recording.called(name) is not None]
    first = FIRST_OUTPUT if key == OUTPUT else "the first one"
    words = f"Which {key} of the FMU was recorded?"
    default, why = (named or list(options))[0], "named like a column" if named else first
    return answers.one_of(key, words, options, default, why)


def trace_columns(file: TraceFile, output: str, driven: str) -> dict[str, Any]:
    """Names of columns that are not the usual ones, with units where the file has none.

    Args:
        file: with its columns.
        output: of the FMU, that was recorded.
        driven: input of the FMU, empty: none.
    """
    named = {"time": (file.time, "time"), "output": (file.observed, output)}
    if file.driven is not None:
        named["input"] = file.driven, driven
    columns = {}
    for key, (column, usual_name) in named.items():
        name = in_file(column) + (f" ({column.unit})" if file.has_no_unit(column) else "")
        if name != usual_name:
            columns[key] = name
    return {"columns": columns} if columns else {}


def described(files: Sequence[TraceFile], output: str, driven: str) -> list[str]:
    """What files were taken for, in sentences.

    Args:
        files: with their columns.
        output: of the FMU, that was recorded.
        driven: input of the FMU, empty: none.
    """
    words, notes = blocks("draft/text"), []
    for file in files:
        notes.append(str(words.recording(file, output, driven)))
        columns = [file.time, file.observed, *([file.driven] if file.driven else []), *file.further]
        taken = [f"'{c.name}' in {c.unit}" for c in columns if file.has_no_unit(c)]
        notes += [str(words.assumed(taken))] if taken else []
    return notes


def in_unit_of(channel: Channel, unit: str) -> Channel:
    """A column in the unit of the FMU's variable where it has none.

    Args:
        channel: of a file.
        unit: of the variable.
    """
    return channel if channel.unit is not None else replace(channel, unit=unit)


def _is_called(channel: Channel, name: str) -> bool:
    """Whether a column is called like a variable, alone or within a model, as "model.fmu.y"."""
    return f".{channel.name.lower()}".endswith(f".{name.lower()}")


def _is_scaled(file: TraceFile, offer: Offer, output: str) -> bool:
    """Whether a detector is between the output and what was recorded, by their units."""
    unit, observed = offer.description.variables[output].unit, file.observed.unit
    return bool(observed and unit) and not same_kind(observed or "", unit or "")


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
    assigned = [c.name for c in (observed, source) if c is not None]
    free = [c for c in others if c.name not in assigned]
    free = [c for c in free if not any(_is_called(c, name) for name in known)]
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
    observed = in_unit_of(observed, offer.unit(output))
    if source is None:
        return TraceFile(table, recording.time, observed)
    u = table.numbers(source)
    changes = np.count_nonzero(np.diff(u)) / max(1, u.size - 1)
    return TraceFile(
        table,
        recording.time,
        observed,
        in_unit_of(source, offer.unit(driven)),
        HELD if changes <= CHANGES else LINEAR,
        tuple(in_unit_of(c, offer.unit(c.name)) for c in further),
    )


def _record(file: TraceFile, offer: Offer, driven: str) -> TraceRecord:
    """The first samples of a recording, inputs in the units of the FMU."""
    time_s, path = file.time_s(MOST_SAMPLES), str(file.table.path)

    def driving(column: Channel, name: str) -> tuple[FloatArray, FloatArray]:
        u = file.table.numbers(column)[:MOST_SAMPLES]
        if column.unit is not None:
            u = _converted(u, column.unit, offer.description.variables[name].unit, path)
        return time_s, u

    return TraceRecord(
        time_s,
        file.table.numbers(file.observed)[:MOST_SAMPLES],
        input=driven if file.driven is not None else "",
        driven=None if file.driven is None else driving(file.driven, driven),
        further={column.name: driving(column, column.name) for column in file.further},
        interpolation=file.interpolation,
        source=path,
    )


def _converted(values: FloatArray, unit: str, wanted: str | None, where: str) -> FloatArray:
    zero, one = (convert(x, unit, wanted, where=where) for x in (0.0, 1.0))
    return np.asarray(zero + (one - zero) * values)


def _simulation(trace: TraceRecord, offer: Offer, output: str) -> Simulated:
    """The output of the FMU under a record as a function of start values."""
    window = trace.window()

    def simulated(values: Mapping[str, Scalar]) -> FloatArray | None:
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

    return simulated


def _fitted(simulated: Simulated, offer: Offer) -> tuple[tuple[str, ...], str, list[str]]:
    """Parameters that the record shows, each by itself; why these; those that look like others."""
    names = [n for n in offer.parameters if offer.description.variables[n].start]
    base = simulated({})
    if base is None:  # its own start values do not run
        return (), "the FMU fails with its own start values under the record", []
    slopes, sizes = {}, {}
    for name in names:
        y = simulated({name: (1.0 + STEP) * offer.start(name)})
        if y is not None:
            slopes[name] = y - base
            sizes[name] = float(np.linalg.norm(slopes[name]))
    moved = [n for n in slopes if sizes[n] > LEAST_EFFECT * max(sizes.values())]
    # Gram and Schmidt, the largest effect first
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
    return tuple(n for n in names if n in taken), why, alike


def _closer_starts(
    record: FloatArray,
    simulated: Simulated,
    variables: Mapping[str, FmuVariable],
    *,
    is_scaled: bool,
) -> dict[str, float]:
    """Start values with smaller residuals of a record (n,) than the FMU's own; those that moved.

    With ``is_scaled`` the record has another unit than the output, so that a factor is free.
    """
    own = {name: float(v.start or 0.0) for name, v in variables.items() if v.start}
    at, without_effect = dict(own), list(own)[:MOST_MOVED]

    def squares(values: Mapping[str, float], *, scaled: bool) -> float:
        """Sum of squared residuals; infinite outside the ranges that the FMU declares."""
        for name, value in values.items():
            low, high = variables[name].min, variables[name].max
            if (low is not None and value <= low) or (high is not None and value >= high):
                return math.inf
        y = simulated(values)
        if y is None or not np.all(np.isfinite(y)):
            return math.inf
        size, factor = float(y @ y), 1.0
        if scaled:
            factor = float(y @ record) / size if size > 0.0 else 0.0
        return float(np.sum((record - factor * y) ** 2))

    def move(name: str, *, scaled: bool) -> bool:
        """Move one value to where the squares are least; whether it has any effect on them."""
        values = [at[name], *(at[name] * factor for factor in FACTORS)]
        sizes = [squares({**at, name: value}, scaled=scaled) for value in values]
        finite = [size for size in sizes if math.isfinite(size)]
        if finite and min(sizes) < CLOSER * sizes[0]:
            at[name] = values[int(np.argmin(sizes))]
        return bool(finite) and max(finite) - min(finite) > NO_EFFECT * max(finite)

    for _ in range(ROUNDS):
        for name in list(own)[:MOST_MOVED]:
            if move(name, scaled=True) and name in without_effect:
                without_effect.remove(name)
    if not is_scaled:
        for name in without_effect:
            move(name, scaled=False)
    if not squares(at, scaled=is_scaled) < CLOSER * squares(own, scaled=is_scaled):
        return {}
    return {name: value for name, value in at.items() if value != own[name]}
