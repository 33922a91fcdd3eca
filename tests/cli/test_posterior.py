"""`fmu-fit posterior`: its files, exit codes and sentences, through an FMU."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest

from fitting.posterior.summary import PosteriorSummary
from fitting.result.result import read_result
from fitting.text.records import read_json
from tests.support.in_process import told
from tests.support.small_campaign import of_pairs, small_campaign

#: On one worker, more walkers than the fewest that an affine move of two values wants.
FEW = ("--workers", "1", "--walkers", "8")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory, swift_fmu: Path) -> tuple[Path, Path]:
    """A campaign of one parameter and one offset, and its fit."""
    folder = tmp_path_factory.mktemp("posterior")
    campaign = of_pairs(small_campaign(folder / "small", swift_fmu), 1)
    words = ("--quick", "--no-profiles", "--no-report", "--workers", "1")
    ended = told("reconstruct", campaign, "--out", folder / "fit", *words)
    assert ended.code == 0, ended.err
    return campaign, folder / "fit" / "result.json"


def test_the_command_draws_writes_and_goes_on(fitted: tuple[Path, Path], tmp_path: Path) -> None:
    campaign, result = fitted
    out = str(tmp_path / "out")
    words = ["posterior", str(campaign), "--at", str(result), "--out", out, *FEW]
    cost = told(*words, "--dry-run")
    assert cost.code == 0, cost.err
    assert re.search(r"at most [\d,]+ evaluations", cost.out.splitlines()[0])
    assert re.search(r"\d+ evaluations", cost.out)
    assert not (tmp_path / "out").exists()

    first = told(*words, "--steps", "200", "--no-report")
    names = {path.name for path in (tmp_path / "out").rglob("*") if path.is_file()}
    assert {"posterior.json", "draws.csv", "chain.npz"} <= names
    assert first.code == 1, first.out  # a chain of two values is not long enough yet
    early = read_json(tmp_path / "out" / "posterior.json", PosteriorSummary)
    assert early.status == "not converged"
    assert all(math.isnan(value.ci95[0]) for value in early.values.values())
    [further_words] = re.findall("fmu-fit posterior .*", first.out)
    assert "--steps 800" in further_words
    assert "--resume" in further_words

    outputs_stand_in_the_table(tmp_path / "out", result, there=False)

    further = told(*words, "--steps", "5000", "--resume", "--json")
    found = json.loads(further.out)
    assert further.code == 0, found["message"]
    assert found["status"] == "converged"
    kept = read_json(tmp_path / "out" / "posterior.json", PosteriorSummary)
    assert kept.steps == found["steps"] > 200
    fit = read_result(result)
    width = kept.values["d1"]
    assert width.ci95[0] < fit.parameters["d1"].most_likely < width.ci95[1]
    assert width.profile95 == fit.parameters["d1"].ci95
    assert "--resume" in (tmp_path / "out" / "report.html").read_text("utf-8")
    assert any((tmp_path / "out").rglob("1_corner.svg"))
    outputs_stand_in_the_table(tmp_path / "out", result, there=True)


def outputs_stand_in_the_table(out: Path, result: Path, *, there: bool) -> None:
    """Derived outputs come with enough draws."""
    names = set(read_result(result).derived)
    assert names
    head, *_ = (out / "draws.csv").read_text("utf-8").splitlines()
    columns = {cell.split(" ")[0] for cell in head.split(",")}
    assert names & columns == (names if there else set())


def test_what_does_not_suit_is_one_line(fitted: tuple[Path, Path], tmp_path: Path) -> None:
    campaign, result = fitted
    out = ("--out", tmp_path / "out")
    for words, complaint in (
        (("--at", tmp_path / "none.json"), "none.json: "),
        (("--at", result, "--walkers", "7"), "--walkers: found '7'"),
        (("--at", result, "--steps", "60"), "--steps: found '60'"),
    ):
        ended = told("posterior", campaign, *words, *out)
        assert (ended.code, ended.err.count("\n")) == (2, 1), ended.err
        assert complaint in ended.err
        assert "Sampling" not in ended.err  # no word of the command


def test_help_tells_the_least_steps() -> None:
    ended = told("posterior", "--help")
    assert "at least 200" in " ".join(ended.out.split())
