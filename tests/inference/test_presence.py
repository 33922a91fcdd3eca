"""Curves out of whose noise no line stands: nothing is said of a sample that was not seen."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import default_rng
from scipy.stats import chi2, f

import fitting as ff
from fitting.fit import search
from fitting.signal.misfit import SURELY, chance
from tests.bench.bench_crossing import METHOD
from tests.support.virtual.crossing import CrossingLaboratory, laboratory

pytestmark = pytest.mark.usefixtures("swift_models")


@pytest.fixture(scope="module")
def fmu() -> ff.Fmu:
    return ff.Fmu("CoupledModes2", workers=1)


def told(lab: CrossingLaboratory, fmu: ff.Fmu, budget: int | None = None) -> ff.Inference:
    """What the data say of a small map, by the closed form, from its own start."""
    fit = ff.fit(lab.by_closed_form(fmu), METHOD, starts=1)
    return ff.profile(fit, list(lab.couplings), budget=budget)


@pytest.mark.parametrize("seed", [2, pytest.param(1, marks=pytest.mark.nightly)])
def test_of_noise_nothing_is_said(fmu: ff.Fmu, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three times the largest amplitude: profiles had cut an interval of a per cent, elsewhere."""
    monkeypatch.setattr(search, "ROUNDS", 2)  # no line is there, however long it takes
    found = told(laboratory(seed, noise=3.0, spectra=5, points=41), fmu, budget=20_000)
    assert str(found["lambda12"].status) == "no verdict"
    assert found.inferred.status.value != "converged"
    knowledge = found.inferred.knowledge
    assert knowledge is not None
    assert knowledge.adequacy.no_line
    assert found.inferred.ending.kind == "no_line"


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.nightly) for k in (1, 2))])
def test_lines_in_noise_that_is_most_of_the_variance_are_described(fmu: ff.Fmu, seed: int) -> None:
    """A fifth of the largest amplitude hides no line; it is half of what the map varies by."""
    found = told(laboratory(seed, noise=0.2, spectra=7, points=61), fmu)
    assert found.inferred.ending.kind == "described"
    assert found.inferred.status.value == "converged"


@pytest.mark.parametrize("probability", [1e-3, 1e-12])
def test_chances_are_those_of_chi_square_and_f(probability: float) -> None:
    rows, unknowns = 200, 12
    left = default_rng(1).standard_normal(rows)
    square = float(left @ left)
    known = chi2.isf(probability, unknowns)
    flat = left * np.sqrt(1.0 + known / square)
    assert chance(flat, left, np.ones(rows), unknowns) == pytest.approx(probability, rel=1e-6)
    ratio = f.isf(probability, unknowns, rows - unknowns) * unknowns / (rows - unknowns)
    flat = left * np.sqrt(1.0 + ratio)
    assert chance(flat, left, np.zeros(rows), unknowns) == pytest.approx(probability, rel=1e-6)


def test_as_many_unknowns_as_rows_tell_nothing() -> None:
    assert chance(np.ones(5), np.ones(5), np.zeros(5), 5) == 0.0 <= SURELY


@pytest.mark.parametrize(
    ("noise", "said"),
    [(1e-5, True), (5e-4, True), pytest.param(5e-3, False, marks=pytest.mark.nightly)],
)
def test_a_weak_line_is_described_and_noise_is_not(noise: float, said: bool) -> None:
    """A line of 1 mV in both quadratures whose noise nobody stated, half of it and five times."""
    rng = default_rng(7)
    u = np.linspace(6.9995e6, 7.0005e6, 301)
    line = 0.5e-3 * 1j * 60.0 / (7e6 - u + 30.0j)
    seen = line + noise * (rng.standard_normal(u.size) + 1j * rng.standard_normal(u.size))
    setup = ff.Setup(
        ff.Drive(frequency_names=("u1",), amplitude_names=("A1",)),
        "q1_hybrid",
        start_values={"periodic_start": True, "A2": 0.0},
        steady_start=True,
    )
    unknowns = [
        ff.Parameter("eta_plus", 7e6, bounds=(6.9996e6, 7.0004e6), unit="Hz"),
        ff.Parameter("d2", 60.0, bounds=(3.0, 1200.0), unit="Hz"),
    ]
    problem = ff.Problem(
        ff.Fmu("CoupledOscillator", workers=1),
        unknowns,
        ff.ComplexSweep(setup, ff.ComplexCurve(u, seen)),
    )
    fit = ff.fit(problem, ff.Tikhonov(nu=1e-3, levels=1, misfit="squares"), starts=1)
    found = ff.profile(fit, ["eta_plus"])
    assert (found.inferred.status.value == "converged") is said
    assert (str(found["eta_plus"].status) == "determined") is said
