"""Recorded inputs that are joined by straight lines, against scipy's exact response to them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.signal import lsim

import fitting as ff
from fitting.simulate.budget import Decision, Kind
from fitting.text.arrays import FloatArray
from tests.support.cfmu_build import build_c_fmu
from tests.support.linear_traces import oscillator

MASS, C, K = 1e-3, 5e-2, 4e3
ACCURACY = 1e-6
BEAM = ff.Setup(ff.Drive(), "displacement", accuracy=ACCURACY)
QUICK = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
PARAMETERS = (
    ff.Parameter("damping", C, bounds=(0.01, 0.2)),
    ff.Parameter("stiffness", K, bounds=(3.5e3, 4.5e3)),
)
#: Ten samples in a period of the beam, 318 Hz, whose force was recorded.
T = np.linspace(0.0, 149 * 3.1e-4, 150)
U = 1e-3 * np.sin(2.0 * np.pi * (200.0 + 1000.0 * T) * T)


@pytest.fixture(scope="module")
def beam(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ff.Fmu]:
    with ff.Fmu(build_c_fmu(tmp_path_factory.mktemp("beam")), workers=1) as fmu:
        yield fmu


def exact(t: FloatArray, u: FloatArray) -> FloatArray:
    """Response to (t, u) joined linearly, from rest."""
    a, b, c = oscillator(MASS, C, K)
    return np.asarray(lsim((a, b[:, None], c[None, :], np.zeros((1, 1))), u, t)[1])


def planned(beam: ff.Fmu, values: FloatArray, **more: object) -> tuple[Decision, FloatArray]:
    """What the plan decided on the step, and what the fit leaves of the values, relative."""
    arguments: dict[str, object] = {"driven": (T, U), **more}
    trace = ff.Trace(T, values, setup=BEAM, input="force", unit="m", **arguments)  # type: ignore[arg-type]
    fit = ff.fit(ff.Problem(beam, PARAMETERS, trace), method=QUICK, starts=1)
    assert fit.result.plan is not None
    [step] = [d for d in fit.result.plan.decisions if d.kind == Kind.STEP]
    assert fit["damping"].value == pytest.approx(C, rel=10.0 * ACCURACY)
    assert fit["stiffness"].value == pytest.approx(K, rel=ACCURACY)
    return step, fit.inferred.fit.solution.final.residuals


def test_two_runs_keep_the_promise_in_few_steps(beam: ff.Fmu) -> None:
    """One run wants 256 steps between two samples: what held means leave falls by four."""
    step, left = planned(beam, exact(T, U))
    assert "extrapolated" in step.numbers
    assert int(step.numbers["per_sample"]) <= 16
    assert float(np.max(np.abs(left))) <= step.bound <= ACCURACY


@pytest.mark.parametrize("seed", [1, pytest.param(0, marks=pytest.mark.nightly)])
def test_corners_between_the_samples_keep_it_as_well(beam: ff.Fmu, seed: int) -> None:
    """An input on a clock of its own has its corners anywhere in a step."""
    rng = np.random.default_rng(seed)
    corners = np.cumsum(rng.integers(3, 40, 80)) * 1e-5
    u = 1e-3 * rng.standard_normal(corners.size)
    every = np.linspace(0.0, (150 * 31 - 1) * 1e-5, 150 * 31)
    y = exact(every, np.interp(every, corners, u))[::31]
    step, left = planned(beam, y, driven=(corners, u))
    assert float(np.max(np.abs(left))) <= step.bound <= ACCURACY
