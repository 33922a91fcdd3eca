"""A fit of other data is refused by every command that sets out from one, and the file is named."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import fitting as ff
from fitting.campaign import BoundCampaign, bind
from fitting.fmu.description import read_description
from fitting.result.provenance import of_any_data, require_same_data
from fitting.result.result import Result, read_result
from fitting.text.errors import BadInput
from tests.support.in_process import told
from tests.support.small_campaign import small_campaign


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory, swift_fmu: Path) -> Path:
    """Folder of a small campaign, `small`, and of its fit, `fit`."""
    folder = tmp_path_factory.mktemp("changed")
    campaign = small_campaign(folder / "small", swift_fmu)
    words = ("--quick", "--no-profiles", "--no-report", "--workers", "1")
    ended = told("reconstruct", campaign, "--out", folder / "fit", *words)
    assert ended.code == 0, ended.err
    return folder


@pytest.fixture
def copied(fitted: Path, tmp_path: Path) -> Path:
    """The same elsewhere, to be changed."""
    shutil.copytree(fitted / "small", tmp_path / "small")
    return tmp_path / "small"


@pytest.mark.parametrize("command", ["posterior", "identify", "design"])
def test_one_changed_cell_is_refused_and_its_file_is_named(
    command: str, fitted: Path, copied: Path, tmp_path: Path
) -> None:
    sweep = copied / "sweep.csv"
    text = sweep.read_text("utf-8")
    sweep.write_text(f"{text.rstrip()[:-1]}7\n", "utf-8")
    at = fitted / "fit" / "result.json"
    ended = told(command, copied / "campaign.toml", "--at", at, "--out", tmp_path / "out")
    assert ended.code == 2
    assert ended.err.count("\n") == 1
    assert str(sweep) in ended.err
    assert "--changed-data" in ended.err
    assert not list((tmp_path / "out").glob("*.json"))


def test_asked_for_it_goes_on_with_changed_data(fitted: Path, copied: Path, tmp_path: Path) -> None:
    sweep = copied / "sweep.csv"
    sweep.write_text(f"{sweep.read_text('utf-8')}\n", "utf-8")
    words: list[str | Path] = [
        *("posterior", copied / "campaign.toml", "--at", fitted / "fit" / "result.json"),
        *("--out", tmp_path / "out", "--dry-run", "--workers", "1"),
    ]
    assert told(*words).code == 2
    assert told(*words, "--changed-data").code == 0


def test_the_same_data_elsewhere_are_the_same_and_the_campaign_file_may_change(
    fitted: Path, copied: Path, tmp_path: Path
) -> None:
    """Bounds are another question to the same data."""
    campaign = copied / "campaign.toml"
    campaign.write_text(f"{campaign.read_text('utf-8')}\n# a remark\n", "utf-8")
    words = ("--at", fitted / "fit" / "result.json", "--out", tmp_path / "out", "--dry-run")
    ended = told("posterior", campaign, *words, "--workers", "1")
    assert ended.code == 0, ended.err


@pytest.fixture(scope="module")
def records(fitted: Path) -> tuple[BoundCampaign, Result]:
    variables = read_description(fitted / "small" / "oscillator.fmu").variables
    bound = bind(ff.read_campaign(fitted / "small" / "campaign.toml"), variables)
    return bound, read_result(fitted / "fit" / "result.json")


def test_a_file_that_the_fit_did_not_read_is_refused(
    records: tuple[BoundCampaign, Result], tmp_path: Path
) -> None:
    bound, result = records
    require_same_data(result, [bound], whole=True)
    another = tmp_path / "more.csv"
    another.write_text("f (Hz),a (V)\n", "utf-8")
    with pytest.raises(BadInput, match=r"more\.csv") as caught:
        require_same_data(result, [replace(bound, files=(*bound.files, another))])
    assert len(caught.value.args) == 1
    require_same_data(of_any_data(result), [replace(bound, files=(another,))], whole=True)


def test_a_file_that_is_gone_counts_where_the_fit_has_to_be_of_all_data(
    records: tuple[BoundCampaign, Result],
) -> None:
    """A part of what was fitted together may be looked at alone, but not drawn from."""
    bound, result = records
    part = replace(bound, files=bound.files[:-1])
    require_same_data(result, [part])
    with pytest.raises(BadInput, match=bound.files[-1].name):
        require_same_data(result, [part], whole=True)


def test_every_changed_file_is_a_line(records: tuple[BoundCampaign, Result]) -> None:
    bound, result = records
    files = dict.fromkeys(result.provenance.files, "0" * 64)
    changed = replace(result, provenance=replace(result.provenance, files=files))
    with pytest.raises(BadInput) as caught:
        require_same_data(changed, [bound])
    assert len(caught.value.args) == len(set(bound.files) - {bound.path})
