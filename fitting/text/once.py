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


#: One lock for all that is made once, so that no two wait for each other.
_lock = RLock()


def _renew() -> None:
    global _lock
    _lock = RLock()


if hasattr(os, "register_at_fork"):  # its owner may be a thread that the fork has not
    os.register_at_fork(after_in_child=_renew)


@contextmanager
def alone() -> Iterator[None]:
    """One thread at a time, that which makes something once among them."""
    with _lock:
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
            with _lock:
                if key not in kept:
                    kept[key] = make(*args, **kwargs)
        return kept[key]

    once.cache_clear = kept.clear  # type: ignore[attr-defined]  # by the name that caches have
    return once
