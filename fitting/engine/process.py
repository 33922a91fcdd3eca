"""A child process that takes messages: how it is started, and how it learns that it is alone."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from multiprocessing import Pipe, connection, spawn
from pathlib import Path
from typing import Any

from fitting.engine import child

CALLER_S = 1.0  # time between two looks whether the caller is there


def start(
    module: str, folder: Path, environment: Mapping[str, str] | None = None
) -> tuple[subprocess.Popen[bytes], connection.Connection]:
    """A process that serves a pipe, and the caller's end of that pipe.

    It heads a group of its own, which the processes that it starts belong to and end with, and has
    the caller's import path. What it prints comes by ``stdout`` of the process.

    Args:
        module: whose ``serve`` is called with the child's end of the pipe.
        folder: current folder of the process.
        environment: variables that it has besides the caller's.

    Raises:
        OSError: no process can be started.
    """
    ours, theirs = Pipe()
    try:
        process = _started(theirs, folder, environment or {})
    except OSError:
        ours.close()
        raise
    finally:
        theirs.close()
    try:
        # the import path by itself: what follows cannot be read before it is known
        for message in ([os.path.abspath(place) for place in sys.path], module):
            with contextlib.suppress(OSError):  # it has ended: found out by who waits for an answer
                ours.send(message)
    except BaseException:
        end(process)
        ours.close()
        raise
    return process, ours


def end(process: subprocess.Popen[bytes], within_s: float = 0.0) -> None:
    """Wait for a process to end by itself, then kill it and all that it has started.

    Args:
        process: that `start` made.
        within_s: time that the process is given to end by itself, s.
    """
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(within_s)
    process.kill()
    if sys.platform != "win32":
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def messages(
    pipe: connection.Connection, orphaned: Callable[[], None] = lambda: None
) -> queue.SimpleQueue[Any]:
    """The caller's messages as they come; the process ends when they cannot come any more.

    They are read by a thread of their own, so that the end of a caller that was killed is noticed
    even while the work is in an endless loop.

    Args:
        pipe: the child's end.
        orphaned: what is done before that, as the caller cannot any more.
    """
    arrived: queue.SimpleQueue[Any] = queue.SimpleQueue()
    caller = os.getppid()

    def read() -> None:
        try:
            while True:
                # a fork of the caller may keep its end of the pipe open
                while not pipe.poll(CALLER_S):
                    if os.getppid() != caller:
                        raise EOFError
                arrived.put(pipe.recv())
        except (EOFError, OSError):
            orphaned()
        except BaseException:
            traceback.print_exc()
        _end_group()
        os._exit(1)

    threading.Thread(target=read, daemon=True).start()
    return arrived


def _end_group() -> None:
    """End this process with those that it has started, where it heads their group."""
    if sys.platform != "win32" and os.getpgrp() == os.getpid():
        os.killpg(os.getpid(), signal.SIGKILL)


def _started(
    theirs: connection.Connection, folder: Path, more: Mapping[str, str]
) -> subprocess.Popen[bytes]:
    """A process with its end of the pipe and nothing else of the caller's, in a folder."""
    python, environment = _interpreter()
    if more:
        environment = {**(environment or os.environ), **more}
    handle = theirs.fileno()
    # -P: neither the current folder nor that of the program is a place to import from
    command = [python, "-P", child.__file__, str(handle)]
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
    before = signal.pthread_sigmask(signal.SIG_BLOCK, child.IGNORED)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
