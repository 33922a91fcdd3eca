"""`fmu-fit posterior`: its files, exit codes and sentences, through an FMU."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fitting.inference.posterior.summary import PosteriorSummary
from fitting.result.result import read_result
from fitting.text.records import read_json
from tests.support.in_process import told
from tests.support.small_campaign import small_campaign


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory, swift_fmu: Path) -> tuple[Path, Path]:
    """A campaign of one parameter and five offsets, and its fit."""
    folder = tmp_path_factory.mktemp("posterior")
    campaign = small_campaign(folder / "small", swift_fmu)
    words = ("--quick", "--no-profiles", "--no-report", "--workers", "1")
    ended = told("reconstruct", campaign, "--out", folder / "fit", *words)
    assert ended.code == 0, ended.err
    return campaign, folder / "fit" / "result.json"


def test_the_command_draws_writes_and_goes_on(fitted: tuple[Path, Path], tmp_path: Path) -> None:
    campaign, result = fitted
    out = str(tmp_path / "out")
    words = ["posterior", str(campaign), "--at", str(result), "--out", out, "--workers", "1"]
    cost = told(*words, "--dry-run")
    assert cost.code == 0, cost.err
    assert cost.out.startswith("expected: ")
    assert "evaluations of the model" in cost.out
    assert not (tmp_path / "out").exists()

    first = told(*words, "--steps", "200")
    names = {path.name for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert {"posterior.json", "draws.csv", "chain.npz", "report.html", "1_corner.svg"} <= names
    assert first.code == 1, first.out  # a chain of six values is not long enough yet
    said = " ".join(first.out.split())  # wherever lines break
    assert "not converged" in said
    assert "no interval is told" in said
    assert "--steps 800" in first.out
    assert "--resume" in first.out

    outputs_stand_in_the_table(tmp_path / "out", result, there=False)

    further = told(*words, "--steps", "5000", "--resume", "--json")
    found = json.loads(further.out)
    assert further.code == 0, found["message"]
    assert found["status"] == "converged"
    kept = read_json(tmp_path / "out" / "posterior.json", PosteriorSummary)
    assert kept.steps == found["steps"] > 200
    fit = read_result(result)
    width = kept.values["d1"]
    assert width.interval95[0] < fit.parameters["d1"].most_likely < width.interval95[1]
    assert width.profile95 == fit.parameters["d1"].ci95
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "fmu-fit posterior" in page
    outputs_stand_in_the_table(tmp_path / "out", result, there=True)


def outputs_stand_in_the_table(out: Path, result: Path, *, there: bool) -> None:
    """Derived outputs come with enough draws; before, the page says so."""
    names = set(read_result(result).derived)
    assert names
    head, *_ = (out / "draws.csv").read_text("utf-8").splitlines()
    columns = {cell.split(" ")[0] for cell in head.split(",")}
    assert names & columns == (names if there else set())
    later = "derived outputs of the fit stand beside them once there are enough draws"
    assert (later in (out / "report.html").read_text("utf-8")) is not there


def test_what_does_not_suit_is_one_line(fitted: tuple[Path, Path], tmp_path: Path) -> None:
    campaign, result = fitted
    out = ("--out", tmp_path / "out")
    for words, complaint in (
        (("--at", tmp_path / "none.json"), "none.json: no such file"),
        (("--at", result, "--walkers", "7"), "--walkers: found '7', wanted an even number of"),
        (("--at", result, "--steps", "60"), "--steps: found '60', wanted a whole number of at le"),
    ):
        ended = told("posterior", campaign, *words, *out)
        assert (ended.code, ended.err.count("\n")) == (2, 1), ended.err
        assert complaint in ended.err
        assert "Sampling" not in ended.err  # no word of the command


def test_help_tells_the_least_steps() -> None:
    ended = told("posterior", "--help")
    assert "200 at least" in " ".join(ended.out.split())
