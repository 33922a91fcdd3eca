"""Where a command writes: it says which files, and they are its own while it runs."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import wraps
from pathlib import Path

from fitting.text.results_folder import results_folder

#: What an earlier run may have left: beside a new result it would be taken for its report.
REPORT = "report.html"
Run = Callable[[argparse.Namespace], int]


def _out(args: argparse.Namespace) -> Path | None:
    out: Path | None = args.out
    return out


def writes(
    command: str, *names: str, to: Callable[[argparse.Namespace], Path | None] = _out
) -> Callable[[Run], Run]:
    """Open the folder of results while a command runs, see `results_folder`.

    A report of an earlier run that goes, as none was written this time, is told.

    Args:
        command: its name.
        *names: relative names and patterns of the files that it writes.
        to: tells the folder from the arguments, None where nothing is written; without it
            ``--out``.
    """

    def opened(run: Run) -> Run:
        @wraps(run)
        def alone(args: argparse.Namespace) -> int:
            folder = to(args)
            if folder is None:
                return run(args)
            page = folder / REPORT
            with results_folder(folder, command, names):
                was_there = page.exists()
                code = run(args)
                if was_there and not page.exists():
                    print(f"removed: {page} and its figures, which told of an earlier result")
                return code

        return alone

    return opened
