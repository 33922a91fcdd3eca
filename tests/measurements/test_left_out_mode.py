"""A reduction that leaves out a mode is no reason to refuse data: of noise, and of a decay."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.fit.likelihood import LikelihoodEvaluator, Request, likelihood_of
from fitting.fit.noise import RowNoise
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.noise import NoiseSpectrum
from fitting.measurements.plan import Plan
from fitting.simulate.budget import Basis, Budget, Decision, Kind
from fitting.simulate.probe import Probe
from fitting.text.errors import NoScale
from tests.bench.bench_noise import PARAMETERS, QUICK, SETUP
from tests.support import reference
from tests.support.scenes import STRING
from tests.support.whitened import WhitenedResponse, parameter, whitened

#: What the FMU declares that it may leave out, and its periodic start.
REDUCTIONS = ("periodic start", "far mode left out", "far mode quasi-static", "rotating frame")
KT = 1.380649e-23 * 300.0
F, WIDTH = 100.0, 8.0
U = np.arange(70.0, 130.25, 1.0)


@pytest.fixture(scope="module")
def fmu(swift_fmu: Path) -> Iterator[ff.Fmu]:
    with ff.Fmu(swift_fmu, workers=1) as opened:
        yield opened


def thermal(seed: int = 3) -> ff.NoiseSpectrum:
    """The noise of one mode of 1 ng at 300 K, seen in volts, 100 averages."""
    w = 2.0 * np.pi * U
    response = 1.0 / ((2.0 * np.pi) ** 2 * (F**2 - U**2) + 1j * 2.0 * np.pi * w * WIDTH)
    density = -4.0 * KT * response.imag / w / 1e-12 * 6e4**2
    density = (density + 0.01 * np.max(density)) * np.random.default_rng(seed).gamma(
        100.0, 0.01, U.size
    )
    return ff.NoiseSpectrum(
        U,
        density,
        averages=100,
        force="thermal",
        temperature_k=300.0,
        mass_kg=1e-12,
        unit="V",
        setup=SETUP,
    )


def test_a_thermal_spectrum_is_fitted_whatever_a_search_tries(fmu: ff.Fmu) -> None:
    """Far beyond its bounds eta_plus is farther from the tones than eta_minus."""
    found = ff.profile(ff.fit(ff.Problem(fmu, PARAMETERS, thermal()), method=QUICK, starts=1))
    for name, truth in {"eta_plus": F, "d1": WIDTH}.items():
        value = found[name]
        assert abs(value.value - truth) < 4.0 * value.std
        assert value.std < 0.2 * truth


def test_a_reduction_that_would_leave_out_what_is_observed_is_not_taken(
    fmu: ff.Fmu, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever it saves.

    With eta_plus up to 210 Hz, eta_minus at 200 Hz, either mode may be next to the tones.
    Quasi-static the mode is exact as long as nothing couples it: that may be taken.
    """
    monkeypatch.setattr(Probe, "cost_ratio", lambda *_: 0.1)
    monkeypatch.setattr(importlib.import_module("fitting.measurements.planning"), "CHEAPER", 100.0)
    plans = [
        next(iter(ff.Problem(fmu, (first, PARAMETERS[1]), thermal()).planned.plans.values()))
        for first in (
            PARAMETERS[0],
            ff.Parameter("eta_plus", 101.0, bounds=(90.0, 210.0), unit="Hz"),
        )
    ]
    narrow, wide = (plan.settings.get("other_mode") for plan in plans)
    assert narrow == 2
    assert wide != 2


def test_no_reduction_is_taken_that_makes_an_evaluation_dearer(fmu: ff.Fmu) -> None:
    """A sweep over both modes: without one of them its response is no rational function.

    A single run gets cheaper, and 121 of them take the place of nine.
    """
    scene = STRING.__class__(
        "two modes", theta=0.3, d1=4.0, d2=5.0, eta_plus=100.0, eta_minus=140.0
    )
    u = np.linspace(80.0, 170.0, 121)
    amplitude = np.array([float(abs(reference.phasors(scene, f)[0])) for f in u])
    parameters = (
        ff.Parameter("eta_plus", 100.5, bounds=(95.0, 105.0), unit="Hz"),
        ff.Parameter("d1", 4.5, bounds=(1.0, 20.0), unit="Hz"),
    )
    runs = []
    for forbid in (("periodic start",), REDUCTIONS):
        setup = ff.Setup(
            ff.Drive(frequency_names=("u1",), amplitude_names=("A1",)),
            "q1_hybrid",
            start_values={"theta": 0.3, "A2": 0.0, "d2": 5.0, "eta_minus": 140.0},
            line_width_hz=4.0,
            accuracy=1e-2,
            annotation=AccuracyAnnotation(forbid=forbid),
        )
        sweep = ff.Sweep(setup, u, amplitude / np.max(amplitude), scale="fit")
        problem = ff.Problem(fmu, parameters, [sweep])
        problem.residuals(problem.start)
        before = fmu.workers.counts.runs
        problem.residuals(problem.start)
        runs.append(fmu.workers.counts.runs - before)
        [plan] = problem.planned.plans.values()
        assert "other_mode" not in plan.settings
    assert runs[0] == runs[1] < 20


@pytest.mark.parametrize("response", [0.0, 1j])
def test_a_response_that_does_not_lag_has_no_scale(response: complex) -> None:
    record = NoiseSpectrum(U, np.ones(U.size), force="thermal", unit="V", averages=10)
    with pytest.raises(NoScale):
        record.shape(np.full(U.size, response))


def test_a_model_without_a_scale_fits_infinitely_badly() -> None:
    """At more points of the box than may fail."""

    def rows(p: np.ndarray) -> np.ndarray:
        if p[0] > 5.0:
            raise NoScale("the model answers with nothing")
        return np.array([p[0] - 3.0])

    plain = whitened(lambda p: np.array([p[0] - 3.0]), parameter("p", 0.0, 10.0))
    objective = replace(plain, response=WhitenedResponse(rows))
    evaluator = LikelihoodEvaluator(
        likelihood_of(objective, RowNoise(np.array([0.01]), np.empty((1, 0))))
    )
    places = tuple(np.array([x]) for x in np.linspace(-4.9, 4.9, 40))
    [samples] = evaluator([Request(places, outputs=False)])
    finite = [bool(np.all(np.isfinite(sample.rows))) for sample in samples]
    assert any(finite)
    assert finite.count(False) > 12


def test_records_over_time_are_simulated_with_the_whole_model() -> None:
    """What a reduction costs is known under the tones that it was measured with."""
    decision = Decision(
        kind=Kind.MODEL,
        basis=Basis.STATED,
        bound=0.0,
        subject="far mode left out",
        settings={"other_mode": 2},
    )
    plan = Plan(
        0.0, budget=Budget(1e-6, (decision,)), settings={"other_mode": 2, "rk4_substep": 1e-9}
    )
    model = DrivenModel(setup=SETUP, parameters=(), plan=plan)
    assert model.values(np.empty(0), None, {})["other_mode"] == 2
    whole = model.whole.values(np.empty(0), None, {})
    assert "other_mode" not in whole
    assert whole["rk4_substep"] == 1e-9
