"""The command that goes on from where one has ended: its own words, with what is different."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterator, Sequence

#: Fewer letters name no option.
SHORTEST = len("--x")


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
