"""``fmu-fit``: finds the command, runs it, turns its ending into an exit code (EXIT_CODES)."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import platform
import shlex
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TextIO

import fitting
from fitting.cli.running.interrupts import INTERRUPTED, Interrupts, interruptible
from fitting.cli.running.output import directed
from fitting.cli.words.parser import overview, parsed
from fitting.text.errors import BadInput, FmuFailure
from fitting.text.streams import outlets

BAD_INPUT, FMU_FAILED, FAULT = 2, 3, 70
#: What libraries report of a thread for which there is no memory, or no number.
NO_THREAD = (os.strerror(errno.EAGAIN), "can't start new thread")
#: Name of the file that keeps a traceback: what it begins and ends with.
FAULT_FILE = ("fmu-fit-fault-", ".txt")
#: Bytes of address space.
LEAST_MEMORY = 400_000_000
#: What the machine may refuse that is no fault of the program, with what is wanted.
REFUSALS = {
    errno.EMFILE: ", wanted a higher limit (ulimit -n) or fewer --workers",
    errno.ENFILE: ", wanted fewer open files on this machine",
    errno.ENOSPC: ", wanted room",
    errno.EDQUOT: ", wanted room",
    errno.EFBIG: ", wanted a higher limit (ulimit -f)",
    errno.ENOMEM: ", wanted more memory",
    errno.EAGAIN: ", wanted room for more processes (ulimit -u) or fewer --workers",
    errno.EROFS: ", wanted a folder that can be written",
    errno.EACCES: ", wanted permission",
    errno.EPERM: ", wanted permission",
    errno.EIO: ", wanted a disk that works",
    errno.ENAMETOOLONG: ", wanted a shorter one",
    errno.ELOOP: ", wanted links that lead to a file",
}
#: What variables of the environment begin with that are read by libraries alone.
LIBRARIES = ("BOKEH_", "TQDM_", "SOURCE_DATE_EPOCH")
#: More complaints about one input are counted, not printed.
MOST_COMPLAINTS = 20
#: Characters of a complaint: all parameters of an FMU that failed, not a cell gone wild.
LONGEST = 4000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code.

    Args:
        arguments: words of the command line, None for the process's own.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if arguments is None:
        _keep_out_settings()
    # without a home it tells, in its own words, that it makes do with a folder that it removes
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    if arguments is None and not sys.warnoptions:  # of libraries, about numbers: no user's concern
        warnings.filterwarnings("ignore", category=RuntimeWarning)
        warnings.filterwarnings("always", category=DeprecationWarning, module=r"fitting\b")
        warnings.showwarning = _warn
    with outlets() as output, interruptible(whole_process=arguments is None) as interrupts:
        try:
            code = _run(given, interrupts)
        except KeyboardInterrupt:  # while it printed how the command ended
            code = _complain("interrupted", INTERRUPTED)
        interrupts.end()
        output.flush()
        lost = output.failure
        if lost is None or isinstance(lost, BrokenPipeError) or code in (BAD_INPUT, FMU_FAILED):
            return code
        return _complain(f"standard output: cannot be written: {lost.strerror}", BAD_INPUT)


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """What is deprecated, and whatever else warns, in a line like every other complaint."""
    print(f"fmu-fit: {message} ({category.__name__})", file=sys.stderr)


def _keep_out_settings() -> None:
    """What is set for libraries changes no file that is written; a slip in it would end a command.

    Figures are drawn into files, whatever window is wanted elsewhere, and bear no date.
    """
    for name in list(os.environ):
        if name.startswith(LIBRARIES):
            del os.environ[name]
    os.environ["MPLBACKEND"] = "agg"


def _run(given: Sequence[str], interrupts: Interrupts) -> int:
    """Run a command; whatever happens is an exit code and a sentence."""
    if not given:
        print(overview())
        return 0
    try:
        for word in given:
            if word.startswith("--") and word.endswith("=--"):  # argparse makes an empty list of it
                raise BadInput(f"{word.removesuffix('=--')}: found '--', wanted a value")
        _require_memory()
        chosen = parsed(given)
        with directed(chosen):
            code: int = chosen.run(chosen)
    except BadInput as error:
        return _complain(error, BAD_INPUT)
    except FmuFailure as error:
        return _complain(error, FMU_FAILED)
    except KeyboardInterrupt as error:
        return _complain(str(error) or "interrupted", INTERRUPTED)
    except Exception as error:
        if interrupts.times and _comes_of_interrupt(error):
            return _complain("interrupted", INTERRUPTED)
        surroundings = _surroundings(error)
        if surroundings:
            return _complain(surroundings, BAD_INPUT)
        return _complain(f"a fault of this program: {_kept(error, given)}", FAULT)
    return code


def _comes_of_interrupt(error: BaseException) -> bool:
    """Whether a library made something else of an interrupt, as compiled ones do when loaded."""
    if isinstance(error, (ImportError, KeyboardInterrupt)):
        return True
    before = error.__cause__ or error.__context__
    return before is not None and _comes_of_interrupt(before)


def _require_memory() -> None:
    """With less, the library of linear algebra ends the process while it is loaded."""
    try:
        import resource
    except ImportError:  # Windows
        return
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < LEAST_MEMORY:
        raise BadInput(
            f"memory is limited to {limit / 1e6:.0f} MB, wanted {LEAST_MEMORY / 1e6:.0f} MB at "
            "least (ulimit -v)"
        )


def _surroundings(error: Exception) -> str:
    """What the machine refuses, as a sentence; empty where the error is none of the machine's."""
    # compiled libraries report a thread that cannot start by the system's word for it
    if isinstance(error, MemoryError) or (
        isinstance(error, RuntimeError) and str(error) in NO_THREAD
    ):
        return "not enough memory: wanted more (ulimit -v), smaller data or fewer --workers"
    if isinstance(error, ImportError):  # of a library that is there: loading it takes both, too
        lacking = [os.strerror(n) for n in (errno.EMFILE, errno.ENOMEM)]
        lacking.append("failed to map segment")
        result = any(words in str(error) for words in lacking)
        return f"a library cannot be loaded: {error}" if result else ""
    if not isinstance(error, OSError):
        return ""
    try:
        Path.cwd()
    except OSError:
        return "the folder in which the command was started is gone: wanted one that is there"
    if error.errno not in REFUSALS:
        return ""
    where = f"{error.filename}: " if error.filename else ""
    return f"{where}{error.strerror}" + REFUSALS[error.errno]


def _kept(error: Exception, given: Sequence[str]) -> str:
    """What went wrong in a line, and the file with all of it."""
    what = " ".join(traceback.format_exception_only(error)[-1].split())
    text = "".join(traceback.format_exception(error))
    head = (
        f"{shlex.join(['fmu-fit', *given])}\nfmu-fit {fitting.__version__}, "
        f"Python {platform.python_version()}, {platform.platform()}\n\n"
    )
    for folder in _folders_for_faults(given):
        with contextlib.suppress(OSError):
            handle, name = tempfile.mkstemp(FAULT_FILE[1], FAULT_FILE[0], folder)
            with os.fdopen(handle, "wb") as file:
                file.write((head + text).encode("utf-8", "backslashreplace"))
            return f"{what}; {name} has the traceback, please report it"
    return f"{what}; its traceback could not be kept in any folder"


def _folders_for_faults(given: Sequence[str]) -> Iterator[str | None]:
    """The folder of the results, if it is there, and that of temporary files."""
    for word, following in zip(given, [*given[1:], ""], strict=True):
        out = following if word == "--out" else word.removeprefix("--out=")
        if word.startswith("--out") and os.path.isdir(out):
            yield out
    yield None


def _complain(error: object, code: int) -> int:
    """A line on stderr for each complaint."""
    complaints = (
        *(error.args if isinstance(error, BadInput) else (error,)),
        *getattr(error, "__notes__", ()),  # what the command knows to do about it
    )
    for complaint in complaints[:MOST_COMPLAINTS]:
        print(f"fmu-fit: {_in_a_line(str(complaint))}", file=sys.stderr)
    if len(complaints) > MOST_COMPLAINTS:
        print(f"fmu-fit: and {len(complaints) - MOST_COMPLAINTS} more errors", file=sys.stderr)
    return code


def _in_a_line(text: str) -> str:
    """The text on one line that a terminal can show, and a reader can take in."""
    line = " ".join(text.split())
    if len(line) > LONGEST:
        line = f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in line)
