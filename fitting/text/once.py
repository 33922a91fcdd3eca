"""What is made once in a process: `functools.cache` lets each of two threads make its own."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
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
    cached = cache(make)

    @wraps(make)
    def once(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Made:
        with _lock:
            return cached(*args, **kwargs)  # type: ignore[arg-type]  # all are hashable

    once.cache_clear = cached.cache_clear  # type: ignore[attr-defined]  # as other caches have it
    return once
