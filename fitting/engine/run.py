"""Many independent items through one executor: results as they end, a lost worker's item again.

Nothing of an item is kept once its result is out; what waits is bounded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from dataclasses import dataclass
from itertools import islice
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

#: Items that are handed over and have not ended: enough for any executor to have the next at hand.
AHEAD = 256


@dataclass(frozen=True)
class Place:
    """Where items run.

    ``losses`` are the exceptions of a worker that was lost, ``repeats`` how often its item
    is then done again: none where the executor does that itself. ``ahead`` items are handed over
    before the first has ended.
    """

    executor: Executor
    losses: tuple[type[BaseException], ...] = (BrokenExecutor,)
    repeats: int = 1
    ahead: int = AHEAD


def run(
    work: Callable[[Item], Result], items: Iterable[Item], place: Place
) -> Iterator[tuple[Item, Result | None, str]]:
    """Results of independent items, as they end; what has not started is left at the end.

    Each item comes with its result, or None and the words on why its worker was lost.

    Args:
        work: a function of a module, called in the executor with each item.
        items: are taken as there is room.
        place: where it runs.

    Raises:
        BrokenExecutor: the executor as a whole takes no more.
        Exception: whatever ``work`` raises.
    """
    coming = iter(items)
    running: dict[Future[Result], tuple[Item, int]] = {}  # items, and how often each was lost

    def submit(item: Item, lost: int = 0) -> None:
        running[place.executor.submit(work, item)] = item, lost

    try:
        while True:
            for item in islice(coming, place.ahead - len(running)):
                submit(item)
            if not running:
                return
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                item, lost = running.pop(future)
                try:
                    result = future.result()
                except place.losses as loss:
                    if lost < place.repeats:
                        submit(item, lost + 1)
                    else:
                        yield item, None, str(loss) or type(loss).__name__
                    continue
                except CancelledError:  # nothing here has cancelled what is waited for
                    raise BrokenExecutor("it has given up what it had been handed") from None
                yield item, result, ""
    finally:
        for future in running:
            future.cancel()
