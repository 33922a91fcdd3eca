"""What asks a command to end: Ctrl-C, SIGTERM, a terminal that is closed. All end it in one way."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

#: Exit code of a command that was interrupted and had nothing to write.
INTERRUPTED = 130
MORE = "fmu-fit: ending, and writing what there is; to be asked once more ends it without"


class Interrupts:
    """Counts how often a command was asked to end.

    The first time raises KeyboardInterrupt, which stops the work; what follows then, as writing
    what there is, goes on the second time as well; the third time ends it at once.
    """

    def __init__(self) -> None:
        self.times = 0
        self._held = False

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Deal with a signal.

        Args:
            number: of the signal.
            frame: where it came.
        """
        self.times += 1
        if self.times == 1 and not self._held:
            raise KeyboardInterrupt
        if self.times == 2:
            with suppress(OSError):  # not by way of a stream that is being written to just now
                os.write(2, f"{MORE}\n".encode())
        if self.times > 2:
            raise SystemExit(INTERRUPTED)

    @contextmanager
    def held(self) -> Iterator[None]:
        """What is done here is done to its end; KeyboardInterrupt comes after it."""
        before = self.times
        self._held = True
        try:
            yield
        finally:
            self._held = False
        if self.times > before == 0:
            raise KeyboardInterrupt


@contextmanager
def interruptible() -> Iterator[None]:
    """While a command runs, all that asks it to end ends it alike.

    Also Ctrl-C in a command that was started in the background with Ctrl-C ignored: it is asked to
    end by ``kill -INT``. A hangup that was ignored (``nohup``) stays ignored.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    signals = [signal.SIGINT, signal.SIGTERM]
    if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        signals.append(signal.SIGHUP)
    interrupts = Interrupts()
    before = {number: signal.signal(number, interrupts) for number in signals}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)


@contextmanager
def to_the_end() -> Iterator[None]:
    """What is done here is not interrupted by the first request to end, but followed by it."""
    handler = signal.getsignal(signal.SIGINT)
    if not isinstance(handler, Interrupts):
        yield
        return
    with handler.held():
        yield
