"""What no file holds, as questions: each has a default, and is answered by a flag or a person."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from fitting.text.errors import BadInput, did_you_mean
from fitting.text.notation import listed
from fitting.text.rendering import blocks
from fitting.text.units import convert, parse_quantity

#: Options that are listed in a question, at most.
MOST_SHOWN = 12
#: How often a person is asked a question.
MOST_TRIES = 3


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
        requested: answers by flags, by the question's key.
        ask: asks a person; None: nobody is there.
        notes: what was taken and why, in sentences.
        columns: names of columns of a recording that hold what is told, as "input" or "output".
    """

    requested: dict[str, tuple[str, ...]] = field(default_factory=dict)
    ask: Ask | None = None
    notes: list[str] = field(default_factory=list)
    columns: dict[str, str] = field(default_factory=dict)

    def of(self, question: Question) -> tuple[str, ...]:
        """The answer to a question.

        Args:
            question: with its options.

        Raises:
            BadInput: a flag that names none of the options, or nothing to choose from.
        """
        key = question.key
        if self.requested.get(key):
            return self._checked(question, self.requested[key], f"--{key}")
        if self.ask is not None and (len(question.options) > 1 or question.unit):
            requested, refused = question, BadInput()
            for _ in range(MOST_TRIES):
                answer = self.ask(requested)
                if not answer:
                    break
                try:
                    return self._checked(question, answer, key, listed_too=False)
                except BadInput as error:
                    requested, refused = replace(question, words=f"{error}"), error
            else:
                raise refused
        if not question.default:
            if question.unit:
                raise BadInput(question.why)
            wanted = "nothing suits by itself, wanted one of "
            wanted += ", ".join(question.options[:MOST_SHOWN])
            if not question.options:
                wanted = "the FMU has nothing that could be named here; wanted a parameter, or "
                wanted += "another variable with a start value, that is a Real number"
            raise BadInput(f"--{key}: {wanted}")
        others = any(name not in question.default for name in question.options)
        stated = blocks("draft/text").default(key, question.default, question.why, others)
        self.notes.append(str(stated))
        return question.default

    def one_of(self, key: str, words: str, options: tuple[str, ...], default: str, why: str) -> str:
        """The answer to a question with one answer, of which the only option needs no reason.

        Args:
            key: see `Question`.
            words: see `Question`.
            options: see `Question`.
            default: what is taken without an answer.
            why: see `Question`.

        Raises:
            BadInput: see `of`.
        """
        why = "the only one" if len(options) == 1 else why
        [answer] = self.of(
            Question(key=key, words=words, options=options, default=(default,), why=why)
        )
        return answer

    def fitted(
        self, options: tuple[str, ...], default: tuple[str, ...], why: str
    ) -> tuple[str, ...]:
        """The parameters of the FMU that are fitted.

        Args:
            options: see `Question`.
            default: see `Question`.
            why: see `Question`.

        Raises:
            BadInput: see `of`.
        """
        words = "Which parameters of the FMU are fitted?"
        return self.of(
            Question(
                key="fit", words=words, options=options, default=default, why=why, several=True
            )
        )

    def _checked(
        self, question: Question, answer: Sequence[str], where: str, *, listed_too: bool = True
    ) -> tuple[str, ...]:
        text, taken = listed(answer), tuple(answer)
        if question.unit:
            text = " ".join(answer)
            value, unit = parse_quantity(text, where=where, wanted=question.unit)
            result = value if unit is None else convert(value, unit, question.unit, where=where)
            if not 0.0 < result < math.inf:
                raise BadInput(
                    f"{where}: found '{text}', wanted a positive quantity in {question.unit}"
                )
            taken = (repr(result),)
        else:
            for name in answer:
                if name not in question.options:
                    hint = did_you_mean(name, question.options, listed=listed_too)
                    raise BadInput(f"{where}: found '{name}'{hint}")
            if len(answer) > 1 and not question.several:
                raise BadInput(f"{where}: found {len(answer)} names, wanted one")
        self.notes.append(str(blocks("draft/text").requested(question.key, text)))
        return taken
