"""Where several names or values of a campaign are wrong, all of them are told at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from fitting.cli.main import main
from fitting.text.toml import read_toml, toml_text
from tests.faults.scene import CAMPAIGN, EXPERIMENTS, FMU, texts


@pytest.fixture
def campaign(tmp_path: Path, oscillator_fmu: Path) -> Path:
    """A campaign that fits its FMU."""
    for name, text in texts().items():
        (tmp_path / name).write_text(text, "utf-8")
    (tmp_path / FMU).write_bytes(oscillator_fmu.read_bytes())
    return tmp_path / CAMPAIGN


def complaints(path: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    assert main(["reconstruct", str(path), "--out", str(path.parent / "out")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith(f"fmu-fit: {path.parent}") for line in lines)
    return lines


def test_names_and_units_beside_the_fmu(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tables = read_toml(campaign)
    tables["observe"]["output"] = "q1_hybird"
    tables["fmu"]["start"] |= {"thet": 0.0, "d2": "30 kg"}
    tables["drive"] |= {"frequencies": ["u1"], "amplitudes": ["B1"]}
    tables["parameters"][0]["name"] = "d3"
    tables["parameters"][1]["lower"] = "310 V"
    tables["derived"]["outputs"] = ["lambda", "lamda"]
    campaign.write_text(toml_text(tables), "utf-8")
    told = complaints(campaign, capsys)
    for words in (
        "[observe] output: the FMU has no variable 'q1_hybird'; did you mean 'q1_hybrid'?",
        "no variable 'thet'; did you mean 'theta'?",
        "found unit 'kg', wanted 'Hz'",
        "[drive] amplitudes: the FMU has no variable 'B1'",
        "[parameters 'd3']: the FMU has no variable 'd3'",
        "found unit 'V', wanted 'Hz'",
        "[derived] outputs: the FMU has no variable 'lamda'",
    ):
        assert sum(words in line for line in told) == 1, words
    assert len(told) == 7


def test_columns_of_the_experiments(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tables = read_toml(campaign)
    for key in ("spectra", "noise_floor", "layout", "columns"):
        del tables["experiments"][key]
    tables["experiments"] |= {"peaks": ["z1"], "peak_sigmas": ["s1"]}
    campaign.write_text(toml_text(tables), "utf-8")
    (campaign.parent / EXPERIMENTS).write_text("experiment,v1 (Hz)\none,310\ntwo,330\n", "utf-8")
    told = complaints(campaign, capsys)
    for name in ("u1", "z1", "s1"):
        assert sum(f"no column '{name}'" in line for line in told) == 1
    assert len(told) == 3
