"""Pumped sweeps of the laboratory: against rotating waves, through files, and through the FMU."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.lab.instruments import LockIns
from fitting.lab.pumped import PumpedBench, measure_pumped
from fitting.lab.synthesis import synthesize
from fitting.measurements.control_sweep import ReadSpectra
from fitting.simulate.budget import Kind
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

pytestmark = pytest.mark.usefixtures("swift_models")

BENCH = PumpedBench()
TONES = Path(__file__).parents[2] / "data" / "string_q1" / "campaign.toml"


def rotating_waves(bench: PumpedBench, depth: float, detuning: float) -> FloatArray:
    """The observed line at a weak pump: two amplitudes, each in its own rotating frame.

    (2 pi)^2 2 eta_k (eta_k - v_k + i w_k/2) a_k + (2 pi)^2 p/2 a_j = g_k, v_1 = u, v_2 = u + u_p,
    driven at u alone; p = f1^2 depth cos(theta) sin(theta) is what the pump on f1 has off the
    diagonal in hybrid coordinates. Parametric normal-mode splitting: arXiv:2412.16767.
    """
    string = bench.string
    (w1, w2), u = string.widths_hz(), bench.places()[0][1]
    c, s = np.cos(string.theta_rad), np.sin(string.theta_rad)
    eta1, eta2 = string.eta_plus_hz, string.eta_minus_hz
    p = depth * c * s * ((c * eta1) ** 2 + (s * eta2) ** 2)
    first = 2.0 * eta1 * (eta1 - u + 0.5j * w1)
    second = 2.0 * eta2 * (eta2 - u - (bench.apart_hz + detuning) + 0.5j * w2)
    return np.asarray(np.abs(second / (first * second - 0.25 * p**2)) / (2.0 * np.pi) ** 2)


@pytest.mark.parametrize("detuning", [-250.0, 0.0, 80.0])
@pytest.mark.parametrize("depth", [0.0, 3e-5, 3e-4])
def test_the_line_is_split_as_rotating_waves_say(depth: float, detuning: float) -> None:
    """What they leave out: p/eta of the line, and the other sideband's shift, some Hz at 3e-4."""
    bench = replace(BENCH, settings=((depth, detuning),) * 2, drift_hz=0.0)
    wanted, found = (
        rotating_waves(bench, depth, detuning),
        np.abs(bench.phasors(*bench.places()[0])),
    )
    assert np.max(np.abs(found - wanted)) <= (2e-4 + 100.0 * depth) * np.max(wanted)


def test_the_line_opens_by_the_angle() -> None:
    """f1^2 |sin 2 theta| depth/(4 sqrt(eta_plus eta_minus)) apart, where that is many widths."""
    sharp = replace(BENCH.string, d1_hz=6.0, d2_hz=5.0)
    bench = replace(BENCH, string=sharp, settings=((3e-4, 0.0),) * 2, drift_hz=0.0, points=1601)
    at, u = bench.places()[0]
    seen = np.abs(bench.phasors(at, u))
    tops = u[1:-1][(seen[1:-1] > seen[:-2]) & (seen[1:-1] > seen[2:])]
    theta, plus, minus = sharp.theta_rad, sharp.eta_plus_hz, sharp.eta_minus_hz
    f1 = np.hypot(np.cos(theta) * plus, np.sin(theta) * minus)
    wanted = f1**2 * abs(np.sin(2.0 * theta)) * 3e-4 / (4.0 * np.sqrt(plus * minus))
    assert tops.size == 2
    assert tops[1] - tops[0] == pytest.approx(wanted, abs=1.5)


def test_seeds_files_and_truth(tmp_path: Path) -> None:
    made = synthesize("pumped", seed=3, noise_scale=0.5, theta_rad=2.0, out=tmp_path)
    again = synthesize(tmp_path / "campaign.toml", seed=3)
    assert np.array_equal(again.measured.amplitude_v, made.measured.amplitude_v)
    assert again.measured.bench == made.measured.bench
    assert tomllib.loads((tmp_path / "truth.toml").read_text("utf-8")) == made.truth
    swept = ff.read_campaign(tmp_path / "campaign.toml").measurements["control_sweep"]
    assert isinstance(swept, ReadSpectra)
    read = np.array([s.amplitude for s in swept.spectra])
    assert read == pytest.approx(made.measured.amplitude_v, rel=1e-14)
    assert not np.array_equal(synthesize("pumped", seed=4).measured.amplitude_v, read)
    rest = (measure_pumped(BENCH, 5).amplitude_v - measure_pumped(BENCH, 5).true_v).ravel()
    assert np.std(rest) == pytest.approx(BENCH.noise_v, rel=0.1)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"alpha1": 1.0}, "alpha1: .*'pumped'"),
        ({"theta_rad": 1.0}, "lambda"),
        ({"points": 3}, "8 points"),
        (
            {"apart_hz": 2.0 * 6.94026e6},
            r"settings\[3\]: .* 1\.00",
        ),
        ({"plan": TONES}, "plan: .*'pumped'"),
        ({"instrument": LockIns(both=False, phases=True)}, r"instrument: .*'pumped'"),
    ],
)
def test_nonsense_is_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        synthesize("pumped", **changes)  # type: ignore[arg-type]


def test_a_fit_through_the_fmu_finds_the_angle(tmp_path: Path) -> None:
    """Few runs for each sweep, at the promised accuracy; what is fitted is what was put in."""
    settings = ((0.0, 0.0), (3e-4, -80.0), (3e-4, 80.0))
    # so little noise that the mean of a noisy magnitude is the amplitude itself
    bench = PumpedBench(settings=settings, points=41, drift_hz=0.0, noise_v=0.2e-12)
    truth = {"theta": 1.9498, "d1": 120.0, "d2": 90.0}
    synthesize(replace(bench, noise_scale=0.0), out=tmp_path)
    with ff.Fmu("CoupledModes2", 1) as fmu:
        problem = ff.Problem.of(ff.read_campaign(tmp_path / "campaign.toml"), fmu)
        p = np.array([truth.get(name, 0.0) for name in problem.names])
        budget = problem.planned.plans[""].budget
        assert budget is not None
        [curve] = [d for d in budget.decisions if d.kind is Kind.CURVE]
        rows = problem.residuals(p)
        matrix = problem.jac(p) / problem.objective.data.sigma[:, np.newaxis]
    assert curve.taken
    assert curve.numbers["points"] == 3 * 41
    assert int(curve.numbers["runs"]) <= 30
    assert np.abs(rows).max() <= 2e-8
    # a Gauss-Newton step from the truth has the errors of the noise, and they are small
    noisy = measure_pumped(bench, 2)
    rest = (noisy.amplitude_v - noisy.true_v).ravel() / bench.noise_v
    step, *_ = np.linalg.lstsq(matrix, rest, rcond=None)
    errors = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    assert np.abs(step / errors).max() < 4.0
    assert errors[problem.names.index("theta")] < 2e-9
