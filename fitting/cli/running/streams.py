"""Standard output and error as a command may find them: closed, full, or of a poor alphabet."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import Any, TextIO, cast

from fitting.text.errors import spelled_out


class Outlet:
    """A text stream that goes on taking text when its reader is gone.

    Whoever closes a pipe (``| head``) has seen enough: the command still ends its work and writes
    its files. ``failure`` is why text was lost, None while none was.

    What steers a terminal is spelled out, but for ``steering``: words of FMUs and of files come
    this way.

    Args:
        stream: where text goes; None where the process was started without it.
        steering: whether text may move the cursor, as that of a progress bar.
    """

    def __init__(self, stream: TextIO | None, *, steering: bool = False) -> None:
        self.failure: OSError | None = None
        self._stream = stream
        self._steering = steering

    def write(self, text: str) -> int:
        """Write what can be written; a character that the stream has not is spelled out.

        Args:
            text: as for any stream.
        """
        if self._stream is not None:
            encoding = self._stream.encoding or "utf-8"
            shown = text if self._steering else spelled_out(text, "\n\t")
            with self._giving_up():
                self._stream.write(shown.encode(encoding, "backslashreplace").decode(encoding))
        return len(text)

    def flush(self) -> None:
        """Hand over what was written."""
        if self._stream is not None:
            with self._giving_up():
                self._stream.flush()

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return self._stream is not None and self._stream.isatty()

    def __getattr__(self, name: str) -> Any:
        """Whatever else the stream itself has."""
        return getattr(self._stream, name)

    @contextlib.contextmanager
    def _giving_up(self) -> Iterator[None]:
        """After a failure everything is dropped, also what Python still holds when it ends."""
        try:
            yield
        except OSError as error:
            self.failure = self.failure or error
            stream, self._stream = self._stream, None
            with contextlib.suppress(OSError, AttributeError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), cast(TextIO, stream).fileno())


@contextlib.contextmanager
def outlets() -> Iterator[Outlet]:
    """Standard output and error as outlets, and put back at the end.

    Yields that of the standard output.
    """
    _occupy_closed()
    before = sys.stdout, sys.stderr
    output, errors = Outlet(before[0]), Outlet(before[1], steering=True)
    sys.stdout, sys.stderr = cast(TextIO, output), cast(TextIO, errors)
    try:
        yield output
    finally:
        output.flush()
        errors.flush()
        sys.stdout, sys.stderr = before


def _occupy_closed() -> None:
    """Files and pipes that are opened later must not become somebody's standard output."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number, which is this one
