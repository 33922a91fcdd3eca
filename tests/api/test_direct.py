"""Fits of an FMU to arrays in one call, against scipy's own solution and least squares."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import StateSpace, lsim

import fitting as ff
from tests.support.cfmu_build import build_c_fmu

MASS = 1e-3
DAMPING, STIFFNESS = 0.2, 4100.0
BOXES = {"damping": (0.15, 0.02, 2.0), "stiffness": (4000.0, 3000.0, 5000.0)}


@pytest.fixture(scope="module")
def oscillator(tmp_path_factory: pytest.TempPathFactory) -> ff.Fmu:
    return ff.Fmu(build_c_fmu(tmp_path_factory.mktemp("direct")), workers=1)


def displacement(t: np.ndarray, force: np.ndarray, c: float, k: float) -> np.ndarray:
    """x of m x'' + c x' + k x = F from rest, F joined by straight lines: scipy's lsim."""
    a = [[0.0, 1.0], [-k / MASS, -c / MASS]]
    system = StateSpace(a, [[0.0], [1.0 / MASS]], [[1.0, 0.0]], [[0.0]])
    return np.asarray(lsim(system, force, t)[1])


def record() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(3)
    t = np.arange(400) * 2e-4
    force = np.sin(2 * np.pi * 300.0 * t) + 0.3 * random.standard_normal(t.size)
    x = displacement(t, force, DAMPING, STIFFNESS)
    return t, force, x + 0.01 * np.max(np.abs(x)) * random.standard_normal(t.size)


def test_a_trace_is_fitted_as_scipy_fits_its_own_solution(oscillator: ff.Fmu) -> None:
    t, force, x = record()
    found = ff.fit_trace(oscillator, t, {"force": force}, {"displacement": x}, BOXES)
    referee = least_squares(
        lambda p: (displacement(t, force, *p) - x) / np.max(np.abs(x)),
        [0.15, 4000.0],
        x_scale=[0.1, 100.0],
    )
    scatter = np.sqrt(2.0 * referee.cost / (t.size - 2))
    stds = scatter * np.sqrt(np.diag(np.linalg.inv(referee.jac.T @ referee.jac)))
    assert found.status == "converged"
    for name, value, std in zip(BOXES, referee.x, stds, strict=True):
        assert found[name].value == pytest.approx(value, abs=0.05 * std)
        assert found[name].std == pytest.approx(std, rel=0.05)


@pytest.mark.parametrize("is_complex", [False, True], ids=["amplitudes", "complex"])
def test_a_sweep_is_fitted_with_a_gain_that_nobody_knows(
    is_complex: bool,
    oscillator: ff.Fmu,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("fitting.api.progress.FIRST_S", 0.01)
    random = np.random.default_rng(5)
    f = np.linspace(290.0, 355.0, 41)
    w = 2.0 * np.pi * f
    y = 0.37 / (STIFFNESS - MASS * w**2 + 1j * DAMPING * w)
    noise = random.standard_normal(f.size) + 1j * random.standard_normal(f.size)
    y = y + 0.003 * np.max(np.abs(y)) * noise
    seen = y if is_complex else np.abs(y)
    before = oscillator.workers.counts
    found = ff.fit_sweep(oscillator, f, seen, BOXES, output_name="displacement", starts=1)
    assert found.status == "converged"
    for name, truth in (("damping", DAMPING), ("stiffness", STIFFNESS)):
        assert abs(found[name].value - truth) < 4.0 * found[name].std < 0.2 * truth
    # what is under way is shown, and no more steps are taken than the accuracy needs
    shown = capsys.readouterr().err.splitlines()
    assert shown
    assert all(re.match(r"fit_sweep: .+, \d+ runs, \d+ s$", line) for line in shown)
    after = oscillator.workers.counts
    assert after.steps - before.steps < 15_000 * (after.runs - before.runs)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({"outputs": {}}, "no outputs"),
        ({"outputs": {"height": np.zeros(400)}}, "height"),
        ({"inputs": {"push": np.zeros(400)}}, "push"),
        ({"inputs": {"force": np.zeros(3)}}, "force"),
        ({"parameters": {"damping": (0.1, 0.2)}}, "start, lower, upper"),
        ({"parameters": {"lightness": (0.1, 0.0, 0.2)}}, "lightness"),
    ],
)
def test_what_does_not_fit_the_fmu_is_named(
    arguments: dict[str, object], told: str, oscillator: ff.Fmu
) -> None:
    t, force, x = record()
    given: dict[str, object] = {"inputs": {"force": force}, "outputs": {"displacement": x}}
    given |= {"parameters": BOXES} | arguments
    with pytest.raises(ff.BadInput, match=told):
        ff.fit_trace(oscillator, t, **given)  # type: ignore[arg-type]


def test_one_of_several_outputs_has_to_be_named(oscillator_fmu: Path) -> None:
    f, a = np.linspace(6.9e6, 6.91e6, 20), np.ones(20)
    with pytest.raises(ff.BadInput, match="output_name is empty"):
        ff.fit_sweep(oscillator_fmu, f, a, {"d1": (100.0, 1.0, 1000.0)})
