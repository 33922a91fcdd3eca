"""What asks a command to end: Ctrl-C, SIGTERM, a terminal that is closed. All end it in one way."""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

#: Exit code of a command that was interrupted and had nothing to write.
INTERRUPTED = 130
MORE = "fmu-fit: ending, and writing the results so far; interrupt once more to end without"


class Interrupts:
    """Counts how often a command was asked to end.

    The first time raises KeyboardInterrupt, which stops the work; what follows then, as writing
    what there is, goes on the second time as well; the third time ends it at once.
    """

    def __init__(self) -> None:
        self.times = 0
        self._deferred = self._over = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Deal with a signal.

        Args:
            number: of the signal.
            frame: where it came.
        """
        self.times += 1
        if self._over:  # the exit code is settled, what is left are temporary files
            if self.times > 2:
                os._exit(INTERRUPTED)
            return
        if self.times == 1 and not self._deferred:
            raise KeyboardInterrupt
        if self.times == 2:
            with suppress(OSError):  # not by way of a stream that is being written to just now
                os.write(2, f"{MORE}\n".encode())
        if self.times > 2:
            raise SystemExit(INTERRUPTED)

    def end(self) -> None:
        """The command is over: there is nothing left to interrupt, and its exit code stays."""
        self._over = True

    @contextmanager
    def deferred(self) -> Iterator[None]:
        """What is done here is done to its end; KeyboardInterrupt comes after it."""
        before = self.times
        self._deferred = True
        try:
            yield
        finally:
            self._deferred = False
        if self.times > before == 0:
            raise KeyboardInterrupt


@contextmanager
def interruptible(*, whole_process: bool = False) -> Iterator[Interrupts]:
    """While a command runs, all that asks it to end ends it alike.

    Also Ctrl-C in a command that was started in the background with Ctrl-C ignored: it is asked to
    end by ``kill -INT``. A hangup that was ignored (``nohup``) stays ignored.

    Yields what counts the requests.

    Args:
        whole_process: whether the process ends with the command: what Python does then, as removing
            temporary files, is not interrupted either.
    """
    interrupts = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield interrupts
        return
    signals = [signal.SIGINT, signal.SIGTERM]
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        signals.append(signal.SIGHUP)
    before = {number: signal.signal(number, interrupts) for number in signals}
    if whole_process:  # before it is finalised, which would let a signal end it by its number
        atexit.register(_ignore, signals)
    try:
        yield interrupts
    finally:
        interrupts.end()
        for number, handler in before.items() if not whole_process else ():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


def _ignore(signals: Iterable[int]) -> None:
    for number in signals:
        signal.signal(number, signal.SIG_IGN)


@contextmanager
def to_the_end() -> Iterator[None]:
    """What is done here is not interrupted by the first request to end, but followed by it."""
    handler = signal.getsignal(signal.SIGINT)
    if not isinstance(handler, Interrupts):
        yield
        return
    with handler.deferred():
        yield
