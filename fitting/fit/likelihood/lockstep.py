"""Many searches side by side: each asks for points, all of what they ask for is one batch.

A search is a generator that yields a `Request` and is sent the answers. A fit whose simulations
run in worker processes is fast only if there is work for all of them at a time; one branch
of a profile has one point to try. Twenty branches have twenty.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from fitting.text.arrays import FloatArray

T = TypeVar("T")


class Exhausted(Exception):
    """No more evaluations are allowed; thrown into every search that still asks."""


@dataclass(frozen=True)
class Request:
    """Search vectors at which rows, outputs or both are wanted."""

    xs: tuple[FloatArray, ...]
    rows: bool = True
    outputs: bool = True


@dataclass(frozen=True)
class Sample:
    """One evaluated search vector: `rows` (m,) whitened, `outputs` (k,); empty if not wanted.

    NaN rows where the model failed; NaN outputs where the model has no value.
    """

    x: FloatArray
    rows: FloatArray
    outputs: FloatArray


Task = Generator[Request, list[Sample], T]


def run_in_lockstep(
    tasks: Sequence[Task[T]], evaluate: Callable[[Sequence[Request]], list[list[Sample]]]
) -> list[T | None]:
    """Run all tasks to their ends, one batch per round; None where `Exhausted` ended one.

    `evaluate` answers the requests of a round in their order, and raises `Exhausted` where it may
    not any more.

    Args:
        tasks: searches that have not begun.
        evaluate: answers requests with samples, in one batch.
    """
    results: list[T | None] = [None] * len(tasks)
    waiting: dict[int, Request] = {}
    for k in range(len(tasks)):
        _advance(k, tasks[k], None, waiting, results)
    while waiting:
        order = list(waiting)
        try:
            answers = evaluate([waiting[k] for k in order])
        except Exhausted as spent:
            for k in order:
                _end(k, tasks[k], spent, results)
            break
        for k, answer in zip(order, answers, strict=True):
            del waiting[k]
            _advance(k, tasks[k], answer, waiting, results)
    return results


def _advance(
    k: int,
    task: Task[T],
    answer: list[Sample] | None,
    waiting: dict[int, Request],
    results: list[T | None],
) -> None:
    try:
        waiting[k] = next(task) if answer is None else task.send(answer)
    except StopIteration as ended:
        results[k] = ended.value


def _end(k: int, task: Task[T], spent: Exhausted, results: list[T | None]) -> None:
    """Tell a task that there is no more; it may still return what it has."""
    try:
        task.throw(spent)
    except StopIteration as ended:
        results[k] = ended.value
    except Exhausted:
        results[k] = None
    else:
        task.close()
