"""A campaign of free decays: recordings of nothing else, and demodulated ones of a lock-in.

A record without a column that drives is a ringdown where its size falls from its first half to its
second, and lines that decay are fitted to it (`fitting.lines.ringdown`), one or two. X and Y, or
amplitudes, of a lock-in over time are such a record, too, about the frequency of its reference.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fitting.draft.boxes import Box, Shown, decade_box, decay_boxes
from fitting.draft.document import (
    Draft,
    Starts,
    draft_from,
    fitted_tables,
    fmu_table,
    in_file,
    noted,
    starts_words,
)
from fitting.draft.model import COUPLING, FIRST_OUTPUT, OWN, UNCOUPLED, Offer, is_of_solver
from fitting.draft.questions import Answers, Question
from fitting.draft.traces import OUTPUT, Recording, TraceFile, described, in_unit_of, trace_columns
from fitting.extension.fmu import Run
from fitting.extension.records import Pulse, TraceRecord
from fitting.lines.decay_begin import decay_start as first_of_decay
from fitting.lines.ringdown import Ringdown
from fitting.lines.ringdown import ringdown_of as lines_of
from fitting.lines.trace import AMPLITUDES, PHASORS, SAMPLES, DecayRecord, decay_record_of
from fitting.measurements.time_record import FOUND
from fitting.measurements.traces import STATES_OF_ONE, UNKNOWN
from fitting.resonance.decay_reading import (
    decay_roles_of,
    is_over_time,
    read_decay_of,
)
from fitting.resonance.reading import Columns, Roles
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.notation import how_many
from fitting.text.rendering import blocks

#: Size of the second half over the first below which a record decays, and its crossings, at least.
DECAYS, CROSSINGS = 0.8, 8
#: Samples of the answer to a pulse that are looked at, and the share of the best output's second
#: line from which another one shows both as well.
AFTER_PULSE, SHOWS = 2000, 0.3
#: Share of a record behind which its decay begins late.
LATEST = 0.02
#: Standard errors from which a constant next to X and Y is solved for.
LEAST_ERRORS = 2.0
#: Share of the rate of the samples to either side of a line: beyond half of it another line gives
#: the same samples.
ALIKE = 0.45
#: Remarks: why tones have no amplitude, what lines rest on, a late start, the input of a decay.
OFF = "off: nothing drives while it rings down"
FITTED = "from lines that decay, fitted to the record"
EARLIER = "earlier samples, of a drive or a blow, are not used"
SPANS = "a pulse at it spans the states that ring down"
QUESTION = Question(
    key="demodulated-at",
    words="at which frequency was it demodulated, as 1.2 MHz?",
    options=(),
    default=(),
    why="does not contain the frequency at which it was demodulated; wanted it by "
    '--demodulated-at, as "1.2 MHz"',
    unit="Hz",
)


@dataclass(frozen=True)
class DemodulatedFile:
    """A file of a demodulated ringdown: its columns by what they are, and what was recorded."""

    path: Path
    columns: Mapping[str, str]
    record: DecayRecord


def ringdown_of(time_s: FloatArray, values: FloatArray) -> tuple[Shown, ...]:
    """The lines of a record that decays freely, the lower one first; none where it does not.

    Args:
        time_s: times of the samples, evenly spaced, shape (n,), s.
        values: of the record, shape (n,), in any unit.
    """
    y = values - np.mean(values)
    # in periods of the whole record: of a drift with noise, which crosses its mean often, it is low
    highest = int(np.argmax(np.abs(np.fft.rfft(y * np.hanning(y.size)))[1:])) + 1
    if np.count_nonzero(np.diff(np.sign(y))) < CROSSINGS or highest < 0.5 * CROSSINGS:
        return ()
    first, second = (float(np.sqrt(np.mean(half**2))) for half in np.array_split(y, 2))
    if not 0.0 < second < DECAYS * first:
        return ()
    try:
        record = decay_record_of(time_s, values, "1")
        return decaying(lines_of(replace(record, kind=SAMPLES)))
    except BadInput:
        return ()


def decaying(ringdown: Ringdown) -> tuple[Shown, ...]:
    """The lines of a ringdown that decay, the lower one first.

    Args:
        ringdown: as it was fitted.
    """
    lines = [(ringdown.frequency.value, ringdown.width.value, 1.0)]
    second = ringdown.second
    if second is not None and second.decays:
        lines.append((second.frequency.value, second.width.value, second.share))
    return tuple(
        Shown(
            frequency_hz=f,
            width_hz=w,
            amplitude=size,
            frequency_words=FITTED,
            width_words=FITTED,
        )
        for f, w, size in sorted(lines, key=lambda each: each[0])
    )


def lines_of_recording(recording: Recording) -> tuple[Shown, ...]:
    """The lines of a recording of nothing but one free decay; none of another.

    Args:
        recording: over time.
    """
    if len(recording.others) != 1:
        return ()
    return ringdown_of(recording.time_s(), recording.table.numbers(recording.others[0]))


def decays_draft(
    recordings: Sequence[Recording], offer: Offer, answers: Answers, folder: Path
) -> Draft | None:
    """A campaign of recordings of ringdowns, from an unknown state that a pulse at the input spans.

    Args:
        recordings: one or more.
        offer: what the FMU offers.
        answers: of flags, of a person, or by default.
        folder: of the campaign.

    Returns:
        None where they are no free decays, or the FMU has no place and width in Hz for each line.

    Raises:
        BadInput: an answer that is none; or the draft does not suit, by the campaign's reader.
    """
    one_column = all(len(each.others) == 1 for each in recordings)
    if not (offer.inputs and offer.outputs and one_column):
        return None
    shown = lines = lines_of_recording(recordings[0])
    if len(offer.places) == len(offer.widths) == 1 < len(shown):
        lines = (max(shown, key=lambda line: line.amplitude),)
    boxes = decay_boxes(lines, offer)
    if not boxes:
        return None
    start, left = _decay_start(offer, lines, boxes)
    default, why = offer.outputs[0], FIRST_OUTPUT
    named = [name for name in offer.outputs if recordings[0].called(name) is not None]
    if named:
        default, why = named[0], "named like a column"
    elif len(offer.outputs) > 1 and len(lines) > 1:
        values = {name: value for name, (value, _) in start.items()}
        default = _showing(offer, lines, values | {b.name: b.start for b in boxes}, recordings[0])
        why = "shows both lines after a pulse"
    output, chosen = _chosen(offer, answers, (default, why), lines, boxes)
    files, late = [], False
    for each in recordings:
        observed = in_unit_of(each.others[0], offer.unit(output))
        files.append(TraceFile(each.table, each.time, observed))
        samples = each.table.numbers(observed)  # of two lines at most
        begins = [first_of_decay(samples, states) for states in (2, 4)]
        late = late or all(k is not None and k > LATEST * samples.size for k in begins)
    traces = []
    for file in files:
        made: dict[str, Any] = {
            "file": file.table.path,
            "input": noted(offer.inputs[0], SPANS),
            "start": noted(UNKNOWN, "solved for: the start of a ringdown is not known"),
        }
        if len(lines) > 1:
            made["states"] = noted(STATES_OF_ONE * len(lines), "two for each mode")
        if late:
            made["begin"] = noted(FOUND, EARLIER)
        traces.append(made | trace_columns(file, output, ""))
    tables = {
        "title": ", ".join(file.table.path.stem for file in files),
        "fmu": _fmu_table(offer, start, left, chosen),
        "observe": {"output": output},
        "trace": traces,
        **fitted_tables(chosen, _qualities(offer, lines)),
    }
    text, lead = blocks("draft/text"), "A ringdown: no column drives, and "
    notes = described(files, output, "") + ([str(text.late())] if late else [])
    notes += str(text.decay(lead, shown, lines, offer, left)).splitlines()
    return draft_from(tables, offer, folder, (*notes, *answers.notes, *starts_words(chosen)))


def demodulated_of(paths: Sequence[Path], columns: Columns) -> tuple[DemodulatedFile, ...]:
    """The files as demodulated ringdowns; none where one of them is something else.

    Args:
        paths: of the files.
        columns: what is told of their columns.

    Raises:
        BadInput: X and Y over times that are not even.
    """
    ringdowns = []
    for path in paths:
        try:
            if not is_over_time(path, columns):
                return ()
            roles = decay_roles_of(path, columns)
            record = None if roles.is_complex else read_decay_of(path, columns)
        except BadInput:
            return ()  # its reader complains
        record = record or read_decay_of(path, columns)
        if record.kind not in (PHASORS, AMPLITUDES) or _is_other(record, roles):
            return ()
        named = {
            "time": roles.axis,
            "X": roles.real,
            "Y": roles.imaginary,
            "amplitude": roles.sizes,
            "phase": roles.phase,
        }
        names = {key: in_file(channel) for key, channel in named.items() if channel is not None}
        ringdowns.append(DemodulatedFile(path, names, record))
    return tuple(ringdowns)


def _is_other(record: DecayRecord, roles: Roles) -> bool:
    """Whether a file holds what no demodulator shows: swings, or a further column that moves."""
    if record.kind == AMPLITUDES and np.any(record.values.real < 0.0):
        return True
    if roles.sizes is not None and roles.sizes.is_complex:  # a campaign reads X and Y
        return True
    others = [c for c in roles.recording.channels if c not in roles.all]
    return any(c.is_complex or np.ptp(roles.recording.numbers(c)) > 0.0 for c in others)


def demodulated_draft(
    files: Sequence[DemodulatedFile], offer: Offer, answers: Answers, folder: Path
) -> Draft:
    """A campaign of demodulated ringdowns.

    Args:
        files: one or more.
        offer: what the FMU offers.
        answers: of flags, of a person, or by default.
        folder: of the campaign.

    Raises:
        BadInput: an unknown reference frequency, no free decay, an FMU with other modes than the
            record shows, an answer that is none; or the draft does not suit, by the campaign's
            reader.
    """
    records = []
    for file in files:
        record = file.record
        # the frequency that was demodulated at is in the file, or answered
        if not math.isfinite(record.reference_hz) or QUESTION.key in answers.requested:
            words, why = (f"{file.path}: {text}" for text in (QUESTION.words, QUESTION.why))
            [requested] = answers.of(replace(QUESTION, words=words, why=why))
            record = replace(record, reference_hz=float(requested))
        records.append(record)
    ringdowns = [lines_of(record) for record in records]
    first, lines = ringdowns[0], decaying(ringdowns[0])
    phasors = first.kind != AMPLITUDES  # amplitudes do not constrain the frequency
    boxes = decay_boxes(lines, offer, ALIKE / first.spacing_s if phasors else 0.0)
    if not boxes or not (offer.inputs and offer.outputs):
        raise BadInput(
            f"{files[0].path}: shows {how_many(len(lines), 'line')}; wanted an FMU with an input, "
            "an output, and a parameter for the frequency and one for the width of each, in Hz"
        )
    start, left = _decay_start(offer, lines, boxes)
    output, chosen = _chosen(offer, answers, (offer.outputs[0], FIRST_OUTPUT), lines, boxes)
    if not phasors:
        start[offer.places[0]] = first.reference_hz, "what was demodulated at"
    traces = []
    for file, ringdown in zip(files, ringdowns, strict=True):
        made: dict[str, Any] = {
            "file": file.path,
            "frequency": noted(f"{ringdown.reference_hz!r} Hz", "what was demodulated at"),
            "input": noted(offer.inputs[0], SPANS),
        }
        if len(lines) > 1:
            made["modes"] = len(lines)
        constant = abs(ringdown.background) > LEAST_ERRORS * ringdown.background_std > 0.0
        if ringdown.kind == PHASORS and constant:
            made["offset"] = noted(True, "a constant is seen, as of a reference that leaks")
        if ringdown.left_out > LATEST * file.record.values.size:
            made["begin"] = noted(FOUND, EARLIER)
        columns = {key: name for key, name in file.columns.items() if name != key}
        traces.append(made | ({"columns": columns} if columns else {}))
    tables = {
        "title": ", ".join(file.path.stem for file in files),
        "fmu": _fmu_table(offer, start, left, chosen),
        "observe": {"output": output},
        "demodulated_trace": traces,
        **fitted_tables(chosen, _qualities(offer, lines) if phasors else ()),
    }
    text = blocks("draft/text")
    notes = text.amplitudes(first, offer)
    if phasors:
        notes = text.decay(str(text.demodulated(first.reference_hz)), lines, lines, offer, left)
    remarks = [words for each in ringdowns for words in each.remarks]
    notes = (*remarks, *str(notes).splitlines(), *answers.notes, *starts_words(chosen))
    return draft_from(tables, offer, folder, notes)


def _decay_start(
    offer: Offer, lines: Sequence[Shown], boxes: Sequence[Box]
) -> tuple[dict[str, tuple[Scalar, str]], list[str]]:
    """Start values with their reasons, and the names of those that the lines do not determine.

    No tone drives; ``boxes`` are of what the lines determine.
    """
    start: dict[str, tuple[Scalar, str]] = {tone[1]: (0.0, OFF) for tone in offer.tones}
    start |= UNCOUPLED if offer.is_two_modes else {}
    if len(lines) < 2:
        return start, []
    left = [COUPLING]
    if not offer.is_two_modes:
        other = {name for tone in offer.tones for name in tone} | {box.name for box in boxes}
        known = offer.description.variables
        left = [n for n in offer.parameters if n not in other and not is_of_solver(known[n])]
    for name in left:
        start.setdefault(name, (offer.start(name), OWN))
    return start, left


def _chosen(
    offer: Offer,
    answers: Answers,
    output: tuple[str, str],
    lines: Sequence[Shown],
    boxes: Sequence[Box],
) -> tuple[str, tuple[Box, ...]]:
    """The output, ``output`` its default and why, and boxes of what is fitted.

    These are of the lines, ``boxes``; others are about the FMU's own start values.
    """
    words = "Which output of the FMU was recorded?"
    observed = answers.one_of(OUTPUT, words, offer.outputs, *output)
    each = "each of its modes" if len(lines) > 1 else "its mode"
    what = "frequency and width" if len(boxes) > len(lines) else "the width"
    known = {box.name: box for box in boxes}
    names = answers.fitted(
        offer.parameters, tuple(known), f"a ringdown determines {what} of {each}"
    )
    return observed, tuple(known[n] if n in known else decade_box(offer, n) for n in names)


def _fmu_table(
    offer: Offer, start: Starts, left: Sequence[str], fitted: Sequence[Box]
) -> dict[str, Any]:
    """The table of the FMU, without start values of what is fitted."""
    names = {box.name for box in fitted}
    start = {name: value for name, value in start.items() if name not in names}
    return fmu_table(offer, start, [name for name in left if name not in names])


def _qualities(offer: Offer, lines: Sequence[Shown]) -> list[str]:
    """Outputs that are reported: a quality factor of each mode."""
    return list(offer.qualities) if len(offer.qualities) == len(lines) else []


def _showing(
    offer: Offer, lines: Sequence[Shown], start: Mapping[str, Scalar], recording: Recording
) -> str:
    """The first output that shows both lines as well as the best one does, after a pulse.

    Of modes m with decays g_m, every output is fitted by sum c_m e^(-g_m t), and the smaller
    |c_m| over the larger one compared.
    """
    time_s = recording.time_s(AFTER_PULSE)
    try:
        trace = TraceRecord(
            time_s - time_s[0],
            np.cos(time_s),
            input=offer.inputs[0],
            driven=Pulse(length_s=float(time_s[1] - time_s[0])),
            source=str(recording.table.path),
        )
        window = trace.window()
        run = Run(
            start_values=start,
            settle_s=window.settle_s,
            sample_step_s=window.step_s,
            samples=window.samples,
            outputs=offer.outputs,
            input_signal=trace.signal(1),
        )
        [simulated] = offer.workers.run([run])
    except (FmuFailure, BadInput):
        return offer.outputs[0]
    poles = [complex(-math.pi * x.width_hz, 2.0 * math.pi * x.frequency_hz) for x in lines]
    waves = np.exp(np.outer(window.times_s()[2:], poles))
    columns = np.concatenate([waves.real, waves.imag], axis=1)
    c = np.linalg.lstsq(columns, np.asarray(simulated)[2:], rcond=None)[0]
    sizes = np.hypot(c[: len(poles)], c[len(poles) :])
    shares = sizes.min(axis=0) / np.maximum(sizes.max(axis=0), 1e-300)
    enough = SHOWS * float(np.max(shares))
    return next(n for n, share in zip(offer.outputs, shares, strict=True) if share >= enough)
