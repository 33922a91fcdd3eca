"""Other processes in tests: are they gone, and waiting for what they will do.

Nothing here is a claim about speed: the bound of a wait only stops a test that would hang.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable

MOST_S = 300.0


def wait_until(holds: Callable[[], bool], what: str, most_s: float = MOST_S) -> None:
    """Wait for a condition; AssertionError with its name if it does not come to hold."""
    until = time.monotonic() + most_s
    while not holds():
        assert time.monotonic() < until, f"waited {most_s:g} s for: {what}"
        time.sleep(0.02)


def is_gone(pid: int) -> bool:
    """Whether no process of that number runs; one that only waits to be collected is gone."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return False


class Clock:
    """The clock by which workers are late: ten seconds on at every look while ``runs`` holds."""

    def __init__(self) -> None:
        self.now = 0.0
        self.runs: Callable[[], bool] = lambda: False

    def monotonic(self) -> float:
        self.now += 10.0 * self.runs()
        return self.now
