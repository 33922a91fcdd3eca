"""The drive that the tool itself generates for an FMU input."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from fitting.fmu.records import Tone

FloatArray = NDArray[np.float64]

_SPLITTER = 134217729.0  # 2**27 + 1 cuts a double into two halves (Dekker 1971)


def held_values(tones: Iterable[Tone], start_s: float, step_s: float, steps: int) -> FloatArray:
    """Values to hold over each of ``steps`` communication steps, shape (steps,).

    Σ a cos(2π f (t + h/2) + φ) / sinc(f h), t = start + k h, as `InputSignal` explains.
    """
    middle = np.asarray(start_s + (np.arange(steps) + 0.5) * step_s, dtype=np.float64)
    values = np.zeros(steps)
    for frequency_hz, amplitude, phase in tones:
        if amplitude != 0.0:
            held = amplitude / float(np.sinc(frequency_hz * step_s))
            values += held * np.cos(2.0 * math.pi * cycle_fraction(frequency_hz, middle) + phase)
    return values


def cycle_fraction(frequency_hz: float, times_s: FloatArray) -> FloatArray:
    """F t without its whole cycles, shape of ``times_s``; no digit of f t is lost at large t.

    The product is formed exactly as the sum of two doubles (Dekker, Numer. Math. 18, 224, 1971);
    2π f t in one double would carry an error of 1e-16 f t cycles.
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
