"""Amplitudes at known tones from samples: three readers, by what they ask of a window."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache

import numpy as np
from scipy.signal import windows

from fitting.lab.tradeoff.records import COHERENT, FLAT_TOP
from fitting.signal.tones import common_period
from fitting.signal.window import Window, coherent_samples, plan_window, tone_amplitudes
from fitting.text.arrays import FloatArray

#: Longest common period that is taken for a window, s.
LONGEST_PERIOD_S = 10.0
#: Where the mean of the tones is seen, as a share of the sampling rate: amid the band.
PLACE = 0.25


@dataclass(frozen=True)
class Sampling:
    """When to sample: t_j = settle + j step, j < samples; held steps in a step (0: none)."""

    tones_hz: tuple[float, ...]
    settle_s: float
    step_s: float
    samples: int
    reader: str
    held_steps: int = 0

    @property
    def input_step_s(self) -> float:
        """Length of a held input step, s."""
        return self.step_s / self.held_steps if self.held_steps else self.step_s

    @property
    def end_s(self) -> float:
        """Time of the last sample."""
        return self.settle_s + (self.samples - 1) * self.step_s

    @cached_property
    def _window(self) -> Window:
        return Window(
            self.tones_hz, self.settle_s, self.step_s, self.samples, held_steps=self.held_steps
        )

    def amplitudes(self, samples: FloatArray) -> FloatArray:
        """Amplitudes (tones,) in the sampled values (samples,)."""
        if self.reader == COHERENT:
            return tone_amplitudes(self._window, samples)
        return largest_lines(samples, self.step_s, self.tones_hz, flat=self.reader == FLAT_TOP)


@lru_cache(maxsize=4096)
def sample(
    tones_hz: tuple[float, ...],
    settle_s: float,
    reader: str,
    window_s: float,
    samples: int,
    held: int = 0,
) -> Sampling:
    """A sampling of about that many samples over about that long a window.

    The coherent reader takes as many whole common periods as fit, one at least, and where the tones
    have none the plan's window for a fit of the tones. The other readers place the tones amid the
    band. `held` > 0: input steps per period of the fastest tone, of which a step and the settling
    take a whole number. Kept for who asks again: no cost of a simulation that is repeated.
    """
    tones = tuple(map(float, tones_hz))
    if reader != COHERENT:
        step = _step_amid_band(tones, window_s / samples)
        return _aligned(tones, settle_s, step, samples, reader, held)
    period = common_period(tones)
    if period > LONGEST_PERIOD_S:
        planned = plan_window(tones, settle_s, samples_per_period=held)
        return Sampling(
            tones, planned.settle_s, planned.step_s, planned.samples, reader, planned.held_steps
        )
    length = period * max(1, round(Fraction(window_s) / period))
    count = coherent_samples(tones, length, max(samples, 2 * len(tones) + 1))
    if count is None:
        count = samples
    return _aligned(tones, settle_s, float(length / count), count, reader, held)


def _step_amid_band(tones: tuple[float, ...], step_s: float) -> float:
    """The step nearest to one wanted with which the mean of the tones is seen amid the band."""
    mean = sum(tones) / len(tones)
    return (max(0, round(mean * step_s - PLACE)) + PLACE) / mean


def _aligned(
    tones: tuple[float, ...], settle_s: float, step_s: float, samples: int, reader: str, held: int
) -> Sampling:
    if not held:
        return Sampling(tones, settle_s, step_s, samples, reader)
    count = max(1, round(step_s * max(tones) * held))
    if reader != COHERENT:  # a window of whole periods must keep its length
        step_s = count / (max(tones) * held)
    grain = step_s / count
    return Sampling(tones, round(settle_s / grain) * grain, step_s, samples, reader, count)


def largest_lines(
    samples: FloatArray, step_s: float, tones_hz: Sequence[float], *, flat: bool
) -> FloatArray:
    """Amplitude (tones,) of the largest line of a spectrum about each tone, nearer than any other.

    2 |sum x_j w_j exp(-2 pi i j k/n)| / sum w_j at the bins k: with a flat-top window w at most
    0.01 dB off for a tone between two bins, without one (w = 1) at most 3.92 dB.

    Source: G. Heinzel, A. Ruediger, R. Schilling, Spectrum and spectral density estimation by the
    DFT, 2002, section 8.
    """
    n = samples.size
    window = windows.flattop(n, sym=False) if flat else np.ones(n)
    lines = 2.0 * np.abs(np.fft.rfft(samples * window)) / float(np.sum(window))
    seen = [_seen_bin(tone, step_s, n) for tone in tones_hz]
    found = []
    for place in seen:
        others = [abs(place - other) for other in seen if other != place]
        reach = max(1.0, 0.5 * min(others, default=4.0))
        low, high = int(np.ceil(place - reach)), int(np.floor(place + reach))
        found.append(float(np.max(lines[max(0, low) : min(lines.size, high + 1)])))
    return np.array(found)


def _seen_bin(tone_hz: float, step_s: float, samples: int) -> float:
    """Where a tone is seen in the spectrum of the samples, folded, in bins."""
    turns = tone_hz * step_s % 1.0
    return samples * min(turns, 1.0 - turns)
