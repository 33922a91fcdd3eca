"""Another FMU, written in C and driven through its input, fitted by a campaign file alone."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from fitting.cli.main import main
from fitting.result.result import read_result
from fitting.text.arrays import FloatArray
from fitting.text.finding import Kind, of_kind
from tests.support.cfmu_build import build_c_fmu

#: A quality factor of 5: every point of every run has to settle first.
MASS, DAMPING, STIFFNESS = 1e-3, 0.4, 4.1e3
F_HZ = np.linspace(262.0, 382.0, 8)

CAMPAIGN = """
title = "Driven oscillator"
synthetic = true
[fmu]
file = "{fmu}"
[fmu.start]
mass = "1 g"
[observe]
output = "displacement"
line_width = "80 Hz"
[drive]
kind = "input"
frequencies = ["f"]
input = "force"
level = 1.0
samples_per_period = {per_period}
[sweep]
file = "sweep.csv"
layout = "csv"
amplitude = "V peak"
use = "fit"
scale = "fit"
[[parameters]]
name = "damping"
unit = "N.s/m"
lower = 0.1
upper = 1.2
start = 0.5
scale = 0.2
[[parameters]]
name = "stiffness"
unit = "N/m"
lower = 3500.0
upper = 4500.0
start = 4000.0
scale = 500.0
[derived]
outputs = {outputs}
[continuation]
nu_start = 1e-6
beta = 0.001
iterations = 2
misfit = "{misfit}"
starts = 1
[accuracy]
amplitude = {accuracy}
"""


def amplitudes(p: FloatArray) -> FloatArray:
    """|F/(k - m w^2 + i c w)| of damping c and stiffness k, where the campaign sweeps."""
    w = 2 * np.pi * F_HZ
    return np.asarray(1.0 / np.abs(p[1] - MASS * w**2 + 1j * p[0] * w))


def worst_shifts(promised: float) -> FloatArray:
    """What relative errors of the amplitudes, all the worst way, make of damping and stiffness.

    sum_i |G_i| e A_i/max A, G the pseudo-inverse of the derivatives of chi A/max A.
    """
    truth = np.array([DAMPING, STIFFNESS])
    measured = amplitudes(truth)

    def rows(p: FloatArray) -> FloatArray:
        found = amplitudes(p)
        return np.asarray(found * (found @ measured) / (found @ found) / np.max(measured))

    steps = np.diag(1e-5 * truth)
    slopes = [(rows(truth + h) - rows(truth - h)) / (2.0 * np.sum(h)) for h in steps]
    pull = np.abs(np.linalg.pinv(np.stack(slopes, axis=1)))
    return np.asarray(promised * pull @ measured / np.max(measured))


def campaign(folder: Path, fmu: Path, misfit: str, outputs: list[str]) -> Path:
    """Campaign and its data, |F/(k - m w^2 + i c w)| in closed form times a detector's gain."""
    amplitude = 0.37 * amplitudes(np.array([DAMPING, STIFFNESS]))
    points = zip(F_HZ.tolist(), amplitude.tolist(), strict=True)
    rows = "".join(f"{a!r},{b!r}\n" for a, b in points)
    (folder / "sweep.csv").write_text(f"frequency (Hz),amplitude (V)\n{rows}")
    path = folder / "campaign.toml"
    # where profiles are walked, every one of a thousand runs counts
    accuracy, per_period = (1e-6, 28) if misfit == "slack" else (1e-3, 12)
    named = {"fmu": fmu.as_posix(), "misfit": misfit, "outputs": outputs}
    path.write_text(CAMPAIGN.format(**named, accuracy=accuracy, per_period=per_period))
    return path


@pytest.mark.parametrize(
    ("reset", "misfit", "profiles"),
    [
        pytest.param("RESET_WORKS", "slack", False, marks=pytest.mark.nightly),
        ("RESET_DOES_NOTHING", "squares", False),
        # stepping an input takes its time
        pytest.param("RESET_DOES_NOTHING", "squares", True, marks=pytest.mark.nightly),
    ],
)
def test_a_foreign_fmu_is_fitted_by_campaign_file_alone(
    reset: str, misfit: str, profiles: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outputs = ["eigenfrequency", "line_width"] if misfit == "slack" else ["line_width"]
    path = campaign(tmp_path, build_c_fmu(tmp_path, reset=reset), misfit, outputs)
    out = tmp_path / "out"
    words = ["reconstruct", str(path), "--out", str(out), "--workers", "2", "--no-report"]
    further = ["--estimator", "algorithm2"] if misfit == "slack" else []
    assert main([*words, *further, *([] if profiles else ["--no-profiles"])]) == 0
    found = read_result(out / "result.json")
    eigenfrequency = math.sqrt(STIFFNESS / MASS) / (2 * math.pi)
    width = DAMPING / MASS / (2 * math.pi)
    assert found.plan is not None
    c, k = worst_shifts(found.plan.promised) if misfit == "squares" else (0.0, 0.0)
    if misfit == "slack":
        assert found.derived["eigenfrequency"].value == pytest.approx(eigenfrequency, rel=1e-6)
    assert found.parameters["stiffness"].value == pytest.approx(STIFFNESS, rel=1e-6, abs=k)
    assert found.derived["line_width"].value == pytest.approx(
        width, rel=1e-6, abs=width * c / DAMPING
    )
    word = "determined" if profiles else "linearised only"
    assert found.derived["line_width"].status == word
    papers = misfit == "slack"
    estimator = "algorithm2" if papers else "likelihood"
    assert found.provenance.settings["estimator"] == estimator
    for parameter in found.parameters.values():
        assert parameter.value == (parameter.algorithm2 if papers else parameter.most_likely)
    assert bool(of_kind(found.findings, Kind.estimator)) == papers
    # what the plan promises no better is in the errors, exact as the data are
    for value, worst in zip(
        (found.parameters["damping"], found.parameters["stiffness"]),
        worst_shifts(found.plan.promised),
        strict=True,
    ):
        assert value.simulation == pytest.approx(worst, rel=0.02)
        assert value.simulation < value.std < 1.3 * value.simulation
    assert of_kind(found.findings, Kind.simulation_error)
    plan = " ".join(found.provenance.plan)
    assert ("reused" in plan) == (reset == "RESET_WORKS")
