"""What is no campaign, or no file of measurements, is called by its kind, with what to do."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from fitting.cli.main import main

SWEEP = "f (kHz),R (mV)\n1,2\n2,3\n3,2\n"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sweep.csv").write_text(SWEEP)
    (tmp_path / "my sweep.txt").write_text("# f (kHz)\tR (mV)\n1\t2\n2\t3\n3\t2\n")
    (tmp_path / "scope.csv").write_text(
        "LECROYWS4,1,Waveform\nSegments,1,SegmentSize,3\n\n\nTime,Ampl\n0,1\n1,2\n2,1\n"
    )
    with zipfile.ZipFile(tmp_path / "a.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", "<fmiModelDescription/>")
    for folder, names in (
        ("usual", ("campaign.toml", "other.toml")),
        ("two", ("a.toml", "b.toml")),
        ("none", ("sweep.csv",)),
    ):
        (tmp_path / folder).mkdir()
        for name in names:
            (tmp_path / folder / name).write_text("")
    (tmp_path / "slip.toml").write_text("a = 1,5\n")
    (tmp_path / "result.json").write_text('{"status": 0}')
    return tmp_path


FILES = "fmu-fit init FILE writes one, of a file of measurements"


@pytest.mark.parametrize("command", ["reconstruct", "identify", "design"])
@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("sweep.csv", "is a file of measurements, not a campaign; fmu-fit init sweep.csv writes"),
        ("my sweep.txt", "is a file of measurements, not a campaign; fmu-fit init 'my sweep.txt'"),
        ("scope.csv", "is a file of measurements, not a campaign; fmu-fit init scope.csv writes"),
        ("a.fmu", "is an FMU, not a campaign; fmu-fit init FILE --fmu a.fmu writes the campaign"),
        ("usual", "is a folder; wanted a campaign in it: usual/campaign.toml"),
        ("two", "is a folder; wanted a campaign in it: two/a.toml or two/b.toml"),
        ("none", f"is a folder; wanted a campaign, and there is none in it; {FILES}"),
        ("result.json", f"is JSON, not a campaign; {FILES}"),
        ("slip.toml", "not valid TOML: "),
        ("absent.toml", "no such file"),
    ],
)
def test_what_is_no_campaign_is_called_by_its_kind(
    command: str, name: str, told: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, name]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f"fmu-fit: {name}: {told}")


CAMPAIGN = "is a campaign (TOML); wanted a file of measurements (fmu-fit reconstruct fits it)"


@pytest.mark.parametrize(
    ("command", "name", "told"),
    [
        (["line"], "a.fmu", "is an FMU; wanted a file of measurements (fmu-fit init FILE --fmu "),
        (["line"], "slip.toml", CAMPAIGN),
        (["init", "--yes", "--out", "o"], "slip.toml", CAMPAIGN),
    ],
)
def test_what_holds_no_measurement_is_called_by_its_kind(
    command: list[str], name: str, told: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*command, name]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f"fmu-fit: {name}: {told}")
