"""``fmu-fit completion``: what a shell needs to complete commands, options and file names."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from fitting.cli.words.parser import COMMANDS, commands_of, parser_of

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
        help="shell; zsh: a file _fmu-fit in a folder of $fpath; tcsh: read by source",
    )


def run(args: argparse.Namespace) -> int:
    """Print the text that the shell reads; returns 0."""
    import shtab  # no other command needs it

    from fitting.api.examples import example_titles

    parser = parser_of(tuple(COMMANDS))
    for name, command in commands_of(parser).items():
        command.description = COMMANDS[name]  # shells list it beside the name, which it begins with
        for action in command._actions:
            if action.choices is None and (action.type is Path or action.dest in FILES):
                action.complete = shtab.FILE  # type: ignore[attr-defined]
            if (name, action.dest) == ("example", "name"):
                action.choices = tuple(example_titles())
    text = shtab.complete(parser, shell=args.shell)
    if args.shell == "zsh":
        # of a list of files shtab has the first one completed, by "(*):what:which", which is one
        # argument; "*:what:which" is any number of them (zshcompsys(1), specs of _arguments)
        text = re.sub(r'^(  ")\(\*\)::?', r"\1*:", text, flags=re.MULTILINE)
    print(text)
    return 0
