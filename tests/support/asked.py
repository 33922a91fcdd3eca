"""The command line in this process, asked to end by a real signal: without a process to start."""

from __future__ import annotations

import os
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.support.in_process import Told, told


def asked_to_end(number: int, when: Callable[[], bool], *words: str | Path) -> Told:
    """Run ``fmu-fit`` with these words, and send this process a signal once ``when`` holds.

    Args:
        number: of the signal.
        when: whether it is time; looked at from another thread.
        words: of the command line.
    """
    ended = threading.Event()

    def ask() -> None:
        while not ended.wait(0.02):
            if when():
                os.kill(os.getpid(), number)
                return

    with harmless(number):
        asking = threading.Thread(target=ask, daemon=True)
        asking.start()
        try:
            return told(*words)
        finally:
            ended.set()
            asking.join()


@contextmanager
def harmless(number: int) -> Iterator[None]:
    """A signal that comes when no command runs does nothing.

    Args:
        number: of the signal.
    """
    before = signal.signal(number, lambda *_: None)
    try:
        yield
    finally:
        signal.signal(number, before)


@contextmanager
def temporary_files_in(folder: Path) -> Iterator[None]:
    """Temporary files of this process are made in a folder, so that it is seen what is left.

    Args:
        folder: made here.
    """
    folder.mkdir(parents=True, exist_ok=True)
    before, tempfile.tempdir = tempfile.tempdir, str(folder)
    try:
        yield
    finally:
        tempfile.tempdir = before
