"""``fmu-fit help``: the pages of the documentation, which come with the program."""

from __future__ import annotations

import argparse
import itertools
import re
import shutil
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path

from fitting.cli.words.parser import COMMANDS, parsed
from fitting.text.errors import BadInput, did_you_mean
from fitting.text.files import shipped

NAME = "help"
EXAMPLE = "fmu-fit help control-sweep"
#: Folders of pages; of two pages with one name that of the first folder has it alone.
FOLDERS = ("reference", "how-to", "tutorials", "explanation")
#: Columns of a terminal's line that tables are fit into, at most and at least.
WIDTH, LEAST_WIDTH = 100, 40
_LINK = re.compile(r"!?\[(?P<text>[^\]]*)\]\((?P<to>[^)]*)\)")
#: Pages of which every entry of a list begins with a name that is looked up: a key, a finding.
ENTRIES = ("campaign", "findings")
_HEADING = re.compile(r"#+ (?P<name>.*)")
_ENTRY = re.compile(r"[-*] `(?P<name>[^`]*)`.*")
_CELL = re.compile(r"\s(?<!\\)\|\s")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument(
        "topic",
        nargs="?",
        metavar="TOPIC",
        help="a page, a command, or a word of headings, keys and findings; without it the pages "
        "are listed",
    )


def run(args: argparse.Namespace) -> int:
    """Print a page, the options of a command, or a list of pages; returns 0.

    Raises:
        BadInput: there is no page and no command of that name, and no heading with that word.
    """
    paths = [p for folder in FOLDERS for p in sorted((shipped("docs") / folder).glob("*.md"))]
    every = {f"{path.parent.name}/{path.stem}": path for path in paths}
    listed: dict[str, Path] = {}
    for full, path in every.items():
        listed[full if path.stem in listed else path.stem] = path
    topic = args.topic
    if topic is None:
        print("fmu-fit help TOPIC prints one of these pages, or the options of a command:\n")
        width = max(map(len, listed))
        for name, path in listed.items():
            title = path.read_text("utf-8").partition("\n")[0].removeprefix("# ")
            print(f"{name:{width}}  {title}")
    elif chosen := listed.get(topic) or every.get(topic):
        print(*_on_terminal(chosen.read_text("utf-8")), sep="\n")
    elif topic in COMMANDS:
        parsed([topic, "--help"])
    elif places := list(_places(topic, listed)):
        print(f"no page {topic!r}; pages that have the word in a heading, a key or a finding:\n")
        width = max(len(page) for page, _ in places)
        for page, words in places:
            print(f"{page:{width}}  {textwrap.shorten(words, _width() - width - 2)}")
    else:
        hint = did_you_mean(topic, [*listed, *COMMANDS], listed=False)
        raise BadInput(f"no page {topic!r}{hint} (see fmu-fit help)")
    return 0


def _places(word: str, pages: Mapping[str, Path]) -> Iterator[tuple[str, str]]:
    """Headings, keys and findings whose names have a word in them, each with the name of its page.

    The word may be a plural, and begins where a word of the name does.
    """
    stem = re.sub(r"(?<=\w\w)s$", "", word.strip())
    if not stem:
        return
    wanted = re.compile(rf"(?<![^\W_]){re.escape(stem)}", re.IGNORECASE)
    for page, path in pages.items():
        table = ""
        text = re.sub(r"```.*?```", "", path.read_text("utf-8"), flags=re.DOTALL)
        for line in text.splitlines():
            if heading := _HEADING.fullmatch(line):
                table = heading["name"].replace("`", "")
                if wanted.search(table):
                    yield page, table
                continue
            entry = _ENTRY.fullmatch(line) if page in ENTRIES else None
            if entry and wanted.search(entry["name"]):
                place = f"{table} " if table.startswith("[") else ""
                yield page, place + _LINK.sub(_named, line[2:]).replace("`", "")


def _width() -> int:
    """Columns of a line."""
    return max(LEAST_WIDTH, min(WIDTH, shutil.get_terminal_size((WIDTH, 0)).columns))


def _on_terminal(page: str) -> Iterator[str]:
    """A page of Markdown for a terminal: tables in columns, lists wrapped, links by their pages."""
    width = _width()
    page = re.sub(r"<!--.*?-->\n?", "", page, flags=re.DOTALL)
    page = _LINK.sub(_named, page)
    for is_table, block in itertools.groupby(page.splitlines(), lambda line: line.startswith("|")):
        if not is_table:
            for line in block:
                is_item = line.startswith("- ")  # others end at the width, or are to be copied
                yield from textwrap.wrap(line, width, subsequent_indent="  ") if is_item else [line]
            continue
        rows = [[cell.strip() for cell in _CELL.split(row.strip("| "))] for row in block]
        heads, *body = [row for row in rows if not set("".join(row)) <= set("-: |")]
        wide = [
            max(map(len, column)) for column in itertools.zip_longest(heads, *body, fillvalue="")
        ]
        if sum(wide) + 2 * len(wide) <= width:
            for row in (heads, *body):
                yield "  ".join(cell.ljust(w) for cell, w in zip(row, wide, strict=False)).rstrip()
            continue
        for first, *others in body:  # too wide: each row by itself, its cells below its first one
            yield first
            for head, cell in zip(heads[1:], others, strict=False):
                text = f"{head}: {cell}" if len(heads) > 2 else cell
                if cell:
                    yield from textwrap.wrap(
                        text, width, initial_indent="    ", subsequent_indent="    "
                    )


def _named(link: re.Match[str]) -> str:
    """The text of a link, and how what it leads to is read."""
    path, _, _ = link["to"].partition("#")
    if path.startswith("http"):
        return f"{link['text']} ({path})"
    name = Path(path).stem
    return f"{link['text']} (fmu-fit help {name})" if path.endswith(".md") else link["text"]
