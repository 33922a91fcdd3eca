"""Finished levels on disk, so that a reconstruction goes on where it was stopped.

One JSON file, replaced atomically after every level: kill -9 at any moment loses the level that
was running and nothing else. A level depends on the end of the one before and on nothing else, so
a resumed run ends bit for bit where an uninterrupted one does.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fitting.fit.continuation import ContinuationStep
from fitting.text.errors import BadInput
from fitting.text.records import read_json, write_json

NAME = "checkpoint.json"


@dataclass(frozen=True)
class _Saved:
    """Content of the file: `job` identifies data, FMU and settings."""

    job: str
    steps: tuple[ContinuationStep, ...]


class Checkpoint:
    """Finished levels of one job, in memory and in `folder`/checkpoint.json."""

    def __init__(self, folder: Path, job: str, steps: tuple[ContinuationStep, ...] = ()) -> None:
        self.path = folder / NAME
        self.job = job
        self._steps = {(s.alternative, s.start, s.level): s for s in steps}

    def recall(self, alternative: int, start: int, level: int) -> ContinuationStep | None:
        """The finished step of that place, None if there is none."""
        return self._steps.get((alternative, start, level))

    def record(self, step: ContinuationStep) -> None:
        """Add a finished step and replace the file."""
        self._steps[step.alternative, step.start, step.level] = step
        write_json(self.path, _Saved(self.job, tuple(self._steps.values())))

    def __len__(self) -> int:
        return len(self._steps)

    def remove(self) -> None:
        """Delete the file: the job is done."""
        self.path.unlink(missing_ok=True)


def begin(folder: Path, job: str) -> Checkpoint:
    """A checkpoint without any finished level; an older file is replaced with the first one."""
    return Checkpoint(folder, job)


def resume(folder: Path, job: str) -> Checkpoint:
    """The checkpoint that an interrupted run of the same job left, empty if it left none.

    Raises:
        BadInput: the file is of another job, or is no checkpoint.
    """
    path = folder / NAME
    if not path.exists():
        return Checkpoint(folder, job)
    saved = read_json(path, _Saved)
    if saved.job != job:
        raise BadInput(
            f"{path}: belongs to other data, another FMU or other settings; "
            "wanted the same as now (leave out --resume to start afresh)"
        )
    return Checkpoint(folder, job, saved.steps)
