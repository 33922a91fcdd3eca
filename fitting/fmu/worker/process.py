"""One worker process, seen from the caller: start, hand over, notice its end, kill."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from time import sleep
from typing import IO, cast

from fitting.engine.process import Printed, end, goes_on, start
from fitting.fmu.isolation import MB
from fitting.fmu.runs import Layout, RunRequest
from fitting.fmu.worker.messages import MOST_OTHERS, Incoming, NotAnAnswer, Reply, Task
from fitting.fmu.worker.pulse import hand_over, new_pulse

#: The module that serves an FMU.
PROGRAM = "fitting.fmu.worker.main"
START_S = 120.0  # longest start of a process, before it touches the FMU
#: Looks whether a process has ended that has closed its pipe, and the time between them, s.
ENDED_LOOKS, ENDED_S = 1000, 0.01
#: Share of its memory that an FMU has taken which wanted more.
NEARLY = 0.8
#: Signals from outside that end a process; whatever else ends it is the FMU's doing.
FROM_OUTSIDE = ("SIGKILL", "SIGTERM", "SIGHUP")


class WorkerProcess:
    """A process that serves one FMU, in an empty folder that is removed with it.

    It heads a group of its own, which the processes that an FMU starts belong to and end with.

    ``task``: what it is there for, its files in one folder.

    Raises OSError if no process can be started.
    """

    def __init__(self, task: Task) -> None:
        pulse_path = Path(task.pulse_path)
        self.pulse, pulse_descriptor = new_pulse(pulse_path)
        self._isolation = task.isolation
        self._folder = Path(tempfile.mkdtemp(prefix=f"{pulse_path.stem}-", dir=pulse_path.parent))
        # what it leaves among the temporary files goes with its folder
        more = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(self._folder))
        isolated = task.isolation is not None
        self._process, self.pipe = start(PROGRAM, self._folder, more, alone=isolated)
        self._incoming = Incoming(self.pipe)
        self._printed = Printed(cast("IO[bytes]", self._process.stdout))
        self._ended = False
        #: Whether the last run that it answered for failed, which may have left anything behind.
        self.has_failed = False
        self._most_memory = 0
        self._batches, self._layouts = 0, 0  # sent so far
        self._sizes: list[int] = []  # of the results of the batch under way
        self._started, self._since = -1, 0.0
        try:
            # by itself: namespaces are left before there is a thread
            self._hand_over(isolated)
            with contextlib.suppress(OSError):
                hand_over(self.pipe, pulse_descriptor)
            self._hand_over(task)
        except BaseException:
            self.end()
            raise
        finally:
            if pulse_descriptor is not None:
                os.close(pulse_descriptor)

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def send(self, layouts: list[Layout], requests: Sequence[RunRequest]) -> None:
        """Hand over a batch; that the process has ended is noticed by `receive`.

        Args:
            layouts: all that there are; the process is sent each only once.
            requests: runs to do.
        """
        self._started, self._since = -1, time.monotonic()
        self.pulse.at_run = 0
        self._batches += 1
        self._sizes = [r.rows * len(layouts[r.layout].names) for r in requests]
        self._hand_over((self._batches, layouts[self._layouts :], list(map(tuple, requests))))
        self._layouts = len(layouts)

    def receive(self) -> Reply | None:
        """The answer to the batch; None while it has not come.

        Raises:
            EOFError: the process has closed its pipe without one.
            NotAnAnswer: something else has come.
        """
        try:
            data = self._incoming.take(8 * sum(self._sizes) + MOST_OTHERS)
        except OSError as error:
            raise EOFError from error
        if data is None:
            return None
        reply = Reply.unpacked(data)
        expected = (self._batches, self.pid, sum(self._sizes[: reply.done]))
        if (reply.number, reply.process, reply.results.size) != expected or not (
            0 <= reply.done <= len(self._sizes)
        ):
            raise NotAnAnswer("an answer to something else")
        return reply

    @property
    def has_ended(self) -> bool:
        """Whether the process has ended and nothing of it remains to be received.

        A process that its FMU has forked may keep the pipe open.
        """
        return self._poll() is not None and not self.pipe.poll()

    def is_late(self, timeout_s: float) -> bool:
        """Whether the process began something longer than that ago; its own start is not counted.

        A start has a limit of its own: on a busy machine, Python alone may take seconds.

        Args:
            timeout_s: longest silence, s.
        """
        started = self.pulse.started
        if started != self._started:
            self._started, self._since = started, time.monotonic()
        return time.monotonic() - self._since > (timeout_s if started else max(timeout_s, START_S))

    def death(self) -> tuple[str, str, bool]:
        """How the process ended, whose pipe has.

        In a sentence; by which signal of somebody outside, empty: by none; and whether it has not
        ended, and closed its pipe alone.
        """
        for _ in range(ENDED_LOOKS):
            if self._poll() is not None or goes_on(self.pid):
                break
            sleep(ENDED_S)
        code, name = self._process.returncode, ""
        if code is not None and code < 0:
            known = {int(number): number.name for number in signal.Signals}
            name = known.get(-code, f"signal {-code}")

        limits = self._isolation
        if limits is not None:
            # Linux counts the caller's memory for a process that it starts: no more than that
            # means nothing for what the process took itself
            most, own = self._most_memory, self.pulse.own_memory
            taken = most - own if most > self.pulse.counted_memory else 0
            beyond = {
                "SIGXCPU": f"took more than {limits.processor_s:g} s of processor time",
                "SIGXFSZ": f"wrote more than {limits.written_mb:g} MB",
                "SIGSYS": "asked for a network, which it has not when isolated,",
            }.get(name)
            if beyond is None and taken > NEARLY * limits.memory_mb * MB:
                beyond = f"wanted more than {limits.memory_mb:g} MB of memory"
            if beyond is not None:
                return f"{beyond} and was stopped", "", False

        if code is None:
            how = "closed the pipe of its process"
        else:
            how = (
                f"crashed its process ({name})" if name else f"ended its process (exit code {code})"
            )
        words = self._printed.last_words()
        how = f"{how}; its last words: {words}" if words else f"{how} without a word"
        if limits is not None and code:
            how += f"; it ran isolated, with {limits.words}"
        return how, name if name in FROM_OUTSIDE else "", code is None

    def written_too_much(self) -> str:
        """In words that an isolated FMU has written more than it may; empty: it has not."""
        if self._isolation is None:
            return ""
        size = 0
        for folder, _, names in os.walk(self._folder):
            for name in names:
                with contextlib.suppress(OSError):
                    size += os.lstat(os.path.join(folder, name)).st_size
        limit = self._isolation.written_mb
        return f"wrote more than {limit:g} MB and was stopped" if size > limit * MB else ""

    def _poll(self) -> int | None:
        """Exit code of the process, None while it runs; what it took is kept."""
        if self._process.returncode is None and hasattr(os, "wait4"):
            with contextlib.suppress(ChildProcessError):
                pid, status, usage = os.wait4(self.pid, os.WNOHANG)
                if pid:
                    self._process.returncode = os.waitstatus_to_exitcode(status)
                    self._most_memory = usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
        return self._process.poll()

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
        end(self._process, within_s, self._folder)
        self._incoming.close()
        self.pipe.close()
        del self.pulse  # whose file cannot be removed before on Windows
        shutil.rmtree(self._folder, ignore_errors=True)

    def _hand_over(self, message: object) -> None:
        with contextlib.suppress(OSError):
            self.pipe.send(message)
