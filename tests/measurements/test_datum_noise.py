"""The accuracy of a plan follows the noise of the data where nobody has requested one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.measurements.residuals import accuracy_for, white_noise
from fitting.simulate.budget import Basis, Kind
from fitting.text.arrays import FloatArray

F0_HZ, WIDTH_HZ = 1000.0, 5.0
SETUP = ff.Setup(
    ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2")),
    "q1_hybrid",
    start_values={"theta": 0.0, "eta_minus": 2000.0, "periodic_start": True},
    steady_start=True,
)
PARAMETERS = (
    ff.Parameter("eta_plus", 1000.5, bounds=(950.0, 1050.0), unit="Hz"),
    ff.Parameter("d1", 6.0, bounds=(1.0, 50.0), unit="Hz"),
)


@pytest.fixture(scope="module")
def fmu(swift_fmu: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(swift_fmu, workers=1) as opened:
        yield opened


@pytest.mark.parametrize(
    ("noise", "accuracy"),
    [([0.01, 0.03], 1e-3), ([0.5], 1e-2), ([1e-12], 1e-9), ([0.0, 0.02], 2e-3)],
)
def test_a_tenth_of_the_smallest_noise_within_its_limits(
    noise: list[float], accuracy: float
) -> None:
    assert accuracy_for(noise) == pytest.approx(accuracy)


def test_nothing_is_known_of_no_noise() -> None:
    assert accuracy_for([]) is None
    assert accuracy_for([0.0]) is None
    assert white_noise(np.ones(7)) == 0.0


@pytest.mark.parametrize("n", [160, 1000])
@pytest.mark.parametrize("sigma", [1e-4, 1e-2])
def test_noise_is_estimated_beside_a_signal(n: int, sigma: float) -> None:
    """Of a line, and of an oscillation of 12 samples a period with its second harmonic."""
    rng = np.random.default_rng(3)
    x = np.linspace(-8.0, 8.0, n)
    peak = 1.0 / np.sqrt(1.0 + x**2)
    wave = np.sin(2.0 * np.pi * np.arange(n) / 12.0) + 0.2 * np.sin(np.pi * np.arange(n) / 3.0)
    for signal in (peak, wave, wave + 1j * peak):
        parts = [rng.standard_normal(n), rng.standard_normal(n) * np.iscomplexobj(signal)]
        y = signal + sigma * (parts[0] + 1j * parts[1] if np.iscomplexobj(signal) else parts[0])
        assert white_noise(y) == pytest.approx(sigma, rel=0.5)


def line(u: FloatArray) -> FloatArray:
    return np.asarray(1.0 / np.abs(F0_HZ**2 - u**2 + 1j * u * WIDTH_HZ) / (2.0 * np.pi) ** 2)


def tones(relative: float) -> ff.Tones:
    u = np.array([[990.0, 1002.0], [998.0, 1010.0], [999.0, 1004.0]])
    return ff.Tones(SETUP, u, line(u), sigmas_v=relative * line(u), amplitude_unit="m")


def sweep(sigma: float) -> ff.Sweep:
    u = np.linspace(970.0, 1030.0, 121)
    a = line(u) / np.max(line(u))
    y = a + sigma * np.random.default_rng(1).standard_normal(u.size)
    return ff.Sweep(SETUP, u, np.abs(y), scale="fit")


def test_the_plan_of_a_fit_aims_at_the_noise_and_prints_why(fmu: ff.Fmu) -> None:
    planned = ff.Problem(fmu, PARAMETERS, tones(0.02)).planned
    [plan] = planned.plans.values()
    assert plan.budget is not None
    assert plan.budget.wanted == pytest.approx(2e-3)
    [why] = plan.budget.of(Kind.ACCURACY)
    assert why.basis is Basis.NOISE
    assert why.numbers["noise"] == pytest.approx(0.02)
    assert any("2.0e-03" in sentence and "2.0e-02" in sentence for sentence in plan.sentences)


def test_that_of_a_sweep_is_estimated_from_its_scatter(fmu: ff.Fmu) -> None:
    [plan] = ff.Problem(fmu, PARAMETERS, sweep(0.004)).planned.plans.values()
    assert plan.budget is not None
    assert plan.budget.wanted == pytest.approx(4e-4, rel=0.4)


def test_a_number_overrides_it(fmu: ff.Fmu) -> None:
    [plan] = ff.Problem(fmu, PARAMETERS, tones(0.02), accuracy=1e-5).planned.plans.values()
    assert plan.budget is not None
    assert plan.budget.wanted == 1e-5
    assert plan.budget.of(Kind.ACCURACY) == ()
