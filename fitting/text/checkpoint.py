"""Finished parts of a long job on disk, so that it goes on where it was stopped.

One JSON file, replaced atomically: kill -9 at any moment loses the part that was running, and what
was finished since the last writing, and nothing else.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from fitting.text.errors import BadInput
from fitting.text.journal import OTHER_JOB
from fitting.text.records import from_plain, read_json, write_json

Part = TypeVar("Part")


@dataclass(frozen=True)
class _Saved:
    """Content of the file: `job` identifies everything that a finished part depends on."""

    job: str
    finished: tuple[Any, ...]


class Checkpoint(Generic[Part]):
    """Finished parts of one job, in memory and in a file.

    Args:
        path: The file; one that is there stays until the first part is recorded.
        job: Fingerprint of everything that a part depends on.
        kind: The record that a part is.
        key: What distinguishes a part from the others.
        every_s: Least time between two writings in s; 0 writes after every part.
    """

    def __init__(
        self,
        path: Path,
        job: str,
        kind: type[Part],
        key: Callable[[Part], Hashable],
        every_s: float = 0.0,
    ) -> None:
        self.path, self.job = path, job
        self._kind, self._key, self._every_s = kind, key, every_s
        self._parts: dict[Hashable, Part] = {}
        self._written_s = 0.0

    def resume(self) -> bool:
        """Take in what an interrupted run of the same job left; False if it left no file.

        Raises:
            BadInput: the file is of another job, or is no checkpoint.
        """
        if not self.path.exists():
            return False
        saved = read_json(self.path, _Saved)
        if saved.job != self.job:
            raise BadInput(f"{self.path}: {OTHER_JOB}")
        for place, plain in enumerate(saved.finished):
            part = from_plain(self._kind, plain, f"{self.path}: finished[{place}]")
            self._parts[self._key(part)] = part
        return True

    def find(self, key: Hashable) -> Part | None:
        """The finished part of that key, None if there is none.

        Args:
            key: under which the part was kept.
        """
        return self._parts.get(key)

    def record(self, part: Part) -> None:
        """Add a finished part, and replace the file if that is due.

        Args:
            part: to be kept, with its key.
        """
        self._parts[self._key(part)] = part
        if not self._every_s or time.monotonic() - self._written_s > self._every_s:
            self.write()

    def write(self) -> None:
        """Replace the file."""
        write_json(self.path, _Saved(self.job, tuple(self._parts.values())))
        self._written_s = time.monotonic()

    def remove(self) -> None:
        """Delete the file: the job is done."""
        self.path.unlink(missing_ok=True)

    def resumed(self, parts: str) -> str:
        """What --resume found, a sentence: so many ``parts`` ("levels", "settings"), or no file."""
        if self._parts or self.path.exists():
            return f"{len(self)} finished {parts} found in {self.path}"
        return f"--resume: {self.path} is not there, nothing to go on from: starting anew"

    def __len__(self) -> int:
        return len(self._parts)
