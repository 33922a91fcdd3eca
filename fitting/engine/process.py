"""A child process that takes messages: how it is started, and how it learns that it is alone."""

from __future__ import annotations

import contextlib
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from multiprocessing import Pipe, connection, spawn
from pathlib import Path
from typing import IO, Any

from fitting.engine import child
from fitting.text.errors import spelled_out

#: Looks for processes that were started while others were killed.
MOST_ROUNDS = 20
#: Longest time from when a process that ends closes its files to its end, and between two looks, s.
GOING_S, LOOK_S = 10.0, 0.01
CALLER_S = 1.0  # time between two looks whether the caller is there
#: What a process that is alone knows of its caller: where programs and libraries are, and words.
PLAIN = {
    *("PATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "PYTHONHOME", "TZ", "LANG", "LANGUAGE"),
    *("SYSTEMROOT", "SystemRoot"),
}
#: Libraries of linear algebra start no threads.
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
#: Those threads would keep what the process gives up, and for each that asks for memory the C
#: library would set aside 64 MB of a limited address space.
ALONE = {"MALLOC_ARENA_MAX": "1", **ONE_THREAD}
#: The flag of a process that is ending (Linux, ``PF_EXITING``).
ENDING = 0x4


def start(
    module: str, folder: Path, more: Mapping[str, str] | None = None, *, alone: bool = False
) -> tuple[subprocess.Popen[bytes], connection.Connection]:
    """A process that serves a pipe, and the caller's end of that pipe.

    It heads a group of its own, which the processes that it starts belong to and end with, and has
    the caller's import path. What it prints comes by ``stdout`` of the process.

    Args:
        module: whose ``serve`` is called with the child's end of the pipe.
        folder: current folder of the process.
        more: variables that it has besides the caller's.
        alone: whether it has none of the caller's but those of the places of programs: neither
            passwords nor keys.

    Raises:
        OSError: no process can be started.
    """
    given = {n: v for n, v in os.environ.items() if not alone or n in PLAIN or n[:3] == "LC_"}
    ours, theirs = Pipe()
    try:
        environment = {**given, **(ALONE if alone else {}), **(more or {})}
        process = _started(theirs, folder, environment, alone)
    except OSError:
        ours.close()
        raise
    finally:
        theirs.close()
    try:
        # the import path by itself: what follows cannot be read before it is known
        for message in ([os.path.abspath(place) for place in sys.path], module):
            with contextlib.suppress(OSError):  # it has ended: noticed by who waits for an answer
                ours.send(message)
    except BaseException:
        end(process)
        ours.close()
        raise
    return process, ours


def end(
    process: subprocess.Popen[bytes], within_s: float = 0.0, folder: Path | None = None
) -> None:
    """Wait for a process to end by itself, then kill it and all that it has started.

    Args:
        process: that `start` made.
        within_s: time that the process is given to end by itself, s.
        folder: in which it had its temporary files, see `end_marked`.
    """
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(within_s)
    process.kill()
    if sys.platform != "win32":
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()  # before the look for others, which would find it again and again till then
    if folder is not None:
        end_marked(folder)


def end_marked(folder: Path) -> None:
    """Kill the processes that were started with this folder for their temporary files (Linux).

    They have left the group of the process that started them, and may have lost it. One that has
    thrown away its environment is not found.

    Args:
        folder: where their ``TMPDIR`` is.
    """
    mark = b"\0TMPDIR=" + os.fsencode(folder) + b"\0"
    for _ in range(MOST_ROUNDS):  # they may start others meanwhile
        marked = False
        for name in os.listdir("/proc") if sys.platform == "linux" else ():
            if name.isdigit() and int(name) != os.getpid():
                # of another user, or gone: there is nothing to read, and nobody to kill
                with contextlib.suppress(OSError):
                    if mark in b"\0" + Path(f"/proc/{name}/environ").read_bytes() + b"\0":
                        marked = True
                        os.kill(int(name), signal.SIGKILL)
        if not marked:
            return


def goes_on(pid: int) -> bool:
    """Whether a process is known not to be ending (Linux): it has closed its pipe, no more.

    Args:
        pid: its number.
    """
    try:
        state = Path(f"/proc/{pid}/stat").read_bytes()
    except OSError:
        return False
    # the name, in brackets, may have any characters
    return not int(state[state.rindex(b")") + 2 :].split()[6]) & ENDING


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

    def is_orphan() -> bool:
        # the caller closes its pipe a moment before it is gone; or closes that alone
        until = time.monotonic() + GOING_S
        while sys.platform != "win32" and os.getppid() == caller:
            if time.monotonic() > until:
                return False
            time.sleep(LOOK_S)
        return True

    def read() -> None:
        try:
            while True:
                # a fork of the caller may keep its end of the pipe open
                while not pipe.poll(CALLER_S):
                    if os.getppid() != caller:
                        raise EOFError
                arrived.put(pipe.recv())
        except (EOFError, OSError):
            if is_orphan():
                orphaned()
        except BaseException:
            traceback.print_exc()
        # with those that it has started, where it heads their group
        if sys.platform != "win32" and os.getpgrp() == os.getpid():
            os.killpg(os.getpid(), signal.SIGKILL)
        os._exit(1)

    threading.Thread(target=read, daemon=True).start()
    return arrived


def _started(
    theirs: connection.Connection, folder: Path, environment: Mapping[str, str], alone: bool
) -> subprocess.Popen[bytes]:
    """A process with its end of the pipe and nothing else of the caller's, in a folder.

    Args:
        theirs: its end of the pipe.
        folder: its current one.
        environment: all its variables.
        alone: whether they are not the caller's.
    """
    # `multiprocessing.set_executable` is heeded, for embedded interpreters
    python = os.fsdecode(spawn.get_executable())
    if os.path.dirname(python):  # the process has another current folder
        python = os.path.abspath(python)
    handle, options, blocked = theirs.fileno(), dict[str, Any](), None
    if sys.platform == "win32":
        os.set_handle_inheritable(handle, True)
        options["startupinfo"] = subprocess.STARTUPINFO(lpAttributeList={"handle_list": [handle]})
        options["creationflags"] = subprocess.CREATE_NEW_PROCESS_GROUP
        # python.exe of a virtual environment only starts another process, which would outlive it
        base = getattr(sys, "_base_executable", python)
        if python == sys.executable != base:
            python, environment = base, {**environment, "__PYVENV_LAUNCHER__": python}
    else:
        # a session of its own: what a terminal sends when keys are pressed or it closes is for the
        # caller to deal with
        options = {"pass_fds": (handle,), "start_new_session": True}
        # no signal asks it to end before it can ignore that
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, child.IGNORED)
    try:
        # -P: neither the current folder nor that of the program is a place to import from
        return subprocess.Popen(  # noqa: S603
            [python, "-P", child.__file__, str(handle)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd=folder,
            env=dict(environment),
            **options,
        )
    finally:
        if blocked is not None and sys.platform != "win32":
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def serve(pipe: connection.Connection) -> None:
    """Answer calls with (result, error, traceback) until the caller sends None, or is gone.

    Args:
        pipe: the process's end.
    """
    # calls as bytes: one that cannot be read here is answered, and does not end the reading
    arriving = messages(pipe)
    while (call := arriving.get()) is not None:
        answer: tuple[Any, BaseException | None, str]
        try:
            work, arguments, names = pickle.loads(call)  # noqa: S301 - from the caller's own pipe
            answer = work(*arguments, **names), None, ""
        except Exception as error:
            answer = None, error, traceback.format_exc()
        try:
            data = pickle.dumps(answer)
        except Exception as error:  # of whatever kind: the caller learns what no pickle can carry
            what = f"{type(answer[1] or answer[0]).__name__} cannot be handed over: {error}"
            data = pickle.dumps((None, RuntimeError(what), answer[2]))
        with contextlib.suppress(OSError):  # the caller is gone, which the other thread deals with
            pipe.send_bytes(data)


KEPT = 4096  # bytes
LAST_WORDS = 500  # characters of what is quoted
ENDING_S = 1.0  # longest wait for what a process that has ended left in its pipe


class Printed:
    """Reads what a process prints until no process can print any more.

    A pipe and not a file: an FMU may print for a whole night. And read by a thread, so that nothing
    waits for a reader that is busy otherwise.

    Args:
        stream: reading end of the pipe.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        self._kept = b""
        self._lines = 0
        self._thread = threading.Thread(target=self._read, args=(stream,), daemon=True)
        self._thread.start()

    def last_words(self) -> str:
        """The end of what was printed by a process that has ended; empty if it printed nothing."""
        self._thread.join(ENDING_S)
        kept, lines = self._kept, self._lines
        words = kept.decode("utf-8", "replace").strip()[-LAST_WORDS:]
        dropped = lines - words.count("\n") - kept.endswith(b"\n")
        words = spelled_out(words, "\n\t")
        return f"{words} (… {dropped} further lines dropped)" if dropped > 0 else words

    def _read(self, stream: IO[bytes]) -> None:
        with stream:
            while chunk := os.read(stream.fileno(), 2**16):
                self._lines += chunk.count(b"\n")
                self._kept = (self._kept + chunk)[-KEPT:]
