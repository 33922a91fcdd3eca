"""Other processes in tests: are they gone, and waiting for what they will do.

Nothing here is a claim about speed: the bound of a wait only stops a test that would hang.
"""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType

MOST_S = 300.0
#: Signals that ask a process to end.
ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def wait_until(holds: Callable[[], bool], what: str, most_s: float = MOST_S) -> None:
    """Wait for a condition; AssertionError with its name if it does not come to hold."""
    until = time.monotonic() + most_s
    while not holds():
        assert time.monotonic() < until, f"waited {most_s:g} s for: {what}"
        time.sleep(0.02)


def is_gone(pid: int) -> bool:
    """Whether no process of that number runs; one that only waits to be collected is gone."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return False


def is_stopped(pid: int) -> bool:
    """Whether all threads of a process have stopped; a stop that was asked for takes a while."""
    tasks = Path(f"/proc/{pid}/task")
    if not tasks.exists():
        return True
    states = [(task / "stat").read_text().rpartition(")")[2].split()[0] for task in tasks.iterdir()]
    return set(states) == {"T"}


class Clock:
    """The clock by which workers are late: ten seconds on at every look while ``runs`` holds."""

    def __init__(self) -> None:
        self.now = 0.0
        self.runs: Callable[[], bool] = lambda: False

    def monotonic(self) -> float:
        self.now += 10.0 * self.runs()
        return self.now


def ignored_ends() -> dict[signal.Signals, signal.Handlers]:
    """Signals that should end a job and are ignored, as after nohup, and what they should do."""
    return {s: signal.SIG_DFL for s in ENDS if signal.getsignal(s) == signal.SIG_IGN}


class Job:
    """``fmu-fit`` as a process of its own, with a folder of its own for temporary files.

    Args:
        words: of the command line.
        temporary: the folder, made here.
        ignored: number of a signal that it is started with ignored, as by ``nohup``; 0: none.
    """

    def __init__(self, words: Sequence[str], temporary: Path, ignored: int = 0) -> None:
        self.temporary = temporary
        temporary.mkdir(parents=True, exist_ok=True)
        self._words, self._ignored = words, ignored
        self._files = [(temporary.parent / f"{temporary.name}.{name}") for name in ("out", "err")]
        self._workers: set[int] = set()

    def __enter__(self) -> Job:
        changed = ignored_ends()
        if self._ignored:
            changed[signal.Signals(self._ignored)] = signal.SIG_IGN
        before = {s: signal.signal(s, how) for s, how in changed.items()}
        try:
            with self._files[0].open("wb") as out, self._files[1].open("wb") as err:
                self._process = subprocess.Popen(
                    [sys.executable, "-m", "fitting", *self._words],
                    stdout=out,
                    stderr=err,
                    env={**os.environ, "TMPDIR": str(self.temporary), "OPENBLAS_NUM_THREADS": "1"},
                )
        finally:
            for s, how in before.items():
                signal.signal(s, how)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.kill()
        self._process.wait()

    @property
    def is_running(self) -> bool:
        """Whether the process has not ended."""
        return self._process.poll() is None

    def send(self, number: int) -> None:
        """Send a signal to the process alone."""
        self._workers |= self.workers()
        self._process.send_signal(number)

    def workers(self) -> set[int]:
        """Numbers of its child processes (Linux)."""
        try:
            told = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children").read_text()
        except OSError:
            return set()
        return set(map(int, told.split()))

    def kill_workers(self) -> None:
        """Kill all child processes."""
        for pid in self.workers():
            self._workers.add(pid)
            with contextlib.suppress(ProcessLookupError):  # it may have ended since
                os.kill(pid, signal.SIGKILL)

    def ended(self) -> tuple[int, str, str]:
        """Exit code, output and errors, once it has ended."""
        wait_until(lambda: not self.is_running, "the end of the command")
        out, err = (path.read_text("utf-8") for path in self._files)
        return self._process.returncode, out, err

    def left_behind(self) -> list[str]:
        """Temporary files and processes that are still there some time after the end."""
        try:
            wait_until(lambda: all(map(is_gone, self._workers)), "the end of the workers", 60.0)
        except AssertionError as error:
            return [str(error)]
        return sorted(path.name for path in self.temporary.iterdir())


def spent_s() -> float:
    """Processor time of this process and of those of its children that have ended, s."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(used.ru_utime + used.ru_stime for used in both)
