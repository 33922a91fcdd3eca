"""A campaign that names one tone of an FMU that drives with two is refused by name."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import fitting as ff
from fitting.cli.main import main
from fitting.text.toml import read_toml, toml_text
from tests.faults.scene import CAMPAIGN, FMU, texts

F = np.linspace(292.0, 352.0, 13)


@pytest.fixture
def campaign(tmp_path: Path, swift_fmu: Path) -> Path:
    """One tone, u1, through an FMU that has two."""
    for name, text in texts().items():
        (tmp_path / name).write_text(text, "utf-8")
    (tmp_path / FMU).write_bytes(swift_fmu.read_bytes())
    return tmp_path / CAMPAIGN


def changed(path: Path, **start: float) -> None:
    """Other start values, None for the FMU's own."""
    tables = read_toml(path)
    del tables["fmu"]["start"]["A2"]
    tables["fmu"]["start"].update(start)
    path.write_text(toml_text(tables), "utf-8")


@pytest.mark.parametrize(
    ("start", "size"), [({}, "1 m/s2"), ({"A2": 0.5}, "0.5 m/s2")], ids=["own", "told"]
)
def test_a_second_tone_that_drives_is_refused_by_name(
    start: dict[str, float], size: str, campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed(campaign, **start)
    out = campaign.parent / "out"
    words = ["reconstruct", str(campaign), "--out", str(out), "--quick", "--no-report"]
    assert main(words) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    for token in (f"{campaign}: [drive] ", "u1", "u2", f"A2 = {size}", "A2 = 0 in [fmu.start]"):
        assert token in told


def test_the_doctor_says_it_too(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmu = str(campaign.parent / FMU)
    assert main(["check", fmu, "--campaign", str(campaign)]) == 0
    changed(campaign)
    assert main(["check", fmu, "--campaign", str(campaign)]) == 2
    assert re.search(r"\[drive\] .*\bu2\b", capsys.readouterr().err)


def test_a_program_hears_the_same_and_may_say_it_of_every_measurement(
    swift_fmu: Path,
) -> None:
    def problem(fmu: ff.Fmu, settings: dict[str, float]) -> ff.Problem:
        setup = ff.Setup(
            ff.Drive(frequency_names=("u1",), amplitude_names=("A1",)),
            "q1_hybrid",
            start_values={"periodic_start": True},
            steady_start=True,
        )
        sweep = ff.Sweep(setup, F, np.ones(F.size), settings=settings)
        wanted = [ff.Parameter("d1", 30.0, bounds=(1.0, 100.0), unit="Hz")]
        return ff.Problem(fmu, wanted, [sweep])

    with ff.Fmu(swift_fmu, 1) as fmu:
        with pytest.raises(ff.BadInput, match=r"\bu1\b.*\bu2\b"):
            problem(fmu, {}).residuals([30.0])
        problem(fmu, {"A2": 0.0})
