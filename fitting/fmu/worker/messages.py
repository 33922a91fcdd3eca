"""What a caller and its worker process say to each other: a task, then batches and replies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from fitting.fmu.isolation import Isolation
from fitting.fmu.loadable import Loadable
from fitting.fmu.run_requests import Layout, RunRequest
from fitting.fmu.runs import Counts
from fitting.fmu.worker.reuse import Verdict
from fitting.text.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class UnpackedFmu(Loadable):
    """An FMU that is unpacked into ``folder``."""

    folder: str


class Task(NamedTuple):
    """What a worker is there for: an FMU, what is known about its reuse, its pulse and limits.

    ``trials`` are what an earlier worker has compared, as that packed it. ``pulse_path`` is the
    file of the pulse, unused where its descriptor came before the task.
    """

    fmu: UnpackedFmu
    verdict: Verdict
    trials: bytes
    pulse_path: str
    isolation: Isolation | None = None


class Batch(NamedTuple):
    """Runs to do, and the layouts that the worker does not know yet, by their numbers.

    ``number`` counts the batches of a worker. ``rows`` are requests as plain tuples, which are
    packed in half the time.
    """

    number: int
    layouts: list[Layout]
    rows: list[tuple[Any, ...]]

    @classmethod
    def of(cls, number: int, layouts: list[Layout], requests: Sequence[RunRequest]) -> Batch:
        """A batch of requests.

        Args:
            number: of the batch.
            layouts: all that there are, the worker's first.
            requests: runs to do.
        """
        return cls(number, layouts, list(map(tuple, requests)))

    @property
    def requests(self) -> Iterator[RunRequest]:
        """The runs to do."""
        return map(RunRequest._make, self.rows)


class Reply(NamedTuple):
    """Results of the first ``done`` requests, flat; the rest is left if ``used_up`` or ``failure``.

    ``number`` is that of the batch, ``process`` who answers. ``used_up``: this process should do no
    more; ``failure``: why the one after the last done one failed. ``trials``: what was compared of
    resets, packed for the next worker. ``memory`` of the process in bytes, 0 where the system does
    not tell.
    """

    number: int
    process: int
    results: FloatArray
    done: int
    used_up: bool
    failure: str | None
    warnings: tuple[str, ...]
    counts: Counts
    verdict: Verdict
    trials: bytes
    memory: int = 0
