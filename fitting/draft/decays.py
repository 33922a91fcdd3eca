"""A campaign of ringdowns: an FMU's drives off, frequencies and widths as the records show them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.draft.model import COUPLING, TWO_MODES, UNCOUPLED, Offer, is_of_solver
from fitting.draft.questions import Answers, Question
from fitting.draft.ringdown import DecayingLine, line_boxes, lines_for, ringdown_of, silenced
from fitting.draft.source import Source
from fitting.draft.trace_draft import (
    OWN,
    Recording,
    TraceDraft,
    TraceFile,
    in_unit_of,
    said_of,
    start_box,
)
from fitting.draft.values import Box
from fitting.fmu import Run
from fitting.measurements.traces.record import TraceRecord
from fitting.measurements.traces.waveform import LINEAR, Pulse
from fitting.signal.decay import decay_start
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.notation import hertz, listed
from fitting.text.units import convert

#: Share of a record behind which its decay begins late, and what is said of it.
LATEST = 0.02
LATE = (
    "It does not decay from its first sample on, as if a drive or a blow came first: where the "
    'decay begins is looked for, begin = "found".'
)
#: Samples of the answer to a pulse that are looked at, and the share of the best output's second
#: line from which another one shows both as well.
LOOKED_AT, SHOWS = 2000, 0.3
#: Why the tones of an FMU have no amplitude.
OFF = "off: nothing drives while it rings down"


def decaying_lines(recording: Recording) -> tuple[DecayingLine, ...]:
    """The lines of a recording of nothing but one free decay; none of another.

    Args:
        recording: over time.
    """
    if len(recording.others) != 1:
        return ()
    [seen] = recording.others
    table, time = recording.table, recording.time
    factor = convert(1.0, time.unit or "s", "s", where=str(table.path))
    return ringdown_of(factor * table.numbers(time), table.numbers(seen))


def decays_of(
    recordings: Sequence[Recording], source: Source, offer: Offer, answers: Answers
) -> TraceDraft | None:
    """A campaign of ringdowns; None: they are none, or the FMU has other modes than they show.

    Args:
        recordings: one or more.
        source: the FMU.
        offer: what it offers.
        answers: of flags, of a person, or by default.

    Raises:
        BadInput: an answer that is none.
    """
    if not (offer.inputs and offer.outputs) or any(len(each.others) != 1 for each in recordings):
        return None
    shown = decaying_lines(recordings[0])
    lines = lines_for(shown, offer)
    boxes = line_boxes(lines, offer) if lines else ()
    if not boxes:
        return None
    decay = Decay(source, offer, shown, lines, boxes)
    output = decay.output(answers, recordings[0])
    names = decay.fitted(answers)
    seen = [in_unit_of(each.others[0], offer.unit(output)) for each in recordings]
    pairs = zip(recordings, seen, strict=True)
    files = tuple(TraceFile(each, column, None, LINEAR) for each, column in pairs)
    late = any(_is_late(file) for file in files)
    return TraceDraft(
        source=source,
        output=output,
        input=offer.inputs[0],
        files=files,
        boxes=decay.boxes_of(names),
        seen=(
            *(words for file in files for words in said_of(file, output, "")),
            *([LATE] if late else []),
            *decay.said("A ringdown: no column drives, and "),
        ),
        start=decay.start(names),
        taken=tuple(name for name in decay.taken() if name not in names),
        modes=len(lines),
        late=late,
        derived=decay.derived,
    )


@dataclass(frozen=True)
class Decay:
    """Lines that decay and the FMU that is to have them: what a draft of them takes of it.

    ``shown`` are all lines of the first record, ``lines`` those that the FMU has, with their
    ``boxes``.
    """

    source: Source
    offer: Offer
    shown: tuple[DecayingLine, ...]
    lines: tuple[DecayingLine, ...]
    boxes: tuple[Box, ...]

    @property
    def derived(self) -> tuple[str, ...]:
        """Outputs that are reported: a quality of each mode."""
        qualities = self.offer.qualities
        return qualities if len(qualities) == len(self.lines) else ()

    def fitted(self, answers: Answers) -> tuple[str, ...]:
        """Names of the parameters that are fitted.

        Args:
            answers: of flags, of a person, or by default.
        """
        each = "each of its modes" if len(self.lines) > 1 else "its mode"
        tells = "frequency and width" if len(self.boxes) > len(self.lines) else "the width"
        return answers.of(
            Question(
                key="fit",
                words="Which parameters of the FMU are fitted?",
                options=self.offer.parameters,
                default=tuple(box.name for box in self.boxes),
                why=f"a ringdown tells {tells} of {each}",
                several=True,
            )
        )

    def boxes_of(self, names: Sequence[str]) -> tuple[Box, ...]:
        """Boxes of parameters: of the lines, others about the FMU's own start values.

        Args:
            names: of the parameters.
        """
        known = {box.name: box for box in self.boxes}
        return tuple(known[n] if n in known else start_box(self.offer, n) for n in names)

    def output(self, answers: Answers, recording: Recording | None = None) -> str:
        """The output that was recorded: of that name, else one that shows all lines.

        Args:
            answers: of flags, of a person, or by default.
            recording: of samples; None: of demodulated values, which follow any output.
        """
        outputs = self.offer.outputs
        named = [n for n in outputs if recording is not None and recording.called(n)]
        default, why = (named or list(outputs))[0], "the first one with continuous values"
        if named:
            why = "named like a column"
        elif len(outputs) == 1:
            why = "the only one"
        elif len(self.lines) > 1 and recording is not None:
            default, why = self.showing(recording), "shows both lines after a pulse"
        [output] = answers.of(
            Question(
                key="output",
                words="Which output of the FMU was recorded?",
                options=outputs,
                default=(default,),
                why=why,
            )
        )
        return output

    def start(self, fitted: Sequence[str]) -> dict[str, tuple[float, str]]:
        """Start values with their reasons, but for what is fitted.

        Args:
            fitted: names of parameters.
        """
        made = {name: (value, OFF) for name, value in silenced(self.offer).items()}
        made |= UNCOUPLED if self.is_ours else {}
        made |= {name: found for name, found in self.taken().items() if name not in made}
        return {name: found for name, found in made.items() if name not in fitted}

    def taken(self) -> dict[str, tuple[float, str]]:
        """What one free decay of two lines does not tell, with reasons; none of a single one."""
        if len(self.lines) < 2:
            return {}
        if self.is_ours:
            return {COUPLING: UNCOUPLED[COUPLING]}
        drives = {name for tone in self.offer.tones for name in (tone.frequency, tone.amplitude)}
        fitted = {box.name for box in self.boxes}
        variables = self.offer.description.variables
        return {
            name: (float(variables[name].start or 0.0), OWN)
            for name in self.offer.parameters
            if name not in fitted | drives and not is_of_solver(variables[name])
        }

    @property
    def is_ours(self) -> bool:
        """Whether the FMU is this project's model of two modes."""
        return self.source.is_model and self.source.name == TWO_MODES

    def said(self, lead: str) -> tuple[str, ...]:
        """What the record was found to be, and what is taken.

        Args:
            lead: how it begins, before "one line decays".
        """
        at = listed(
            f"{hertz(x.frequency_hz, digits=6)} ({hertz(x.width_hz, digits=3)} wide)"
            for x in self.shown
        )
        where = f"one line decays, at {at}" if len(self.shown) == 1 else f"two lines decay, at {at}"
        off = ", the FMU's own tones are off" if self.offer.tones else ""
        words = [f"{lead}{where}; where it starts is solved for{off}."]
        if len(self.lines) < len(self.shown):
            words.append(
                "The FMU has one mode, which is taken for the larger line: the fit may end as one "
                "that does not describe the data (exit code 4)."
            )
        taken = self.taken()
        if self.is_ours and taken:
            words.append(
                "Taken: each line is a mode of its own, without a coupling. Coupled modes may give "
                "the same two lines, which a free decay does not tell: what is found holds under "
                "this."
            )
        elif taken:
            words.append(
                f"Taken at the FMU's own start values: {listed(taken)}. Others may give the same "
                "two lines, which a free decay does not tell: what is found holds under these."
            )
        return tuple(words)

    def showing(self, recording: Recording) -> str:
        """The first output that shows both lines as well as the best one does, after a pulse.

        Args:
            recording: whose samples are taken.

        Of modes m with decays g_m, the output is fitted by sum c_m e^(-g_m t), and the smaller
        |c_m| over the larger one compared.
        """
        outputs = self.offer.outputs
        try:
            seen, time_s = self._pulsed(recording)
        except (FmuFailure, BadInput):
            return outputs[0]
        poles = [complex(-math.pi * x.width_hz, 2.0 * math.pi * x.frequency_hz) for x in self.lines]
        waves = np.exp(np.outer(time_s, poles))
        columns = np.concatenate([waves.real, waves.imag], axis=1)
        c = np.linalg.lstsq(columns, seen, rcond=None)[0]
        sizes = np.hypot(c[: len(poles)], c[len(poles) :])
        shares = sizes.min(axis=0) / np.maximum(sizes.max(axis=0), 1e-300)
        enough = SHOWS * float(np.max(shares))
        return next(n for n, share in zip(outputs, shares, strict=True) if share >= enough)

    def _pulsed(self, recording: Recording) -> tuple[FloatArray, FloatArray]:
        """All outputs after a pulse of one sample, (n, outputs), and their times, s."""
        table, time = recording.table, recording.time
        factor = convert(1.0, time.unit or "s", "s", where=str(table.path))
        time_s = factor * table.numbers(time)[:LOOKED_AT]
        trace = TraceRecord(
            time_s - time_s[0],
            np.cos(time_s),
            input=self.offer.inputs[0],
            driven=Pulse(length_s=float(time_s[1] - time_s[0])),
            source=str(table.path),
        )
        window = trace.window()
        start = {name: value for name, (value, _) in self.start(()).items()}
        start |= {box.name: box.start for box in self.boxes}
        [seen] = self.source.workers.run(
            [
                Run(
                    start_values=start,
                    settle_s=window.settle_s,
                    sample_step_s=window.step_s,
                    samples=window.samples,
                    outputs=self.offer.outputs,
                    input_signal=trace.signal(1),
                )
            ]
        )
        return np.asarray(seen)[2:], window.times_s()[2:]


def _is_late(file: TraceFile) -> bool:
    """Whether a free decay, of two lines at most, begins inside the record."""
    values = file.recording.table.numbers(file.seen)
    begun = (decay_start(values, states) for states in (2, 4))
    return all(first is not None and first > LATEST * values.size for first in begun)
