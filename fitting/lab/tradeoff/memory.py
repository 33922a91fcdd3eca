"""Finished settings on disk, so that a study goes on where it was stopped."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from fitting.lab.tradeoff.records import Measurement, Reference
from fitting.text.checkpoint import Checkpoint

NAME = "tradeoff-checkpoint.json"
#: Time between two writings of the file, s: kill -9 loses no more than that.
EVERY_S = 2.0
_REFERENCES = "references"


@dataclass(frozen=True)
class _Part:
    """A finished setting, or the references that errors are measured from."""

    measurement: Measurement | None = None
    references: tuple[Reference, ...] = ()

    @property
    def key(self) -> str:
        return _REFERENCES if self.measurement is None else self.measurement.setting.key


class Memory(Checkpoint[_Part]):
    """References and measurements of one job, in memory and in the folder's checkpoint file."""

    def __init__(self, folder: Path, job: str) -> None:
        super().__init__(folder / NAME, job, _Part, lambda part: part.key, EVERY_S)

    @property
    def references(self) -> tuple[Reference, ...]:
        """The references, none before they were kept."""
        part = self.find(_REFERENCES)
        return part.references if part else ()

    def keep_references(self, references: tuple[Reference, ...]) -> None:
        """Keep the references and write the file."""
        self.record(_Part(references=references))
        self.write()

    def recall(self, key: str) -> Measurement | None:
        """The finished measurement of a setting, None if there is none."""
        part = self.find(key)
        return part.measurement if part else None

    def keep(self, measurement: Measurement) -> None:
        """Add a measurement; the file follows within seconds."""
        self.record(_Part(measurement))

    def __len__(self) -> int:
        """The number of finished settings."""
        return super().__len__() - bool(self.references)


def begin(folder: Path, job: str) -> Memory:
    """A memory without any finished setting; an older file is replaced with the first one."""
    return Memory(folder, job)


def resume(folder: Path, job: str) -> Memory:
    """The memory that an interrupted run of the same job left, empty if it left none.

    Raises:
        BadInput: the file is of another job, or is none of these.
    """
    memory = Memory(folder, job)
    memory.resume()
    return memory
