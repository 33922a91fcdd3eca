"""Lock-in amplifiers that record both quadratures: X and Y of every tone, one mode or both.

The two amplifiers share a reference, whose phase against the drive is not known; it is another one
after a restart. Noise is alike on both quadratures and relative to the amplitude, as `lock_in` has
it: an amplitude that is known to 1 % has a phase that is known to 0.01 rad.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.lab.bench import OUTPUTS, Answer, Bench, Cell, Instrument
from fitting.lab.instruments.analyser import Analyser
from fitting.lab.instruments.lock_in import PAUSE_MIN, check_noise, with_offsets
from fitting.text.toml import Tables, put

X, Y, SIGMAS = ("X1", "X2"), ("Y1", "Y2"), ("s1", "s2")


@dataclass(frozen=True, kw_only=True)
class PhaseDetectors(Instrument):
    """Arrays "x_v", "y_v", "sigmas_v" (2,) and "time_min", "reference_rad" () at every pair.

    ``noise`` is the standard deviation of each quadrature over the amplitude (times the bench's
    noise scale); ``both`` modes are recorded, or the observed one alone; ``restarts`` are the
    pairs, from 0, before which the instrument is restarted.

    Raises:
        BadInput: a noise that is none.
    """

    noise: float = 0.01
    both: bool = False
    restarts: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        check_noise(self.noise)

    def read(
        self, bench: Bench, answers: Sequence[Answer], rng: np.random.Generator, seed: int
    ) -> tuple[Answer, ...]:
        """X exp(i reference) (1 + r), r complex of the relative noise, the observed mode first."""
        # drawn and left: a seed has the same drift whatever instrument reads the series
        Analyser().read(bench, answers, rng, seed)
        own, result, reference = np.random.default_rng([seed, 2]), [], 0.0
        for place, answer in enumerate(answers):
            if place == 0 or place in self.restarts:
                reference = float(own.uniform(-math.pi, math.pi))
            for mode in (answer.observed, 1 - answer.observed)[: 1 + self.both]:
                label = answer.label + ("" if mode == answer.observed else "_cross")
                lines = answer.waves_v[:, mode] * np.exp(1j * reference)
                draws = own.standard_normal((2, lines.size))
                values = lines * (1.0 + self.noise * bench.noise_scale * (draws[0] + 1j * draws[1]))
                arrays = {
                    "x_v": values.real,
                    "y_v": values.imag,
                    "sigmas_v": self.noise * np.abs(values),
                    "time_min": np.array(PAUSE_MIN * place),
                    "reference_rad": np.array(reference),
                }
                result.append(replace(answer.reading(arrays), label=label, observed=mode))
        return tuple(result)

    def edit(self, tables: Tables) -> None:
        """X and Y, a reference phase solved inside, an offset of every pair from the drift."""
        tables["title"] = str(tables["title"]).replace(" (", " with phases (", 1)
        experiments = {
            "file": tables["experiments"]["file"],
            "x": list(X),
            "y": list(Y),
            "peak_sigmas": list(SIGMAS),
            "amplitude": "V peak",
            "unknown": "phase",
        }
        if self.restarts:
            experiments["restarted"] = [f"pair{k + 1}" for k in self.restarts]
        put(tables, "experiments", experiments, "referred to drive and gain of the sweep")
        with_offsets(tables)

    def columns(self, reading: Answer) -> dict[str, Cell]:
        """Time, mode, both quadratures and their standard deviations."""
        result: dict[str, Cell] = {
            "time (min)": float(reading.arrays["time_min"]),
            "output": OUTPUTS[reading.observed],
        }
        for names, key in ((X, "x_v"), (Y, "y_v"), (SIGMAS, "sigmas_v")):
            pairs = zip(names, reading.arrays[key], strict=True)
            result |= {f"{name} (uV)": float(value) * 1e6 for name, value in pairs}
        return result
