"""FMU workers in tests are forked from a process that has imported what they need.

Each worker is a Python of its own, which imports numpy and the loop that serves an FMU: 0.4 s of
processor time, for runs of milliseconds. Here one such process per test process does that once, and
the workers are its forks: with the same pipe, folder, session and signals, and children of the test
process, as those of `fitting.engine.process.start` are. Linux alone; elsewhere, where a thread of a
library runs in that process, for isolated FMUs, and in tests marked ``cold_start``, workers are
started as users start them.
"""

from __future__ import annotations

import array
import ctypes
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from multiprocessing import connection
from pathlib import Path

from fitting.engine import child

PR_SET_CHILD_SUBREAPER = 36
MOST_BYTES = 2**20
#: What a worker imports before it knows its FMU.
MODULES = ("fitting.fmu.worker.main", "fitting.fmu.worker.loop")

Start = Callable[[connection.Connection, Path, Mapping[str, str], bool], "subprocess.Popen[bytes]"]


class WarmStarts:
    """Stands in for ``fitting.engine.process._started``."""

    def __init__(self, cold: Start) -> None:
        self._cold = cold
        self._lock = threading.Lock()
        self._server: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket | None = None
        self._owner = os.getpid()  # a fork of this process is no parent of what is forked here
        #: Whether forks are taken; isolated workers never are.
        self.is_wanted = True
        # a second thread of linear algebra would run in the process that is forked
        self._can = sys.platform == "linux" and os.environ.get("OPENBLAS_NUM_THREADS") == "1"

    def __call__(
        self,
        theirs: connection.Connection,
        folder: Path,
        environment: Mapping[str, str],
        alone: bool,
    ) -> subprocess.Popen[bytes]:
        """A process with its end of the pipe, in a folder.

        Args:
            theirs: the worker's end of the pipe.
            folder: current folder of the process.
            environment: its variables.
            alone: whether they are not the caller's; such a process is started anew.
        """
        if alone or not self.is_wanted or os.getpid() != self._owner:
            return self._cold(theirs, folder, environment, alone)
        with self._lock:
            asked = self._ready()
            if asked is None:
                return self._cold(theirs, folder, environment, alone)
            read, write = os.pipe()
            try:
                pid = self._forked(asked, theirs.fileno(), write, folder, environment)
                return _popen(pid, read)
            finally:
                os.close(write)

    def _ready(self) -> socket.socket | None:
        """The process that is forked, by its socket; None where there can be none."""
        if self._can and self._server is None:
            self._socket, theirs = socket.socketpair()
            with theirs:
                self._server = subprocess.Popen(
                    [sys.executable, "-c", f"import {__name__} as w; w.serve({theirs.fileno()})"],
                    pass_fds=(theirs.fileno(),),
                    env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
                    start_new_session=True,
                )
            self._can = self._socket.recv(1) == b"y"
        return self._socket if self._can else None

    def _forked(
        self,
        server: socket.socket,
        pipe: int,
        printed: int,
        folder: Path,
        environment: Mapping[str, str],
    ) -> int:
        asked = {"folder": str(folder), "environment": dict(environment), "caller": os.getpid()}
        libc = ctypes.CDLL(None, use_errno=True)
        # the fork's own parent ends at once: who takes over is whoever says so
        libc.prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        try:
            files = array.array("i", [pipe, printed])
            rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, files)]
            server.sendmsg([json.dumps(asked).encode()], rights)
            return int(server.recv(32))
        finally:
            libc.prctl(PR_SET_CHILD_SUBREAPER, 0, 0, 0, 0)

    def close(self) -> None:
        """End the process that is forked; its forks stay."""
        if self._server is not None and self._socket is not None:
            self._socket.close()
            self._server.wait()


def _popen(pid: int, read: int) -> subprocess.Popen[bytes]:
    """The handle of a child that `subprocess` has not started itself."""
    made: subprocess.Popen[bytes] = subprocess.Popen.__new__(subprocess.Popen)
    made.__dict__.update(
        args=["worker"],
        pid=pid,
        returncode=None,
        stdin=None,
        stdout=os.fdopen(read, "rb"),
        stderr=None,
        text_mode=None,
        encoding=None,
        errors=None,
        pipesize=-1,
        process_group=None,
        _waitpid_lock=threading.Lock(),
        _child_created=True,
        _input=None,
        _communication_started=False,
        _closed_child_pipe_fds=True,
        _sigint_wait_secs=0.25,
    )
    return made


def serve(number: int) -> None:
    """Import what workers need, then fork one for each message.

    Args:
        number: file descriptor of the socket.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, child.IGNORED)  # until a fork ignores them
    for module in MODULES:
        __import__(module)
    asked = socket.socket(fileno=number)
    # what a thread holds while another one forks is held for ever
    alone = len(os.listdir("/proc/self/task")) == 1
    asked.send(b"y" if alone else b"n")
    while True:
        text, files, _, _ = socket.recv_fds(asked, MOST_BYTES, 2)
        if not text:
            return
        read, write = os.pipe()
        between = os.fork()
        if not between:
            os.close(read)
            pid = os.fork()
            if pid:
                os.write(write, str(pid).encode())
                os._exit(0)
            os.close(write)
            asked.close()
            _work(json.loads(text), *files)
        os.close(write)
        os.waitpid(between, 0)  # from here on the caller is the parent
        asked.send(os.read(read, 32))
        for file in (read, *files):
            os.close(file)


def _work(asked: Mapping[str, object], pipe: int, printed: int) -> None:
    """Be a worker as `fitting.engine.process.start` makes one, and end."""
    code = 1
    try:
        os.setsid()
        nothing = os.open(os.devnull, os.O_RDONLY)
        for old, new in ((nothing, 0), (printed, 1), (printed, 2)):
            os.dup2(old, new)
        os.close(nothing)
        os.close(printed)
        os.environ.clear()
        os.environ.update(asked["environment"])  # type: ignore[call-overload]
        os.chdir(str(asked["folder"]))
        while os.getppid() != asked["caller"]:
            time.sleep(1e-4)
        child.main(pipe)
        code = 0
    except SystemExit as ended:
        code = int(ended.code or 0)
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
