"""Finished levels on disk, so that a reconstruction goes on where it was stopped.

A level depends on the end of the one before and on nothing else, so a resumed run ends bit for bit
where an uninterrupted one does. They are the parts of a journal: kill -9 at any moment loses the
level that was running, and nothing else.
"""

from __future__ import annotations

from pathlib import Path

from fitting.fit.path import PathLevel
from fitting.text.journal import Journal

NAME = "checkpoint.jsonl"


class Checkpoint:
    """Finished levels of one job, in memory and in `folder`/checkpoint.jsonl.

    Args:
        folder: where the file is; one that is there stays until the first level is recorded.
        job: fingerprint of everything that a level depends on.
        resume: whether the levels count that an interrupted run of the same job left.

    Raises:
        BadInput: the file of an interrupted run is of another job, or is no checkpoint.
    """

    def __init__(self, folder: Path, job: str, *, resume: bool = False) -> None:
        self.path = folder / NAME
        self._journal = Journal(self.path, job, PathLevel)
        self._levels: dict[tuple[str, int, int], PathLevel] = {}
        for each in self._journal.resume() if resume else ():
            self._levels[each.kind, each.alternative, each.level] = each

    def recall(self, kind: str, alternative: int, level: int) -> PathLevel | None:
        """The finished level of that place, None if there is none.

        Args:
            kind: of the path.
            alternative: its number.
            level: of ν, from 0.
        """
        return self._levels.get((kind, alternative, level))

    def record(self, level: PathLevel) -> None:
        """Add a finished level, also to the file.

        Args:
            level: that has ended.

        Raises:
            BadInput: the file cannot be written.
        """
        self._levels[level.kind, level.alternative, level.level] = level
        self._journal.record(level)

    def remove(self) -> None:
        """Delete the file: the job is done."""
        self.path.unlink(missing_ok=True)

    def resumed(self) -> str:
        """What --resume found, a sentence: so many levels, or no file."""
        if self._levels or self.path.exists():
            return f"{len(self)} finished levels found in {self.path}"
        return f"--resume: {self.path} is not there, nothing to go on from: starting anew"

    def __len__(self) -> int:
        return len(self._levels)
