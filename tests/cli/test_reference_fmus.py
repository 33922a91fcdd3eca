"""Reference FMUs through the commands: plain answers, whatever they are."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from fitting.cli.main import main
from fitting.result.result import read_result
from fitting.text.finding import Kind, of_kind
from tests.support.cfmu_build import build_reference_fmu

#: What `check` says of each, and what `init` and `simulate` want of it.
FMUS = {
    "Dahlquist": (
        "warning .* every 0.1 s",
        "something to drive",
    ),
    "VanDerPol": (
        "warning .* every 0.01 s",
        "something to drive",
    ),
    "BouncingBall": (
        # FIXED_SOLVER_STEP of its config.h is 1 ms
        r"warning .* about every (0.001|0.00099\d|0.00100\d) s",
        "something to drive",
    ),
    "Feedthrough": (
        r"direct feed-through, without a step: Float64_continuous_input",
        "Float64_fixed_parameter, Float64_tunable_parameter",
    ),
    "Stair": ("trial run: .* step of 200 ms, 1 output", "Real output"),
}


#: Like Dahlquist's, which declares its step as well.
SAMPLE = [
    pytest.param(name, marks=pytest.mark.nightly) if name == "VanDerPol" else name for name in FMUS
]


@pytest.mark.parametrize("name", SAMPLE)
def test_a_reference_fmu_is_told_of_plainly(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fmu = str(build_reference_fmu(tmp_path, name))
    checked, wanted = FMUS[name]
    assert main(["check", fmu, "--verbose"]) == 0
    assert re.search(checked, " ".join(capsys.readouterr().out.split()))
    assert main(["init", fmu, "--out", str(tmp_path / "draft"), "--yes"]) == 2
    [said] = capsys.readouterr().err.splitlines()
    assert wanted in said
    assert main(["simulate", fmu, "--out", str(tmp_path / "out")]) == 2
    [said] = capsys.readouterr().err.splitlines()
    assert "u1 and u2" in said


def test_an_output_that_follows_its_input_at_once_has_a_gain_of_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fmu = str(build_reference_fmu(tmp_path, "Feedthrough"))
    drive = ["--input", "Float64_continuous_input", "--drive", "0.2 Hz", "--accuracy", "1e-3"]
    assert main(["simulate", fmu, *drive, "--out", str(tmp_path / "out")]) == 0
    told = re.search(r"^ +Float64_continuous_output (\S+) ", capsys.readouterr().out, re.MULTILINE)
    assert told is not None
    assert float(told[1]) == pytest.approx(1.0, rel=1e-3)


def test_a_decay_from_rest_becomes_a_campaign_that_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """x' = -1.3 x from the FMU's own start: its steps of 0.1 s would move k by 0.08."""
    t = 0.1 * np.arange(51)
    x = np.exp(-1.3 * t) + 1e-3 * np.random.default_rng(1).standard_normal(t.size)
    rows = "".join(f"{a:.1f},{b:.6f}\n" for a, b in zip(t.tolist(), x.tolist(), strict=True))
    (tmp_path / "decay.csv").write_text("time (s),x (1)\n" + rows)
    fmu, data = str(build_reference_fmu(tmp_path, "Dahlquist")), str(tmp_path / "decay.csv")
    assert main(["init", fmu, data, "--out", str(tmp_path), "--yes"]) == 0
    words = [str(tmp_path / "campaign.toml"), "--out", str(tmp_path / "out"), "--no-report"]
    assert main(["reconstruct", *words, "--workers", "1"]) == 0
    told = capsys.readouterr().out
    found = re.search(r"^  k (\S+) ± (\S+)", told, re.MULTILINE)
    assert found is not None, told
    value, std = float(found[1]), float(found[2])
    assert abs(value - 1.3) < 3.0 * std < 0.02
    assert of_kind(read_result(tmp_path / "out/result.json").findings, Kind.model_exchange_taken)
