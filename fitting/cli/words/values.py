"""Numbers and times on the command line: what an option cannot mean is refused at once."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

from fitting.text.errors import BadInput, shown
from fitting.text.units import checked_accuracy, convert, parse_quantity

#: Where no limit is stated: a count beyond that would take years, or all memory.
MOST = 10**6
MOST_SEED = 2**63 - 1
LARGEST = 1e60
Number = TypeVar("Number", int, float)


def seed() -> Callable[[str], int]:
    """An argparse type: the seed of what is drawn at random."""
    return whole_number(0, MOST_SEED)


def worker_count() -> Callable[[str], int]:
    """An argparse type: a number of worker processes."""

    def read(text: str) -> int:
        from fitting.api.fmu import MOST_WORKERS  # takes libraries along, help does not

        return whole_number(1, MOST_WORKERS)(text)

    return read


def _number_of(
    read: Callable[[str], Number], *rules: tuple[Callable[[Number], bool], str]
) -> Callable[[str], Number]:
    """An argparse type: a number for which all rules hold, each with what is wanted.

    Args:
        read: the text as a number; the first rule states what is wanted where it is none.
        *rules: whether a number is allowed, and what is wanted, in words.
    """

    def number(text: str) -> Number:
        wanted = rules[0][1]
        try:
            value = read(text)
            broken = (words for holds, words in rules if not holds(value))
            wanted = next(broken, "")
        except ValueError:
            pass
        if wanted:
            raise argparse.ArgumentTypeError(f"found {shown(text)}, wanted {wanted}")
        return value

    return number


def whole_number(least: int, most: int = MOST) -> Callable[[str], int]:
    """An argparse type: a whole number from ``least`` to ``most``."""
    return _number_of(
        int,
        (lambda value: value >= least, f"a whole number of at least {least}"),
        (lambda value: value <= most, f"a whole number of at most {most}"),
    )


def even_number(least: int) -> Callable[[str], int]:
    """An argparse type: an even number from ``least``.

    Args:
        least: an even number.
    """
    even = (lambda value: value % 2 == 0, f"an even number of at least {least}")
    return _number_of(whole_number(least), even)


#: An argparse type: a number that can be squared and cubed.
bounded_number = _number_of(
    float,
    (lambda value: abs(value) <= LARGEST, f"a number from {-LARGEST:g} to {LARGEST:g}"),
)
#: An argparse type: how many steps, as "2e6".
number_of_steps = _number_of(
    float, (lambda value: 1.0 <= value < math.inf, "a number of at least 1")
)


def relative_accuracy(option: str) -> Callable[[str], float]:
    """An argparse type: a relative accuracy above 0 and below 1.

    Args:
        option: name of the option, for complaints.
    """

    def read(text: str) -> float:
        return checked_accuracy(quantity(text, "1", where=option), option)

    return read


def positive_time(option: str) -> Callable[[str], float]:
    """An argparse type: a time above zero in s, as "2 ms"; a plain number is in s.

    Args:
        option: name of the option, for complaints.
    """

    def read(text: str) -> float:
        return positive_quantity(text, "s", where=option)

    return read


def positive_quantity(text: str, unit: str, *, where: str) -> float:
    """A written quantity above zero in ``unit``, in which a plain number is taken.

    Args:
        text: as it was written.
        unit: of the values.
        where: file, row or key, for complaints.

    Raises BadInput, beginning with ``where``.
    """
    value = quantity(text, unit, where=where)
    if not value > 0.0:
        raise BadInput(f"{where}: found {shown(text)}, wanted a positive number")
    return value


def quantity(text: str, unit: str, *, where: str) -> float:
    """A written quantity in ``unit``, in which a plain number is taken.

    Args:
        text: as it was written.
        unit: of the values.
        where: file, row or key, for complaints.

    Raises BadInput, beginning with ``where``.
    """
    try:
        is_finite = math.isfinite(float(text))  # "nan" looks like a word to the reader of units
    except ValueError:  # text with a unit
        is_finite = True
    if not is_finite:
        raise BadInput(f"{where}: found {shown(text)}, wanted a finite number")
    number, written = parse_quantity(text, where=where)
    return number if written is None else convert(number, written, unit, where=where)


def folder_name(path: Path) -> str:
    """Name of the folder that a file is in, as the user sees it: links are not followed.

    Args:
        path: of the file, which need not be there.
    """
    return Path(os.path.abspath(path)).parent.name


def joint_name(paths: Sequence[Path]) -> str:
    """Names of the folders of several files, each once.

    Args:
        paths: of the files, which need not be there.
    """
    return "+".join(dict.fromkeys(map(folder_name, paths)))


def default_workers() -> int:
    """Worker processes where none are asked for: one per processor, up to 8."""
    return min(os.cpu_count() or 1, 8)
