"""``fmu-fit check`` tells what is wrong with an FMU, and of what is right only that."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from fitting.cli import main
from tests.cfmu_build import build_c_fmu

ROOT = Path(__file__).parents[1]


def test_a_sound_fmu(oscillator_fmu: Path, capsys: pytest.CaptureFixture[str]) -> None:
    campaign = ROOT / "data" / "string_q1" / "campaign.toml"
    assert main(["check", str(oscillator_fmu), "--campaign", str(campaign)]) == 0
    text = capsys.readouterr().out
    assert "problem" not in text
    assert "eta_plus" in text
    assert "suits this FMU" in text
    assert "same bit for bit" in text


def test_an_fmu_that_does_not_suit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    campaign = ROOT / "data" / "string_q1" / "campaign.toml"
    assert main(["check", str(build_c_fmu(tmp_path)), "--campaign", str(campaign)]) == 2
    assert "q1_hybrid" in capsys.readouterr().err


@pytest.mark.parametrize("reset", ["RESET_DOES_NOTHING", "RESET_KEEPS_DERIVED"])
def test_a_reset_that_lies_is_told(
    reset: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(build_c_fmu(tmp_path, reset=reset))]) == 0
    assert "every run has a new instance" in capsys.readouterr().out


def test_rules_broken_are_listed_and_exit_code_is_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sound = build_c_fmu(tmp_path)
    broken = tmp_path / "broken.fmu"
    with zipfile.ZipFile(sound) as source, zipfile.ZipFile(broken, "w") as target:
        for name in source.namelist():
            content = source.read(name)
            if name == "modelDescription.xml":
                content = content.replace(b'unit="N/m" ', b'unit="furlong" ')
            target.writestr(name, content)
    assert main(["check", str(broken)]) == 2
    told = capsys.readouterr()
    assert "problem: " in told.out
    assert "furlong" in told.out
    assert "breaks 1 rules" in told.err


def test_no_binary_for_this_platform(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(build_c_fmu(tmp_path, platform="plan9"))]) == 2
    assert "no binary for this platform" in capsys.readouterr().err


def test_failing_fmu_is_exit_code_3(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = build_c_fmu(tmp_path)
    assert main(["simulate", str(path), "--input", "force", "--drive", "300 Hz", "--set",
                 "misbehave=5", "--out", str(tmp_path / "out")]) == 3  # fmt: skip
    told = capsys.readouterr()
    assert "told to fail: misbehave = 5" in told.err
    assert "misbehave = 5" in told.err
    assert told.err.count("\n") == 1
    assert not (tmp_path / "out").exists()
