"""The pulse of a worker process: numbers in memory that it shares with its caller.

They can be read while the worker is inside the FMU and answers nothing. Under Linux the memory is
sealed: no FMU can take it away from under its caller. Elsewhere it is a mapped file next to the
unpacked FMU, which goes when that folder goes.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import socket
import sys
from multiprocessing import connection
from pathlib import Path


class Pulse(ctypes.Structure):
    """The numbers of a pulse, of 64 bits each; the memory is given back with the last reference.

    ``at_run`` is the run of the batch that is under way, ``started`` a count of everything that was
    started. ``in_trial``: a reset instance is only being tried; ``freeing``: an instance is being
    freed. ``own_memory`` is the memory of the process in bytes before there is an FMU in it,
    ``counted_memory`` the most that the system counts for it till then.
    """

    _fields_ = tuple(
        (name, ctypes.c_int64)
        for name in ("at_run", "started", "in_trial", "freeing", "own_memory", "counted_memory")
    )
    at_run: int
    started: int
    in_trial: int
    freeing: int
    own_memory: int
    counted_memory: int


def new_pulse(path: Path) -> tuple[Pulse, int | None]:
    """A pulse at zero, and the descriptor by which another process gets it; None: by its file.

    Args:
        path: of the file, where there has to be one.
    """
    if sys.platform != "linux":
        path.write_bytes(bytes(ctypes.sizeof(Pulse)))
        return open_pulse(path), None
    import fcntl

    descriptor = os.memfd_create("pulse", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    os.ftruncate(descriptor, ctypes.sizeof(Pulse))
    seals = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
    fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, seals)
    return _mapped(descriptor), descriptor


def open_pulse(place: Path | int) -> Pulse:
    """The pulse that the other process has made.

    Args:
        place: file or descriptor of it; that is closed.
    """
    descriptor = place if isinstance(place, int) else os.open(place, os.O_RDWR)
    try:
        return _mapped(descriptor)
    finally:
        os.close(descriptor)


def _mapped(descriptor: int) -> Pulse:
    return Pulse.from_buffer(mmap.mmap(descriptor, ctypes.sizeof(Pulse)))


def hand_over(pipe: connection.Connection, descriptor: int | None) -> None:
    """Give the process at the other end of a pipe a descriptor, where there is one.

    Args:
        pipe: the caller's end.
        descriptor: that `new_pulse` made.
    """
    if descriptor is not None:
        with socket.socket(fileno=os.dup(pipe.fileno())) as way:
            socket.send_fds(way, [b"p"], [descriptor])


def taken_over(pipe: connection.Connection) -> int | None:
    """The descriptor that `hand_over` gave; None where there is none.

    Args:
        pipe: the worker's end.

    Raises:
        EOFError: the caller is gone.
    """
    if sys.platform != "linux":
        return None
    with socket.socket(fileno=os.dup(pipe.fileno())) as way:
        _, descriptors, _, _ = socket.recv_fds(way, 1, 1)
    if not descriptors:
        raise EOFError
    return descriptors[0]
