"""Free decays as a draft sees them: the lines of a record, and an FMU that rings down like it.

A record without a column that drives is a ringdown where its size falls from its first half to its
second, and lines that decay are fitted to it (`fitting.lines.ringdown`), one or two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitting.draft.boxes import Box, Shown, decade_box
from fitting.draft.model import COUPLING, UNCOUPLED, Offer, is_of_solver
from fitting.draft.questions import Answers, Question
from fitting.extension.fmu import Run
from fitting.extension.records import Pulse, TraceRecord
from fitting.lines.decay_record import SAMPLES
from fitting.lines.ringdown import Ringdown
from fitting.lines.ringdown import ringdown_of as lines_of
from fitting.resonance.decay_reading import decay_record_of
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure

#: Size of the second half over the first below which a record decays, and its crossings, at least.
DECAYS, CROSSINGS = 0.8, 8
#: Samples of the answer to a pulse that are looked at, and the share of the best output's second
#: line from which another one shows both as well.
MOST_SAMPLES, SHOWS = 2000, 0.3
#: Why the tones of an FMU have no amplitude, and why a parameter that is not fitted has its value.
OFF = "off: nothing drives while it rings down"
OWN = "the FMU's own start value, not measured"
FITTED = "from lines that decay, fitted to the record"


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
    if ringdown.second is not None and ringdown.second.decays:
        second = ringdown.second
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


def undetermined(offer: Offer, lines: Sequence[Shown], boxes: Sequence[Box]) -> list[str]:
    """Names of what one free decay of two lines does not determine; none of a single one.

    Args:
        offer: what the FMU offers.
        lines: that it has.
        boxes: of what the lines determine.
    """
    if len(lines) < 2:
        return []
    if offer.is_two_modes:
        return [COUPLING]
    other = {name for tone in offer.tones for name in tone} | {box.name for box in boxes}
    known = offer.description.variables
    return [n for n in offer.parameters if n not in other and not is_of_solver(known[n])]


def decay_start(
    offer: Offer, lines: Sequence[Shown], boxes: Sequence[Box]
) -> dict[str, tuple[Scalar, str]]:
    """Start values with their reasons: no tone drives, and what the lines do not determine.

    Args:
        offer: what the FMU offers.
        lines: that it has.
        boxes: of what the lines determine.
    """
    start: dict[str, tuple[Scalar, str]] = {tone[1]: (0.0, OFF) for tone in offer.tones}
    start |= UNCOUPLED if offer.is_two_modes else {}
    for name in undetermined(offer, lines, boxes):
        start.setdefault(name, (offer.start(name), OWN))
    return start


def decay_boxes_chosen(
    offer: Offer, answers: Answers, lines: Sequence[Shown], boxes: Sequence[Box]
) -> tuple[Box, ...]:
    """Boxes of what is fitted: of the lines, others about the FMU's own start values.

    Args:
        offer: what the FMU offers.
        answers: of flags, of a person, or by default.
        lines: that it has.
        boxes: of what the lines determine.
    """
    each = "each of its modes" if len(lines) > 1 else "its mode"
    what = "frequency and width" if len(boxes) > len(lines) else "the width"
    names = answers.of(
        Question(
            key="fit",
            words="Which parameters of the FMU are fitted?",
            options=offer.parameters,
            default=tuple(box.name for box in boxes),
            why=f"a ringdown determines {what} of {each}",
            several=True,
        )
    )
    known = {box.name: box for box in boxes}
    return tuple(known[n] if n in known else decade_box(offer, n) for n in names)


def qualities(offer: Offer, lines: Sequence[Shown]) -> list[str]:
    """Outputs that are reported: a quality factor of each mode.

    Args:
        offer: what the FMU offers.
        lines: that it has.
    """
    return list(offer.qualities) if len(offer.qualities) == len(lines) else []


def showing(
    offer: Offer, lines: Sequence[Shown], boxes: Sequence[Box], time_s: FloatArray, source: str
) -> str:
    """The first output that shows both lines as well as the best one does, after a pulse.

    Of modes m with decays g_m, every output is fitted by sum c_m e^(-g_m t), and the smaller
    |c_m| over the larger one compared.

    Args:
        offer: what the FMU offers.
        lines: that decay.
        boxes: of what they determine.
        time_s: times of the first samples of a record, s.
        source: the file, for errors.
    """
    start = {name: value for name, (value, _) in decay_start(offer, lines, boxes).items()}
    try:
        trace = TraceRecord(
            time_s - time_s[0],
            np.cos(time_s),
            input=offer.inputs[0],
            driven=Pulse(length_s=float(time_s[1] - time_s[0])),
            source=source,
        )
        window = trace.window()
        run = Run(
            start_values=start | {box.name: box.start for box in boxes},
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
