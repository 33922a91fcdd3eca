"""What a command prints, and where: its summary, its log, the one document for other programs."""

from __future__ import annotations

import argparse
import io
import logging
import stat
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout
from pathlib import Path

from fitting.cli.running.progress import above_status, hidden
from fitting.text.errors import BadInput

#: Every module of the package logs under this name.
LOGGER = "fitting"
#: How a file of the log begins, so that no other file is added to.
HEAD = "fmu-fit log: time, module, what was done"


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
    path = Path(name)
    try:
        _require_log(path)
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


def _require_log(path: Path) -> None:
    """Nothing is added to a file that is no log of this program; a pipe may have no reader."""
    if not path.exists():
        return
    result = path.stat()
    if stat.S_ISFIFO(result.st_mode) or stat.S_ISSOCK(result.st_mode):
        raise BadInput(f"--log {path}: is a pipe, wanted a file that can be written")
    if not stat.S_ISREG(result.st_mode) or result.st_size == 0:
        return
    with path.open("rb") as file:
        if file.read(len(HEAD)) != HEAD.encode():
            raise BadInput(f"--log {path}: holds something else, wanted a new file or an older log")
