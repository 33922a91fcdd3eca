"""How long a command took, and each of its parts: what a user waits for, not only the fit."""

from __future__ import annotations

import time
from collections.abc import Callable


class Laps:
    """A clock that runs from its making on; each lap is the time since the one before it.

    Args:
        clock: measures seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self.clock = clock
        self._times = [clock()]
        self._names: list[str] = []

    def end(self, name: str) -> None:
        """A part has ended.

        Args:
            name: of the part, in words that stand behind its seconds.
        """
        self._names.append(name)
        self._times.append(self.clock())

    @property
    def words(self) -> str:
        """One line: seconds in all, and of each part."""
        pairs = zip(self._times, self._times[1:], strict=False)
        parts = [f"{b - a:.1f} {n}" for (a, b), n in zip(pairs, self._names, strict=True)]
        return f"took {self._times[-1] - self._times[0]:.1f} s: {', '.join(parts)}"
