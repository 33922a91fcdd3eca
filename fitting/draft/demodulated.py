"""A campaign of demodulated ringdowns: X and Y, or amplitudes, over time, of a lock-in."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fitting.campaign.instruments import Channel
from fitting.draft.campaign import Remarks, in_file
from fitting.draft.decays import Decay
from fitting.draft.model import Offer
from fitting.draft.questions import Answers, Question
from fitting.draft.ringdown import DecayingLine, line_boxes, lines_of_ringdown, width_box
from fitting.draft.source import Source, relative_path
from fitting.draft.trace_draft import TimeDraft
from fitting.draft.values import Box
from fitting.measurements.traces.time_record import FOUND
from fitting.resonance.decay_reading import decay_roles_of, is_over_time, read_decay_of
from fitting.resonance.decay_record import AMPLITUDES, PHASORS, DecayRecord
from fitting.resonance.reading import Columns, ValueRoles
from fitting.resonance.ringdown import Ringdown, ringdown_of
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, how_many

#: Share of a record behind which its decay begins late.
LATEST = 0.02
#: Standard errors from which a constant beside X and Y is solved for.
SEEN = 2.0
#: Share of the rate of the samples to either side of a line: beyond half of it another line gives
#: the same samples.
ALIKE = 0.45
QUESTION = Question(
    key="demodulated-at",
    words="at which frequency was it demodulated, as 1.2 MHz?",
    options=(),
    default=(),
    why="does not tell at which frequency it was demodulated; wanted it by --demodulated-at, as "
    '"1.2 MHz"',
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
    found = []
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
        found.append(DemodulatedFile(path, names, record))
    return tuple(found)


def _is_other(record: DecayRecord, roles: ValueRoles, time: Channel) -> bool:
    """Whether a file holds what no demodulator shows: swings, or a further column that moves."""
    if record.kind == AMPLITUDES and np.any(record.values.real < 0.0):
        return True
    if roles.sizes is not None and roles.sizes.is_complex:  # a campaign reads X and Y
        return True
    taken = (time, *roles.values)
    others = [c for c in roles.recording.channels if c not in taken]
    return any(c.is_complex or np.ptp(roles.recording.numbers(c)) > 0.0 for c in others)


@dataclass(frozen=True, kw_only=True)
class DemodulatedDraft(TimeDraft):
    """A campaign of demodulated ringdowns: the files, and what was found in each."""

    input: str
    modes: int
    files: tuple[DemodulatedFile, ...]
    found: tuple[Ringdown, ...]

    @property
    def paths(self) -> tuple[Path, ...]:
        """Of the files."""
        return tuple(file.path for file in self.files)

    def measured(self, folder: Path | None, remarks: Remarks) -> dict[str, Any]:
        """Tables of the demodulated ringdowns.

        Args:
            folder: see `text`.
            remarks: of the campaign.
        """
        tables = [self._trace(k, folder, remarks) for k, _ in enumerate(self.files)]
        return {"demodulated_trace": tables}

    def _trace(self, k: int, folder: Path | None, remarks: Remarks) -> dict[str, Any]:
        file, found = self.files[k], self.found[k]
        table = "demodulated_trace"
        made: dict[str, Any] = {
            "file": relative_path(file.path, folder),
            "frequency": f"{found.reference_hz!r} Hz",
            "input": self.input,
        }
        remarks[table, k, "frequency"] = "what was demodulated at"
        remarks[table, k, "input"] = "a pulse at it spans the states that ring down"
        if self.modes > 1:
            made["modes"] = self.modes
        if found.kind == PHASORS and abs(found.background) > SEEN * found.background_std > 0.0:
            made["offset"] = True
            remarks[table, k, "offset"] = "a constant is seen, as of a reference that leaks"
        if found.left_out > LATEST * file.record.values.size:
            made["begin"] = FOUND
            remarks[table, k, "begin"] = "earlier samples, of a drive or a blow, are not used"
        usual = {key: name for key, name in file.columns.items() if name != key}
        if usual:
            made["columns"] = usual
        return made


def demodulated_draft_of(
    files: Sequence[DemodulatedFile], source: Source, offer: Offer, answers: Answers
) -> DemodulatedDraft:
    """A campaign of demodulated ringdowns.

    Args:
        files: one or more.
        source: the FMU.
        offer: what it offers.
        answers: of flags, of a person, or by default.

    Raises:
        BadInput: nobody tells what was demodulated at, no free decay, an FMU with other modes than
            the record shows, an answer that is none.
    """
    known = tuple(_with_reference(file, answers) for file in files)
    found = tuple(ringdown_of(file.record) for file in known)
    lines = lines_of_ringdown(found[0])
    of_amplitudes = found[0].kind == AMPLITUDES
    boxes = _boxes(found[0], lines, offer, of_amplitudes=of_amplitudes)
    if not boxes or not (offer.inputs and offer.outputs):
        raise BadInput(
            f"{files[0].path}: shows {how_many(len(lines), 'line')}; wanted an FMU with an input, "
            "an output, and a parameter for the frequency and one for the width of each, in Hz"
        )
    decay = Decay(source, offer, lines, lines, boxes)
    output, names = decay.output(answers), decay.fitted(answers)
    start = decay.start(names)
    if of_amplitudes:
        start[offer.places[0]] = (found[0].reference_hz, "what was demodulated at")
    return DemodulatedDraft(
        source=source,
        output=output,
        input=offer.inputs[0],
        modes=len(lines),
        files=known,
        found=found,
        boxes=decay.boxes_of(names),
        start=start,
        seen=(*(words for each in found for words in each.remarks), *_said(found[0], decay)),
        taken=tuple(name for name in decay.taken() if name not in names),
        derived=() if of_amplitudes else decay.derived,
    )


def modes_of(file: DemodulatedFile) -> int:
    """How many lines of a file decay.

    Args:
        file: of a demodulated ringdown.

    Raises:
        BadInput: no free decay.
    """
    return len(lines_of_ringdown(ringdown_of(file.record)))


def _with_reference(file: DemodulatedFile, answers: Answers) -> DemodulatedFile:
    """The file with the frequency that was demodulated at, as it tells, or as is answered."""
    if math.isfinite(file.record.reference_hz) and QUESTION.key not in answers.told:
        return file
    words, why = (f"{file.path}: {text}" for text in (QUESTION.words, QUESTION.why))
    [told] = answers.of(replace(QUESTION, words=words, why=why))
    return replace(file, record=replace(file.record, reference_hz=float(told)))


def _boxes(
    found: Ringdown, lines: Sequence[DecayingLine], offer: Offer, *, of_amplitudes: bool
) -> tuple[Box, ...]:
    """Boxes of frequencies and widths; amplitudes tell no frequency."""
    if not of_amplitudes:
        return line_boxes(lines, offer, most_hz=ALIKE / found.spacing_s)
    if (len(offer.places), len(offer.widths)) != (1, 1) or offer.unit(offer.widths[0]) != "Hz":
        return ()
    return (width_box(lines[0], offer.widths[0]),)


def _said(found: Ringdown, decay: Decay) -> tuple[str, ...]:
    """What the record was found to be."""
    at = hertz(found.reference_hz, digits=9)
    if found.kind == AMPLITUDES:
        width = hertz(found.width.value, digits=3)
        off = ", the FMU's own tones are off" if decay.offer.tones else ""
        return (
            f"A ringdown, amplitudes demodulated at {at}: one line decays, {width} wide. They tell "
            f"no frequency, which stays at what was demodulated at{off}.",
        )
    return decay.said(f"A ringdown, X and Y demodulated at {at}: ")
