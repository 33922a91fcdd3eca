"""A free decay as a draft sees it: whether a record is one, and the lines that it shows.

A record without a column that drives is a ringdown where its size falls from its first half to its
second. Its lines are those that `fitting.resonance.ringdown` finds, one or two that decay. Where it
finds none, the frequency is that of the highest line of the spectrum of the whole record, refined
by a parabola through the logarithms about it; the width follows from the halves,

    rms_2/rms_1 = exp(-pi width T/2)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fitting.draft.model import Offer
from fitting.draft.values import Box
from fitting.resonance.decay_record import SAMPLES, decay_record_of
from fitting.resonance.ringdown import Ringdown
from fitting.resonance.ringdown import ringdown_of as lines_of
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

#: Size of the second half over the first below which a record decays, and its crossings, at least.
DECAYS, CROSSINGS = 0.8, 8
#: Shares of the frequency and multiples of the width to either side, and factor on the width.
REACH, WIDTHS, FACTOR = 0.02, 20.0, 20.0


#: Digits of the ends of a box.
DIGITS = 3
SPECTRUM = "the highest line of the record's spectrum"
HALVES = "from how the record decays from its first half to its second"
FITTED = "from lines that decay, fitted to the record"


@dataclass(frozen=True, kw_only=True)
class DecayingLine:
    """A line of a free decay: its frequency and its full width, Hz, and how each was found.

    ``amplitude`` is that at the first sample, in any unit.
    """

    frequency_hz: float
    width_hz: float
    amplitude: float = 1.0
    frequency_words: str = FITTED
    width_words: str = FITTED


def ringdown_of(time_s: FloatArray, values: FloatArray) -> tuple[DecayingLine, ...]:
    """The lines of a record that decays freely, the lower one first; none where it does not.

    Args:
        time_s: times of the samples, evenly spaced, shape (n,), s.
        values: of the record, shape (n,), in any unit.
    """
    y = values - np.mean(values)
    if np.count_nonzero(np.diff(np.sign(y))) < CROSSINGS or _highest(y) < 0.5 * CROSSINGS:
        return ()
    first, second = (float(np.sqrt(np.mean(half**2))) for half in np.array_split(y, 2))
    if not 0.0 < second < DECAYS * first:
        return ()
    found = _fitted(time_s, values)
    if found:
        return found
    span_s = float(time_s[-1] - time_s[0]) * y.size / (y.size - 1)
    return (
        DecayingLine(
            frequency_hz=_highest(y) / span_s,
            width_hz=2.0 * math.log(first / second) / (math.pi * span_s),
            frequency_words=SPECTRUM,
            width_words=HALVES,
        ),
    )


def _fitted(time_s: FloatArray, values: FloatArray) -> tuple[DecayingLine, ...]:
    """Lines that were fitted to the samples, one or two; none where that finds no decay."""
    try:
        record = decay_record_of(time_s, values, "1")
        line = lines_of(replace(record, kind=SAMPLES))
    except BadInput:
        return ()
    return lines_of_ringdown(line)


def lines_of_ringdown(line: Ringdown) -> tuple[DecayingLine, ...]:
    """The lines of a ringdown that decay, the lower one first.

    Args:
        line: as it was fitted.
    """
    decaying = [DecayingLine(frequency_hz=line.frequency.value, width_hz=line.width.value)]
    one = line.second
    if one is not None and one.decays:
        f, width = one.frequency.value, one.width.value
        decaying.append(DecayingLine(frequency_hz=f, width_hz=width, amplitude=one.share))
    return tuple(sorted(decaying, key=lambda each: each.frequency_hz))


def _highest(y: FloatArray) -> float:
    """Where the spectrum of a record is highest, in periods of the whole record."""
    sizes = np.abs(np.fft.rfft(y * np.hanning(y.size)))
    k = int(np.argmax(sizes[1:])) + 1
    if k + 1 >= sizes.size:
        return float(k)
    below, top, above = np.log(np.maximum(sizes[k - 1 : k + 2], 1e-300))
    bend = 2.0 * top - below - above
    return k + (0.5 * float(above - below) / float(bend) if bend > 0.0 else 0.0)


def silenced(offer: Offer) -> Mapping[str, float]:
    """Start values that turn the tones of an FMU off.

    Args:
        offer: what it offers.
    """
    return {tone.amplitude: 0.0 for tone in offer.tones}


def lines_for(lines: Sequence[DecayingLine], offer: Offer) -> tuple[DecayingLine, ...]:
    """The lines that an FMU may have: the largest one where it has but one mode.

    Args:
        lines: of the record.
        offer: what the FMU offers.
    """
    if len(offer.places) == len(offer.widths) == 1 < len(lines):
        return (max(lines, key=lambda line: line.amplitude),)
    return tuple(lines)


def line_boxes(
    lines: Sequence[DecayingLine], offer: Offer, most_hz: float = math.inf
) -> tuple[Box, ...]:
    """Boxes of frequencies and widths; none where the FMU has other numbers of them, in hertz.

    Boxes of two frequencies meet in the middle between their lines: neither line is the other's.

    Args:
        lines: of the record, the lower one first.
        offer: what the FMU offers.
        most_hz: how far a frequency may lie from its line, Hz.
    """
    names = (*offer.places, *offer.widths)
    counts = {len(lines), len(offer.places), len(offer.widths)}
    if len(counts) > 1 or {*map(offer.unit, names)} != {"Hz"}:
        return ()
    apart = [0.5 * (b.frequency_hz - a.frequency_hz) for a, b in pairwise(lines)]
    return tuple(
        box
        for line, place, width in zip(lines, offer.places, offer.widths, strict=True)
        for box in (_place(line, place, min((*apart, most_hz))), width_box(line, width))
    )


def _place(line: DecayingLine, name: str, most: float) -> Box:
    """The box of a frequency, ``most`` Hz to either side at most."""
    f = float(f"{line.frequency_hz:.9g}")
    reach = min(most, _rounded(max(REACH * f, WIDTHS * line.width_hz), 2))
    return Box(
        name=name,
        unit="Hz",
        lower=_rounded(max(0.5 * f, f - reach), 9),
        upper=_rounded(f + reach, 9),
        start=f,
        scale=_rounded(reach, 2),
        why=line.frequency_words,
    )


def width_box(line: DecayingLine, name: str) -> Box:
    """The box of a full width.

    Args:
        line: of the record.
        name: of the parameter that sets it, in Hz.
    """
    d = _rounded(line.width_hz, DIGITS)
    return Box(
        name=name,
        unit="Hz",
        lower=_rounded(d / FACTOR, DIGITS),
        upper=_rounded(d * FACTOR, DIGITS),
        start=d,
        scale=d,
        why=line.width_words,
    )


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
