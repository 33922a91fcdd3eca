"""The program of a child process: ``python child.py HANDLE``, started by `engine.process.start`.

A program of its own, so that nothing of the caller is imported again: neither its ``__main__``,
which need not be guarded then, nor what that imports. HANDLE is the child's end of the pipe, an
inherited file descriptor (a handle on Windows), which no other process can have.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
from multiprocessing import connection

#: What asks a process to end is for the caller to deal with: it ends its children.
IGNORED = [signal.SIGINT, signal.SIGTERM]
if sys.platform != "win32":
    IGNORED.append(signal.SIGHUP)


def main(handle: int) -> None:
    """Ignore what asks to end, take over the caller's import path, and serve.

    Args:
        handle: file descriptor of the pipe.
    """
    for number in IGNORED:
        signal.signal(number, signal.SIG_IGN)
    if sys.platform == "win32":
        os.set_handle_inheritable(handle, False)  # not for the processes that a child may start
        pipe = connection.PipeConnection(handle)
    else:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, IGNORED)
        os.set_inheritable(handle, False)
        pipe = connection.Connection(handle)
    try:
        sys.path[:] = pipe.recv()
        module = pipe.recv()
    except EOFError:  # the caller has gone already
        return
    importlib.import_module(module).serve(pipe)


if __name__ == "__main__":
    main(int(sys.argv[1]))
