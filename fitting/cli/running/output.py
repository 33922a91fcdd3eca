"""Where what a command finds goes: its folder, its summary, its log, its document."""

from __future__ import annotations

import argparse
import io
import logging
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout
from functools import wraps
from pathlib import Path

from fitting.api.progress import above_status, hidden
from fitting.text.errors import BadInput

#: Every module of the package logs under this name.
LOGGER = "fitting"
#: How a file of the log begins, so that no other file is added to.
HEAD = "fmu-fit log: time, module, what was done"
#: What an earlier run may have left: next to a new result it would be taken for its report.
REPORT = "report.html"
Run = Callable[[argparse.Namespace], int]


@contextmanager
def directed(args: argparse.Namespace) -> Iterator[None]:
    """While a command runs, its words go where the options of every command send them.

    Args:
        args: of the command: ``quiet``, ``verbose``, ``log``, and ``json`` where it has one.

    Raises:
        BadInput: the file of the log cannot be written, or holds something else.
    """
    wants_document = getattr(args, "json", False)
    args.document = None
    with ExitStack() as stack:
        if args.log is not None:
            stack.enter_context(_logged(_file(args.log)))
        if args.verbose:
            stack.enter_context(_logged(_Terminal()))
        if args.quiet:
            stack.enter_context(hidden())
        output = sys.stdout
        if args.quiet or wants_document:
            stack.enter_context(redirect_stdout(io.StringIO()))
        try:
            yield
        finally:
            if wants_document and args.document is not None:
                from fitting.text.records import json_text  # a command's help does not need it

                output.write(json_text(args.document))


def hand_over(args: argparse.Namespace, document: object) -> None:
    """Keep the record that ``--json`` prints when the command ends, well or not.

    Args:
        args: of the command.
        document: a record, as `fitting.text.records` takes it.
    """
    args.document = document


@contextmanager
def _logged(handler: logging.Handler) -> Iterator[None]:
    logger = logging.getLogger(LOGGER)
    before = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.DEBUG if before == logging.NOTSET else min(before, logging.DEBUG))
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(before)
        handler.close()


class _Terminal(logging.Handler):
    """Lines on stderr, above the line of the progress where there is one."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)

    def emit(self, record: logging.LogRecord) -> None:
        above_status(self.format(record))


class _File(logging.FileHandler):
    """A file that takes what it can: what it refuses ends no work."""

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - name of logging
        logging.getLogger(LOGGER).removeHandler(self)
        above_status(f"fmu-fit: --log {self.baseFilename}: cannot be written any further")


def _file(name: str) -> logging.Handler:
    """The file of the log, which is new, empty, or an older log; no other file is added to."""
    path = Path(name)
    try:
        if path.exists():
            status = path.stat()
            if stat.S_ISFIFO(status.st_mode) or stat.S_ISSOCK(status.st_mode):  # without a reader
                raise BadInput(f"--log {path}: is a pipe, wanted a file that can be written")
            if stat.S_ISREG(status.st_mode) and status.st_size:
                with path.open("rb") as file:
                    head = file.read(len(HEAD))
                if head != HEAD.encode():
                    wanted = "wanted a new file or an older log"
                    raise BadInput(f"--log {path}: holds something else, {wanted}")
        with path.open("a", encoding="utf-8") as stream:
            if not stream.seekable() or stream.tell() == 0:
                stream.write(f"{HEAD}\n")
        handler = _File(path, encoding="utf-8", errors="backslashreplace")
    except BadInput:
        raise
    except (OSError, ValueError) as error:
        words = error.strerror if isinstance(error, OSError) else error
        raise BadInput(f"--log {name}: {words}, wanted a file that can be written") from None
    handler.setFormatter(logging.Formatter("%(asctime)s %(name)s: %(message)s"))
    return handler


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

    def files(folder: Path) -> set[Path]:
        return {path for pattern in names for path in folder.glob(pattern)}

    def opened(run: Run) -> Run:
        @wraps(run)
        def alone(args: argparse.Namespace) -> int:
            folder = None if getattr(args, "dry_run", False) else to(args)
            if folder is None:
                return run(args)
            from fitting.text.results_folder import results_folder  # help needs none

            with results_folder(folder, command, names):
                before = files(folder)
                code = run(args)
                missing = sorted(str(path.relative_to(folder)) for path in before - files(folder))
                if REPORT in missing:
                    which = "which went with an earlier report"
                    print(f"removed from {folder}: {', '.join(missing)}, {which}")
                return code

        return alone

    return opened
