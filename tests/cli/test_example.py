"""``fmu-fit example``: the shipped campaigns, listed and written."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

import fitting
from fitting.cli.main import main
from fitting.measurements.kinds import read_campaign
from fitting.text.errors import BadInput
from fitting.text.files import shipped

DATA = Path(__file__).parents[2] / "data"
NAMES = sorted(path.parent.name for path in DATA.glob("*/campaign.toml"))


def files(folder: Path) -> dict[str, bytes]:
    found = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def test_without_a_name_every_example_has_a_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["example"]) == 0
    lines = capsys.readouterr().out.splitlines()
    texts = {name: (DATA / name / "campaign.toml").read_text("utf-8") for name in NAMES}
    titles = {name: tomllib.loads(text)["title"] for name, text in texts.items()}
    assert dict(re.split(" {2,}", line, maxsplit=1) for line in lines) == titles


@pytest.mark.parametrize("name", NAMES)
def test_an_example_is_written_whole(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["example", name]) == 0
    assert files(tmp_path / name) == files(DATA / name)
    assert read_campaign(tmp_path / name / "campaign.toml").file.fmu.model
    told = capsys.readouterr().out
    assert f"fmu-fit reconstruct {name}/campaign.toml" in told
    others = ("afm_sensor", "coupled_rlc", "string_pumped", "string_vdc")
    assert " sweep.csv" in told or name in others
    # into an empty folder, but never onto something
    (tmp_path / "empty").mkdir()
    assert main(["example", name, "--out", "empty"]) == 0
    (tmp_path / name / "sweep.csv").write_text("mine")
    assert main(["example", name]) == 2
    assert (tmp_path / name / "sweep.csv").read_text() == "mine"
    assert capsys.readouterr().err.startswith(f"fmu-fit: {name}: ")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["string_q3"], ["'string_q3'", *NAMES]),
        (["..", "--out", "o"], ["'..'", *NAMES]),
        (["--out", "o"], ["--out o: ", "NAME", *NAMES]),
    ],
)
def test_what_is_no_example(
    arguments: list[str],
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["example", *arguments]) == 2
    told = capsys.readouterr().err
    assert all(word in told for word in words)
    assert not any(tmp_path.iterdir())


def test_an_installed_copy_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "fitting"
    (package / "shipped" / "data").mkdir(parents=True)
    (tmp_path / "build_fmu.py").touch()
    monkeypatch.setattr(fitting, "__file__", str(package / "__init__.py"))
    assert shipped("data") == package / "shipped" / "data"
    assert shipped("build_fmu.py") == tmp_path / "build_fmu.py"
    with pytest.raises(BadInput, match="fmu_src: "):
        shipped("fmu_src")
