"""Local processes as an executor: a process that is killed costs its call, and nothing else."""

from __future__ import annotations

import contextlib
import logging
import pickle
import queue
import subprocess
import threading
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from multiprocessing import connection
from pathlib import Path
from typing import IO, Any, ParamSpec, TypeVar, cast

from fitting.engine.process import ONE_THREAD, Printed, end, start
from fitting.text.scratch import Scratch

_log = logging.getLogger(__name__)

Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")

CLOSING_S = 2.0


class LostProcess(BrokenExecutor):
    """The process of a call has ended without an answer."""


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
        self._home = Scratch()
        self._threads = ThreadPoolExecutor(workers)
        self._slots = [_Slot(self._home.path / f"process{k}") for k in range(workers)]
        # the last that was free is taken first, so that no process starts while another idles
        self._free: queue.LifoQueue[_Slot] = queue.LifoQueue()
        for slot in reversed(self._slots):
            self._free.put(slot)

    @property
    def pids(self) -> tuple[int, ...]:
        """Numbers of the processes that are running."""
        processes = [slot.process for slot in self._slots]
        return tuple(p.pid for p in processes if p is not None and p.poll() is None)

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
        return self._threads.submit(self._call, pickle.dumps((fn, args, kwargs)))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes.

        Args:
            wait: whether everything that was requested is done first; else it is lost.
            cancel_futures: whether what has not started is left.
        """
        self._threads.shutdown(wait, cancel_futures=cancel_futures or not wait)
        for slot in self._slots:
            slot.close(asking=wait)
        self._threads.shutdown()  # threads whose process was ended under them
        for slot in self._slots:
            slot.end(CLOSING_S)
        self._home.remove()

    def _call(self, call: bytes) -> Any:
        slot = self._free.get()
        try:
            result, error, where = slot.ask(call)
        finally:
            self._free.put(slot)
        if error is not None:
            error.add_note(where)
            raise error
        return result


class _Slot:
    """The place of one process, which another one takes when it is lost."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.process: subprocess.Popen[bytes] | None = None
        self._pipe: connection.Connection | None = None
        self._closed = False
        self._lock = threading.Lock()

    def ask(self, call: bytes) -> tuple[Any, BaseException | None, str]:
        """The answer of the process to a call: result, error, traceback.

        Args:
            call: as `fitting.engine.process` reads it.

        Raises:
            LostProcess: it ended without one; the next call gets another process.
        """
        with self._lock:
            if self._closed:
                raise LostProcess("its process was ended")
            if self.process is None or self._pipe is None:
                self.folder.mkdir(exist_ok=True)
                # what it makes there goes with the executor, however it ends
                place = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(self.folder))
                self.process, self._pipe = start(
                    "fitting.engine.process", self.folder, {**ONE_THREAD, **place}
                )
                Printed(cast("IO[bytes]", self.process.stdout))  # it is never held up by that
                _log.debug("process %d started", self.process.pid)
            process, pipe = self.process, self._pipe
        try:
            pipe.send(call)
            return pickle.loads(pipe.recv_bytes())  # type: ignore[no-any-return]  # noqa: S301 - from our own child
        except (EOFError, OSError):
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(CLOSING_S)
            code = process.returncode
            self.end(0.0)
            how = "closed its pipe" if code is None else f"ended with exit code {code}"
            how = f"was killed by signal {-code}" if code is not None and code < 0 else how
            _log.info("process %d %s", process.pid, how)
            raise LostProcess(f"its process {how}") from None

    def close(self, *, asking: bool) -> None:
        """From now on no process is started; the present one ends.

        Args:
            asking: whether it is asked to end by itself, as it idles; else it is killed.
        """
        with self._lock:
            self._closed = True
            if self.process is not None and self._pipe is not None:
                if not asking:
                    end(self.process)
                with contextlib.suppress(OSError):
                    self._pipe.send(None)

    def end(self, within_s: float) -> None:
        """Let go of the process, if there is one, after its end.

        Args:
            within_s: time that it is given to end by itself, s.
        """
        with self._lock:
            process, pipe, self.process, self._pipe = self.process, self._pipe, None, None
            if process is not None and pipe is not None:
                end(process, within_s)
                pipe.close()
