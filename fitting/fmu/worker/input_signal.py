"""The drive that the tool itself generates for an FMU input."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from fitting.fmu.runs import Tone
from fitting.signal.tones import cycle_fraction
from fitting.text.arrays import FloatArray


def held_values(tones: Iterable[Tone], start_s: float, step_s: float, steps: int) -> FloatArray:
    """Values to hold over each of ``steps`` communication steps, shape (steps,).

    Σ a cos(2π f (t + h/2) + φ) / sinc(f h), t = start + k h, as `InputSignal` explains.

    Args:
        tones: frequency in Hz, amplitude and phase of each.
        start_s: time of the first step, s.
        step_s: time between samples, s.
        steps: number of steps.
    """
    middle = np.asarray(start_s + (np.arange(steps) + 0.5) * step_s, dtype=np.float64)
    values = np.zeros(steps)
    for frequency_hz, amplitude, phase in tones:
        if amplitude != 0.0:
            held = amplitude / float(np.sinc(frequency_hz * step_s))
            values += held * np.cos(2.0 * math.pi * cycle_fraction(frequency_hz, middle) + phase)
    return values


def seen_values(tones: Iterable[Tone], times_s: FloatArray) -> list[float]:
    """Values of the tones at some times, Σ a cos(2π f t + φ), shape (times,).

    Args:
        tones: frequency in Hz, amplitude and phase of each.
        times_s: when, shape (times,), s.
    """
    values = np.zeros(len(times_s))
    for frequency_hz, amplitude, phase in tones:
        turns = cycle_fraction(frequency_hz, np.asarray(times_s, dtype=np.float64))
        values += amplitude * np.cos(2.0 * math.pi * turns + phase)
    return [float(value) for value in values]
