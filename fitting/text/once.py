"""What is made once in a process: `functools.cache` lets each of two threads make its own."""

from __future__ import annotations

import os
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from functools import wraps
from threading import RLock
from typing import ParamSpec, TypeVar

Arguments = ParamSpec("Arguments")
Made = TypeVar("Made")


class _Turn:
    """One lock for all that is made once, so that no two wait for each other; new in a fork."""

    def __init__(self) -> None:
        self.renew()
        if hasattr(os, "register_at_fork"):  # its owner may be a thread that the fork has not
            os.register_at_fork(after_in_child=self.renew)

    def renew(self) -> None:
        """A lock that nobody holds."""
        self.lock = RLock()


_turn = _Turn()


@contextmanager
def alone() -> Iterator[None]:
    """One thread at a time, that which makes something once among them."""
    with _turn.lock:
        yield


def made_once(make: Callable[Arguments, Made]) -> Callable[Arguments, Made]:
    """A function whose result is made once for each set of arguments, and kept.

    Args:
        make: of arguments that are hashable, by place.
    """
    kept: dict[Hashable, Made] = {}

    @wraps(make)
    def once(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Made:
        key = (args, tuple(kwargs.items()))
        if key not in kept:
            with _turn.lock:
                if key not in kept:
                    kept[key] = make(*args, **kwargs)
        return kept[key]

    once.cache_clear = kept.clear  # type: ignore[attr-defined]  # by the name that caches have
    return once
