"""Trials of FMUs: which parameters make the line, and a level at which it is one."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from fitting.draft.api import init
from fitting.text.arrays import Scalar
from tests.support.cfmu_build import build_own_step_fmu
from tests.support.lines import mode, write_csv

pytestmark = pytest.mark.usefixtures("swift_models")

ETA, WIDTH = 7e6, 60.0
F = ETA + np.linspace(-500.0, 500.0, 41)


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("line")
    return write_csv(
        folder / "line.csv", "frequency (Hz),amplitude (V)", F, 1e-3 * np.abs(mode(F, ETA, WIDTH))
    )


def start_of(campaign: dict[str, Any]) -> dict[str, Scalar]:
    """The level, and start values of the FMU at the line, without the drive's amplitude."""
    found = {p["name"]: p["start"] for p in campaign["parameters"]}
    start = {**campaign["fmu"]["start"], **found, "u1": ETA}
    return {"level": campaign["drive"]["level"], **start}


def test_a_linear_fmu_is_driven_with_one_and_the_mode_that_its_output_shows_is_fitted(
    line: Path, tmp_path: Path
) -> None:
    """q1_hybrid is the upper mode, of width d1 cos^2(theta) + d2 sin^2(theta), theta = 1.95.

    What one line does not tell is held and named.
    """
    path, said = init([line], "CoupledOscillator", out=tmp_path)
    campaign = tomllib.loads(path.read_text("utf-8"))
    start = start_of(campaign)
    assert start["level"] == 1.0
    assert start["eta_plus"] == pytest.approx(ETA, abs=1.0)
    assert "d2" in start
    assert "eta_minus" not in start
    assert any("eta_minus" in sentence and "d1" in sentence for sentence in said)
    # lambda, f1 and f2 would be those of the held mode
    assert campaign["derived"]["outputs"] == ["width_plus", "Q_plus"]


def test_a_duffing_string_is_driven_so_weakly_that_its_line_is_one(
    line: Path, tmp_path: Path
) -> None:
    path, _ = init([line], "DuffingOscillator", out=tmp_path)
    start = start_of(tomllib.loads(path.read_text("utf-8")))
    level = float(start.pop("level"))
    fmu = ff.Fmu("DuffingOscillator")

    def peak(amplitude: float) -> float:
        found = fmu.simulate({**start, "A1": amplitude}, tones=("u1",), outputs="q1_hybrid")
        return float(found.peaks[0, 0])

    assert peak(0.1 * level) == pytest.approx(0.1 * peak(level), rel=1e-3)
    assert abs(peak(0.1) / (0.1 * peak(1.0)) - 1.0) > 0.01


def test_a_draft_that_fails_where_it_starts_is_no_campaign_that_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The oscillator of own_step.h refuses other steps than its own: no tone has whole ones."""
    fmu = build_own_step_fmu(tmp_path, "REFUSES")
    rows = "".join(f"{f},{1.0 / abs(complex(320.0 - f, 15.0))}\n" for f in range(286, 359, 6))
    (tmp_path / "sweep.csv").write_text("frequency (Hz),R (V)\n" + rows, "utf-8")
    words = [str(tmp_path / "sweep.csv"), "--fmu", str(fmu), "--out", str(tmp_path / "draft")]
    assert main(["init", *words, "--yes"]) == 3
    told = capsys.readouterr()
    assert "fmi2DoStep" in told.err
    assert "reconstruct" not in told.out
    head = (tmp_path / "draft" / "campaign.toml").read_text("utf-8").split("\n\n")[0]
    assert "it runs as it is" not in head
    assert "fmi2DoStep" in head
    with pytest.raises(ff.FmuFailure):
        init([tmp_path / "sweep.csv"], fmu, out=tmp_path / "other")
