"""``fmu-fit example``: a shipped campaign with all its files, to try and to start from."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

import fitting as ff

NAME = "example"
EXAMPLE = "fmu-fit example string_q1 --out string_q1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "name", metavar="NAME", nargs="?", help="which campaign; without it they are listed"
    )
    parser.add_argument("--out", type=Path, help="new folder for its files (NAME)")


def run(args: argparse.Namespace) -> int:
    """List the examples, or write one; returns 0.

    Raises:
        BadInput: no example of that name, or a folder that holds something already.
    """
    from fitting.api.examples import example_titles
    from fitting.report.screen import printed_lines

    titles = example_titles()
    if args.name is None:
        if args.out is not None:
            raise ff.BadInput(
                f"--out {args.out}: wanted a NAME as well, one of {', '.join(titles)}"
            )
        print(*printed_lines("files", "examples", titles), sep="\n")
        return 0
    campaign = ff.example(args.name, args.out or Path(args.name))
    files = sorted(path for path in campaign.parent.rglob("*") if path.is_file())
    names = ", ".join(path.relative_to(campaign.parent).as_posix() for path in files)
    command = shlex.join(["fmu-fit", "reconstruct", str(campaign)])
    lines = printed_lines(
        "files", "campaign", titles[args.name], "copied", [("files", names)], campaign, command
    )
    print(*lines, sep="\n")
    return 0
