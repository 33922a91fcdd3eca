"""Lines beside the tones in a response that is not linear, by name: 2 u1 - u2 and its like."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.signal.combinations import USUAL_ORDER, mixed_lines
from fitting.signal.tones import exact
from fitting.simulate.drive import BESIDE, DriveResult
from fitting.text.arrays import FloatArray


@dataclass(frozen=True)
class MixedLine:
    """A line at sum_i factors[i] f_i of the tones, with its amplitudes (outputs,)."""

    factors: tuple[int, ...]
    frequency_hz: float
    amplitudes: FloatArray


def mixed_peaks(result: DriveResult, order: int = USUAL_ORDER) -> tuple[MixedLine, ...]:
    """Lines at combinations of the tones that stand out of rounding, by order and frequency.

    Those within the band that the spectrum shows, up to sum |k_i| = ``order``, larger than 1e-6 of
    the output's largest peak; none where the bins do not hold the tones exactly.
    """
    if not result.coherent:
        return ()
    tones = [exact(f) for f in result.drive.tones_hz]
    limit = max(BESIDE, result.rounding) * result.peaks.max(axis=0)
    first, count = float(result.frequencies_hz[0]), result.frequencies_hz.size
    step = (float(result.frequencies_hz[-1]) - first) / (count - 1)
    taken = set(result.drive.tones_hz)
    found = []
    for factors in sorted(mixed_lines(len(tones), order), key=lambda k: sum(map(abs, k))):
        f = float(sum(k * tone for k, tone in zip(factors, tones, strict=True)))
        if f < 0.0:
            f, factors = -f, tuple(-k for k in factors)
        at = round((f - first) / step)
        if f in taken or not 0 <= at < count or abs(first + at * step - f) > 1e-3 * step:
            continue
        taken.add(f)
        if np.any(result.amplitudes[at] > limit):
            found.append(MixedLine(factors, f, result.amplitudes[at]))
    return tuple(sorted(found, key=lambda line: (sum(map(abs, line.factors)), line.frequency_hz)))
