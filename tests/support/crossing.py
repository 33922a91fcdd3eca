"""Two modes at an avoided crossing, in closed form: lines that overlap, several minima of chi^2.

Both modes are read at tones over both lines; theta, both dampings and both eigenfrequencies are
looked for in wide boxes. Random laboratories, 1 % noise, no FMU.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.campaign.parameters import Parameter
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective, make_objective
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import Evaluation
from fitting.text.arrays import FloatArray
from tests.support import closed_form
from tests.support.datasets import answer, dataset

NOISE = 0.01


@dataclass(frozen=True)
class Crossing:
    """Response of both modes at the same tones; p = theta, d1, d2, eta_plus, eta_minus."""

    tones_hz: FloatArray
    reflection: bool = False

    def peaks(self, p: FloatArray) -> FloatArray:
        d = closed_form.damping(p[0], p[1], p[2], self.reflection)
        eta = (float(p[3]), float(p[4]))
        return np.concatenate([closed_form.amplitude(self.tones_hz, eta, d, k) for k in (0, 1)])

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [answer(self.peaks(p)) for p in ps]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        with np.errstate(invalid="ignore"):
            return [
                {"lambda": np.sqrt(np.array([-0.5 * np.sin(2 * p[0]) * (p[4] ** 2 - p[3] ** 2)]))}
                for p in ps
            ]


@dataclass(frozen=True)
class Laboratory:
    """What was measured, by which sample (n,), and what is looked for."""

    response: Crossing
    parameters: tuple[Parameter, ...]
    data: Dataset
    truth: FloatArray

    def objective(self) -> Objective:
        return make_objective(self.response, self.parameters, self.data)

    def evaluator(self) -> LikelihoodEvaluator:
        sigma = self.data.sigma
        return LikelihoodEvaluator(
            likelihood_of(self.objective(), RowNoise(sigma, np.zeros((sigma.size, 0))))
        )

    def chi_square(self, p: FloatArray) -> float:
        """Of parameters in their units, from the peaks alone."""
        tones = self.data.tones[0]
        return float(np.sum(((self.response.peaks(p) - tones.peaks_v) / tones.sigmas_v) ** 2))


def laboratory(seed: int, *, starts: tuple[float, float] = (-1.0, 1.0)) -> Laboratory:
    """A random sample whose lines are half a width to four widths apart.

    `starts` of both eigenfrequencies, in widths from the middle of the lines.
    """
    generator = np.random.default_rng(seed)
    theta = generator.uniform(np.pi / 2, np.pi)
    d1, d2 = 10 ** generator.uniform(1.3, 2.5, 2)
    width = 0.5 * (d1 + d2)
    eta = (1e6, 1e6 + generator.uniform(0.5, 4.0) * width)
    tones = np.concatenate([centre + width * np.linspace(-1.0, 1.0, 8) for centre in eta])
    response = Crossing(tones)
    truth = np.array([theta, d1, d2, *eta])
    clean = response.peaks(truth)
    peaks = clean * (1.0 + NOISE * generator.standard_normal(clean.size))
    middle = 0.5 * (eta[0] + eta[1])

    def frequency(name: str, start: float) -> Parameter:
        return Parameter(
            name=name,
            unit="Hz",
            lower=middle - 8.0 * width,
            upper=middle + 8.0 * width,
            start=middle + start * width,
            reference=middle,
            scale=width,
        )

    def damping(name: str) -> Parameter:
        return Parameter(
            name=name, unit="Hz", lower=1.0, upper=1000.0, start=100.0, reference=100.0, scale=100.0
        )

    parameters = (
        closed_form.string_parameters()[0],
        damping("d1"),
        damping("d2"),
        frequency("eta_plus", starts[0]),
        frequency("eta_minus", starts[1]),
    )
    return Laboratory(response, parameters, dataset(peaks, NOISE * peaks), truth)
