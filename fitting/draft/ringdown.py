"""A free decay as a draft sees it: whether a record is one, and the line that its spectrum shows.

A record without a column that drives is a ringdown where its size falls from its first half to its
second. The frequency is that of the highest line of the spectrum of the whole record, refined by a
parabola through the logarithms about it; the width follows from the halves,

    rms_2/rms_1 = exp(-pi width T/2)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitting.draft.model import Offer
from fitting.draft.values import Box
from fitting.text.arrays import FloatArray

#: Size of the second half over the first below which a record decays, and its crossings, at least.
DECAYS, CROSSINGS = 0.8, 8
#: Shares of the frequency and multiples of the width to either side, and factor on the width.
REACH, WIDTHS, FACTOR = 0.02, 20.0, 20.0


@dataclass(frozen=True, kw_only=True)
class Ringdown:
    """The highest line of a free decay: its frequency and its full width, Hz."""

    frequency_hz: float
    width_hz: float


def ringdown_of(time_s: FloatArray, values: FloatArray) -> Ringdown | None:
    """The line of a record that decays freely; None where it does not decay or hardly oscillates.

    Args:
        time_s: times of the samples, evenly spaced, shape (n,), s.
        values: of the record, shape (n,), in any unit.
    """
    y = values - np.mean(values)
    if np.count_nonzero(np.diff(np.sign(y))) < CROSSINGS or _highest(y) < 0.5 * CROSSINGS:
        return None
    first, second = (float(np.sqrt(np.mean(half**2))) for half in np.array_split(y, 2))
    if not 0.0 < second < DECAYS * first:
        return None
    span_s = float(time_s[-1] - time_s[0]) * y.size / (y.size - 1)
    width_hz = 2.0 * math.log(first / second) / (math.pi * span_s)
    return Ringdown(frequency_hz=_highest(y) / span_s, width_hz=width_hz)


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


def line_boxes(found: Ringdown, offer: Offer) -> tuple[Box, ...]:
    """Boxes of frequency and width; none where the FMU has not one of each, in hertz.

    Args:
        found: the line.
        offer: what the FMU offers.
    """
    names = (*offer.places, *offer.widths)
    if (len(offer.places), len(offer.widths)) != (1, 1) or {*map(offer.unit, names)} != {"Hz"}:
        return ()
    f, d = float(f"{found.frequency_hz:.7g}"), float(f"{found.width_hz:.3g}")
    reach = float(f"{max(REACH * f, WIDTHS * d):.2g}")
    return (
        Box(
            name=offer.places[0],
            unit="Hz",
            lower=max(0.5 * f, f - reach),
            upper=f + reach,
            start=f,
            scale=reach,
            why="the highest line of the record's spectrum",
        ),
        Box(
            name=offer.widths[0],
            unit="Hz",
            lower=d / FACTOR,
            upper=d * FACTOR,
            start=d,
            scale=d,
            why="from how the record decays from its first half to its second",
        ),
    )
