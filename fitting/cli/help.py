"""``fmu-fit help``: the pages of the documentation, which come with the program."""

from __future__ import annotations

import argparse
from pathlib import Path

from fitting.cli.words.parser import COMMANDS, parsed
from fitting.text.errors import BadInput, did_you_mean
from fitting.text.shipped import shipped

NAME = "help"
EXAMPLE = "fmu-fit help control-sweep"
#: Folders of pages; of two pages with one name that of the first folder has it alone.
FOLDERS = ("reference", "how-to", "tutorials", "explanation")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "topic",
        nargs="?",
        metavar="TOPIC",
        help="a page or a command; without it the pages are listed",
    )


def run(args: argparse.Namespace) -> int:
    """Print a page, the options of a command, or the list of pages; returns 0.

    Raises:
        BadInput: there is no page and no command of that name.
    """
    listed: dict[str, Path] = {}
    every: dict[str, Path] = {}
    for path in (p for folder in FOLDERS for p in sorted((shipped("docs") / folder).glob("*.md"))):
        full = f"{path.parent.name}/{path.stem}"
        every[full] = path
        listed[full if path.stem in listed else path.stem] = path
    topic = args.topic
    if topic is None:
        print("fmu-fit help TOPIC prints one of these pages, or the options of a command:\n")
        width = max(map(len, listed))
        for name, path in listed.items():
            title = path.read_text("utf-8").partition("\n")[0].removeprefix("# ")
            print(f"{name:{width}}  {title}")
    elif topic in COMMANDS and topic not in listed:
        parsed([topic, "--help"])
    elif topic in listed or topic in every:
        lines = (listed.get(topic) or every[topic]).read_text("utf-8").splitlines()
        print(*(line for line in lines if not line.startswith("<!--")), sep="\n")
    else:
        hint = did_you_mean(topic, [*listed, *COMMANDS], listed=False)
        raise BadInput(f"no page {topic!r}{hint} (see fmu-fit help)")
    return 0
