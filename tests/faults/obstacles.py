"""What stands in the folder of the results where a command would write, and records made up."""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from fitting.text.results_folder import LOCK_NAME, RECORD_NAME
from tests.faults.campaign_keys import COMMAND
from tests.faults.case import HERE, OUT, Case, drawn
from tests.faults.scene import FMU

OBSTACLES, RECORDS = "obstacles in the folder of results", "records of files, made up"

OUTPUT = ("--out", f"{HERE}/{OUT}")
LINE = ("line", f"{HERE}/sweep.csv", *OUTPUT)
#: Commands, and names that each writes.
NAMES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "reconstruct": (COMMAND, ("result.json", "history.csv", "values.csv", "report.html")),
    "line": (LINE, ("line.json", "line.csv", "line.png", "line.svg")),
    "simulate": (
        ("simulate", f"{HERE}/{FMU}", "--set", "A2=0", "--set", "u1=320", *OUTPUT),
        ("peaks.csv", "spectrum.csv", "trace.png"),
    ),
    "identify": (
        ("identify", f"{HERE}/campaign.toml", *OUTPUT, "--workers", "1"),
        ("identify.json", "report.html", "figures"),
    ),
    "design": (
        ("design", f"{HERE}/campaign.toml", *OUTPUT, "--workers", "1"),
        ("design.json", "campaign", "figures"),
    ),
    "tradeoff": (
        ("tradeoff", "--campaign", f"{HERE}/campaign.toml", *OUTPUT),
        ("tradeoff.csv", "figures"),
    ),
}


def _folder(path: Path) -> None:
    path.mkdir()
    (path / "mine").touch()


THINGS: dict[str, Callable[[Path], object]] = {
    "a file": lambda path: path.write_text("measured"),
    "a pipe": os.mkfifo,
    "a link to nothing": lambda path: path.symlink_to("nothing"),
    "a link to itself": lambda path: path.symlink_to(path.name),
    "a link to a device": lambda path: path.symlink_to("/dev/zero"),
    "a folder with a file": _folder,
}


def cases(count: int, seed: int) -> Iterator[Case]:
    """Every name and thing: refused, and as it was."""
    named = [(c, name) for c, (_, names) in NAMES.items() for name in names]
    named += [(c, name) for c in NAMES for name in (RECORD_NAME, LOCK_NAME)]
    for (command, name), thing in drawn(itertools.product(named, THINGS), count, seed):
        if thing == "a folder with a file" and name in ("figures", "campaign"):
            continue  # is one, into which is written
        if thing == "a file" and name == LOCK_NAME:
            continue  # of a command that was killed
        yield Case(
            kind=OBSTACLES,
            name=f"{command}: {name} is {thing}",
            words=NAMES[command][0],
            change=partial(_put, name, THINGS[thing]),
            about=(name, OUT),
            codes=(2,),
            writes=True,
        )


def _put(name: str, make: Callable[[Path], object], folder: Path) -> None:
    (folder / OUT).mkdir()
    make(folder / OUT / name)


#: Texts that a record may hold.
_ENTRY: dict[str, Any] = {"command": "line", "sha256": ["0" * 64]}
_ENTRIES: dict[str, Any] = {
    "nothing": None,
    "text": "line",
    "a list": [],
    "empty": {},
    "without digests": {"command": "line"},
    "without a command": {"sha256": ["0" * 64]},
    "of a number": {"command": 1, "sha256": ["0" * 64]},
    "of a long command": {"command": "l" * 50, "sha256": ["0" * 64]},
    "of a command with a line feed": {"command": "line\nx", "sha256": ["0" * 64]},
    "of a digest that is a number": {"command": "line", "sha256": [1]},
    "of digests that are text": {"command": "line", "sha256": "0" * 64},
    "of an addition that is a list": {**_ENTRY, "added": ["x"]},
}
TEXTS: dict[str, str] = {
    "empty": "",
    "no JSON": "{",
    "deep": "[" * 100_000,
    "a list": "[]",
    "a number": "1",
    "no files": "{}",
    "files that are a list": '{"files": []}',
    "files that are text": '{"files": "line.json"}',
    "NUL bytes": "\0" * 100,
    "a number of 5,000 digits": '{"files": {"a": ' + "9" * 5000 + "}}",
    "17 MB": " " * (17 * 2**20),
    **{
        f"the name {name[:30]!r}": json.dumps({"files": {name: _ENTRY}})
        for name in (
            *("../victim", "a/../../victim", "/etc/passwd", "", ".", "..", "a/../b", "./a", "a//b"),
            *("a\0b", "//a", "../" * 50 + "etc/passwd"),
        )
    },
    **{
        f"an entry that is {what}": json.dumps({"files": {"line.json": entry}})
        for what, entry in _ENTRIES.items()
    },
}


def record_cases(count: int, seed: int) -> Iterator[Case]:
    """Records that are none, and such that name what is not of the folder: refused."""
    for what, text in drawn(TEXTS.items(), count, seed):
        yield Case(
            kind=RECORDS,
            name=what,
            words=LINE,
            change=partial(_put, RECORD_NAME, partial(_write, text)),
            about=(RECORD_NAME,),
            codes=(2,),
            writes=True,
        )


def _write(text: str, path: Path) -> None:
    path.write_text(text, "utf-8")
