"""Finished parts of a long job as lines of JSON that are added to a file, however many there are.

The first line says which job they are of. kill -9 at any moment loses the parts that were running,
and nothing else: a last line that was cut is left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Generic, TypeVar

from fitting.text.atomic import add_to_file
from fitting.text.errors import BadInput
from fitting.text.files import write_whole
from fitting.text.records import from_plain, to_plain
from fitting.text.results_folder import open_folder_of

Part = TypeVar("Part")


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
        self._begun = False

    def resume(self) -> Iterator[Part]:
        """Parts that an interrupted run of the same job left, none where it left no file.

        What is recorded later is added to them.

        Raises:
            BadInput: the file is of another job, or is no journal.
        """
        whole = self._whole()
        yield from self._parts(whole)
        if whole:
            with self.path.open("rb+") as file:
                file.truncate(whole)
            self._begun = True

    def read(self) -> Iterator[Part]:
        """The same parts; the file stays as it is.

        Raises:
            BadInput: the file is of another job, or is no journal.
        """
        yield from self._parts(self._whole())

    def _parts(self, whole: int) -> Iterator[Part]:
        """The parts in so many bytes."""
        if not whole:
            return
        with self.path.open(encoding="utf-8") as lines:
            head = _read(next(lines), self.path, 1)
            if not isinstance(head, dict) or "job" not in head:
                raise BadInput(f"{self.path}: is no journal of finished items")
            if head["job"] != self.job:
                raise BadInput(
                    f"{self.path}: belongs to other data, another FMU or other settings; "
                    "wanted the same as now (leave out --resume to start afresh)"
                )
            size = len(head_line(self.job).encode())
            for place, line in enumerate(lines, start=2):
                size += len(line.encode())
                if size > whole:
                    break
                plain = _read(line, self.path, place)
                yield from_plain(self._kind, plain, f"{self.path}: row {place}")

    def record(self, part: Part) -> None:
        """Add a finished part.

        Args:
            part: to be kept.

        Raises:
            BadInput: the file cannot be written.
        """
        if not self._begun:
            write_whole(self.path, head_line(self.job))
            self._begun = True
        line = json.dumps(to_plain(part), allow_nan=False, separators=(",", ":")) + "\n"
        folder = open_folder_of(self.path)
        if folder is None:
            add_to_file(self.path, line.encode())
        else:
            folder.add_to(self.path, line)

    def _whole(self) -> int:
        """Bytes up to the end of the last whole line."""
        if not self.path.exists():
            return 0
        whole = 0
        with self.path.open("rb") as file:
            for line in file:
                whole += len(line) if line.endswith(b"\n") else 0
        return whole


def head_line(job: str) -> str:
    """The first line of a journal.

    Args:
        job: fingerprint of everything that a part depends on.
    """
    return json.dumps({"job": job}) + "\n"


def _read(line: str, path: Path, place: int) -> Any:
    try:
        return json.loads(line)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{path}: row {place}: cannot be read as JSON: {error}") from error
