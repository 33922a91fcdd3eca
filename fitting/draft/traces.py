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

from fitting.campaign.instruments import Channel, read_recording
from fitting.draft.closer_start import Record, closer_starts
from fitting.draft.decays import decays_of
from fitting.draft.model import Offer
from fitting.draft.questions import Answers, Question
from fitting.draft.source import Source
from fitting.draft.trace_draft import OWN, Recording, TraceDraft, TraceFile, said_of, start_box
from fitting.fmu import Run
from fitting.measurements.traces.record import TraceRecord
from fitting.measurements.traces.waveform import HELD, LINEAR
from fitting.resonance.reading import TIME_PAGE
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.notation import listed
from fitting.text.units import convert, same_kind

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


def recordings_of(paths: Sequence[Path]) -> tuple[Recording, ...]:
    """The files as recordings over time; none where one of them is something else.

    Args:
        paths: of the files.
    """
    found = []
    for path in paths:
        try:
            table = read_recording(path)
        except BadInput:
            return ()  # its reader complains, if it is none either
        units = [c.unit for c in table.channels if c.unit]
        times = [c for c in table.channels if c.unit and same_kind(c.unit, "s")]
        none = any(same_kind(u, "Hz") for u in units) or any(c.is_complex for c in table.channels)
        if len(times) != 1 or len(table.channels) < 2 or none:
            return ()
        found.append(Recording(table, times[0]))
    return tuple(found)


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
    decaying = decays_of(recordings, source, offer, answers)
    if decaying is not None:
        return decaying
    output = _output(recordings, offer, answers)
    driven = _input(recordings, offer, answers)
    files = tuple(_file(r, output, driven, offer) for r in recordings)
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
            *(said_of(file, output, driven) for file in files),
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


def _file(recording: Recording, output: str, driven: str, offer: Offer) -> TraceFile:
    """Which columns are which: by their names, else the input stands before the output."""
    inputs = [name for name in offer.inputs if name != driven]
    further = tuple(c for c in recording.others if driven and c.name in inputs)
    others = [c for c in recording.others if c not in further]
    seen = recording.called(output)
    source = recording.called(driven) if driven else None
    left = [c for c in others if c not in (seen, source)]
    if seen is None:
        if (len(left) > 1 and source is not None) or not left:
            names = listed(f"'{c.name}'" for c in others)
            raise BadInput(
                f"{recording.table.path}: no column '{output}' among {names}; wanted one that is "
                "called like the FMU's output"
            )
        seen = left.pop()
    if driven and source is None and left:
        source = left[0]
    if source is None:
        return TraceFile(recording, seen, None, LINEAR)
    u = recording.table.numbers(source)
    changes = np.count_nonzero(np.diff(u)) / max(1, u.size - 1)
    how = HELD if changes <= CHANGES else LINEAR
    return TraceFile(recording, seen, source, how, further)


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
    if unit and seen and not is_scaled:
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
        if column.unit is not None and wanted is not None:
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
