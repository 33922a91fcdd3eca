"""Markers of an analyser on tones and intermodulation lines, with their standard deviations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.lab.bench import Answer, Bench, Cell, Instrument
from fitting.lab.instruments.peaks import peak_columns, peak_table
from fitting.text.toml import Tables, put

#: Both tones and the first intermodulation lines, and what their columns are called.
READ = ((1, 0), (0, 1), (2, -1), (-1, 2))
PEAKS = ("z_u1", "z_u2", "z_low", "z_high")
SIGMAS = ("s_u1", "s_u2", "s_low", "s_high")


@dataclass(frozen=True)
class Markers(Instrument):
    """Arrays "peaks_v" and "sigmas_v" (4,), at the combinations `READ`.

    A line has the relative error ``repeatability`` next to the noise floor.

    Raises:
        ValueError: a repeatability that is none.
    """

    repeatability: float = 0.003
    lines: tuple[tuple[int, ...], ...] = READ

    def __post_init__(self) -> None:
        if not 0.0 <= self.repeatability < 0.1:
            raise ValueError(f"repeatability {self.repeatability}, wanted 0 to 0.1")

    def read(
        self, bench: Bench, answers: Sequence[Answer], rng: np.random.Generator, seed: int
    ) -> tuple[Answer, ...]:
        """|X (1 + r) + n|: noise n of one floor for all of them, r of the repeatability."""
        waves = np.array([answer.lines_v for answer in answers])
        floor = bench.noise(rng, waves.size).reshape(waves.shape)
        jitter = 1.0 + bench.noise_scale * self.repeatability * rng.standard_normal(waves.shape)
        peaks = np.abs(waves * jitter + floor)
        # a spectrum's mean floor, in one quadrature
        quiet = bench.noise_scale * sum(bench.floor_v) / math.sqrt(2.0 * math.pi)
        sigmas = np.hypot(quiet, bench.noise_scale * self.repeatability * np.abs(waves))
        rows = zip(answers, peaks, sigmas, strict=True)
        return tuple(a.reading({"peaks_v": peak, "sigmas_v": s}) for a, peak, s in rows)

    def edit(self, tables: Tables) -> None:
        """Ready peaks and their standard deviations, in columns."""
        put(tables, "experiments", peak_table(tables["experiments"]["file"], PEAKS, SIGMAS))

    def columns(self, reading: Answer) -> dict[str, Cell]:
        """Peaks and standard deviations."""
        return peak_columns(reading, PEAKS, SIGMAS)
