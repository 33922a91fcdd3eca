"""A spectrum analyser: the magnitude of all lines about a drive pair."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.lab.bench import Answer, Bench, Instrument
from fitting.text.arrays import FloatArray
from fitting.text.toml import Tables, put


@dataclass(frozen=True)
class Analyser(Instrument):
    """Arrays "frequency_hz" and "amplitude_v" (n,): a spectrum for every drive."""

    def read(
        self, bench: Bench, answers: Sequence[Answer], rng: np.random.Generator, seed: int
    ) -> tuple[Answer, ...]:
        """All lines through a Gaussian resolution filter, plus complex noise, in magnitude."""
        return tuple(answer.reading(_spectrum(bench, answer, rng)) for answer in answers)

    def edit(self, tables: Tables) -> None:
        """A file per experiment, whose noise floor is its own."""
        experiments = {
            "file": tables["experiments"]["file"],
            "spectra": "spectra/{experiment}.csv",
            "layout": "csv",
            "amplitude": "V peak",
            "noise_floor": "robust",
        }
        put(tables, "experiments", experiments)

    def files(self, reading: Answer) -> dict[str, dict[str, FloatArray]]:
        """The spectrum."""
        columns = {
            "frequency (MHz)": reading.arrays["frequency_hz"] / 1e6,
            "amplitude (uV)": reading.arrays["amplitude_v"] * 1e6,
        }
        return {f"spectra/{reading.label}.csv": columns}


def _spectrum(bench: Bench, answer: Answer, rng: np.random.Generator) -> dict[str, FloatArray]:
    tones = answer.drive.tones_hz
    half = round(bench.spectrum_span_hz / bench.resolution_hz / 2.0)
    steps = np.arange(-half, half + 1, dtype=np.float64)
    frequency = 0.5 * (tones[0] + tones[-1]) + bench.resolution_hz * steps
    wave = np.zeros(frequency.size, dtype=complex)
    for tone, line in zip(tones, answer.lines_v, strict=True):
        # amplitude 1/sqrt(2) half a bandwidth off the line: bandwidth between the 3 dB points
        offset = 2.0 * (frequency - tone) / bench.resolution_hz
        wave += line * np.exp(-0.5 * math.log(2.0) * offset**2)
    amplitude = np.abs(wave + bench.noise(rng, frequency.size))
    return {"frequency_hz": frequency, "amplitude_v": amplitude}
