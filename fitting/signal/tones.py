"""Known tones in samples: exact arithmetic on their frequencies, and the one fit of them.

Frequencies are taken as the decimal numbers that people wrote (the shortest text of the double),
and all reasoning about periods is in whole numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import listed, number

#: Condition number of a tone fit above which the tones are not distinguished.
WORST_CONDITION = 1e3
#: Tones that are this many times as fast as others look like a forgotten unit.
FAR_APART = 1e3
_SPLITTER = 134217729.0  # 2**27 + 1 cuts a double into two halves (Dekker 1971)


@dataclass(frozen=True)
class FittedTones:
    """Mean and tones of samples, and what they leave.

    `mean` (outputs,); `phasors` (tones, outputs), complex peak amplitudes with the phase at time
    0; `rest` (samples, outputs). Without the last axis where the samples had none.
    """

    mean: FloatArray
    phasors: ComplexArray
    rest: FloatArray

    @property
    def amplitudes(self) -> FloatArray:
        """Peak amplitudes, (tones, outputs), in the unit of the samples."""
        return np.abs(self.phasors)


@dataclass(frozen=True)
class ToneFit:
    """Least squares of a mean and known tones on samples taken at known times.

    y(t) = c + sum_k a_k cos 2 pi f_k t + b_k sin 2 pi f_k t, phasor a_k - i b_k. `tones_hz`
    (tones,), `times_s` (samples,); `expected_hz`: lines that are fitted and not reported.
    The projector is made once for all samples at these times.
    """

    tones_hz: tuple[float, ...]
    times_s: FloatArray
    expected_hz: tuple[float, ...] = ()

    @cached_property
    def design(self) -> FloatArray:
        """Columns 1, cos 2 pi f t, sin 2 pi f t, ...: shape (samples, 1 + 2 lines)."""
        return tone_design((*self.tones_hz, *self.expected_hz), self.times_s)

    @cached_property
    def projector(self) -> FloatArray:
        """The fit as a matrix on the samples, (1 + 2 lines, samples)."""
        return np.asarray(np.linalg.pinv(self.design))

    @cached_property
    def reader(self) -> ComplexArray:
        """The phasors of the fit as a matrix on the samples, (tones, samples)."""
        phasors = self.projector[1::2] - 1j * self.projector[2::2]
        return np.asarray(phasors[: len(self.tones_hz)])

    @cached_property
    def condition(self) -> float:
        """Factor by which the fit may amplify rounding; infinite for fewer samples than unknowns.

        It is the condition number of the design.
        """
        if self.design.shape[0] < self.design.shape[1]:
            return math.inf
        return float(np.linalg.cond(self.design))

    def __call__(self, values: FloatArray) -> FittedTones:
        """Fit samples, shape (samples,) or (samples, outputs)."""
        fitted = self.projector @ values
        phasors = (fitted[1::2] - 1j * fitted[2::2])[: len(self.tones_hz)]
        return FittedTones(fitted[0], phasors, np.asarray(values - self.design @ fitted))


def fit_tones(tones_hz: Sequence[float], times_s: FloatArray, values: FloatArray) -> FittedTones:
    """Mean and tones of samples by least squares, for windows that are not whole periods.

    ``times_s`` (samples,), ``values`` (samples, outputs).

    Args:
        tones_hz: frequencies of the tones, Hz.
        times_s: of the samples (samples,), s.
        values: samples (samples, outputs).

    Raises:
        BadInput: the samples do not distinguish the tones.
    """
    fit = ToneFit(tuple(tones_hz), times_s)
    if fit.condition > WORST_CONDITION:
        raise BadInput(
            f"{tones_in_words(tones_hz)}: {times_s.size} samples over {float(np.ptp(times_s))!r} s "
            f"do not distinguish them (condition number {fit.condition:.3g}), wanted a longer "
            f"window"
        )
    return fit(values)


def tone_design(tones_hz: Sequence[float], times_s: FloatArray) -> FloatArray:
    """Columns 1, cos 2 pi f t, sin 2 pi f t, ...: shape (times, 1 + 2 tones).

    Args:
        tones_hz: frequencies of the tones, Hz.
        times_s: of the samples (samples,), s.
    """
    columns = [np.ones(times_s.size)]
    for tone in tones_hz:
        phase = 2.0 * np.pi * cycle_fraction(tone, times_s)
        columns += [np.cos(phase), np.sin(phase)]
    return np.stack(columns, axis=1)


def exact(frequency_hz: float) -> Fraction:
    """The decimal number that a frequency was written as: 0.1 is 1/10.

    Args:
        frequency_hz: frequency, Hz.
    """
    return Fraction(repr(float(frequency_hz)))


def common_period(tones_hz: Sequence[float]) -> Fraction:
    """Shortest time in which every tone makes whole periods, exact; tones of 0 Hz fit any.

    Args:
        tones_hz: frequencies of the tones, Hz.
    """
    tones = [exact(tone) for tone in tones_hz if tone != 0.0]
    if not tones:
        raise BadInput("no tone above 0 Hz, wanted one at least")
    denominator = math.lcm(*(tone.denominator for tone in tones))
    return denominator / Fraction(math.gcd(*(int(tone * denominator) for tone in tones)))


def cycle_fraction(frequency_hz: float, times_s: FloatArray) -> FloatArray:
    """F t without its whole cycles, shape of ``times_s``; no digit of f t is lost at large t.

    The product is formed exactly as the sum of two doubles (Dekker, Numer. Math. 18, 224, 1971);
    2π f t in one double would carry an error of 1e-16 f t cycles.

    Args:
        frequency_hz: frequency, Hz.
        times_s: of the samples (samples,), s.
    """
    product = frequency_hz * times_s
    f_high, f_low = _split(np.float64(frequency_hz))
    t_high, t_low = _split(times_s)
    rest = ((f_high * t_high - product) + f_high * t_low + f_low * t_high) + f_low * t_low
    return np.asarray(np.fmod(product, 1.0) + rest, dtype=np.float64)


def _split(value: np.float64 | FloatArray) -> tuple[FloatArray, FloatArray]:
    scaled = np.asarray(value * _SPLITTER)
    high = scaled - (scaled - value)
    return high, value - high


def tones_in_words(tones_hz: Sequence[float]) -> str:
    """Tones with none of their digits left out: "tones 6.94018 Hz and 6940360 Hz".

    Args:
        tones_hz: frequencies of the tones, Hz.
    """
    many = "tones" if len(tones_hz) > 1 else "tone"
    texts = (repr(float(tone)).removesuffix(".0") for tone in tones_hz)
    return f"{many} {listed(f'{text} Hz' for text in texts)}"


def unit_hint(tones_hz: Sequence[float]) -> str:
    """What to print where tones are so far apart that a unit may have been forgotten; or nothing.

    Args:
        tones_hz: frequencies of the tones, Hz.
    """
    slow, fast = min(tones_hz), max(tones_hz)
    if not 0.0 < FAR_APART * slow < fast:
        return ""
    return (
        f"; they differ by a factor of {number(fast / slow, 2)}: is a unit missing, as in "
        '"6.94 MHz"?'
    )
