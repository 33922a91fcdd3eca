"""The bytes of an answer, and how a caller takes them: a worker holds somebody else's program.

An FMU can write into the pipe of its process. So nothing that comes from there is unpickled, waited
for without end, or believed before it has been looked through: an answer is a head, a text in JSON,
plain numbers, and what is known of resets, which the caller keeps unread for the next worker.
"""

from __future__ import annotations

import json
import os
import socket
import struct
import sys
from dataclasses import asdict
from multiprocessing import connection

import numpy as np

from fitting.fmu.runs import Counts
from fitting.fmu.worker.messages import Reply
from fitting.fmu.worker.reuse import Verdict

#: Bytes of the text, and how many numbers follow it.
HEAD = struct.Struct("!IQ")
#: Bytes of an answer beside the numbers that were asked for: words, and what is known of resets.
MOST_BESIDE = 2**28
CHUNK = 2**20


class NotAnAnswer(Exception):
    """What came by the pipe of a worker is no answer to what it was asked."""


def packed(reply: Reply) -> bytes:
    """The bytes of an answer.

    Args:
        reply: of a worker.
    """
    told = reply._asdict()
    numbers, trials = told.pop("results"), told.pop("trials")
    told |= {"counts": asdict(reply.counts), "verdict": asdict(reply.verdict)}
    text = json.dumps(told).encode()
    head = HEAD.pack(len(text), numbers.size)
    return b"".join((head, text, np.ascontiguousarray(numbers, dtype="=f8").tobytes(), trials))


def unpacked(data: bytes) -> Reply:
    """The answer of these bytes.

    Args:
        data: as `packed` makes them, or anything else.

    Raises:
        NotAnAnswer: they are something else.
    """
    try:
        size, count = HEAD.unpack_from(data)
        told = json.loads(data[HEAD.size : HEAD.size + size])
        numbers = np.frombuffer(data, "=f8", count, HEAD.size + size)
        verdict, counts = told["verdict"], told["counts"]
        return Reply(
            number=int(told["number"]),
            process=int(told["process"]),
            results=numbers,
            done=int(told["done"]),
            used_up=bool(told["used_up"]),
            failure=None if told["failure"] is None else str(told["failure"]),
            warnings=tuple(map(str, told["warnings"])),
            counts=Counts(
                runs=int(counts["runs"]),
                steps=int(counts["steps"]),
                seconds=float(counts["seconds"]),
                processor_s=float(counts["processor_s"]),
                instances=int(counts["instances"]),
            ),
            verdict=Verdict(
                reused=None if verdict["reused"] is None else bool(verdict["reused"]),
                note=str(verdict["note"]),
                ended=bool(verdict["ended"]),
                lied=bool(verdict["lied"]),
                failed=bool(verdict["failed"]),
            ),
            trials=bytes(data[HEAD.size + size + 8 * count :]),
            memory=int(told["memory"]),
        )
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
        if (
            sys.platform != "win32"
        ):  # a handle of its own on the same pipe, which alone may not wait
            handle = os.dup(pipe.fileno())
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM, 0, handle)

    def take(self, most: int) -> bytes | None:
        """The next message, None where it has not come to its end.

        Args:
            most: bytes that it may have.

        Raises:
            EOFError: the other end is closed.
            NotAnAnswer: it says that it is longer than that.
        """
        if self._socket is None:
            return self._pipe.recv_bytes(most)
        while (message := self._first(most)) is None:
            try:
                chunk = self._socket.recv(CHUNK, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return None
            if not chunk:
                raise EOFError
            self._come += chunk
        return message

    def close(self) -> None:
        """Let go of the pipe."""
        if self._socket is not None:
            self._socket.close()

    def _first(self, most: int) -> bytes | None:
        begin, size = 4, -1
        if len(self._come) >= begin:
            [size] = struct.unpack_from("!i", self._come)
            if size == -1:  # one of more than 2 GB
                begin = 12
                size = -1 if len(self._come) < begin else struct.unpack_from("!Q", self._come, 4)[0]
            elif size < -1 or size > most:
                raise NotAnAnswer(f"a message of {size} bytes")
        if size > most:
            raise NotAnAnswer(f"a message of {size} bytes")
        if size < 0 or len(self._come) < begin + size:
            return None
        message = bytes(self._come[begin : begin + size])
        del self._come[: begin + size]
        return message
