"""``fmu-fit completion``: what a shell needs to complete commands, options and file names."""

from __future__ import annotations

import argparse
from pathlib import Path

from fitting.cli.words.parser import COMMANDS, parser_of

NAME = "completion"
EXAMPLE = "fmu-fit completion bash > ~/.local/share/bash-completion/completions/fmu-fit"
SHELLS = ("bash", "zsh", "tcsh")
#: Arguments that are no `Path` and yet name a file.
FILES = ("fmu", "log")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "shell",
        choices=SHELLS,
        help="whose; for zsh the text goes into a file _fmu-fit in a folder of $fpath, for tcsh "
        "it is read by source",
    )


def run(args: argparse.Namespace) -> int:
    """Print the text that the shell reads; returns 0."""
    import shtab  # no other command needs it

    parser = parser_of(tuple(COMMANDS))
    for command in _commands(parser):
        for action in command._actions:
            if action.choices is None and (action.type is Path or action.dest in FILES):
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(parser, shell=args.shell))
    return 0


def _commands(parser: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    """The parsers of all commands."""
    [made] = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    return list(made.choices.values())
