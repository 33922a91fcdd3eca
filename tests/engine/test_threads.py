"""Linear algebra on one thread while something is solved, and on the caller's own number after."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import fitting as ff
from fitting.api import fitted
from fitting.engine.threads import one_thread

OWN = 2


@pytest.fixture(autouse=True)
def _caller() -> Iterator[None]:
    """A caller who has asked for two threads."""
    with threadpool_limits(OWN, user_api="blas"):
        yield


def threads() -> set[int]:
    """Threads that libraries of linear algebra take here."""
    return {found["num_threads"] for found in threadpool_info() if found["user_api"] == "blas"}


def test_one_thread_within_and_the_callers_own_after() -> None:
    assert threads() == {OWN}
    with one_thread():
        assert threads() == {1}
        with one_thread():
            assert threads() == {1}
        assert threads() == {1}
    assert threads() == {OWN}


def test_the_callers_own_come_back_after_an_error() -> None:
    with pytest.raises(ZeroDivisionError), one_thread():
        _ = 1 // 0
    assert threads() == {OWN}


def test_of_two_that_overlap_the_last_gives_them_back() -> None:
    """The first to begin ends first: what the second found is not what is given back."""
    first, second = one_thread(), one_thread()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert threads() == {1}
    second.__exit__(None, None, None)
    assert threads() == {OWN}


def test_a_fit_is_solved_on_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """What both call first sees one thread, the caller its own number afterwards."""
    seen: list[set[int]] = []

    def look(*_: object) -> None:
        seen.append(threads())
        raise ff.BadInput("looked")

    for name in ("search_options", "require_values"):
        monkeypatch.setattr(fitted, name, look)
    given: Any = SimpleNamespace(problem=SimpleNamespace(record=SimpleNamespace(campaigns={})))
    given.values = ()
    verbs: tuple[Callable[..., object], ...] = (ff.fit, ff.profile)
    for verb in verbs:
        with pytest.raises(ff.BadInput, match="looked"):
            verb.__wrapped__(given)  # type: ignore[attr-defined]
    assert seen == [{1}, {1}]
    assert threads() == {OWN}
