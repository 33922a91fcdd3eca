"""Pieces of work in turn: the order is told beforehand, whatever ends them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from fitting.engine.turns import in_turn, pass_on


def piece(told: list[str], name: str, waits: int) -> str:
    """It waits so many times."""
    for k in range(waits):
        told.append(f"{name}{k}")
        pass_on()
    told.append(f"{name} ends")
    return name


def test_each_goes_on_where_the_others_wait_and_answers_in_its_place() -> None:
    told: list[str] = []
    works = [partial(piece, told, name, waits) for name, waits in (("a", 2), ("b", 0), ("c", 3))]
    assert in_turn(works) == ["a", "b", "c"]
    assert told == ["a0", "b ends", "c0", "a1", "c1", "a ends", "c2", "c ends"]


def test_one_alone_and_none_have_no_turns() -> None:
    told: list[str] = []
    assert in_turn([partial(piece, told, "a", 2)]) == ["a"]
    assert told == ["a0", "a1", "a ends"]
    nothing: list[Callable[[], None]] = []
    assert in_turn(nothing) == []
    pass_on()  # of nobody


def test_the_first_error_ends_them_all() -> None:
    told: list[str] = []

    def tidy() -> None:
        try:
            pass_on()
            told.append("went on")
        finally:
            told.append("tidied up")

    def stumbling() -> None:
        raise KeyboardInterrupt

    works: list[Callable[[], None]] = [tidy, stumbling, partial(told.append, "begun")]
    with pytest.raises(KeyboardInterrupt):
        in_turn(works)
    assert told == ["tidied up"]


def test_pieces_of_a_piece_have_turns_of_their_own() -> None:
    told: list[str] = []

    def both() -> list[str]:
        return in_turn([partial(piece, told, "a", 1), partial(piece, told, "b", 1)])

    def one() -> list[str]:
        return [piece(told, "c", 1)]

    assert in_turn([both, one]) == [["a", "b"], ["c"]]
    assert told == ["a0", "b0", "a ends", "b ends", "c0", "c ends"]


def test_settings_of_the_caller_hold_in_the_pieces() -> None:
    def divided() -> float:
        pass_on()
        return float(np.float64(1.0) / np.float64(0.0))

    with np.errstate(divide="raise"), pytest.raises(FloatingPointError):
        in_turn([divided, divided])
    with np.errstate(divide="ignore"):
        assert in_turn([divided, divided]) == [np.inf, np.inf]
