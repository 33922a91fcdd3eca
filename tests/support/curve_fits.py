"""Fits of single curves in closed form: a measurement, a model of it, and what a fit infers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from fitting.campaign.parameters import Parameter
from fitting.fit.fit import Fit, solve_problem
from fitting.fit.options import Options, Schedule
from fitting.fit.problem import Problem
from fitting.inference.infer import Inference, infer
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import Evaluation, Measurement, Prediction
from fitting.measurements.sweep import Sweep
from fitting.text.arrays import FloatArray
from tests.support.datasets import SETUP

#: Frequencies of a sweep over six widths, Hz, and what its line is: centre and FWHM, Hz.
U = 1000.0 + np.linspace(-24.0, 24.0, 201)
CENTRE_HZ, WIDTH_HZ = 1000.7, 8.0


def line(u: FloatArray, centre: float = CENTRE_HZ, width: float = WIDTH_HZ) -> FloatArray:
    """Amplitude of one damped mode, its top one, (n,)."""
    return np.asarray(1.0 / np.sqrt(1.0 + (2.0 * (u - centre) / width) ** 2))


@dataclass(frozen=True)
class ClosedResponse:
    """`Response` by a function: predictions of all measurements at parameters p (n,)."""

    predicted: Callable[[FloatArray], Sequence[Prediction]]
    outputs: dict[str, Callable[[FloatArray], float]] = field(default_factory=dict)

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [Evaluation(tuple(self.predicted(p)), 1) for p in ps]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [{n: np.array([made(p)]) for n, made in self.outputs.items()} for p in ps]


def parameter(name: str, low: float, high: float, start: float, unit: str = "Hz") -> Parameter:
    """A parameter whose reference is its start."""
    scale = 0.1 * (high - low)
    return Parameter(
        name=name, unit=unit, lower=low, upper=high, start=start, reference=start, scale=scale
    )


LINE = (parameter("centre", 990.0, 1010.0, 1000.0), parameter("width", 2.0, 30.0, 9.0))


def sweep(amplitude: FloatArray, sigma: float = 0.0, u: FloatArray = U) -> Sweep:
    """A fitted sweep with a scale of least squares; noise of zero is not stated."""
    return Sweep(
        setup=SETUP,
        frequency_hz=u,
        amplitude_v=amplitude,
        fitted=True,
        scaled_by="fit",
        known=sigma > 0.0,
        sigmas_v=np.full(u.size, sigma),
        maximum_v=float(np.max(amplitude)),
    )


def fitted(
    measurements: Sequence[Measurement],
    predicted: Callable[[FloatArray], Sequence[Prediction]],
    parameters: Sequence[Parameter] = LINE,
) -> Fit:
    """The fit of some measurements by a function."""
    problem = Problem(tuple(parameters), Dataset(tuple(measurements)))
    schedule = Schedule(starts=1, nu_start=1e-3, iterations=2)
    options = Options(schedule=schedule, misfit="squares")
    return solve_problem(problem, lambda chosen: ClosedResponse(predicted), options)


def fitted_line(measured: Sweep) -> Fit:
    """The fit of one damped mode to a sweep."""
    u = measured.frequency_hz
    return fitted([measured], lambda p: [Prediction(line(u, *p))])


def inferred(fit: Fit, *, profiles: bool = False) -> Inference:
    """What a fit determines."""
    return infer(fit, profiles=profiles)
