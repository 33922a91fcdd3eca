"""Questions at a terminal: a slip of the hand is asked about once more."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from fitting.draft.document import MOST_TRIES, Answers, Question
from fitting.text.errors import BadInput

OUTPUT = Question(
    key="output",
    words="Which output does the detector see?",
    options=("q1", "q2"),
    default=("q1",),
    why="the first one",
)


class Person:
    """Types what it is told to, and keeps what it was asked."""

    def __init__(self, *typed: str) -> None:
        self.typed = list(typed)
        self.asked: list[str] = []

    def __call__(self, question: Question) -> Sequence[str] | None:
        self.asked.append(question.words)
        return self.typed.pop(0).split() or None


def test_nothing_to_choose_from_is_said() -> None:
    """An FMU whose values are all inputs has no parameter: no list of options without an option."""
    fit = Question(key="fit", words="Which are fitted?", options=(), default=(), why="")
    with pytest.raises(BadInput, match="--fit: "):
        Answers().of(fit)


def test_an_answer_that_is_no_option_is_asked_for_again() -> None:
    person = Person("Q3", "q2")
    answers = Answers(ask=person)
    assert answers.of(OUTPUT) == ("q2",)
    assert person.asked[0] == OUTPUT.words
    assert "'Q3'" in person.asked[1]
    assert "q1" not in person.asked[1]  # the options stand behind it
    [said] = answers.notes
    assert said.startswith("output: q2")


def test_the_default_may_be_taken_at_last() -> None:
    assert Answers(ask=Person("q1 q2", "")).of(OUTPUT) == ("q1",)


def test_nobody_is_asked_without_end() -> None:
    person = Person(*["no"] * 10)
    with pytest.raises(BadInput, match=r"output: .*'no'"):
        Answers(ask=person).of(OUTPUT)
    assert len(person.asked) == MOST_TRIES
