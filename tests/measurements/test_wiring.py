"""Notches, reflections and measured circuits: values and errors against the closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

import fitting as ff
from fitting.campaign import Setup
from fitting.report.screen import phrases
from fitting.text.arrays import ComplexArray, FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import number
from tests.bench.bench_wiring import deviations, laboratory
from tests.support.complex_data import notch, with_noise

RLC = Path(__file__).parents[2] / "data" / "coupled_rlc"
ETA, Q, TAU = 5e6, 6250.0, 41e-6
COUPLING = 9e3 * np.exp(-0.4j)
SEEN = ETA + np.linspace(-4000.0, 4000.0, 81)
START: dict[str, Scalar] = {
    "periodic_start": True,
    "theta": 0.0,
    "g2": 0.0,
    "d2": 100.0,
    "eta_minus": 6e6,
    "u2": 5.5e6,
}
DRIVE = ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2"))
SETUP = Setup(DRIVE, "q1_hybrid", start_values=START, steady_start=True)
PARAMETERS = (
    ff.Parameter("eta_plus", ETA + 100.0, bounds=(ETA - 2000.0, ETA + 2000.0), scale=100.0),
    ff.Parameter("d1", 600.0, bounds=(50.0, 5000.0), scale=100.0),
)
METHOD = ff.Tikhonov(nu=1e-6, beta=0.01, levels=3, misfit="squares")


def seen(q: FloatArray, twice: float) -> ComplexArray:
    """Gain (2), eigenfrequency off ETA, 1/Q, complex 1/Qc, delay: what an analyser sees.

    The dip of a reflection is twice that of a notch.
    """
    coupling = twice * (q[4] + 1j * q[5])
    dip = notch(SEEN, ETA + q[2], 1e4 / q[3], 1e4 / coupling)
    turn = np.exp(-2j * np.pi * (SEEN - ETA) * q[6] * 1e-6)
    return np.asarray(complex(q[0], q[1]) * turn * dip)


@pytest.mark.parametrize(
    ("kind", "twice"), [("notch", 1.0), pytest.param("reflection", 2.0, marks=pytest.mark.nightly)]
)
def test_qualities_and_their_errors_are_those_of_least_squares_in_all_unknowns(
    kind: str, twice: float, swift: ff.Fmu
) -> None:
    """1/Qc = Re(1/(|Qc| exp(-i phi))): the diameter correction of Probst et al. (2015)."""
    inverse = 1e4 / COUPLING
    true = np.array([0.1, 0.28, 0.0, 1e4 / Q, inverse.real, inverse.imag, 1e6 * TAU])
    y = with_noise(seen(true, twice), 1e-3, seed=8)
    fit = least_squares(
        lambda q: np.concatenate([(seen(q, twice) - y).real, (seen(q, twice) - y).imag]),
        true,
        x_scale=[1.0, 1.0, 10.0, 1.0, 1.0, 1.0, 1.0],
        xtol=1e-15,
        ftol=1e-15,
    )
    variance = float(fit.fun @ fit.fun) / (fit.fun.size - true.size)
    errors = np.sqrt(variance * np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))

    curve = ff.ComplexCurve(SEEN, y, delay_s=None, wiring=ff.Wiring(kind=kind))
    problem = ff.Problem(swift, PARAMETERS, ff.ComplexSweep(SETUP, curve))
    found = ff.fit(problem, method=METHOD, starts=1)
    assert problem.names == ("eta_plus", "d1", "delay")
    assert found.x[0] - ETA == pytest.approx(fit.x[2], abs=0.02 * errors[2])
    assert 1e6 * found.x[2] == pytest.approx(fit.x[6], abs=0.02 * errors[6])
    told = {q.name: q for q in found.inferred.quadratures.qualities}
    loaded, coupled = fit.x[3], fit.x[4]
    assert told["Q_coupling"].value == pytest.approx(1e4 / coupled, rel=0.02 * errors[4] / coupled)
    assert told["Q_internal"].value == pytest.approx(1e4 / (loaded - coupled), rel=1e-4)
    widening = found.record.solution.errors.inflation
    relative = told["Q_coupling"].std / told["Q_coupling"].value
    assert relative == pytest.approx(widening * errors[4] / coupled, rel=0.03)
    low, high = told["Q_coupling"].ci95
    assert np.log(high / low) == pytest.approx(2 * 1.96 * relative, rel=1e-3)
    assert low < 1e4 / inverse.real < high


def test_an_internal_quality_that_noise_hides_has_an_interval_open_above(
    swift: ff.Fmu,
) -> None:
    """Losses add up: 1/Qi is 1 % of 1/Q, its interval reaches zero, and holds the truth."""
    coupled = 1e4 / Q * 0.99
    true = np.array([0.1, 0.28, 0.0, 1e4 / Q, coupled, 0.3 * coupled, 0.0])
    y = with_noise(seen(true, 1.0), 0.02, seed=4)
    fit = least_squares(
        lambda q: np.concatenate([(seen(q, 1.0) - y).real, (seen(q, 1.0) - y).imag]),
        true,
        x_scale=[1.0, 1.0, 10.0, 1.0, 1.0, 1.0, 1.0],
    )
    freedom = fit.fun.size - true.size
    spread = float(fit.fun @ fit.fun) / freedom * np.linalg.inv(fit.jac.T @ fit.jac)
    loss = 1e-4 * (fit.x[3] - fit.x[4])
    error = 1e-4 * np.sqrt(spread[3, 3] + spread[4, 4] - 2 * spread[3, 4])
    assert loss < 1.9 * error  # so that noise hides it
    curve = ff.ComplexCurve(SEEN, y, delay_s=None, wiring=ff.Wiring(kind="notch"))
    problem = ff.Problem(swift, PARAMETERS, ff.ComplexSweep(SETUP, curve))
    found = ff.fit(problem, method=METHOD, starts=1)
    told = found.inferred.quadratures
    [internal] = [q for q in told.qualities if q.name == "Q_internal"]
    widening = found.record.solution.errors.inflation
    low, high = internal.ci95
    assert 1.0 / low == pytest.approx(loss + 1.96 * widening * error, rel=0.02)
    assert np.isinf(high)
    assert low < 100.0 * Q
    [said] = [s for s in phrases("result", "quadratures", told) if s.startswith("Q_internal")]
    assert f" {number(low, 3)} or more" in said


def test_a_word_that_is_no_wiring_is_refused() -> None:
    with pytest.raises(BadInput, match=r"kind is 'notches'.* 'transmission'"):
        ff.Wiring(kind="notches")


def test_phases_halve_the_error_of_a_measured_coupling(swift: ff.Fmu) -> None:
    """The components of the circuit tell the coupling: 1/(2 pi sqrt(L C3)) = 711.8 Hz."""
    rows = np.genfromtxt(RLC / "c1_response.csv", delimiter=",", skip_header=1)
    u, drive, amplitude, phase = rows.T
    setup = Setup(
        DRIVE,
        "q1",
        start_values={"periodic_start": True, "theta": 0.75 * np.pi, "g1": 1.0, "g2": -1.0},
        steady_start=True,
    )
    parameters = [
        ff.Parameter("eta_plus", 480.0, bounds=(300.0, 700.0), scale=20.0),
        ff.Parameter("eta_minus", 1080.0, bounds=(900.0, 1400.0), scale=20.0),
        ff.Parameter("d1", 200.0, bounds=(50.0, 1000.0), scale=20.0),
        ff.Parameter("d2", 200.0, bounds=(50.0, 1000.0), scale=20.0),
    ]
    y = amplitude / drive * np.exp(1j * phase)
    coupling = 1.0 / (2.0 * np.pi * np.sqrt(50e-9))
    errors = []
    for measured in (
        ff.Sweep(setup, u, np.abs(y)),
        ff.ComplexSweep(setup, ff.ComplexCurve(u, y, unit="1")),
    ):
        problem = ff.Problem(swift, parameters, measured, derived="lambda")
        found = ff.fit(problem, method=METHOD, starts=1)["lambda"]
        low, high = found.interval()
        assert low < coupling < high
        errors.append(high - low)
    assert errors[0] > 2.0 * errors[1]


def test_seeded_laboratories_are_within_their_errors(swift: ff.Fmu) -> None:
    """A few of those by which `tests.bench.bench_wiring` counts coverage: with a slope, too."""
    apart = [
        deviations(laboratory(kind, seed), swift)
        for kind, seed in (("notch", 1), ("reflection", 2))
    ]
    assert np.max(np.abs(apart)) < 3.5
