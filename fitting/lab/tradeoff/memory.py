"""Finished settings on disk, so that a study goes on where it was stopped."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from fitting.lab.tradeoff.records import Measurement, Reference
from fitting.text.errors import BadInput
from fitting.text.records import read_json, write_json

NAME = "tradeoff-checkpoint.json"
#: Time between two writings of the file, s: kill -9 loses no more than that.
EVERY_S = 2.0


@dataclass(frozen=True)
class _Saved:
    """Content of the file: `job` identifies scene, FMU, grid and versions."""

    job: str
    references: tuple[Reference, ...]
    measurements: tuple[Measurement, ...]


class Memory:
    """References and measurements of one job, in memory and in the folder's checkpoint file."""

    def __init__(self, folder: Path, job: str, saved: _Saved | None = None) -> None:
        self.path = folder / NAME
        self.job = job
        self.references = saved.references if saved else ()
        found = saved.measurements if saved else ()
        self._found = {m.setting.key: m for m in found}
        self._written_s = 0.0

    def recall(self, key: str) -> Measurement | None:
        """The finished measurement of a setting, None if there is none."""
        return self._found.get(key)

    def keep_references(self, references: tuple[Reference, ...]) -> None:
        """Keep the references and write the file."""
        self.references = references
        self.write()

    def record(self, measurement: Measurement) -> None:
        """Add a measurement; the file follows within seconds."""
        self._found[measurement.setting.key] = measurement
        if time.monotonic() - self._written_s > EVERY_S:
            self.write()

    def write(self) -> None:
        """Replace the file."""
        write_json(self.path, _Saved(self.job, self.references, tuple(self._found.values())))
        self._written_s = time.monotonic()

    def __len__(self) -> int:
        return len(self._found)

    def remove(self) -> None:
        """Delete the file: the job is done."""
        self.path.unlink(missing_ok=True)


def begin(folder: Path, job: str) -> Memory:
    """A memory without any finished setting; an older file is replaced with the first one."""
    return Memory(folder, job)


def resume(folder: Path, job: str) -> Memory:
    """The memory that an interrupted run of the same job left, empty if it left none.

    Raises:
        BadInput: the file is of another job, or is none of these.
    """
    path = folder / NAME
    if not path.exists():
        return Memory(folder, job)
    saved = read_json(path, _Saved)
    if saved.job != job:
        raise BadInput(
            f"{path}: belongs to another scene, another FMU or other options; "
            "wanted the same as now (leave out --resume to start afresh)"
        )
    return Memory(folder, job, saved)
