"""Finished levels on disk, so that a reconstruction goes on where it was stopped.

A level depends on the end of the one before and on nothing else, so a resumed run ends bit for bit
where an uninterrupted one does. They are one JSON file, replaced atomically: kill -9 at any moment
loses the level that was running, and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fitting.fit.path import PathLevel
from fitting.text.errors import BadInput
from fitting.text.journal import OTHER_JOB
from fitting.text.records import from_plain, read_json, write_json

NAME = "checkpoint.json"


@dataclass(frozen=True)
class _Saved:
    """Content of the file: `job` identifies everything that a finished level depends on."""

    job: str
    finished: tuple[Any, ...]


class Checkpoint:
    """Finished levels of one job, in memory and in `folder`/checkpoint.json.

    Args:
        folder: where the file is; one that is there stays until the first level is recorded.
        job: fingerprint of everything that a level depends on.
        levels: that have ended already.
    """

    def __init__(self, folder: Path, job: str, levels: Iterable[PathLevel] = ()) -> None:
        self.path, self.job = folder / NAME, job
        self._levels = {(each.kind, each.alternative, each.level): each for each in levels}

    def recall(self, kind: str, alternative: int, level: int) -> PathLevel | None:
        """The finished level of that place, None if there is none.

        Args:
            kind: of the path.
            alternative: its number.
            level: of ν, from 0.
        """
        return self._levels.get((kind, alternative, level))

    def record(self, level: PathLevel) -> None:
        """Add a finished level, and replace the file.

        Args:
            level: that has ended.

        Raises:
            BadInput: the file cannot be written.
        """
        self._levels[level.kind, level.alternative, level.level] = level
        write_json(self.path, _Saved(self.job, tuple(self._levels.values())))

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


def resume(folder: Path, job: str) -> Checkpoint:
    """The checkpoint that an interrupted run of the same job left, empty if it left none.

    Args:
        folder: where the checkpoint is kept.
        job: fingerprint of everything that a level depends on.

    Raises:
        BadInput: the file is of another job, or is no checkpoint.
    """
    path = folder / NAME
    if not path.exists():
        return Checkpoint(folder, job)
    saved = read_json(path, _Saved)
    if saved.job != job:
        raise BadInput(f"{path}: {OTHER_JOB}")
    levels = [
        from_plain(PathLevel, plain, f"{path}: finished[{place}]")
        for place, plain in enumerate(saved.finished)
    ]
    return Checkpoint(folder, job, levels)
