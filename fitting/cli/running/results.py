"""Where a command writes: it states which files, and they are its own while it runs."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
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

    A report of an earlier run that goes, as none was written this time, is named.

    Args:
        command: its name.
        *names: relative names and patterns of the files that it writes.
        to: the folder by the arguments, None where nothing is written; without it ``--out``. With
            ``--dry-run`` nothing is written by any command.
    """

    def opened(run: Run) -> Run:
        @wraps(run)
        def alone(args: argparse.Namespace) -> int:
            folder = None if getattr(args, "dry_run", False) else to(args)
            if folder is None:
                return run(args)
            with results_folder(folder, command, names):
                before = _files(folder, names)
                code = run(args)
                missing = before - _files(folder, names)
                if folder / REPORT in missing:
                    print(_removed_words(folder, missing))
                return code

        return alone

    return opened


def _files(folder: Path, patterns: Iterable[str]) -> set[Path]:
    """What is there of the files that a command writes."""
    return {path for pattern in patterns for path in folder.glob(pattern)}


def _removed_words(folder: Path, missing: set[Path]) -> str:
    """Which files went, figures counted."""
    from fitting.text.notation import how_many, listed  # loads numpy, which --help does not take

    nearby = sorted(path.name for path in missing if path.parent == folder)
    figures = len(missing) - len(nearby)
    files = [*nearby, *([how_many(figures, "file of figures", "files of figures")] * bool(figures))]
    return f"removed from {folder}: {listed(files)}, which went with an earlier report"
