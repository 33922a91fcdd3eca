"""Finished parts of a long job on disk, so that it goes on where it was stopped.

A checkpoint is one JSON file, replaced atomically. A journal is a file of lines of JSON to which
parts are added, however many there are; the first line identifies their job. kill -9 at any moment
loses the parts that were running, and what was finished since the last writing, and nothing else:
a last line that was cut is left out.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from fitting.text.errors import BadInput
from fitting.text.files import add_to_file
from fitting.text.records import from_plain, read_json, to_plain, write_json
from fitting.text.results_folder import open_folder_of, write_whole

Part = TypeVar("Part")
OTHER_JOB = (
    "belongs to other data, another FMU or other settings; wanted the same as now (leave out "
    "--resume to start afresh)"
)


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


class Journal(Generic[Part]):
    """Finished parts of one job in a file that grows.

    Args:
        path: The file; one that is there stays until the first part is recorded.
        job: Fingerprint of everything that a part depends on.
        kind: The record that a part is.
    """

    def __init__(self, path: Path, job: str, kind: type[Part]) -> None:
        self.path, self.job = path, job
        self._kind = kind
        self._started, self._whole = False, 0

    def resume(self) -> Iterator[Part]:
        """Parts that an interrupted run of the same job left, none where it left no file.

        What is recorded later is added to them.

        Raises:
            BadInput: the file is of another job, or is no journal.
        """
        yield from self.read()
        if self._whole:
            with self.path.open("rb+") as file:
                file.truncate(self._whole)
            self._started = True

    def read(self) -> Iterator[Part]:
        """The same parts; the file stays as it is.

        Raises:
            BadInput: the file is of another job, or is no journal.
        """
        self._whole = 0  # bytes up to the end of the last whole line
        if not self.path.exists():
            return
        with self.path.open("rb") as lines:
            for place, line in enumerate(lines, start=1):
                if not line.endswith(b"\n"):
                    return
                where = f"{self.path}: row {place}"
                try:
                    plain = json.loads(line)
                except (ValueError, RecursionError) as error:
                    raise BadInput(f"{where}: cannot be read as JSON: {error}") from error
                if place > 1:
                    yield from_plain(self._kind, plain, where)
                elif not isinstance(plain, dict) or "job" not in plain:
                    raise BadInput(f"{self.path}: is no journal of finished items")
                elif plain["job"] != self.job:
                    raise BadInput(f"{self.path}: {OTHER_JOB}")
                self._whole += len(line)

    def recorded(self) -> Iterator[Part]:
        """The parts in the file since this run, or the one it goes on with, began to write."""
        if self._started:
            yield from self.read()

    def record(self, part: Part) -> None:
        """Add a finished part.

        Args:
            part: to be kept.

        Raises:
            BadInput: the file cannot be written.
        """
        if not self._started:
            write_whole(self.path, json.dumps({"job": self.job}) + "\n")
            self._started = True
        line = json.dumps(to_plain(part), allow_nan=False, separators=(",", ":")) + "\n"
        folder = open_folder_of(self.path)
        if folder is None:
            add_to_file(self.path, line.encode())
        else:
            folder.add_to(self.path, line)
