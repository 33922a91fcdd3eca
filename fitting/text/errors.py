"""The two ways in which a command can end early: the input is wrong, or the FMU failed."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, cast

if TYPE_CHECKING:  # the types of arrays take numpy along, which a command's help does not need
    from fitting.text.arrays import FloatArray, Scalar

#: Start values that a failure names.
MOST_NAMED = 10
Made = TypeVar("Made")
Arguments = ParamSpec("Arguments")


class BadInput(ValueError):
    """One line that names the file, row, column or key, what was found and what is required.

    Several errors at once: ``args`` are that many lines.
    """

    def __str__(self) -> str:
        return "\n".join(map(str, self.args))

    def __format__(self, spec: str) -> str:
        """All of them in one sentence: what is put into another complaint is one line again."""
        return format("; ".join(map(str, self.args)), spec)


class MissingFile(BadInput, FileNotFoundError):
    """There is no file of that name."""


class SeveralSweeps(BadInput):
    """A file holds several sweeps, and none is chosen: ``parts`` are the columns of each of them.

    Each part has the keys of `fitting.resonance.reading.Columns` that choose it.
    """

    def __init__(self, *errors: str, parts: Sequence[Mapping[str, Any]]) -> None:
        super().__init__(*errors)
        self.parts = tuple(parts)


#: Characters of a found value in a complaint.
LONGEST_SHOWN = 200


def shown(value: object) -> str:
    """A value as a complaint repeats it, cut where it is long.

    Args:
        value: what was found.
    """
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # thousands of digits; lists in lists without end
        return f"a {type(value).__name__} beyond all measure"
    if len(text) <= LONGEST_SHOWN:
        return text
    return f"{text[: LONGEST_SHOWN // 2]} ... {text[-LONGEST_SHOWN // 4 :]}"


#: What moves, colours or clears (C0, DEL, C1), and what turns the direction of writing.
_STEERS = re.compile("[\x00-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def spelled_out(text: str, kept: str = "") -> str:
    """A text whose control characters are spelled out, as JSON does.

    Args:
        text: of anybody, as an FMU.
        kept: characters that stay as they are.
    """
    return _STEERS.sub(lambda m: m[0] if m[0] in kept else f"\\u{ord(m[0]):04x}", text)


def did_you_mean(name: str, candidates: Sequence[str], *, listed: bool = True) -> str:
    """A hint to append to a complaint: the nearest name, else (``listed``) what there is.

    Args:
        name: of the variable.
        candidates: words that would have been understood.
        listed: whether all candidates are listed where none is alike.
    """
    lowered = {c.lower(): c for c in candidates}
    near = difflib.get_close_matches(name.lower(), list(lowered), n=1, cutoff=0.6)
    if near:
        return f"; did you mean '{lowered[near[0]]}'?"
    if listed and candidates:
        shown = ", ".join(candidates[:12]) + (", ..." if len(candidates) > 12 else "")
        return f"; there is: {shown}"
    return ""


class Complaints:
    """What several readers complain of, each within ``with``; `check` raises all of it at once."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def __enter__(self) -> None:
        """Read within."""

    def __exit__(self, kind: object, error: object, trace: object) -> bool:
        """Keep what was wrong, and go on."""
        if not isinstance(error, BadInput):
            return False
        self.lines += error.args
        return True

    def read(
        self, reader: Callable[Arguments, Made], *args: Arguments.args, **kwargs: Arguments.kwargs
    ) -> Made:
        """What a reader makes; None where it complains, so that `check` comes before its use.

        Args:
            reader: makes one record, or complains.
            *args: of the reader.
            **kwargs: of the reader.
        """
        made: Made | None = None
        with self:
            made = reader(*args, **kwargs)
        return cast("Made", made)

    def check(self) -> None:
        """Complain, if there is anything.

        Raises:
            BadInput: every line once.
        """
        if self.lines:
            raise BadInput(*dict.fromkeys(self.lines))


def gathered(readers: Iterable[Callable[[], Made]]) -> list[Made]:
    """What all the readers make.

    Args:
        readers: each makes one record, or complains.

    Raises:
        BadInput: what any of them complains of, every line once.
    """
    made: list[Made] = []
    stated = Complaints()
    for read in readers:
        with stated:
            made.append(read())
    stated.check()
    return made


class NoScale(BadInput):
    """Simulated and measured amplitudes that have no finite ratio; states which."""


class OutOfBudget(BadInput):
    """A budget that was spent before there was any result."""


class FmuFailure(Exception):
    """An FMU failed; in the FMU's own words.

    ``message`` with its log, start values ``parameters``, file ``fmu``. Of a batch ``at`` is the
    run's number or None, ``answers`` are results of others.
    """

    def __init__(self, message: str, parameters: Mapping[str, Scalar], fmu: Path) -> None:
        super().__init__(message, parameters, fmu)
        self.message = message
        self.parameters = dict(parameters)
        self.fmu = Path(fmu)
        self.at: int | None = None
        self.answers: dict[int, FloatArray] = {}

    def __str__(self) -> str:
        named = [f"{name} = {value!r}" for name, value in self.parameters.items()]
        more = len(named) - MOST_NAMED
        values = ", ".join(named[:MOST_NAMED]) + (f" and {more} others" if more > 0 else "")
        return f"{self.fmu}: {self.message}" + (f" [with {values}]" if values else "")


class NoAnswer(FmuFailure):
    """An FMU that gave no answer in time, or something else, or whose process was killed again.

    Other values are no way round it: every attempt would cost as much time. Who catches failures in
    order to try something else lets this one pass.
    """
