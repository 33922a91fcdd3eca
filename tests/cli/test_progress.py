"""Progress of a long job: what is said of it, and where."""

from __future__ import annotations

import itertools
import os
import pty
import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from fitting.api.cost import Expected
from fitting.api.fitted import Progress, Spent
from fitting.api.progress import hidden, status_line
from fitting.cli.main import main
from fitting.cli.running.remaining import Remaining
from fitting.inference.cost import Stage
from tests.support.small_campaign import of_pairs, small_campaign

ROOT = Path(__file__).parents[2]
EXPECTED = Expected(
    parameters=3,
    alternatives=1,
    levels=4,
    starts=1,
    profiled=2,
    outputs=1,
    refits=0,
    search=(40.0, 80.0),
    path=(100.0, 400.0),
    profiles=(200.0, 1000.0),
    stages={
        Stage.MINIMA: (50.0, 100.0),
        Stage.SCANS: (100.0, 700.0),
        Stage.DIRECTIONS: (50.0, 200.0),
    },
    bootstrap=(0.0, 0.0),
    output_runs=(0.0, 0.0),
)
FIRST = Progress(
    stage="search",
    done=0,
    of=1,
    nu=float("nan"),
    j_fit=float("nan"),
    j_reg=float("nan"),
    evaluations=0,
    elapsed_s=0.0,
)
LEVEL = replace(FIRST, stage="path", of=4, nu=0.1)


class Clock:
    """Seconds that pass when it is told."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def told(clock: Clock) -> Remaining:
    """Of a job without a report."""
    return Remaining(EXPECTED, drawn=False, clock=clock)


def after(told: Remaining, clock: Clock, now_s: float, spent: Spent) -> str:
    """What is left at a moment: the evaluations told before have been made by then."""
    clock.now_s = now_s
    told.profiling(spent)
    return told.left()


def span_s(words: str) -> tuple[float, float]:
    """Both ends of what is told, s; where one alone is told it is the upper one, from 0 on.

    Of "about 10 s" both are the same; of more than was expected nothing is left.
    """
    if "expected" in words:
        return (0.0, 0.0)
    match = re.fullmatch(r"(?:(about )|up to |(\d+) to )(\d+) (s|min) left", words)
    assert match, words
    size = 60.0 if match[4] == "min" else 1.0
    high = size * float(match[3])
    return (high if match[1] else size * float(match[2] or 0.0), high)


def most_s(words: str) -> float:
    """The upper end of what is told, s."""
    return span_s(words)[1]


def counts(words: str) -> list[str]:
    """Whole numbers that are told, as they stand."""
    return re.findall(r"\d+", words)


def test_the_first_line_knows_no_number_and_tells_none(told: Remaining) -> None:
    assert told.searching(FIRST) == "search, alternative 1/1"
    assert told.left() == ""
    assert told.searching(replace(LEVEL, done=2, nu=1e-3)) == "path, level 3/4, ν = 1e-03"


def test_what_is_left_counts_profiles_and_figures_in(told: Remaining, clock: Clock) -> None:
    """Half of the levels done at 0.05 s an evaluation: 50 to 200 and the profiles are left."""
    state = replace(LEVEL, j_fit=0.5, j_reg=0.25, evaluations=90, done=2, elapsed_s=4.5)
    assert told.searching(state).endswith("J = 0.75")
    assert span_s(told.left()) == (12.0, 60.0)
    drawn = Remaining(EXPECTED, clock=clock)  # and ten figures, half a second to two each
    drawn.searching(state)
    assert span_s(drawn.left()) == (18.0, 80.0)


def test_a_stage_that_ended_early_is_not_waited_for(told: Remaining, clock: Clock) -> None:
    """Walks take 100 to 700 evaluations, what has no effect 50 to 200."""
    said = told.profiling(Spent(Stage.SCANS, 100, 0))
    assert Stage.SCANS in said
    assert counts(said) == ["2", "100"]  # of two values, evaluations
    # 100 in ten seconds: up to 500 and 50 to 200 are left
    assert span_s(after(told, clock, 10.0, Spent(Stage.SCANS, 200, 0))) == (5.0, 70.0)
    assert span_s(after(told, clock, 20.0, Spent(Stage.SCANS, 600, 0))) == (5.0, 35.0)
    assert span_s(after(told, clock, 30.0, Spent(Stage.DIRECTIONS, 0, 600))) == (2.0, 10.0)


def test_the_time_left_runs_down_while_nothing_is_told(told: Remaining, clock: Clock) -> None:
    told.profiling(Spent(Stage.DIRECTIONS, 100, 0))
    assert span_s(after(told, clock, 10.0, Spent(Stage.DIRECTIONS, 101, 0))) == (0.0, 10.0)
    clock.now_s = 14.0
    assert span_s(told.left()) == (0.0, 6.0)
    clock.now_s = 21.0
    assert span_s(told.left()) == (0.0, 0.0)


def test_profiles_that_begin_anew_keep_their_pace(told: Remaining, clock: Clock) -> None:
    """At 0.05 s an evaluation 150 to 925 are left, not the 0.4 s of all that was before."""
    told.profiling(Spent(Stage.SCANS, 600, 0))
    after(told, clock, 30.0, Spent(Stage.DIRECTIONS, 0, 600))
    said = after(told, clock, 40.0, Spent(Stage.MINIMA, 100, 0))
    assert 40.0 < most_s(said) < 70.0
    later = after(told, clock, 50.0, Spent(Stage.MINIMA, 110, 0))
    assert 35.0 < most_s(later) < 70.0


def test_a_stage_that_takes_longer_is_given_a_quarter_more(told: Remaining, clock: Clock) -> None:
    told.profiling(Spent(Stage.DIRECTIONS, 400, 0))
    assert span_s(after(told, clock, 40.0, Spent(Stage.DIRECTIONS, 401, 0))) == (0.0, 10.0)


def test_no_time_is_told_of_a_pace_that_was_hardly_seen(told: Remaining, clock: Clock) -> None:
    told.profiling(Spent(Stage.SCANS, 400, 0))
    assert after(told, clock, 1.0, Spent(Stage.SCANS, 500, 0)) == ""  # fast ones, for a second
    assert after(told, clock, 10.0, Spent(Stage.SCANS, 600, 0)).endswith(" left")
    hardly = Remaining(EXPECTED)
    hardly.searching(replace(LEVEL, evaluations=9, done=1, elapsed_s=0.9))
    assert hardly.left() == ""


def test_the_time_left_runs_down_while_estimates_waver_and_follows_what_they_say(
    clock: Clock,
) -> None:
    """The paces that are seen would say 89, 88, 87.5 and 89 s."""
    stages = {**EXPECTED.stages, Stage.SCANS: (0.0, 10_000.0), Stage.DIRECTIONS: (0.0, 0.0)}
    told = Remaining(replace(EXPECTED, stages=stages), drawn=False, clock=clock)
    for k in range(10):
        after(told, clock, float(k), Spent(Stage.SCANS, 100 * (k + 1), 0))
    counts = {10.0: 1100, 11.0: 1200, 12.0: 1250, 13.0: 1450}
    said = [after(told, clock, at_s, Spent(Stage.SCANS, n, 0)) for at_s, n in counts.items()]
    assert [most_s(words) for words in said] == [89.0, 88.0, 87.0, 86.0]
    # 200 in 27 s, where they took two
    assert span_s(after(told, clock, 40.0, Spent(Stage.SCANS, 2050, 0))) == (0.0, 240.0)


def test_over_a_whole_job_the_end_is_never_put_off(clock: Clock) -> None:
    """400 evaluations at 0.1 s, 330 at 0.2 s, seven figures and a page: 114 s in all."""
    told = Remaining(EXPECTED, clock=clock)
    ends: list[float] = []
    left: list[tuple[float, float]] = []

    def look() -> None:
        if words := told.left():
            ends.append(clock.now_s + most_s(words))
            left.append((114.0 - clock.now_s, most_s(words)))

    for done in range(5):
        told.searching(replace(LEVEL, evaluations=100 * done, done=done, elapsed_s=10.0 * done))
        look()
        clock.now_s += 10.0 * (done < 4)
    before = 0
    for stage, count in ((Stage.MINIMA, 70), (Stage.SCANS, 200), (Stage.DIRECTIONS, 60)):
        for k in range(0, count, 10):
            told.profiling(Spent(stage, k + 10, before))
            look()
            clock.now_s += 2.0
        before += count
    told.profiling(Spent(Stage.DIRECTIONS, 0, before))
    look()
    last = [end for end, (true_s, _) in zip(ends, left, strict=True) if true_s <= 20.0]
    assert len(last) > 5
    assert all(later <= sooner for sooner, later in itertools.pairwise(last))
    assert all(true_s <= said_s for true_s, said_s in left)


def test_nothing_is_shown_where_it_is_hidden(capsys: pytest.CaptureFixture[str]) -> None:
    before = threading.active_count()
    with hidden(), status_line("job") as tell:
        tell("working")
        assert threading.active_count() == before
    assert capsys.readouterr().err == ""


def test_lines_in_a_pipe_have_words_and_a_time(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fitting.api.progress.FIRST_S", 0.01)
    monkeypatch.setattr("fitting.api.progress.MOST_S", 0.01)
    counted = threading.Event()

    def runs() -> str:
        counted.set()
        return "12 runs"

    with status_line("job", runs) as tell:
        tell("half done")
        counted.clear()
        assert counted.wait(60.0)
    last = capsys.readouterr().err.splitlines()[-1]
    *words, time = re.split(": |, ", last)
    assert words == ["job", "half done", "12 runs"]
    assert re.fullmatch(r"\d+ s", time)


def test_a_terminal_gets_no_colours(swift_fmu: Path, tmp_path: Path) -> None:
    """On a terminal of its own, with lines above the one that lives there."""
    campaign = of_pairs(small_campaign(tmp_path / "small", swift_fmu), 1)
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


def test_the_progress_of_a_fit_counts_its_runs(
    tmp_path: Path, swift_fmu: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []

    @contextmanager
    def at_the_end(label: str, counted: Callable[[], str]) -> Iterator[Callable[[str], None]]:
        yield lambda text: None
        shown.append(counted())

    monkeypatch.setattr("fitting.cli.running.reconstruction.status_line", at_the_end)
    campaign = of_pairs(small_campaign(tmp_path / "small", swift_fmu), 1)
    words = ["reconstruct", str(campaign), "--quick", "--no-profiles", "--no-report"]
    assert main([*words, "--workers", "1", "--out", str(tmp_path / "out")]) == 0
    [runs] = [int(n) for text in shown for n in re.findall(r"(\d+) runs", text)]
    assert runs > 100
