"""Finished parts of a long job as lines of JSON that are added to a file, however many there are.

The first line identifies their job. kill -9 at any moment loses the parts that were running,
and nothing else: a last line that was cut is left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Generic, TypeVar

from fitting.text.errors import BadInput
from fitting.text.files import add_to_file
from fitting.text.records import from_plain, to_plain
from fitting.text.results_folder import open_folder_of, write_whole

Part = TypeVar("Part")
OTHER_JOB = (
    "belongs to other data, another FMU or other settings; wanted the same as now (leave out "
    "--resume to start afresh)"
)


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
        line = json.dumps(to_plain(part), allow_nan=False, separators=(",", ":")) + "\n"
        folder = open_folder_of(self.path)
        if not self._started:  # a file that is there holds a part
            write_whole(self.path, json.dumps({"job": self.job}) + "\n" + line)
            self._started = True
        elif folder is None:
            add_to_file(self.path, line.encode())
        else:
            folder.add_to(self.path, line)
