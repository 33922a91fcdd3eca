"""``fmu-fit ensemble`` as it is typed: killed, asked to end, gone on with, and refused."""

from __future__ import annotations

import json
import os
import re
import signal
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import fitting as ff
from fitting.ensembles import ITEMS_FILE
from fitting.ensembles.report import csv_of
from tests.support.in_process import told
from tests.support.processes import Job, wait_until

LINES = ("--series", "transmission", "--change", "points=15", "--no-profiles", "--workers", "1")


def rows(out: Path) -> int:
    """Items in the journal."""
    path = out / ITEMS_FILE
    return len(path.read_text().splitlines()) - 1 if path.exists() else 0


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_killed_asked_to_end_and_gone_on_with_it_is_the_same_table(
    swift_fmu: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    words = ["ensemble", *LINES, "--fmu", str(swift_fmu), "--out", str(out), "--laboratories"]
    with Job([*words, "400"], tmp_path / "tmp") as job:
        wait_until(lambda: rows(out) >= 1, "the first item")
        job.kill_workers()
        had = rows(out)
        wait_until(lambda: rows(out) > had, "an item of the next process")
        second = told("ensemble", *LINES, "--fmu", swift_fmu, "--out", out)
        job.send(signal.SIGTERM)
        code, printed, err = job.ended()
        assert job.left_behind() == []
    assert (second.code, f"{out}: " in second.err) == (2, True)
    assert code == 1, err
    [goes_on] = [line for line in printed.splitlines() if "fmu-fit ensemble " in line]
    assert {"transmission", "400", "--resume"} <= set(goes_on.split())
    assert "Traceback" not in err
    found = json.loads((out / "ensemble.json").read_text())
    assert (found["status"], len(found["rows"])) == ("interrupted", rows(out))
    assert all(row["status"] == "converged" for row in found["rows"])
    assert not (out / "report.html").exists()
    # as many as there are: an item that was under way when the end was asked for may be missing
    labels = sorted(int(row["label"].removeprefix("seed ")) for row in found["rows"])
    # a busy machine may have let it make many: the first four are held against those of one thread
    wanted = min(4, next(k for k in range(1, 402) if k not in labels) - 1)
    again = told(*words, str(wanted), "--resume", "--json")
    assert again.code == 0, again.err
    assert json.loads(again.out)["total"] == wanted
    check_table(out, swift_fmu, wanted)


def check_table(out: Path, fmu: Path, count: int) -> None:
    """The table is that of one thread; figure and report are there."""
    of = ff.Laboratories("transmission", count, changes={"points": 15})
    with ThreadPoolExecutor(1) as pool:
        options = ff.EnsembleOptions(profiles=False)
        alone = ff.ensemble(of, fmu, options, executor=pool)
    assert (out / "ensemble.csv").read_text() == csv_of(alone)
    assert (out / "figures" / "1_ensemble.svg").exists()
    assert "--change points=15" in (out / "report.html").read_text()
    assert not list(out.glob("**/*.fmu"))


def test_without_a_worker_to_start_the_cost_is_told_and_nothing_written(
    swift_fmu: Path, tmp_path: Path
) -> None:
    ended = told("ensemble", *LINES, "--fmu", swift_fmu, "--out", tmp_path / "out", "--dry-run")
    assert ended.code == 0, ended.err
    assert ended.out.startswith("100 items")
    assert "expected: " in ended.out
    assert not (tmp_path / "out").exists()


def test_the_cost_of_going_on_is_that_of_what_is_left(swift_fmu: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    own = ("--fmu", swift_fmu, "--out", out, "--no-report", "--laboratories")
    words = ("ensemble", *LINES, *own)
    assert told(*words, "1").code == 0
    with (out / ITEMS_FILE).open("a") as file:
        file.write('{"row":{"index":1,"lab')  # as kill -9 leaves it
    before = (out / ITEMS_FILE).read_bytes()
    ended = told(*words, "4", "--resume", "--dry-run")
    assert ended.code == 0, ended.err
    assert re.findall(r"\d+", ended.out.partition("expected: ")[0]) == ["4", "1", "3"]
    assert (out / ITEMS_FILE).read_bytes() == before
    done = told(*words, "1", "--resume", "--dry-run")
    assert (done.code, re.findall(r"\d+", done.out)) == (0, ["1"])


REFUSED = [
    ([], "--series or --like"),
    (["x.toml", "--series", "q1"], "--series or --like"),
    (["x.toml", "--seed", "3"], "--seed: "),
    (["x.toml", "--change", "a=1"], "--change: "),
    (["--series", "q1", "--change", "drift_hz"], "--change drift_hz: found ''"),
    (["--series", "q1", "--change", "drifts=3"], "drifts"),
    (["--series", "notch", "--change", "points=nan"], "--change points=nan: found 'nan'"),
    (["--series", "q1", "--no-profiles", "--value", "d1"], "--value: "),
    (["--series", "q1", "--laboratories", "0"], "--laboratories: found '0'"),
    (["--series", "q1", "--workers", "2", "--scheduler", "tcp://a:1"], "--scheduler: "),
    (["--series", "transmission", "--value", "lambda"], "'lambda'; there is: Q_plus"),
    (["--like", "none.toml"], "truth.toml: "),
    (["none"], "none: "),
    (["--series", "q1", "--fmu", "none.fmu"], "none.fmu: "),
]


@pytest.mark.parametrize(("words", "complaint"), REFUSED)
def test_bad_input_is_one_line_and_writes_nothing(
    words: list[str], complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ended = told("ensemble", *words, "--out", "out")
    assert (ended.code, ended.err.count("\n")) == (2, 1), ended.err
    assert complaint in ended.err
    assert os.listdir(tmp_path) == []
