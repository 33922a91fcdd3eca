"""A prescribed window: from rest a time to settle, then samples, read by a Fourier transform.

    z(u) = |2/N sum_j q(t_j) exp(-i 2 pi u t_j)|        t_j = settle + j step, j < N

That is what a tone leaves in a spectrum of finite length: with what is left of the transient, and
with a share of every tone that is no whole number of 1/length away. Nothing is proved here, unlike
in `fitting.signal.window`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated

import numpy as np

from fitting.signal.free_decay import FewSamples, rebuilt
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.schema import Keys, Quantity, Refused

#: Blocks and samples of each by which a linear response is known at all samples, and the error, ten
#: times what is seen at others, up to which they are: amplitudes are then off by 1.3e-7 at most
#: (300 random points of the box of string_q1_published).
BLOCKS, BLOCK, TOLERANCE = 24, 8, 1e-5
#: Samples for each of which, at the least, one is simulated: fewer are simulated whole.
SPARED = 4


@dataclass(frozen=True, kw_only=True)
class PrescribedWindow(Keys):
    """When tones are sampled from rest on, and read by a Fourier transform at the lines."""

    settle: Annotated[float, Quantity("s")]
    """Time from rest to the first sample."""
    length: Annotated[float, Quantity("s")]
    """Time that is sampled."""
    step: Annotated[float, Quantity("s")]
    """Time between samples."""

    def __post_init__(self) -> None:
        if not (self.settle >= 0.0 and self.step > 0.0 and self.length >= 3.0 * self.step):
            raise Refused("wanted positive times, and three samples or more")

    @property
    def samples(self) -> int:
        """How many samples the window has."""
        return round(self.length / self.step)

    @cached_property
    def few(self) -> FewSamples | None:
        """Samples that are enough of a linear response; None: the window has too few."""
        if self.samples < SPARED * BLOCKS * BLOCK:
            return None
        return FewSamples(self.samples, BLOCKS, BLOCK)

    def whole(self, few: FloatArray) -> FloatArray | None:
        """All samples (n,) of a linear response; None where they do not follow from the few.

        Args:
            few: samples (m,) at the indices of `few`.
        """
        if self.few is None:
            return None
        result = rebuilt(self.few, few, TOLERANCE, enough=TOLERANCE)
        return None if result is None else result.samples

    def amplitudes(self, values: FloatArray, lines_hz: tuple[float, ...]) -> FloatArray:
        """Absolute values (lines,) of the Fourier transform, V peak for volts.

        Args:
            values: all samples (n,).
            lines_hz: frequencies at which it is read, Hz.
        """
        return np.abs(_waves(self, lines_hz) @ values)

    def transient(self, width_hz: float) -> float:
        """Share of a transient that is left when the samples begin.

        Args:
            width_hz: full width of the line, Hz.
        """
        return math.exp(-math.pi * width_hz * self.settle)

    def leakage(self, distance_hz: float) -> float:
        """Share of a tone that is read at another frequency.

        Args:
            distance_hz: of the frequency from the tone, Hz.
        """
        return float(abs(np.sinc(distance_hz * self.length)))


@lru_cache(maxsize=64)
def _waves(window: PrescribedWindow, lines_hz: tuple[float, ...]) -> ComplexArray:
    """What samples are multiplied by, (lines, n)."""
    times_s = window.settle + np.arange(window.samples) * window.step
    cycles = np.outer(lines_hz, times_s)
    return np.asarray(2.0 / window.samples * np.exp(-2j * np.pi * cycles))
