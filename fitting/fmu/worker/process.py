"""One worker process, seen from the caller: start, hand over, notice its end, kill."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from multiprocessing import Pipe, connection, spawn
from pathlib import Path
from typing import Any

from fitting.fmu.worker import main as worker_main
from fitting.fmu.worker.messages import Batch, Reply, Task, UnpackedFmu
from fitting.fmu.worker.pulse import AT_RUN, BEGUN, IN_TRIAL, new_pulse
from fitting.fmu.worker.reuse import ReuseDecision

START_S = 120.0  # longest start of a process, before it touches the FMU
LAST_WORDS = 500  # characters of what the FMU printed before it crashed


class WorkerProcess:
    """A process that serves one FMU.

    ``verdict``: what is known about reuse; ``home`` / ``name``.log and .pulse: files that it uses.

    Raises OSError if no process can be started.
    """

    def __init__(self, fmu: UnpackedFmu, verdict: ReuseDecision, home: Path, name: str) -> None:
        self._log_path = home / f"{name}.log"
        pulse_path = home / f"{name}.pulse"
        self._pulse = new_pulse(pulse_path)
        self.pipe, theirs = Pipe()
        try:
            self._process = _start(theirs, self._log_path)
        except OSError:
            self.pipe.close()
            self._pulse.close()
            raise
        finally:
            theirs.close()
        self._begun = -1
        self._since = 0.0
        # the import path by itself: what follows cannot be read before it is known
        try:
            self._hand_over(sys.path)
            self._hand_over(
                Task(
                    fmu=fmu,
                    verdict=verdict,
                    log_path=str(self._log_path),
                    pulse_path=str(pulse_path),
                )
            )
        except BaseException:
            self.end()
            raise

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def send(self, batch: Batch) -> None:
        """Hand over a batch; that the process has ended is found out by `receive`.

        Args:
            batch: runs, and how they are simulated.
        """
        self._begun, self._since = -1, time.monotonic()
        self._pulse.numbers[AT_RUN] = 0
        self._hand_over(batch)

    def receive(self) -> Reply | None:
        """The answer to the batch; None if the process has ended without one."""
        try:
            reply: Reply = self.pipe.recv()
        except (EOFError, OSError):
            self._process.wait()
            return None
        return reply

    @property
    def at_run(self) -> int:
        """Which run of the batch is under way."""
        return self._pulse.numbers[AT_RUN]

    @property
    def in_trial(self) -> bool:
        """Whether the FMU is only being tried after a reset."""
        return bool(self._pulse.numbers[IN_TRIAL])

    def is_late(self, timeout_s: float) -> bool:
        """Whether the process began something longer than that ago; its own start is not counted.

        A start has a limit of its own: on a busy machine, Python alone may take seconds.

        Args:
            timeout_s: longest silence, s.
        """
        begun = self._pulse.numbers[BEGUN]
        if begun != self._begun:
            self._begun, self._since = begun, time.monotonic()
        return time.monotonic() - self._since > (timeout_s if begun else max(timeout_s, START_S))

    def cause_of_death(self) -> str:
        """A sentence on how the process ended and what the FMU printed last."""
        code = self._process.returncode or 0
        if code < 0:
            try:
                how = f"crashed its process ({signal.Signals(-code).name})"
            except ValueError:
                how = f"crashed its process (signal {-code})"
        else:
            how = f"ended its process (exit code {code})"
        try:
            words = self._log_path.read_text("utf-8", "replace").strip()[-LAST_WORDS:]
        except OSError:
            words = ""
        return f"{how}; its last words: {words}" if words else f"{how} without a word"

    def ask_to_end(self) -> None:
        """Let the process free its FMU and end."""
        self._hand_over(None)

    def end(self, within_s: float = 0.0) -> None:
        """Wait for the process to end by itself, then kill it.

        Args:
            within_s: time that the process is given to end by itself, s.
        """
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(within_s)
        self._process.kill()
        self._process.wait()
        self.pipe.close()
        self._pulse.close()

    def _hand_over(self, message: object) -> None:
        with contextlib.suppress(OSError):
            self.pipe.send(message)


def _start(theirs: connection.Connection, log_path: Path) -> subprocess.Popen[bytes]:
    """A process with its end of the pipe, its output in a file, and deaf to Ctrl-C."""
    python, environment = _interpreter()
    handle = theirs.fileno()
    # -P: neither the current folder nor that of the program is a place to import from
    command = [python, "-P", worker_main.__file__, str(handle)]
    options: dict[str, Any]
    if sys.platform == "win32":
        os.set_handle_inheritable(handle, True)
        options = {
            "startupinfo": subprocess.STARTUPINFO(lpAttributeList={"handle_list": [handle]}),
            "creationflags": subprocess.CREATE_NEW_PROCESS_GROUP,
        }
    else:
        options = {"pass_fds": (handle,)}
    with log_path.open("wb") as log, _interrupts_held():
        return subprocess.Popen(  # noqa: S603
            command,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            env=environment,
            **options,
        )


def _interpreter() -> tuple[str, dict[str, str] | None]:
    """Path of Python, and the environment that it wants (None: the present one).

    On Windows, python.exe of a virtual environment only starts another process, which would outlive
    it when it is killed. `multiprocessing.set_executable` is heeded, for embedded interpreters.
    """
    python = os.fsdecode(spawn.get_executable())
    base = getattr(sys, "_base_executable", python)
    if sys.platform == "win32" and python == sys.executable != base:
        return base, {**os.environ, "__PYVENV_LAUNCHER__": python}
    return python, None


@contextlib.contextmanager
def _interrupts_held() -> Iterator[None]:
    """A process that is started meanwhile is not ended by Ctrl-C before it can ignore it."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
