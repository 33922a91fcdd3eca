"""Traces through Reference FMUs, whose steps of Euler's method are their own, against the truth."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import fitting as ff
from fitting.measurements.steps import euler_leaves
from fitting.simulate.budget import Decision, Kind
from fitting.simulate.words import decision_in_words
from fitting.text.arrays import FloatArray
from tests.support.cfmu_build import build_reference_fmu

QUICK = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")


@pytest.fixture(scope="module")
def dahlquist(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ff.Fmu]:
    path = build_reference_fmu(tmp_path_factory.mktemp("d"), "Dahlquist")
    with ff.Fmu(path, workers=1, interface="co-simulation") as fmu:
        yield fmu


@pytest.fixture(scope="module")
def van_der_pol(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ff.Fmu]:
    path = build_reference_fmu(tmp_path_factory.mktemp("v"), "VanDerPol")
    with ff.Fmu(path, workers=1, interface="co-simulation") as fmu:
        yield fmu


def decided(fit: ff.Fit) -> Decision:
    assert fit.result.plan is not None
    [decision] = [d for d in fit.result.plan.decisions if d.kind == Kind.STEP]
    return decision


def decay(
    fmu: ff.Fmu, begun: float, k: float, spacing_s: float, seed: int
) -> tuple[ff.Fit, Decision]:
    """The fit of x' = -k x from 2, in closed form and 0.1 % of noise; and the decision on steps."""
    t = spacing_s * np.arange(round(5.0 / spacing_s) + 1)
    y = 2.0 * np.exp(-k * t) + 0.002 * np.random.default_rng(seed).standard_normal(t.size)
    trace = ff.Trace(t, y, setup=ff.Setup(ff.Drive(), "x"), unit="")
    parameters = [
        ff.Parameter("k", begun, bounds=(0.05, 9.0)),
        ff.Parameter("x", 1.0, bounds=(0.1, 10.0)),
    ]
    fit = ff.fit(ff.Problem(fmu, parameters, trace), method=QUICK, starts=1)
    return fit, decided(fit)


@pytest.mark.parametrize(
    ("begun", "k", "spacing_s"),
    [
        pytest.param(1.0, 1.3, 0.1, id="a step in a sample"),
        pytest.param(1.0, 1.3, 0.5, id="five steps in a sample"),
        pytest.param(1.0, 1.3, 0.02, id="five samples in a step"),
        pytest.param(0.2, 4.0, 0.1, id="much faster than where the fit begins"),
        pytest.param(8.0, 0.3, 0.1, id="much slower than where the fit begins"),
    ],
)
def test_a_decay_from_rest_holds_the_truth(
    dahlquist: ff.Fmu, begun: float, k: float, spacing_s: float
) -> None:
    """Steps of 0.1 s put k off by k^2 h/2, a hundred errors of the noise: one seed shows it."""
    fit, decision = decay(dahlquist, begun, k, spacing_s, 1)
    assert decision.numbers["stands_s"] == pytest.approx(0.1, rel=0.02)
    assert "its own" in decision_in_words(decision)
    steps = np.arange(50)
    off = np.max(np.abs((1.0 - 0.1 * k) ** steps - np.exp(-0.1 * k * steps)))
    assert off < decision.bound < 12.0 * off + 0.1 * k
    for name, true in (("k", k), ("x", 2.0)):
        low, high = fit[name].interval()
        assert low <= true <= high, name


def relaxation(mu: float, t: FloatArray) -> FloatArray:
    """x0 of x0'' = mu (1 - x0^2) x0' - x0 from 2 at rest."""
    result: FloatArray = solve_ivp(
        lambda _, x: (x[1], mu * (1.0 - x[0] ** 2) * x[1] - x[0]),
        (0.0, t[-1]),
        (2.0, 0.0),
        t_eval=t,
        rtol=1e-10,
        atol=1e-12,
    ).y[0]
    return result


def test_model_exchange_has_no_steps_that_shift_an_oscillation(van_der_pol: ff.Fmu) -> None:
    """Taken where nobody chose the interface: errors are those of the noise."""
    mu, sigma, t = 1.2, 0.02, np.linspace(0.0, 20.0, 401)
    y = relaxation(mu, t) + sigma * np.random.default_rng(2).standard_normal(t.size)
    trace = ff.Trace(t, y, setup=ff.Setup(ff.Drive(), "x0"), sigma=sigma)
    parameter = ff.Parameter("mu", 1.0, bounds=(0.1, 5.0))
    with ff.Fmu(van_der_pol.description.path, workers=1) as fmu:
        found = ff.fit(ff.Problem(fmu, parameter, trace), method=QUICK, starts=1)["mu"]
    slopes = (relaxation(mu + 1e-4, t) - relaxation(mu - 1e-4, t)) / 2e-4
    assert abs(found.value - mu) < 3.0 * found.std
    assert found.std == pytest.approx(sigma / np.linalg.norm(slopes), rel=0.2)


@pytest.mark.parametrize(
    ("mu", "length_s"),
    [(0.5, 20.0), (1.2, 20.0), pytest.param(1.2, 60.0, marks=pytest.mark.nightly)],
)
def test_an_oscillation_that_is_shifted_holds_the_truth(
    van_der_pol: ff.Fmu, mu: float, length_s: float
) -> None:
    """Euler's method over 0.01 s makes the period of van der Pol's oscillator too long."""
    t = np.linspace(0.0, length_s, round(length_s / 0.05) + 1)
    y = relaxation(mu, t) + 0.02 * np.random.default_rng(2).standard_normal(t.size)
    trace = ff.Trace(t, y, setup=ff.Setup(ff.Drive(), "x0"), unit="")
    parameter = ff.Parameter("mu", 1.0, bounds=(0.1, 5.0))
    fit = ff.fit(ff.Problem(van_der_pol, parameter, trace), method=QUICK, starts=1)
    decision = decided(fit)
    low, high = fit["mu"].interval()
    assert low <= mu <= high
    assert "oscillation" in decision_in_words(decision)


def left_of(step: complex, count: int) -> tuple[float, bool, float]:
    """What is told of Re z^k, z = 1 + s h by Euler's method, and what it is off e^(s h k) by."""
    k = np.arange(count)
    found, true = (1.0 + step) ** k, np.exp(step * k)
    told, shifted = euler_leaves(
        np.array(found.real, dtype=float), np.zeros(count - 1, dtype=bool), late=False
    )
    return told, shifted, float(np.max(np.abs(found - true).real) / np.max(np.abs(found.real)))


@pytest.mark.parametrize("step", [0.01j, 0.01j - 5e-4, 0.02j - 5e-3, 0.01j - 0.01])
def test_what_is_told_of_an_oscillation_is_more_than_is_left(step: complex) -> None:
    told, shifted, off = left_of(step, 2000)
    assert off < told < 8.0 * off
    assert shifted


def test_what_only_decays_is_not_shifted() -> None:
    """Also where it has come to its end, and rounding turns it."""
    told, shifted, off = left_of(-0.05 + 0.0j, 4000)
    assert off < told < 4.0 * off
    assert not shifted
