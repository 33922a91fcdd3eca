"""Workers that are killed, what their FMUs leave, and what nobody is left to clear up."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from fitting.fmu.pool import FmuWorkers
from fitting.text.errors import FmuFailure, NoAnswer
from tests.support.cfmu_build import PULLED, build_c_fmu, misbehaving
from tests.support.processes import is_gone, is_stopped, wait_until

pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX"),
    pytest.mark.cold_start,
]

ROOT = Path(__file__).parents[2]
# values of `misbehave`, in the order of the enum in model.h
HANGS = 1
IS_KILLED, IS_KILLED_ONCE, FORKS, PRINTS_MUCH_AND_ABORTS, WRITES_FILE = range(11, 16)
#: What it prints, besides its very last line.
LINES = 300_000


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_c_fmu(tmp_path_factory.mktemp("cfmus"))


def pulled(workers: FmuWorkers) -> list[float]:
    [result] = workers.run([PULLED])
    return [float(x) for x in result[:, 0]]


@pytest.mark.parametrize("count", [2, pytest.param(1, marks=pytest.mark.nightly)])
def test_a_killed_worker_is_replaced_and_does_its_runs_again(
    good: Path, tmp_path: Path, count: int
) -> None:
    """Killed in the middle of a batch, whose first runs it has done already."""
    forces = [replace(PULLED, start_values={"force": 1.0 + k}) for k in range(6)]
    once = misbehaving(IS_KILLED_ONCE, tmp_path / "killed")
    with FmuWorkers(good, workers=count) as workers:
        undisturbed = workers.run([*forces, PULLED, PULLED])
        results = workers.run([*forces, once, PULLED])
        assert workers.counts.processes == count + 1
    assert (tmp_path / "killed").exists()
    assert [r.tobytes() for r in results] == [r.tobytes() for r in undisturbed]


def test_a_worker_that_is_killed_again_is_told_as_that(good: Path) -> None:
    bad = misbehaving(IS_KILLED)
    with FmuWorkers(good) as workers:
        expected = pulled(workers)
        with pytest.raises(NoAnswer, match=r"\(SIGKILL\) twice.*memory") as failure:
            workers.run([PULLED, bad, PULLED])
        assert failure.value.parameters == bad.start_values
        assert workers.counts.processes == 2
        assert pulled(workers) == expected


@pytest.mark.parametrize(
    "how",
    [signal.SIGKILL, signal.SIGTERM, pytest.param(signal.SIGHUP, marks=pytest.mark.nightly)],
)
def test_a_signal_to_an_idle_worker_is_not_noticed(good: Path, how: signal.Signals) -> None:
    """What asks all processes of a job to end is dealt with by the caller alone."""
    with FmuWorkers(good) as workers:
        expected = pulled(workers)
        [pid] = workers.pids
        os.kill(pid, how)
        if how == signal.SIGKILL:
            wait_until(lambda: is_gone(pid), "the end of the worker")
        assert pulled(workers) == expected
        assert workers.counts.processes == (2 if how == signal.SIGKILL else 1)


def child_of(label: Path) -> int:
    """Number of the process that the FMU has started."""
    wait_until(lambda: label.exists() and label.read_text().endswith("\n"), "the FMU's own child")
    return int(label.read_text())


def test_what_an_fmu_starts_ends_with_it(good: Path, tmp_path: Path) -> None:
    label = tmp_path / "child"
    with FmuWorkers(good) as workers:
        workers.run([misbehaving(FORKS, label)])
        child = child_of(label)
        assert not is_gone(child)
    wait_until(lambda: is_gone(child), "the end of the FMU's child")


def test_a_worker_is_missed_though_a_child_keeps_its_pipe_open(good: Path, tmp_path: Path) -> None:
    """The child of a dead process answers nothing; nobody waits a time-out for that."""
    label = tmp_path / "child"
    with FmuWorkers(good, timeout_s=1e6) as workers:
        expected = pulled(workers)
        workers.run([misbehaving(FORKS, label)])
        [pid] = workers.pids
        os.kill(pid, signal.SIGKILL)
        assert pulled(workers) == expected
        wait_until(lambda: is_gone(child_of(label)), "the end of the FMU's child")


CALLER = """
import sys
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run
workers = FmuWorkers(sys.argv[1])

def run(**values):
    run = Run(
        start_values=values, settle_s=0.0, sample_step_s=1.0, samples=2, outputs=("displacement",)
    )
    return workers.run([run])

if sys.argv[2]:
    run(misbehave=13, label=sys.argv[2])
run()
print(*workers.pids, workers._open.home, flush=True)
sys.stdin.read()
"""


def started(good: Path, folder: Path, child: Path | str = "") -> subprocess.Popen[str]:
    script = folder / "caller.py"
    script.write_text(CALLER)
    return subprocess.Popen(
        [sys.executable, str(script), str(good), str(child)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(folder)},
        text=True,
    )


def told(caller: subprocess.Popen[str]) -> tuple[int, Path]:
    assert caller.stdout is not None
    pid, home = caller.stdout.readline().split()
    return int(pid), Path(home)


def test_what_an_fmu_starts_ends_when_the_caller_is_killed(good: Path, tmp_path: Path) -> None:
    with started(good, tmp_path, tmp_path / "child") as caller:
        pid, home = told(caller)
        child = child_of(tmp_path / "child")
        caller.kill()
        for number in (pid, child):
            wait_until(lambda number=number: is_gone(number), "the end of worker and child")  # type: ignore[misc]
        assert not home.exists()
        # the pipe of the caller's output ends, too: nobody has inherited it
        assert caller.stdout is not None
        assert caller.stdout.read() == ""


def test_the_next_run_removes_what_killed_ones_left(
    good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Caller and worker killed at once: neither can clear up. Folders of the living stay."""
    (tmp_path / "fmu-fit-results").mkdir()  # somebody's own, by chance of that name
    with started(good, tmp_path) as living, started(good, tmp_path) as dying:
        _, kept = told(living)
        pid, home = told(dying)
        os.kill(pid, signal.SIGSTOP)  # so that it does not clear up
        wait_until(lambda: is_stopped(pid), "the stop")
        dying.kill()
        dying.wait()
        os.kill(pid, signal.SIGKILL)
        assert home.exists()
        monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
        with FmuWorkers(good) as workers:
            pulled(workers)
            assert not home.exists()
            assert kept.exists()
            assert (tmp_path / "fmu-fit-results").exists()
        assert living.stdin is not None
        living.stdin.close()
    assert [path.name for path in tmp_path.glob("fmu-fit-*")] == ["fmu-fit-results"]


def test_only_the_end_of_what_an_fmu_prints_is_kept(good: Path) -> None:
    with FmuWorkers(good) as workers, pytest.raises(FmuFailure) as failure:
        workers.run([misbehaving(PRINTS_MUCH_AND_ABORTS)])
    message = failure.value.message
    assert "SIGABRT" in message
    assert "last line (… " in message
    words, _, rest = message.partition("; its last words: ")[2].partition(" (… ")
    assert len(words) <= 500
    assert rest.endswith(" dropped)")
    assert int(rest.split()[0]) == LINES + 1 - len(words.splitlines())


def test_an_fmu_runs_in_a_folder_of_its_own(
    good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with FmuWorkers(good) as workers:
        home = workers._open.home
        workers.run([misbehaving(WRITES_FILE)])
        assert home is not None
        [written] = home.glob("**/trace.txt")
        assert len(list(written.parent.iterdir())) == 1
    assert not home.exists()
    assert list(tmp_path.iterdir()) == []
