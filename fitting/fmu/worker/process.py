"""One worker process, seen from the caller: start, hand over, notice its end, kill."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from multiprocessing import Pipe, connection, spawn
from pathlib import Path
from typing import IO, Any, NamedTuple, cast

from fitting.fmu.worker import main as worker_main
from fitting.fmu.worker.messages import Batch, Reply, Task, UnpackedFmu
from fitting.fmu.worker.printed import Printed
from fitting.fmu.worker.pulse import AT_RUN, BEGUN, IN_TRIAL, new_pulse
from fitting.fmu.worker.reuse import ReuseDecision

START_S = 120.0  # longest start of a process, before it touches the FMU
ENDING_S = 10.0  # longest end of a process that has closed its pipe
#: Signals from outside that end a process; whatever else ends it is the FMU's doing.
FROM_OUTSIDE = ("SIGKILL", "SIGTERM", "SIGHUP")


class Death(NamedTuple):
    """How a process ended, in a sentence; ``killed_by`` names the signal of somebody outside."""

    how: str
    killed_by: str


class WorkerProcess:
    """A process that serves one FMU, in an empty folder that is removed with it.

    It heads a group of its own, which the processes that an FMU starts belong to and end with.

    ``verdict``: what is known about reuse; ``home``: folder for its files, which ``name`` begins.

    Raises OSError if no process can be started.
    """

    def __init__(self, fmu: UnpackedFmu, verdict: ReuseDecision, home: Path, name: str) -> None:
        pulse_path = home / f"{name}.pulse"
        self._pulse = new_pulse(pulse_path)
        self._folder = Path(tempfile.mkdtemp(prefix=f"{name}-", dir=home))
        self.pipe, theirs = Pipe()
        try:
            self._process = _start(theirs, self._folder)
        except OSError:
            self.pipe.close()
            self._pulse.close()
            raise
        finally:
            theirs.close()
        self._printed = Printed(cast("IO[bytes]", self._process.stdout))
        self._ended = False
        self._begun = -1
        self._since = 0.0
        # the import path by itself: what follows cannot be read before it is known
        try:
            self._hand_over([os.path.abspath(place) for place in sys.path])
            self._hand_over(Task(fmu=fmu, verdict=verdict, pulse_path=str(pulse_path)))
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
            return None
        return reply

    @property
    def is_gone(self) -> bool:
        """Whether the process has ended and nothing of it is left to be received.

        A process that its FMU has forked may keep the pipe open.
        """
        return self._process.poll() is not None and not self.pipe.poll()

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

    def death(self) -> Death:
        """How the process ended, whose pipe has."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(ENDING_S)
        code = self._process.returncode
        name = _signal_name(code)
        if code is None:
            how = "closed the pipe of its process"
        elif name:
            how = f"crashed its process ({name})"
        else:
            how = f"ended its process (exit code {code})"
        words = self._printed.last_words()
        how = f"{how}; its last words: {words}" if words else f"{how} without a word"
        return Death(how, name if name in FROM_OUTSIDE else "")

    def ask_to_end(self) -> None:
        """Let the process free its FMU and end."""
        self._hand_over(None)

    def end(self, within_s: float = 0.0) -> None:
        """Wait for the process to end by itself, then kill it and all that its FMU has started.

        Args:
            within_s: time that the process is given to end by itself, s.
        """
        if self._ended:
            return
        self._ended = True
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(within_s)
        self._process.kill()
        if sys.platform != "win32":
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, signal.SIGKILL)
        self._process.wait()
        self.pipe.close()
        self._pulse.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _hand_over(self, message: object) -> None:
        with contextlib.suppress(OSError):
            self.pipe.send(message)


def _start(theirs: connection.Connection, folder: Path) -> subprocess.Popen[bytes]:
    """A process with its end of the pipe and nothing else of the caller's, in a folder."""
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
        # a session of its own: what a terminal sends when keys are pressed or it closes is for the
        # caller to deal with
        options = {"pass_fds": (handle,), "start_new_session": True}
    with _signals_held():
        return subprocess.Popen(  # noqa: S603
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=folder,
            env=environment,
            **options,
        )


def _signal_name(code: int | None) -> str:
    """Name of the signal that ended a process of that return code; empty if none did."""
    if code is None or code >= 0:
        return ""
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"


def _interpreter() -> tuple[str, dict[str, str] | None]:
    """Path of Python, and the environment that it wants (None: the present one).

    On Windows, python.exe of a virtual environment only starts another process, which would outlive
    it when it is killed. `multiprocessing.set_executable` is heeded, for embedded interpreters.
    """
    python = os.fsdecode(spawn.get_executable())
    if os.path.dirname(python):  # the process has another current folder
        python = os.path.abspath(python)
    base = getattr(sys, "_base_executable", python)
    if sys.platform == "win32" and python == sys.executable != base:
        return base, {**os.environ, "__PYVENV_LAUNCHER__": python}
    return python, None


@contextlib.contextmanager
def _signals_held() -> Iterator[None]:
    """A process that is started meanwhile is not asked to end before it can ignore that."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, worker_main.IGNORED)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
