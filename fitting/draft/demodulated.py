"""A campaign of demodulated ringdowns: X and Y, or amplitudes, over time, of a lock-in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fitting.draft.boxes import decay_boxes
from fitting.draft.decays import (
    decay_boxes_chosen,
    decay_start,
    decaying,
    qualities,
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
from fitting.draft.traces import EARLIER, LATEST, SPANS
from fitting.extension.records import Channel
from fitting.lines.decay_record import AMPLITUDES, PHASORS, DecayRecord
from fitting.lines.ringdown import Ringdown, ringdown_of
from fitting.measurements.traces.time_record import FOUND
from fitting.resonance.decay_reading import decay_roles_of, is_over_time, read_decay_of
from fitting.resonance.reading import Columns, ValueRoles
from fitting.text.errors import BadInput
from fitting.text.notation import how_many
from fitting.text.rendering import blocks

#: Standard errors from which a constant next to X and Y is solved for.
LEAST_ERRORS = 2.0
#: Share of the rate of the samples to either side of a line: beyond half of it another line gives
#: the same samples.
ALIKE = 0.45
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
            time, roles = decay_roles_of(path, columns)
            record = None if roles.is_complex else read_decay_of(path, columns)
        except BadInput:
            return ()  # its reader complains
        record = record or read_decay_of(path, columns)
        if record.kind not in (PHASORS, AMPLITUDES) or _is_other(record, roles, time):
            return ()
        named = {
            "time": time,
            "X": roles.real,
            "Y": roles.imaginary,
            "amplitude": roles.sizes,
            "phase": roles.phase,
        }
        names = {key: in_file(channel) for key, channel in named.items() if channel is not None}
        ringdowns.append(DemodulatedFile(path, names, record))
    return tuple(ringdowns)


def _is_other(record: DecayRecord, roles: ValueRoles, time: Channel) -> bool:
    """Whether a file holds what no demodulator shows: swings, or a further column that moves."""
    if record.kind == AMPLITUDES and np.any(record.values.real < 0.0):
        return True
    if roles.sizes is not None and roles.sizes.is_complex:  # a campaign reads X and Y
        return True
    taken = (time, *roles.values)
    others = [c for c in roles.recording.channels if c not in taken]
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
    known = [_with_reference(file, answers) for file in files]
    ringdowns = [ringdown_of(file.record) for file in known]
    first, lines = ringdowns[0], decaying(ringdowns[0])
    phasors = first.kind != AMPLITUDES  # amplitudes do not constrain the frequency
    boxes = decay_boxes(lines, offer, ALIKE / first.spacing_s if phasors else 0.0)
    if not boxes or not (offer.inputs and offer.outputs):
        raise BadInput(
            f"{files[0].path}: shows {how_many(len(lines), 'line')}; wanted an FMU with an input, "
            "an output, and a parameter for the frequency and one for the width of each, in Hz"
        )
    words, why = "Which output of the FMU was recorded?", "the first one with continuous values"
    output = answers.one_of("output", words, offer.outputs, offer.outputs[0], why)
    chosen = decay_boxes_chosen(offer, answers, lines, boxes)
    names = {box.name for box in chosen}
    start = decay_start(offer, lines, boxes)
    start = {name: value for name, value in start.items() if name not in names}
    if not phasors:
        start[offer.places[0]] = first.reference_hz, "what was demodulated at"
    left = undetermined(offer, lines, boxes)
    pairs = zip(known, ringdowns, strict=True)
    tables = {
        "title": ", ".join(file.path.stem for file in known),
        "fmu": fmu_table(offer, start, [name for name in left if name not in names]),
        "observe": {"output": output},
        "demodulated_trace": [
            _trace(file, each, offer.inputs[0], len(lines)) for file, each in pairs
        ],
        **fitted_tables(chosen, qualities(offer, lines) if phasors else ()),
    }
    text = blocks("draft/text")
    notes = text.amplitudes(first, offer)
    if phasors:
        notes = text.decay(str(text.demodulated(first.reference_hz)), lines, lines, offer, left)
    remarks = [words for each in ringdowns for words in each.remarks]
    notes = (*remarks, *str(notes).splitlines(), *answers.said, *starts_words(chosen))
    return draft_from(tables, offer, folder, notes)


def _trace(file: DemodulatedFile, ringdown: Ringdown, driven: str, modes: int) -> dict[str, Any]:
    """The table of a demodulated ringdown."""
    made: dict[str, Any] = {
        "file": file.path,
        "frequency": noted(f"{ringdown.reference_hz!r} Hz", "what was demodulated at"),
        "input": noted(driven, SPANS),
    }
    if modes > 1:
        made["modes"] = modes
    if (
        ringdown.kind == PHASORS
        and abs(ringdown.background) > LEAST_ERRORS * ringdown.background_std > 0.0
    ):
        made["offset"] = noted(True, "a constant is seen, as of a reference that leaks")
    if ringdown.left_out > LATEST * file.record.values.size:
        made["begin"] = noted(FOUND, EARLIER)
    columns = {key: name for key, name in file.columns.items() if name != key}
    return made | ({"columns": columns} if columns else {})


def modes_of(file: DemodulatedFile) -> int:
    """How many lines of a file decay.

    Args:
        file: of a demodulated ringdown.

    Raises:
        BadInput: no free decay.
    """
    return len(decaying(ringdown_of(file.record)))


def _with_reference(file: DemodulatedFile, answers: Answers) -> DemodulatedFile:
    """The file with the frequency that was demodulated at, of the file, or as is answered."""
    if math.isfinite(file.record.reference_hz) and QUESTION.key not in answers.told:
        return file
    words, why = (f"{file.path}: {text}" for text in (QUESTION.words, QUESTION.why))
    [requested] = answers.of(replace(QUESTION, words=words, why=why))
    return replace(file, record=replace(file.record, reference_hz=float(requested)))
