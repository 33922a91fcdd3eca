"""Every path in a campaign that is written leads to its file from where the campaign stands."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

import fitting as ff
from tests.lab import test_sweep_plan, test_tone_plan
from tests.support.in_process import told

MODEL = 'model = "CoupledModes2"'


def with_own_fmu(plan: Path, fmu: str) -> Path:
    """The plan, of an FMU's file."""
    text = plan.read_text("utf-8")
    assert MODEL in text
    plan.write_text(text.replace(MODEL, f'file = "{fmu}"'), "utf-8")
    return plan


@pytest.mark.parametrize("planned", [test_tone_plan.planned, test_sweep_plan.planned])
@pytest.mark.parametrize("out", ["measured", "deep/er/measured"])
def test_a_plan_that_is_measured_elsewhere_names_the_same_fmu(
    planned: Callable[[Path], Path], out: str, tmp_path: Path
) -> None:
    (tmp_path / "own.fmu").write_bytes(b"an FMU")
    plan = with_own_fmu(planned(tmp_path / "plan"), "../own.fmu")
    made = ff.synthesize("crossing", plan=plan, out=tmp_path / out)
    assert made.files
    written = ff.read_campaign(tmp_path / out / "campaign.toml")
    assert written.file.fmu.file is not None
    assert written.file.fmu.file.resolve() == (tmp_path / "own.fmu").resolve()
    assert not Path(tables(tmp_path / out)["fmu"]["file"]).is_absolute()


def tables(folder: Path) -> dict[str, dict[str, str]]:
    return tomllib.loads((folder / "campaign.toml").read_text("utf-8"))


def test_a_path_behind_a_link_leads_where_the_link_does(tmp_path: Path) -> None:
    """`..` of a folder that is a link is the folder above its target."""
    (tmp_path / "own.fmu").write_bytes(b"an FMU")
    (tmp_path / "far" / "away").mkdir(parents=True)
    (tmp_path / "near").symlink_to(tmp_path / "far" / "away", target_is_directory=True)
    plan = with_own_fmu(test_tone_plan.planned(tmp_path / "plan"), "../own.fmu")
    ff.synthesize("crossing", plan=plan, out=tmp_path / "near" / "measured")
    campaign = tmp_path / "near" / "measured"
    assert os.path.samefile(campaign / tables(campaign)["fmu"]["file"], tmp_path / "own.fmu")


def test_an_absolute_path_becomes_relative(tmp_path: Path) -> None:
    (tmp_path / "own.fmu").write_bytes(b"an FMU")
    fmu = (tmp_path / "own.fmu").as_posix()
    plan = with_own_fmu(test_tone_plan.planned(tmp_path / "plan"), fmu)
    ff.synthesize("crossing", plan=plan, out=tmp_path / "measured")
    assert tables(tmp_path / "measured")["fmu"]["file"] == "../own.fmu"


def test_a_sweep_in_another_folder_is_written_beside_the_campaign(tmp_path: Path) -> None:
    """What a plan takes its scale from is copied, and named where the copy is."""
    plan = test_tone_plan.planned(tmp_path / "plan")
    (tmp_path / "sweep.csv").write_text((plan.parent / "sweep.csv").read_text("utf-8"), "utf-8")
    (plan.parent / "sweep.csv").unlink()
    text = plan.read_text("utf-8").replace('file = "sweep.csv"', 'file = "../sweep.csv"')
    plan.write_text(text, "utf-8")
    ff.synthesize("crossing", plan=plan, out=tmp_path / "a" / "measured")
    assert tables(tmp_path / "a" / "measured")["sweep"]["file"] == "sweep.csv"
    read = ff.read_campaign(tmp_path / "a" / "measured" / "campaign.toml")
    assert read.files


def test_the_command_writes_such_a_campaign(tmp_path: Path) -> None:
    (tmp_path / "own.fmu").write_bytes(b"an FMU")
    plan = with_own_fmu(test_tone_plan.planned(tmp_path / "plan"), "../own.fmu")
    ff.synthesize_curves("crossing", out=tmp_path / "map")
    words = ("--plan", plan, "--truth", tmp_path / "map" / "truth.toml")
    ended = told("synthesize", *words, "--out", tmp_path / "b" / "measured")
    assert ended.code == 0, ended.err
    assert tables(tmp_path / "b" / "measured")["fmu"]["file"] == "../../own.fmu"
