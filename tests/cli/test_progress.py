"""Progress of a long job: what is said of it, and where."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from fitting.api.cost import Expected
from fitting.api.fitted import Progress
from fitting.cli.running.progress import hidden, status_line
from fitting.cli.running.remaining import Remaining
from tests.support.small_campaign import small_campaign

ROOT = Path(__file__).parents[2]
EXPECTED = Expected(
    parameters=3,
    alternatives=1,
    levels=4,
    starts=1,
    profiled=2,
    outputs=1,
    refits=0,
    search=(100.0, 400.0),
    profiles=(200.0, 1000.0),
    bootstrap=(0.0, 0.0),
    output_runs=(0.0, 0.0),
)
FIRST = Progress(
    alternative=0,
    alternatives=1,
    start=0,
    starts=1,
    level=0,
    levels=4,
    nu=0.1,
    j_fit=float("nan"),
    j_reg=float("nan"),
    evaluations=0,
    done=0,
    of=4,
    elapsed_s=0.0,
    left_s=float("nan"),
    seconds_each=float("nan"),
)


def test_the_first_line_knows_no_number_and_tells_none() -> None:
    assert Remaining(EXPECTED).searching(FIRST) == "alternative 1/1, start 1/1, ν = 1e-01"


def test_what_is_left_counts_the_profiles_in() -> None:
    """Half of the levels done at 0.1 s an evaluation: 50 to 200 and the profiles are left."""
    state = replace(FIRST, j_fit=0.5, j_reg=0.25, evaluations=90, done=2, seconds_each=0.1)
    said = Remaining(EXPECTED).searching(state)
    assert said.endswith("J = 0.75, up to 2 min left")


def test_the_profiles_have_a_pace_of_their_own() -> None:
    now = iter([0.0, 10.0, 10.0, 100.0, 200.0])
    remaining = Remaining(EXPECTED, clock=lambda: next(now))
    assert remaining.walking(0) == "profiles of 2 values, 0 evaluations"
    # 100 in ten seconds: 100 to 900 are left
    assert remaining.walking(100) == "profiles of 2 values, 100 evaluations, 10 to 90 s left"
    assert remaining.walking(500) == "profiles of 2 values, 500 evaluations, up to 10 s left"
    assert remaining.walking(1000).endswith("1000 evaluations, longer than expected")


def test_no_time_is_told_of_a_pace_that_was_hardly_seen() -> None:
    now = iter([0.0, 1.0, 10.0])
    remaining = Remaining(EXPECTED, clock=lambda: next(now))
    assert remaining.walking(0).endswith(" 0 evaluations")
    assert remaining.walking(400).endswith(" 400 evaluations")  # fast ones, for a second
    assert remaining.walking(500).endswith(" left")
    hardly = replace(FIRST, evaluations=9, done=1, seconds_each=0.1)
    assert "left" not in Remaining(EXPECTED).searching(hardly)


def test_the_time_left_runs_down_while_estimates_waver_and_follows_what_they_say() -> None:
    """The paces that are seen would say 90, 89, 121 and 95 s."""
    now = iter([0.0, 10.0, 11.0, 12.0, 13.0, 40.0])
    told = Remaining(replace(EXPECTED, profiles=(0.0, 10_000.0)), clock=lambda: next(now))
    told.walking(0)
    said = [told.walking(n).partition("up to ")[2] for n in (1000, 1100, 900, 1200)]
    assert said == ["90 s left", "89 s left", "88 s left", "87 s left"]
    # half as fast as it was: 40 s for 2000 leave 160 s for the other 8000
    assert told.walking(2000).endswith("up to 3 min left")


def test_nothing_is_shown_where_it_is_hidden(capsys: pytest.CaptureFixture[str]) -> None:
    before = threading.active_count()
    with hidden(), status_line("job") as tell:
        tell("working")
        assert threading.active_count() == before
    assert capsys.readouterr().err == ""


def test_lines_in_a_pipe_have_words_and_a_time(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fitting.cli.running.progress.FIRST_S", 0.01)
    monkeypatch.setattr("fitting.cli.running.progress.MOST_S", 0.01)
    counted = threading.Event()

    def runs() -> str:
        counted.set()
        return "12 runs"

    with status_line("job", runs) as tell:
        tell("half done")
        counted.clear()
        assert counted.wait(60.0)
    last = capsys.readouterr().err.splitlines()[-1]
    assert re.fullmatch(r"job: half done, 12 runs, \d+ s", last)


def test_a_terminal_gets_no_colours(oscillator_fmu: Path, tmp_path: Path) -> None:
    """On a terminal of its own, with lines above the one that lives there."""
    campaign = small_campaign(tmp_path / "small", oscillator_fmu)
    ours, theirs = pty.openpty()
    words = [sys.executable, "-m", "fitting", "reconstruct", str(campaign), "--verbose"]
    words += ["--no-report", "--no-profiles", "--workers", "1", "--out", str(tmp_path / "out")]
    with subprocess.Popen(
        words,
        cwd=ROOT,
        stderr=theirs,
        stdout=subprocess.DEVNULL,
        env={**os.environ, "NO_COLOR": "1"},
    ) as command:
        os.close(theirs)
        said = b""
        while True:
            try:
                said += (more := os.read(ours, 4096))
            except OSError:  # Linux: nobody has the other end open any more
                break
            if not more:
                break
    os.close(ours)
    assert command.returncode == 0
    assert b"fit: converged: " in said
    assert re.findall(rb"\x1b\[[0-9;]*m", said) == []
    assert b"nan" not in said
