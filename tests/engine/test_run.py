"""Items through any executor: few at once, one after the other, none that nobody asks for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from typing import Any

import pytest

from fitting.engine.run import Place, run
from tests.support import work
from tests.support.work import Piece


class Late(Executor):
    """Does what it was asked when it has been asked so often, the last first."""

    def __init__(self, most: int) -> None:
        self.most, self.waiting = most, list[tuple[Future[Any], Callable[[], Any]]]()
        self.largest = 0

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.waiting.append((future, lambda: fn(*args, **kwargs)))
        self.largest = max(self.largest, len(self.waiting))
        if len(self.waiting) == self.most:
            while self.waiting:
                one, call = self.waiting.pop()
                one.set_result(call())
        return future


def test_no_more_than_a_few_are_under_way() -> None:
    taken = 0

    def pieces() -> Iterator[Piece]:
        nonlocal taken
        for k in range(30):
            taken += 1
            yield Piece(k)

    late = Late(5)
    results = run(work.squared, pieces(), Place(late, ahead=5))
    _, first, _ = next(results)
    assert first is not None
    assert taken == 5
    rest = [result for _, result, _ in results]
    assert late.largest <= 5
    assert {first, *rest} == {(k, k * k) for k in range(30)}


class GivesUp(Late):
    """Does so many, and lets go of the rest, as a cluster without its scheduler."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future = super().submit(fn, *args, **kwargs)
        if len(self.waiting) == self.most - 1:
            one, call = self.waiting.pop(0)
            one.set_result(call())
            for other, _ in self.waiting:
                other.cancel()
                other.set_running_or_notify_cancel()
        return future


def test_an_executor_that_lets_go_of_its_items_takes_no_more() -> None:
    results = run(work.squared, [Piece(k) for k in range(3)], Place(GivesUp(4), ahead=3))
    with pytest.raises(BrokenExecutor, match="given up"):
        list(results)


def test_what_has_not_begun_is_left_when_nobody_asks_on() -> None:
    with ThreadPoolExecutor(1) as pool:
        results = run(work.squared, (Piece(k) for k in range(100)), Place(pool, ahead=3))
        next(results)
        results.close()  # type: ignore[attr-defined]
    assert pool._work_queue.qsize() <= 1  # the word that ends the thread


def test_an_executor_that_takes_no_more_ends_it() -> None:
    class Broken(Executor):
        def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
            raise BrokenExecutor("gone")

    with pytest.raises(BrokenExecutor, match="gone"):
        list(run(work.squared, [Piece(1)], Place(Broken())))


def test_a_fault_of_the_work_reaches_the_caller() -> None:
    with ThreadPoolExecutor(1) as pool, pytest.raises(Exception, match="refused"):
        list(run(work.refusing, [Piece(0), Piece(1)], Place(pool)))
