"""What caller and worker process exchange: a task, batches of requests, replies.

To the worker goes its `Task`, then batches: their number, the layouts that it does not know yet,
and requests as plain tuples, which are pickled in half the time; None ends it.

An FMU can write into the pipe of its process. So nothing that comes from there is unpickled, waited
for without end, or believed before it has been examined: a reply is a head, a text in JSON, plain
numbers, and what is known of resets, which the caller keeps unread for the next worker.
"""

from __future__ import annotations

import json
import os
import socket
import struct
import sys
from dataclasses import dataclass, field, fields, replace
from multiprocessing import connection
from typing import NamedTuple

import numpy as np

from fitting.fmu.description import FmuDescription
from fitting.fmu.isolation import Isolation
from fitting.fmu.runs import Counts
from fitting.fmu.worker.reuse import Verdict
from fitting.text.arrays import FloatArray
from fitting.text.records import from_plain, to_plain

#: Bytes of the text, and how many numbers follow it.
HEAD = struct.Struct("!IQ")
#: Bytes of a reply beside the numbers that were asked for: words, and what is known of resets.
MOST_OTHERS = 2**28
CHUNK = 2**20


class NotAnAnswer(Exception):
    """What came by the pipe of a worker is no answer to what it was asked."""


class Task(NamedTuple):
    """What a worker is there for: an FMU, what is known about its reuse, its pulse and limits.

    ``fmu`` is its description without the variables, ``folder`` where it is unpacked. ``trials``
    are what an earlier worker has compared, as that packed it. ``pulse_path`` is the file of the
    pulse, unused where its descriptor came before the task.
    """

    fmu: FmuDescription
    folder: str
    verdict: Verdict
    trials: bytes
    pulse_path: str
    isolation: Isolation | None = None


@dataclass(frozen=True, kw_only=True)
class Reply:
    """Results of the first ``done`` requests, flat; the rest is left if ``used_up`` or ``failure``.

    ``number`` is that of the batch, ``process`` who answers. ``used_up``: this process should do no
    more; ``failure``: why the one after the last done one failed. ``trials``: what was compared of
    resets, packed for the next worker. ``memory`` of the process in bytes, 0 where the system does
    not report it.
    """

    number: int
    process: int
    done: int
    used_up: bool
    failure: str | None
    warnings: tuple[str, ...]
    counts: Counts
    verdict: Verdict
    memory: int
    results: FloatArray = field(default_factory=lambda: np.empty(0))
    trials: bytes = b""

    def packed(self) -> bytes:
        """Its bytes."""
        words = {f.name: getattr(self, f.name) for f in fields(self)[:-2]}
        text = json.dumps(to_plain(words)).encode()
        numbers = np.ascontiguousarray(self.results, dtype="=f8").tobytes()
        return b"".join((HEAD.pack(len(text), self.results.size), text, numbers, self.trials))

    @classmethod
    def unpacked(cls, data: bytes) -> Reply:
        """The reply of these bytes.

        Args:
            data: as `packed` makes them, or anything else.

        Raises:
            NotAnAnswer: they are something else.
        """
        try:
            size, count = HEAD.unpack_from(data)
            words = from_plain(cls, json.loads(data[HEAD.size : HEAD.size + size]))
            numbers = np.frombuffer(data, "=f8", count, HEAD.size + size)
            return replace(words, results=numbers, trials=data[HEAD.size + size + 8 * count :])
        # whatever a program may write there: numbers beyond all bounds, lists a million deep
        except (
            ArithmeticError,
            LookupError,
            TypeError,
            ValueError,
            RecursionError,
            struct.error,
        ) as error:
            raise NotAnAnswer(str(error)) from error


class Incoming:
    """What has come so far by a pipe: whole messages are taken, nothing is waited for.

    The frames are those of `multiprocessing.connection`. On Windows, where these pipes have
    messages of their own, the system keeps them apart.

    Args:
        pipe: the caller's end.
    """

    def __init__(self, pipe: connection.Connection) -> None:
        self._pipe = pipe
        self._come = bytearray()
        self._socket: socket.socket | None = None
        if sys.platform != "win32":
            # a handle of its own on the same pipe, which alone may not wait
            handle = os.dup(pipe.fileno())
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM, 0, handle)

    def take(self, most: int) -> bytes | None:
        """The next message, None where it has not come to its end.

        Args:
            most: bytes that it may have.

        Raises:
            EOFError: the other end is closed.
            NotAnAnswer: it is longer than that, by its head.
        """
        if self._socket is None:
            return self._pipe.recv_bytes(most)
        while True:
            start, size = 4, -1
            if len(self._come) >= start:
                [size] = struct.unpack_from("!i", self._come)
                if size == -1:  # one of more than 2 GB, whose size follows
                    start = 12
                    if len(self._come) >= start:
                        [size] = struct.unpack_from("!Q", self._come, 4)
                if size < -1 or size > most:
                    raise NotAnAnswer(f"a message of {size} bytes")
            if 0 <= size <= len(self._come) - start:
                message = bytes(self._come[start : start + size])
                del self._come[: start + size]
                return message
            try:
                chunk = self._socket.recv(CHUNK, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return None
            if not chunk:
                raise EOFError
            self._come += chunk

    def close(self) -> None:
        """Let go of the pipe."""
        if self._socket is not None:
            self._socket.close()
