"""A campaign of traces: recordings over time of an output, under an input or none, and an FMU.

What is fitted by default is what the record shows: parameters whose small change changes the
output, each otherwise than those before it. That is seen by running the FMU at its own start values
under the recorded input:

    s_k = d y/d ln p_k,     p_k is taken while |s_k - (its projection on those taken)| > 1 % |s_k|

and while |s_k| is more than 1/1000 of the largest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign import instruments
from fitting.campaign.instruments import Channel, read_recording
from fitting.draft.campaign import (
    CONTINUATION,
    Remarks,
    parameter_table,
    put_remarks,
    relative_path,
)
from fitting.draft.model import Offer
from fitting.draft.questions import Answers, Question
from fitting.draft.ringdown import Ringdown, line_boxes, ringdown_of, silenced
from fitting.draft.source import Source
from fitting.draft.values import Box
from fitting.fmu import Run
from fitting.measurements.traces.record import FIT, FOUND, UNKNOWN, TraceRecord
from fitting.measurements.traces.waveform import HELD, LINEAR
from fitting.resonance.reading import TIME_PAGE
from fitting.signal.decay import decay_start
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.notation import hertz, listed
from fitting.text.toml import rewritten, toml_text
from fitting.text.units import convert, same_kind

#: Samples of a record that are looked at.
LOOKED_AT = 4000
#: Change of a logarithm, and shares of a change below which a parameter is not seen.
STEP, SEEN, OWN = 1e-3, 1e-3, 1e-2
#: Share of the samples of an input at which it may change and still seem held.
CHANGES = 0.25
#: Names of both quadratures, in small letters.
QUADRATURES = (("x", "y"), ("re", "im"))
#: What is said of a recording without an input, of an FMU that has one.
UNDRIVEN = (
    "No column drives: the FMU runs from its start values, with what drive it has of its own. Of a "
    f'ringdown nobody knows where it starts: start = "unknown", {TIME_PAGE}.'
)
#: Share of a record behind which its decay begins late, and what is said of it.
LATEST = 0.02
LATE = (
    "It does not decay from its first sample on, as if a drive or a blow came first: where the "
    'decay begins is looked for, begin = "found".'
)
#: Factor to either side of the FMU's own start value.
FACTOR = 10.0


@dataclass(frozen=True)
class Recording:
    """Columns over time, and which of them holds the times."""

    table: instruments.Recording
    time: Channel

    @property
    def others(self) -> tuple[Channel, ...]:
        """All columns but that of times."""
        return tuple(c for c in self.table.channels if c is not self.time)


@dataclass(frozen=True)
class TraceFile:
    """A recording whose columns are known: of the output, and of the input, None: none drives.

    ``further`` are columns of further inputs, by their names.
    """

    recording: Recording
    seen: Channel
    driven: Channel | None
    interpolation: str
    further: tuple[Channel, ...] = ()

    @property
    def path(self) -> Path:
        """Of the file."""
        return self.recording.table.path


@dataclass(frozen=True, kw_only=True)
class TraceDraft:
    """A campaign of traces: ``input`` is empty where nothing drives; ``seen`` are sentences.

    ``start`` are start values of the FMU; with ``decays`` the traces are ringdowns from a state
    that nobody knows, which a pulse at the input spans; with ``late`` they begin inside the
    records. ``derived`` are outputs that are reported.
    """

    source: Source
    output: str
    input: str
    files: tuple[TraceFile, ...]
    boxes: tuple[Box, ...]
    seen: tuple[str, ...]
    start: Mapping[str, float] = field(default_factory=dict)
    decays: bool = False
    late: bool = False
    derived: tuple[str, ...] = ()

    def text(self, folder: Path | None) -> str:
        """The text of the campaign.

        Args:
            folder: where it stands, to which paths are relative; None: they are absolute.
        """
        remarks: Remarks = {}
        name = self.source.name
        fmu: dict[str, Any] = (
            {"model": name} if self.source.is_model else {"file": relative_path(Path(name), folder)}
        )
        if self.start:
            fmu["start"] = dict(self.start)
            for tone in self.start:
                remarks["fmu", "start", tone] = "off: nothing drives while it rings down"
        tables: dict[str, Any] = {
            "title": ", ".join(file.path.stem for file in self.files),
            "fmu": fmu,
            "observe": {"output": self.output},
            "trace": [self._trace(file, k, folder, remarks) for k, file in enumerate(self.files)],
            "parameters": [parameter_table(box, k, remarks) for k, box in enumerate(self.boxes)],
            **({"derived": {"outputs": list(self.derived)}} if self.derived else {}),
            "continuation": dict(CONTINUATION),
        }
        remarks["continuation", "nu_start"] = "the prior only helps at the start"
        head = (
            "A first campaign, written by fmu-fit init from these files: it runs as it is.",
            "What a remark calls a guess is one; docs/reference/campaign.md tells every key.",
        )
        return rewritten(toml_text(tables, head), lambda made: put_remarks(made, remarks))

    def _trace(
        self, file: TraceFile, k: int, folder: Path | None, remarks: Remarks
    ) -> dict[str, Any]:
        made: dict[str, Any] = {"file": relative_path(file.path, folder)}
        columns = {}
        if file.recording.time.name != "time":
            columns["time"] = file.recording.time.name
        if file.seen.name != self.output:
            columns["output"] = file.seen.name
        if file.driven is not None:
            made |= {"input": self.input, "interpolation": file.interpolation}
            remarks["trace", k, "interpolation"] = _how(file.interpolation)
            if file.driven.name != self.input:
                columns["input"] = file.driven.name
        if self.decays:
            made |= {"input": self.input, "start": UNKNOWN}
            remarks["trace", k, "input"] = "a pulse at it spans the states that ring down"
            remarks["trace", k, "start"] = "solved for: nobody knows where a ringdown starts"
            if self.late:
                made["begin"] = FOUND
                remarks["trace", k, "begin"] = "earlier samples, of a drive or a blow, are not used"
        elif self._is_scaled(file):
            made["gain"] = FIT
            remarks["trace", k, "gain"] = f"{file.seen.unit} for the FMU's output: in proportion"
        if file.further:
            made["further_inputs"] = [column.name for column in file.further]
        if columns:
            made["columns"] = columns
        return made

    def _is_scaled(self, file: TraceFile) -> bool:
        """Whether a detector stands between the output and what was recorded, by their units."""
        unit = self.source.workers.description.variables[self.output].unit
        return bool(file.seen.unit and unit) and not same_kind(file.seen.unit or "", unit or "")


def _how(interpolation: str) -> str:
    if interpolation == HELD:
        return 'a guess: it stands still and jumps; or "linear" between samples'
    return 'a guess: it moves from sample to sample; or "held" from each to the next'


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


def decays(recording: Recording) -> bool:
    """Whether nothing but one free decay was recorded.

    Args:
        recording: over time.
    """
    others = recording.others
    return len(others) == 1 and _line(recording, others[0]) is not None


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
    for recording in recordings:
        _refuse_demodulated(recording, offer)
    output = _output(recordings, offer, answers)
    driven = _input(recordings, offer, answers)
    files = tuple(_file(r, output, driven, offer) for r in recordings)
    if not driven and offer.inputs:
        found = _ringdown(files[0], offer)
        if found is not None:
            return _decaying(files, source, offer, answers, output, found)
    default, why = _fitted(files[0], source, offer, output, driven)
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
    return TraceDraft(
        source=source,
        output=output,
        input=driven,
        files=files,
        boxes=tuple(_box(offer, name) for name in names),
        seen=(
            *(_said(file, output, driven) for file in files),
            *([UNDRIVEN] if not driven and offer.inputs else []),
        ),
    )


def _ringdown(file: TraceFile, offer: Offer) -> tuple[Ringdown, tuple[Box, ...]] | None:
    """The line of a free decay with its boxes; None: it is none, or the FMU has more modes."""
    found = _line(file.recording, file.seen)
    boxes = () if found is None else line_boxes(found, offer)
    return (found, boxes) if found is not None and boxes else None


def _line(recording: Recording, seen: Channel) -> Ringdown | None:
    """The line of a free decay."""
    table, time = recording.table, recording.time
    factor = convert(1.0, time.unit or "s", "s", where=str(table.path))
    return ringdown_of(factor * table.numbers(time), table.numbers(seen))


def _is_late(file: TraceFile) -> bool:
    """Whether a free decay, of two lines at most, begins inside the record."""
    values = file.recording.table.numbers(file.seen)
    begun = (decay_start(values, states) for states in (2, 4))
    return all(first is not None and first > LATEST * values.size for first in begun)


def _decaying(
    files: tuple[TraceFile, ...],
    source: Source,
    offer: Offer,
    answers: Answers,
    output: str,
    found: tuple[Ringdown, tuple[Box, ...]],
) -> TraceDraft:
    """A campaign of ringdowns of one mode: its drives off, frequency and width from the record."""
    line, boxes = found
    late = any(_is_late(file) for file in files)
    names = answers.of(
        Question(
            key="fit",
            words="Which parameters of the FMU are fitted?",
            options=offer.parameters,
            default=tuple(box.name for box in boxes),
            why="a ringdown tells frequency and width of its mode",
            several=True,
        )
    )
    known = {box.name: box for box in boxes}
    return TraceDraft(
        source=source,
        output=output,
        input=offer.inputs[0],
        files=files,
        boxes=tuple(known[name] if name in known else _box(offer, name) for name in names),
        seen=(
            *(_said(file, output, "") for file in files),
            *([LATE] if late else []),
            f"A ringdown: no column drives and it decays. The highest line of its spectrum lies at "
            f"{hertz(line.frequency_hz, digits=6)}; where it starts is solved for"
            + (", the FMU's own tones are off." if offer.tones else "."),
        ),
        start=silenced(offer),
        decays=True,
        late=late,
        derived=offer.qualities if len(offer.qualities) == 1 else (),  # those of one mode
    )


def _refuse_demodulated(recording: Recording, offer: Offer) -> None:
    """Complain of X and Y over time, unless the FMU has variables of these names."""
    names = {c.name.lower() for c in recording.others}
    known = {name.lower() for name in offer.description.variables}
    for x, y in QUADRATURES:
        if {x, y} <= names and not {x, y} <= known:
            raise BadInput(
                f"{recording.table.path}: is a demodulated recording, X and Y over time, of which "
                f"there is no draft; wanted [[demodulated_trace]] in a campaign: {TIME_PAGE}"
            )


def _said(file: TraceFile, output: str, driven: str) -> str:
    count = len(file.recording.table.places)
    under = "" if file.driven is None else f", under '{driven}' as '{file.driven.name}'"
    under += "".join(f" and '{column.name}'" for column in file.further)
    return (
        f"{file.path.name}: {file.recording.table.words}, {count} samples over time of '{output}' "
        f"as '{file.seen.name}'{under}."
    )


def _named(recordings: Sequence[Recording], names: Sequence[str]) -> list[str]:
    """Those of the FMU's variables that a column of the first recording is called by."""
    return [name for name in names if recordings[0].table.find(name) is not None]


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
    seen = recording.table.find(output)
    source = recording.table.find(driven) if driven else None
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
) -> tuple[tuple[str, ...], str]:
    """Parameters that the record shows, each by itself."""
    trace = _record(file, offer, driven)
    names = [n for n in offer.parameters if offer.description.variables[n].start]
    starts = {n: float(offer.description.variables[n].start or 0.0) for n in names}
    points: list[Mapping[str, Scalar]] = [{}]
    points += [{n: (1.0 + STEP) * starts[n]} for n in names]
    base, *seen = _simulated(trace, source, output, points)
    if base is None:  # its own start values do not run: nothing is seen of any
        return (), "the FMU fails with its own start values under the record"
    slopes = {n: y - base for n, y in zip(names, seen, strict=True) if y is not None}
    largest = max((float(np.linalg.norm(s)) for s in slopes.values()), default=0.0)
    taken: list[str] = []
    basis = np.empty((base.size, 0))
    for name in sorted(slopes, key=lambda n: -float(np.linalg.norm(slopes[n]))):
        size = float(np.linalg.norm(slopes[name]))
        rest = slopes[name] - basis @ (basis.T @ slopes[name])
        own = float(np.linalg.norm(rest))
        if size > SEEN * largest and own > OWN * size:
            taken.append(name)
            basis = np.column_stack([basis, rest / own])
    ordered = tuple(n for n in names if n in taken)
    moved = [n for n in names if n in slopes and np.linalg.norm(slopes[n]) > SEEN * largest]
    alike = [n for n in moved if n not in taken]
    left_out = f"; not {listed(alike)}, which look like others there" if alike else ""
    return ordered, (
        "each changes the output otherwise than the others, at the FMU's start values" + left_out
    )


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


def _box(offer: Offer, name: str) -> Box:
    """A tenth to ten times the FMU's own start value, within its range."""
    variable = offer.description.variables[name]
    start = float(variable.start or 0.0)
    low, high = sorted((start / FACTOR, start * FACTOR)) if start else (-1.0, 1.0)
    low = low if variable.min is None else max(low, variable.min)
    high = high if variable.max is None else min(high, variable.max)
    if not low < start < high:
        raise BadInput(
            f"{name}: its start value {start:g} lies at the end of its range, {low:g} to {high:g}; "
            "wanted another --fit"
        )
    digits = 3 - math.floor(math.log10(max(abs(low), abs(high))))
    return Box(
        name=name,
        unit=offer.unit(name),
        lower=low if low == variable.min else round(low, digits + 2),
        upper=high if high == variable.max else round(high, digits),
        start=start,
        scale=float(f"{0.3 * abs(start) or 0.5:.2g}"),
        why="the FMU's own start value; bounds are a guess"
        + (": a tenth of it to ten times" if start else ""),
    )
