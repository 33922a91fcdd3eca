"""Peaks of spectra that are averaged with their phases kept: what a plan asks for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.lab.bench import Answer, Bench, Instrument, Reading
from fitting.text.toml import Tables


@dataclass(frozen=True)
class Averaged(Instrument):
    """Arrays "peaks_v" and "sigmas_v" (tones,).

    Of one spectrum's peak: ``floor_v`` per quadrature, which falls by the root of how many are
    averaged, and ``relative`` to the peak, which stays.
    """

    floor_v: float
    relative: float

    def read(
        self, bench: Bench, answers: Sequence[Answer], rng: np.random.Generator, seed: int
    ) -> tuple[Reading, ...]:
        """|X + n| (1 + r): complex n of the floor after averaging, r of the relative noise."""
        relative = bench.noise_scale * self.relative
        found = []
        for answer in answers:
            line = answer.lines_v
            floor_v = bench.noise_scale * self.floor_v / math.sqrt(answer.averaged)
            quadratures = rng.standard_normal((2, line.size)) * floor_v
            factor = 1.0 + relative * rng.standard_normal(line.size)
            peaks = np.abs(line + quadratures[0] + 1j * quadratures[1]) * np.abs(factor)
            sigmas = np.hypot(floor_v, relative * peaks)
            found.append(answer.reading({"peaks_v": peaks, "sigmas_v": sigmas}))
        return tuple(found)

    def edit(self, tables: Tables) -> None:
        """The plan says how its data are to be read."""
