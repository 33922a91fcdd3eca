"""A kind of measurement that the package does not have, defined here and fitted through the FMU.

A lock-in amplifier gives both quadratures of one driven mode: complex values, two rows for each.
What nothing in the package knows of it stands in this file, which is what adding a kind takes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign import Drive, Setup
from fitting.campaign.parameters import Parameter
from fitting.fit.fit import Fit, solve_problem
from fitting.fit.options import Options
from fitting.fit.planned_fmu import plan_problem
from fitting.fit.problem import Problem
from fitting.fmu import FmuWorkers
from fitting.inference.infer import InferenceRequest, infer
from fitting.measurements.dataset import Dataset
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.measurement import MeasurementKind, Predicting, Prediction
from fitting.signal.window import Window
from fitting.simulate.batch import Batch
from fitting.text.arrays import ComplexArray, FloatArray, Scalar

QUADRATURES = ("q1_hybrid_X_u1", "q1_hybrid_Y_u1")
#: Truth of the synthetic measurement: eigenfrequency and width of the only mode that is seen.
ETA_HZ, WIDTH_HZ = 1000.0, 12.5
SEEN_HZ = ETA_HZ + np.linspace(-20.0, 20.0, 7)


@dataclass(frozen=True)
class LockIn(MeasurementKind):
    """Complex amplitudes (m,) at drive frequencies (m,), Hz, each quadrature with noise `sigma_v`.

    Rows are real and imaginary parts of (simulated - measured), over the largest modulus.
    """

    setup: Setup
    frequency_hz: FloatArray
    amplitude_v: ComplexArray
    sigma_v: float
    series: str = ""

    @property
    def rows(self) -> int:
        return 2 * self.frequency_hz.size

    @property
    def sigma(self) -> FloatArray:
        return np.full(self.rows, self.sigma_v / self._largest)

    @property
    def _largest(self) -> float:
        return float(np.max(np.abs(self.amplitude_v)))

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        return tuple(("", {"u1": float(u)}) for u in self.frequency_hz)

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        window = Window(tones_hz=(), settle_s=model.plan.settle_s, step_s=1e-3, samples=1)
        asked = [
            [
                batch.ask(model.values(p, label, settings), window, None, quadrature, k)
                for label, settings in self.places
                for quadrature in QUADRATURES
            ]
            for k, p in enumerate(table)
        ]
        yield
        return [
            Prediction(
                np.array([batch.samples(run, QUADRATURES[0])[-1] for run in runs[0::2]])
                + 1j * np.array([batch.samples(run, QUADRATURES[1])[-1] for run in runs[1::2]])
            )
            for runs in asked
        ]

    def residuals(self, prediction: Prediction, chi: float) -> FloatArray:
        apart = (prediction.values - self.amplitude_v) / self._largest
        return np.concatenate([apart.real, apart.imag])


def closed_form(u_hz: FloatArray) -> ComplexArray:
    """X(u) of q'' + 2 pi w q' + (2 pi eta)^2 q = cos 2 pi u t, the phasor of exp(i 2 pi u t)."""
    return np.asarray(
        1.0
        / (
            (2 * np.pi) ** 2 * (ETA_HZ - u_hz) * (ETA_HZ + u_hz)
            + 1j * (2 * np.pi) ** 2 * u_hz * WIDTH_HZ
        )
    )


def problem_of_a_lock_in(seed: int, noise: float) -> Problem:
    """One mode (theta = 0 leaves d1 to the first) seen by a lock-in with synthetic noise."""
    setup = Setup(
        drive=Drive(
            frequency_names=("u1", "u2"),
            amplitude_names=("A1", "A2"),
            input=None,
            amplitude=1.0,
            samples_per_period=0,
        ),
        output="q1_hybrid",
        start_values={
            "periodic_start": True,
            "theta": 0.0,
            "d2": 10.0,
            "eta_minus": 2000.0,
            "u2": 1500.0,
        },
        steady_start=True,
    )
    exact = closed_form(SEEN_HZ)
    sigma = noise * float(np.max(np.abs(exact)))
    scatter = np.random.default_rng(seed).standard_normal((2, SEEN_HZ.size))
    seen = exact + sigma * (scatter[0] + 1j * scatter[1])
    parameters = (
        Parameter(
            name="d1", unit="Hz", lower=1.0, upper=100.0, start=30.0, reference=30.0, scale=10.0
        ),
        Parameter(
            name="eta_plus",
            unit="Hz",
            lower=980.0,
            upper=1020.0,
            start=1004.0,
            reference=1004.0,
            scale=5.0,
        ),
    )
    data = Dataset((LockIn(setup, SEEN_HZ, seen, sigma),), weigh=True)
    return Problem(parameters, data, derived={"": ("width_plus", "Q_plus")})


@pytest.fixture(scope="module")
def workers(oscillator_fmu: Path) -> FmuWorkers:
    return FmuWorkers(oscillator_fmu, workers=1)


def fitted(problem: Problem, workers: FmuWorkers) -> Fit:
    planned = plan_problem(problem, workers)
    return solve_problem(problem, planned.response, Options())


def test_without_noise_the_truth_comes_back(workers: FmuWorkers) -> None:
    fit = fitted(problem_of_a_lock_in(1, 0.0), workers)
    assert fit.success
    # the regularisation of the last level still pulls by about nu = 1e-9
    assert fit.x == pytest.approx([WIDTH_HZ, ETA_HZ], rel=1e-6)


def test_it_is_inferred_from_as_any_other_kind(workers: FmuWorkers) -> None:
    """Errors are those of the linear problem, worked out here from the closed form."""
    noise = 0.01
    fit = fitted(problem_of_a_lock_in(3, noise), workers)
    found = infer(fit, InferenceRequest(units={"width_plus": "Hz", "Q_plus": "1"}))
    assert found.knowledge is not None
    u, x = SEEN_HZ, closed_form(SEEN_HZ)
    slopes = [-(x**2) * 1j * (2 * np.pi) ** 2 * u, -(x**2) * (2 * np.pi) ** 2 * 2 * ETA_HZ]
    matrix = np.stack([np.concatenate([s.real, s.imag]) for s in slopes], axis=1)
    covariance = np.linalg.inv(matrix.T @ matrix) * (noise * np.max(np.abs(x))) ** 2
    for name, std, truth in zip(
        ("d1", "eta_plus"), np.sqrt(np.diag(covariance)), (WIDTH_HZ, ETA_HZ), strict=True
    ):
        value = found.parameters[name]
        assert value.identifiable == "determined"
        assert abs(value.value - truth) < 4.0 * std
        half = 0.5 * (value.ci95[1] - value.ci95[0]) / 1.96
        # residuals larger than the noise, by chance, widen the intervals
        assert half == pytest.approx(found.knowledge.inflation * std, rel=0.02)
    assert found.derived["width_plus"].value == pytest.approx(found.parameters["d1"].value)
