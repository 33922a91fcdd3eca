"""Pieces of work in turn: while one waits for other processes, the next goes on in this one.

Each has a stack of its own (a greenlet), and passes the turn on where it waits. Which one goes on
when depends on nothing but the order in which they wait: results and counts do not depend on time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from contextvars import copy_context
from typing import Any, TypeVar

from greenlet import GreenletExit, getcurrent, greenlet

T = TypeVar("T")


class _Piece(greenlet):
    """A piece of work that has its turn among others."""


def in_turn(works: Sequence[Callable[[], T]]) -> list[T]:
    """What pieces of work return, which go on in turn; the first error of one ends them all.

    Args:
        works: that call `pass_on` where they wait.
    """
    if len(works) < 2:
        return [work() for work in works]
    pieces = [_Piece(work) for work in works]
    results: dict[int, Any] = {}
    going = deque(enumerate(pieces))
    try:
        while going:
            k, piece = going.popleft()
            if not piece:
                piece.gr_context = copy_context()
            value = piece.switch()
            if piece.dead:
                results[k] = value
            else:
                going.append((k, piece))
    finally:
        for _, piece in going:
            if piece:
                piece.throw(GreenletExit)
    return [results[k] for k in range(len(pieces))]


def pass_on() -> None:
    """Let the others go on; returns when the turn comes back, at once where there are none."""
    here = getcurrent()
    if isinstance(here, _Piece) and here.parent is not None:
        here.parent.switch()
