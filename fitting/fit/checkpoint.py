"""Finished levels on disk, so that a reconstruction goes on where it was stopped.

A level depends on the end of the one before and on nothing else, so a resumed run ends bit for bit
where an uninterrupted one does.
"""

from __future__ import annotations

from pathlib import Path

from fitting.fit.path import PathLevel
from fitting.text import checkpoint

NAME = "checkpoint.json"


def _place(level: PathLevel) -> tuple[str, int, int]:
    return level.kind, level.alternative, level.level


class Checkpoint(checkpoint.Checkpoint[PathLevel]):
    """Finished levels of one job, in memory and in `folder`/checkpoint.json."""

    def __init__(self, folder: Path, job: str) -> None:
        super().__init__(folder / NAME, job, PathLevel, _place)

    def recall(self, kind: str, alternative: int, level: int) -> PathLevel | None:
        """The finished level of that place, None if there is none.

        Args:
            kind: of the path.
            alternative: its number.
            level: of ν, from 0.
        """
        return self.find((kind, alternative, level))


def resume(folder: Path, job: str) -> Checkpoint:
    """The checkpoint that an interrupted run of the same job left, empty if it left none.

    Args:
        folder: where the checkpoint is kept.
        job: fingerprint of everything that a level depends on.

    Raises:
        BadInput: the file is of another job, or is no checkpoint.
    """
    kept = Checkpoint(folder, job)
    kept.resume()
    return kept
