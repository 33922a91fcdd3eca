"""What a process prints: its last lines are kept, however much goes before them."""

from __future__ import annotations

import os
import threading
from typing import IO

from fitting.text.controls import spelled_out

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
