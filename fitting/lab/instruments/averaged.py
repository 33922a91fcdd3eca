"""Peaks of spectra that are averaged with their phases kept: what a plan asks for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.lab.bench import Answer, Bench, Instrument
from fitting.text.toml import Tables


@dataclass(frozen=True)
class Averaged(Instrument):
    """Arrays "peaks_v" and "sigmas_v" (tones,).

    Of one spectrum's peak: ``floor_v`` per quadrature, which falls by the root of how many are
    averaged, and ``relative`` to the peak, which stays. With ``phases`` "x_v" and "y_v" stand in
    place of "peaks_v", both with that noise, against a reference phase that is not known.
    """

    floor_v: float
    relative: float
    phases: bool = False

    @property
    def arrays(self) -> tuple[str, ...]:
        """Names of the arrays in the order of the columns."""
        return ("x_v", "y_v", "sigmas_v") if self.phases else ("peaks_v", "sigmas_v")

    def read(
        self, bench: Bench, answers: Sequence[Answer], rng: np.random.Generator, seed: int
    ) -> tuple[Answer, ...]:
        """|X + n| (1 + r): complex n of the floor after averaging, r of the relative noise."""
        relative = bench.noise_scale * self.relative
        result, own = [], np.random.default_rng([seed, 3])
        reference = float(own.uniform(-math.pi, math.pi))
        for answer in answers:
            line = answer.lines_v
            floor_v = bench.noise_scale * self.floor_v / math.sqrt(answer.averaged)
            quadratures = rng.standard_normal((2, line.size)) * floor_v
            factor = 1.0 + relative * rng.standard_normal(line.size)
            peaks = np.abs(line + quadratures[0] + 1j * quadratures[1]) * np.abs(factor)
            sigmas = np.hypot(floor_v, relative * peaks)
            made = {"peaks_v": peaks, "sigmas_v": sigmas}
            if self.phases:
                turn = relative * own.standard_normal(line.size)
                waves = line + quadratures[0] + 1j * quadratures[1]
                waves = waves * (factor + 1j * turn) * np.exp(1j * reference)
                made = {"x_v": waves.real, "y_v": waves.imag, "sigmas_v": sigmas}
            result.append(answer.reading(made))
        return tuple(result)

    def edit(self, tables: Tables) -> None:
        """The plan states how its data are to be read."""
