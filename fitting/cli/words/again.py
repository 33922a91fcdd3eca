"""The command that made a result, the one that goes on from its end, the fit it starts from."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fitting.result.result import Result

#: Fewer letters name no option.
SHORTEST = len("--x")


def command_line(
    args: argparse.Namespace,
    words: Sequence[str],
    options: Sequence[str],
    repeated: Sequence[str] = (),
    flags: Sequence[str] = (),
) -> str:
    """The command as a result records it: the options that differ from their defaults.

    Args:
        args: of the command.
        words: the command and its positional arguments.
        options: names of options with a value, None where it is the default.
        repeated: names of options that may be repeated.
        flags: names of options without a value, or with one word.
    """
    given = [(name, getattr(args, name)) for name in options]
    given += [(name, value) for name in repeated for value in getattr(args, name)]
    made = ["fmu-fit", *words]
    for name, value in given:
        if value is not None:
            made += [f"--{name}", value.as_posix() if isinstance(value, Path) else str(value)]
    for name in flags:
        value = getattr(args, name)
        written = f"--{name.replace('_', '-')}"
        made += [written if value is True else f"{written}={value}"] if value else []
    return shlex.join(made)


def command_again(args: argparse.Namespace, *, steps: int | None = None) -> str:
    """The command as it was typed, every option of it, with ``--resume``.

    Args:
        args: of the command, as the parser made them.
        steps: what `--steps` is now; None: as it was.
    """
    words = [word for word in args.given if word != "--resume"]
    if steps is not None:
        words = [*_without("--steps", words), "--steps", str(steps)]
    return shlex.join(["fmu-fit", *words, "--resume"])


def _without(option: str, words: Sequence[str]) -> Iterator[str]:
    """Words without an option and its value, however it was written."""
    skip = False
    for word in words:
        name, equals, _ = word.partition("=")
        is_it = len(name) >= SHORTEST and option.startswith(name)
        if not (skip or is_it):
            yield word
        skip = is_it and not equals


def add_at(parser: argparse.ArgumentParser, text: str, *, required: bool = False) -> None:
    """Declare both options.

    Args:
        parser: of the command.
        text: what the fit is for.
        required: whether the command does nothing without one.
    """
    parser.add_argument("--at", type=Path, required=required, metavar="RESULT.json", help=text)
    parser.add_argument(
        "--changed-data",
        action="store_true",
        help="take a fit whose data files have changed since, or are others",
    )


def fit_at(args: argparse.Namespace) -> Result | None:
    """The fit; None where none is named.

    Args:
        args: of the command.

    Raises:
        BadInput: it cannot be read.
    """
    # the work takes libraries along, help does not
    from fitting.result.result import read_result
    from fitting.result.same_data import of_any_data

    if args.at is None:
        return None
    result = read_result(args.at)
    return of_any_data(result) if args.changed_data else result
