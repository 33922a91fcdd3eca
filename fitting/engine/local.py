"""Local processes as an executor in which a lost process costs what it was at, and nothing else."""

from __future__ import annotations

import contextlib
import logging
import pickle
import queue
import subprocess
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from multiprocessing import connection
from pathlib import Path
from typing import IO, Any, ParamSpec, TypeVar, cast

from fitting.engine.loop import Answer
from fitting.engine.process import ONE_THREAD, end, start
from fitting.text.scratch import Scratch

_log = logging.getLogger(__name__)

Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")

CLOSING_S = 2.0
_Call = tuple[bytes, Future[Any]]


class LostProcess(BrokenExecutor):
    """The process that was at something has ended without an answer."""


class LocalProcesses(Executor):
    """Processes of this machine, a thread here for each; they start when there is work.

    Unlike ``ProcessPoolExecutor`` it goes on when one is killed, with a new process in its place,
    and imports nothing of the caller's ``__main__``: functions are found by their module's name.

    Args:
        workers: number of processes, at least 1.

    Raises:
        BadInput: no folder for temporary files.
    """

    def __init__(self, workers: int) -> None:
        self._calls: queue.SimpleQueue[_Call | None] = queue.SimpleQueue()
        self._home = Scratch()
        self._closed = False
        self._lock = threading.Lock()
        self._slots = [_Slot(self._home.path / f"process{k}") for k in range(workers)]
        self._threads = [
            threading.Thread(target=slot.serve, args=(self._calls,), daemon=True)
            for slot in self._slots
        ]
        for thread in self._threads:
            thread.start()

    @property
    def pids(self) -> tuple[int, ...]:
        """Numbers of the processes that are running."""
        found = [slot.process for slot in self._slots]
        return tuple(p.pid for p in found if p is not None and p.poll() is None)

    def submit(
        self, fn: Callable[Arguments, Result], /, *args: Arguments.args, **kwargs: Arguments.kwargs
    ) -> Future[Result]:
        """Have a function called in one of the processes.

        Args:
            fn: a function that can be imported by its name.
            *args: what it is called with; all can be pickled.
            **kwargs: likewise.

        Raises:
            RuntimeError: after `shutdown`.
        """
        call, future = pickle.dumps((fn, args, kwargs)), Future[Result]()
        with self._lock:
            if self._closed:
                raise RuntimeError("cannot schedule new futures after shutdown")
            self._calls.put((call, future))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes.

        Args:
            wait: whether everything is done first that was asked for; else it is lost.
            cancel_futures: whether what has not begun is left.
        """
        with self._lock:
            begun = not self._closed
            self._closed = True
        if cancel_futures or not wait:
            self._cancel_waiting()
        if begun:
            for _ in self._threads:
                self._calls.put(None)
        if not wait:
            for slot in self._slots:
                slot.stop()
        for thread in self._threads:
            thread.join()
        self._home.remove()

    def _cancel_waiting(self) -> None:
        with contextlib.suppress(queue.Empty):
            while True:
                found = self._calls.get_nowait()
                if found is not None:
                    found[1].cancel()


class _Slot:
    """The place of one process, which another one takes when it is lost."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.process: subprocess.Popen[bytes] | None = None
        self._pipe: connection.Connection | None = None
        self._stopped = False
        self._lock = threading.Lock()

    def serve(self, calls: queue.SimpleQueue[_Call | None]) -> None:
        """Take calls until there is None.

        Args:
            calls: of all slots.
        """
        while (found := calls.get()) is not None:
            call, future = found
            if not future.set_running_or_notify_cancel():
                continue
            try:
                answer = self._asked(call)
            except BaseException as error:
                future.set_exception(error)
                continue
            if answer.error is None:
                future.set_result(answer.result)
            else:
                answer.error.add_note(answer.where)
                future.set_exception(answer.error)
        self._leave(CLOSING_S)

    def stop(self) -> None:
        """End the process at once, whatever it is at."""
        with self._lock:
            self._stopped = True
            if self.process is not None:
                end(self.process)

    def _asked(self, call: bytes) -> Answer:
        pipe = self._open()
        try:
            pipe.send(call)
            answer: Answer = pickle.loads(pipe.recv_bytes())  # noqa: S301 - from our own child
        except (EOFError, OSError):
            raise LostProcess(self._loss()) from None
        return answer

    def _open(self) -> connection.Connection:
        with self._lock:
            if self._stopped:
                raise LostProcess("its process was ended")
            if self._pipe is not None:
                return self._pipe
            self.folder.mkdir(exist_ok=True)
            # what it makes there goes with the executor, however it ends
            place = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(self.folder))
            process, pipe = start("fitting.engine.loop", self.folder, {**ONE_THREAD, **place})
            self.process, self._pipe = process, pipe
        threading.Thread(target=_drain, args=(process,), daemon=True).start()
        _log.debug("process %d started", process.pid)
        return pipe

    def _loss(self) -> str:
        """How the process ended, whose pipe has; the next call gets another one."""
        process = cast("subprocess.Popen[bytes]", self.process)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(CLOSING_S)
        code = process.returncode
        self._leave(0.0)
        how = "closed its pipe" if code is None else f"ended with exit code {code}"
        how = f"was killed by signal {-code}" if code is not None and code < 0 else how
        _log.info("process %d %s", process.pid, how)
        return f"its process {how}"

    def _leave(self, within_s: float) -> None:
        with self._lock:
            process, pipe, self.process, self._pipe = self.process, self._pipe, None, None
        if process is None or pipe is None:
            return
        with contextlib.suppress(OSError):
            pipe.send(None)
        end(process, within_s)
        pipe.close()


def _drain(process: subprocess.Popen[bytes]) -> None:
    """Take what the process prints, so that it is never held up by it; it is told to nobody."""
    with contextlib.suppress(OSError, ValueError), cast("IO[bytes]", process.stdout) as lines:
        for line in lines:
            _log.debug("process %d: %s", process.pid, line.decode("utf-8", "replace").rstrip())
