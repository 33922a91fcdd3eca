"""Local processes: what is lost with one of them, and what never is."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from fitting.engine.local import LocalProcesses, LostProcess
from fitting.engine.run import Place, opened, run
from fitting.text.errors import BadInput
from tests.support import work
from tests.support.processes import is_gone, wait_until
from tests.support.work import Piece


@pytest.fixture(scope="module")
def two() -> Iterator[LocalProcesses]:
    executor = LocalProcesses(2)
    yield executor
    executor.shutdown()


def test_every_item_is_done_once(two: LocalProcesses) -> None:
    ended = list(run(work.squared, (Piece(k) for k in range(40)), Place(two)))
    assert sorted(result for _, result, _ in ended if result) == [(k, k * k) for k in range(40)]
    assert all(item.number == result[0] for item, result, _ in ended if result)


def test_a_lost_process_costs_its_item_a_repetition(two: LocalProcesses, tmp_path: Path) -> None:
    pieces = [Piece(k, str(tmp_path)) for k in range(8)]
    ended = list(run(work.squared_after_a_loss, pieces, Place(two)))
    assert (tmp_path / "lost").exists()
    assert sorted(result for _, result, _ in ended if result) == [(k, k * k) for k in range(8)]


def test_one_that_is_lost_twice_is_told_and_costs_no_other(
    two: LocalProcesses, tmp_path: Path
) -> None:
    pieces = [Piece(k, str(tmp_path)) for k in range(8)]
    ended = list(run(work.always_lost, pieces, Place(two)))
    assert len(list(tmp_path.glob("lost*"))) == 2
    [(item, result, lost)] = [e for e in ended if e[2]]
    assert (item.number, result) == (3, None)
    assert "signal 9" in lost
    assert sorted(result for _, result, _ in ended if result) == [
        (k, k * k) for k in range(8) if k != 3
    ]


def test_what_no_pickle_can_carry_is_told(two: LocalProcesses) -> None:
    with pytest.raises(RuntimeError, match="Local"):
        two.submit(work.refusing, Piece(1)).result()
    assert two.submit(work.refusing, Piece(2)).result() == (2, 4)


@pytest.mark.cold_start
def test_processes_have_one_thread_and_nothing_of_the_callers_program() -> None:
    one = LocalProcesses(1)
    try:
        assert one.submit(work.environment, "OPENBLAS_NUM_THREADS").result() == "1"
        assert one.submit(work.main_file, 0).result() == "child.py"
    finally:
        one.shutdown(wait=False)


def test_an_end_is_not_waited_for_and_leaves_nothing(tmp_path: Path) -> None:
    executor = LocalProcesses(1)
    running = executor.submit(work.endless, Piece(0, str(tmp_path)))
    waiting = executor.submit(work.squared, Piece(1))
    wait_until(lambda: any(tmp_path.iterdir()), "the endless item")
    [pid] = executor.pids
    home = executor._home.path
    executor.shutdown(wait=False)
    assert isinstance(running.exception(), LostProcess)
    assert waiting.cancelled()
    assert is_gone(pid)
    assert not home.exists()
    with pytest.raises(RuntimeError, match="after shutdown"):
        executor.submit(work.squared, Piece(2))


SCRIPT = """
import sys
from fitting.engine.local import LocalProcesses
from tests.support import work
executor = LocalProcesses(1)
executor.submit(work.endless, work.Piece(0, sys.argv[1])).result()
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_processes_end_with_a_caller_that_is_killed(tmp_path: Path) -> None:
    caller = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(tmp_path)],
        cwd=Path(__file__).parents[2],
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    try:
        wait_until(lambda: any(tmp_path.glob("pid*")), "the endless item")
    finally:
        caller.send_signal(signal.SIGKILL)
        caller.wait()
    [mark] = tmp_path.glob("pid*")
    wait_until(lambda: is_gone(int(mark.name.removeprefix("pid"))), "the end of the process")


@pytest.mark.parametrize("count", [0, 257])
def test_an_impossible_number_of_processes_is_refused(count: int) -> None:
    with pytest.raises(BadInput, match=f"{count}.*256"), opened(count, ()):
        pass
