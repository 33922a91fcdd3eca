"""What no file tells, as questions: each has a default, and is answered by a flag or a person."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from fitting.text.errors import BadInput, did_you_mean
from fitting.text.notation import listed
from fitting.text.units import convert, parse_quantity

#: Options that are listed in a question, at most.
MOST_SHOWN = 12
#: How often a person is asked a question.
MOST_ASKED = 3


@dataclass(frozen=True, kw_only=True)
class Question:
    """Something to choose.

    Attributes:
        key: short name of it, that of its flag.
        words: the question.
        options: what may be chosen; ``several`` of them where it says so.
        default: what is taken without an answer.
        why: the reason for it, in words; without a default the complaint that there is none.
        unit: of an answer that is a positive quantity, and no option; empty: it is one.
    """

    key: str
    words: str
    options: tuple[str, ...]
    default: tuple[str, ...]
    why: str
    several: bool = False
    unit: str = ""


#: Answers a question with words; None: the default.
Ask = Callable[[Question], Sequence[str] | None]


@dataclass
class Answers:
    """Answers by flags, then by a person, else by default; and what was taken, in sentences.

    Attributes:
        told: answers by flags, by the question's key.
        ask: asks a person; None: nobody is there.
        said: what was taken and why, in sentences.
        columns: names of columns of a recording that hold what is told, as "input" or "output".
    """

    told: dict[str, tuple[str, ...]] = field(default_factory=dict)
    ask: Ask | None = None
    said: list[str] = field(default_factory=list)
    columns: dict[str, str] = field(default_factory=dict)

    def of(self, question: Question) -> tuple[str, ...]:
        """The answer to a question.

        Args:
            question: with its options.

        Raises:
            BadInput: a flag that names none of the options, or nothing to choose from.
        """
        told = self.told.get(question.key, ())
        if told:
            return self._checked(question, told, f"--{question.key}")
        if self.ask is not None and (len(question.options) > 1 or question.unit):
            answer = self._asked(question, self.ask)
            if answer:
                return answer
        if not question.default and question.unit:
            raise BadInput(question.why)
        if not question.default and not question.options:
            raise BadInput(
                f"--{question.key}: the FMU has nothing that could be named here; wanted a "
                "parameter, or another variable with a start value, that is a Real number"
                if question.key == "fit"
                else f"--{question.key}: the FMU has nothing that could be named here"
            )
        if not question.default:
            raise BadInput(
                f"--{question.key}: nothing suits by itself, wanted one of "
                f"{', '.join(question.options[:MOST_SHOWN])}"
            )
        others = [name for name in question.options if name not in question.default]
        hint = f"; --{question.key} takes another" if others else ""
        self.said.append(f"{question.key}: {listed(question.default)}, {question.why}{hint}.")
        return question.default

    def _asked(self, question: Question, ask: Ask) -> tuple[str, ...]:
        """What a person answers, asked again where that is no option; empty: the default."""
        asked, refused = question, BadInput()
        for _ in range(MOST_ASKED):
            answer = ask(asked)
            if not answer:
                return ()
            try:
                return self._checked(question, answer, question.key, listed_too=False)
            except BadInput as error:
                asked, refused = replace(question, words=f"{error}"), error
        raise refused

    def _checked(
        self, question: Question, answer: Sequence[str], where: str, *, listed_too: bool = True
    ) -> tuple[str, ...]:
        if question.unit:
            return self._quantity(question, " ".join(answer), where)
        for name in answer:
            if name not in question.options:
                hint = did_you_mean(name, question.options, listed=listed_too)
                raise BadInput(f"{where}: found '{name}'{hint}")
        if len(answer) > 1 and not question.several:
            raise BadInput(f"{where}: found {len(answer)} names, wanted one")
        self.said.append(f"{question.key}: {listed(answer)}, as asked for.")
        return tuple(answer)

    def _quantity(self, question: Question, text: str, where: str) -> tuple[str, ...]:
        """An answer that is a positive quantity, in the question's unit, as a number."""
        value, unit = parse_quantity(text, where=where, wanted=question.unit)
        found = value if unit is None else convert(value, unit, question.unit, where=where)
        if not 0.0 < found < math.inf:
            raise BadInput(
                f"{where}: found '{text}', wanted a positive quantity in {question.unit}"
            )
        self.said.append(f"{question.key}: {text}, as asked for.")
        return (repr(found),)
