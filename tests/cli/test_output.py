"""What a command tells: --quiet, --verbose, --log, --json, on a terminal and in a pipe."""

from __future__ import annotations

import csv
import errno
import json
import logging
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fitting.cli.running.output import HEAD, LOGGER
from fitting.cli.words.parser import COMMANDS, command_of
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run
from tests.support.in_process import Told, told
from tests.support.small_campaign import small_campaign

ROOT = Path(__file__).parents[2]
FIT = ("--workers", "1", "--no-report", "--no-profiles")
LEVEL = re.compile(r"path, ν = \S+: J = \S+, [\w ]+, \d+ iterations, \d+ evaluations, \S+ s")


@pytest.fixture(scope="module")
def folder(swift_fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small campaign and its FMU."""
    return small_campaign(tmp_path_factory.mktemp("output") / "small", swift_fmu).parent


@pytest.fixture(scope="module")
def fitted(folder: Path) -> Told:
    """A fit that says all it can."""
    words = ("--json", "--verbose", "--log", folder / "fit.log")
    with pytest.MonkeyPatch.context() as patch:  # on a busy machine progress would stand among them
        patch.setattr("fitting.api.progress.FIRST_S", 1e6)
        return told("reconstruct", folder / "campaign.toml", "--out", folder / "out", *FIT, *words)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_can_be_told_how_much_to_say(name: str) -> None:
    text = told(name, "--help").out
    assert "--quiet | --verbose" in text
    assert "--log FILE" in text
    assert ("--json" in text) == hasattr(command_of(name), "DOCUMENT")


def test_the_document_is_the_file_and_nothing_else(folder: Path, fitted: Told) -> None:
    assert fitted.code == 0
    assert fitted.out == (folder / "out" / "result.json").read_text("utf-8")
    parameters = json.loads(fitted.out)["parameters"]
    assert set(parameters) == {"d1"}
    assert parameters["d1"]["unit"] == "Hz"


def test_a_line_for_every_level_and_every_decision_of_the_plan(folder: Path, fitted: Told) -> None:
    with (folder / "out" / "history.csv").open(encoding="utf-8") as file:
        levels = sum(int(row["level"]) >= 0 for row in csv.DictReader(file))
    lines = fitted.err.splitlines()
    assert sum(LEVEL.fullmatch(line) is not None for line in lines) == levels > 0
    plan = json.loads(fitted.out)["plan"]
    assert sum(line.startswith("plan: ") for line in lines) > len(plan["decisions"]) > 0
    assert sum(line.startswith("fit: converged: ") for line in lines) == 1


def test_the_log_holds_the_same_lines_with_their_times(folder: Path, fitted: Told) -> None:
    head, *lines = (folder / "fit.log").read_text("utf-8").splitlines()
    assert head == HEAD
    rows = [re.fullmatch(r"(\d{4}-\d\d-\d\d [\d:,]+) (fitting\.[\w.]+): (.*)", s) for s in lines]
    assert all(rows)
    said = [row[3] for row in rows if row]
    assert set(fitted.err.splitlines()) <= set(said)
    assert [row[1] for row in rows if row] == sorted(row[1] for row in rows if row)


def test_a_log_is_added_to_and_nobody_hears_of_the_next_command(folder: Path) -> None:
    path = folder / "twice.log"
    for name in ("one", "two"):
        words = ("example", "afm_sensor", "--out", folder / name, "--log", path)
        assert told(*words).err == ""
    told("example", "afm_sensor", "--out", folder / "three")
    text = path.read_text("utf-8")
    assert text.count(HEAD) == 1
    assert [str(folder / name) in text for name in ("one", "two", "three")] == [True, True, False]
    assert not logging.getLogger(LOGGER).handlers
    assert logging.getLogger(LOGGER).level == logging.NOTSET


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("campaign.toml", ""),
        ("absent/file.log", os.strerror(errno.ENOENT)),
        (".", os.strerror(errno.EISDIR)),
        ("x" * 300, os.strerror(errno.ENAMETOOLONG)),
    ],
)
def test_a_log_that_cannot_be_written_is_refused(name: str, words: str, folder: Path) -> None:
    before = (folder / "campaign.toml").read_text()
    ended = told("example", "--log", folder / name)
    assert (ended.code, ended.out) == (2, "")
    place = folder / name
    assert ended.err.startswith(f"fmu-fit: --log {place}: ")
    assert words in ended.err
    assert ended.err.count("\n") == 1
    assert (folder / "campaign.toml").read_text() == before


def test_quiet_writes_its_files_and_says_nothing(folder: Path, fitted: Told) -> None:
    out = folder / "quiet"
    ended = told("reconstruct", folder / "campaign.toml", "--out", out, *FIT, "--quiet")
    assert ended == Told(0, "", "")
    found = json.loads((out / "result.json").read_text("utf-8"))["parameters"]
    assert found == json.loads(fitted.out)["parameters"]


def test_quiet_still_complains(folder: Path) -> None:
    ended = told("check", folder / "absent.fmu", "--quiet")
    assert (ended.code, ended.out) == (2, "")
    assert "absent.fmu: " in ended.err


def test_quiet_and_verbose_contradict_each_other() -> None:
    ended = told("example", "--quiet", "--verbose")
    assert ended.code == 2
    assert {"--quiet", "--verbose"} <= set(re.findall(r"--\w+", ended.err))


def test_what_identify_hands_over_is_its_file(folder: Path) -> None:
    words = ("--workers", "1", "--no-report", "--json", "--out", folder / "identified")
    ended = told("identify", folder / "campaign.toml", *words, "--budget", "300")
    assert ended.code == 0
    assert ended.out == (folder / "identified" / "identify.json").read_text("utf-8")


def test_a_budget_that_does_not_reach_anywhere_is_refused(folder: Path) -> None:
    words = ("--workers", "1", "--no-report", "--out", folder / "none")
    ended = told("identify", folder / "campaign.toml", *words, "--budget", "1")
    assert (ended.code, ended.out) == (2, "")
    assert "budget: found 1," in ended.err


def test_an_fmu_that_does_not_suit_is_told_in_the_document(swift_fmu: Path) -> None:
    campaign = ROOT / "data" / "duffing_string" / "campaign.toml"
    ended = told("check", swift_fmu, "--campaign", campaign, "--json")
    assert ended.code == 2
    found = json.loads(ended.out)
    assert not found["sound"]
    assert found["suits"] is None
    assert [f"fmu-fit: {line}" for line in found["unsuited"]] == ended.err.splitlines()


def test_a_sweep_as_a_document_is_its_table(swift_fmu: Path, tmp_path: Path) -> None:
    band = ("--from", "6.9399 MHz", "--to", "6.9405 MHz", "--points", "4", "--set", "A2=0")
    ended = told("sweep", swift_fmu, *band, "--out", tmp_path, "--json")
    found = json.loads(ended.out)
    with (tmp_path / "sweep.csv").open(encoding="utf-8") as file:
        _, *rows = csv.reader(file)
    table = np.array(rows, dtype=float)
    assert ended.code == 0
    np.testing.assert_allclose(found["frequency_hz"], table[:, 0], rtol=1e-12)
    np.testing.assert_allclose(found["amplitude"]["up"], table[:, 1], rtol=1e-6)
    assert (found["output"], found["unit"]) == ("q1_hybrid", "m")


def test_a_drive_and_its_plan_as_documents(swift_fmu: Path, tmp_path: Path) -> None:
    ended = told("simulate", swift_fmu, "--out", tmp_path, "--json")
    planned = told("simulate", swift_fmu, "--plan", "--json")
    assert (ended.code, planned.code) == (0, 0)
    found = json.loads(ended.out)
    assert json.loads(planned.out) == found["plan"]
    assert found["tones_hz"] == {"u1": 6940160.0, "u2": 6940360.0}
    spectrum = (tmp_path / "spectrum.csv").read_text("utf-8")
    peak = found["outputs"]["q1_hybrid"]["peaks"]["u1"]
    at_u1 = next(s for s in spectrum.splitlines() if s.startswith("6940160"))
    assert float(at_u1.split(",")[1]) == pytest.approx(peak, rel=1e-6)


def test_a_reader_of_the_document_may_leave_early(swift_fmu: Path) -> None:
    script = f"'{sys.executable}' -m fitting check '{swift_fmu}' --json | head -c 20"
    ended = subprocess.run(["sh", "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert (len(ended.stdout), ended.stderr) == (20, "")


def test_a_worker_that_is_replaced_is_a_line(
    swift_fmu: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run = Run(start_values={}, settle_s=0.0, sample_step_s=1e-4, samples=2, outputs=("q1",))
    with FmuWorkers(swift_fmu) as workers, caplog.at_level(logging.INFO, LOGGER):
        before = workers.run([run])
        os.kill(workers.pids[0], signal.SIGKILL)
        after = workers.run([run])
    np.testing.assert_array_equal(before, after)
    [said] = [record.getMessage() for record in caplog.records]
    assert said.startswith("worker 1: ")
    assert "SIGKILL" in said


def test_a_pipe_that_nobody_reads_is_no_log(folder: Path) -> None:
    os.mkfifo(path := folder / "pipe")
    ended = told("example", "--log", path)
    assert (ended.code, ended.out, ended.err.count("\n")) == (2, "", 1)
    assert ended.err.startswith(f"fmu-fit: --log {path}: ")
    path.unlink()
