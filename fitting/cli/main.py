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
from collections.abc import Sequence
from pathlib import Path

import fitting
from fitting.cli.running.interrupts import INTERRUPTED, Interrupts, interruptible
from fitting.cli.running.output import directed
from fitting.cli.running.streams import outlets
from fitting.cli.words.parser import overview, parsed
from fitting.text.errors import BadInput, FmuFailure

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
#: More errors about one input are counted, not printed.
MOST_ERRORS = 20
#: Characters of an error: all parameters of an FMU that failed, not a cell gone wild.
LONGEST = 4000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code.

    Args:
        arguments: words of the command line, None for the process's own.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if arguments is None:  # what is set for libraries changes no file, and ends no command
        for name in [name for name in os.environ if name.startswith(LIBRARIES)]:
            del os.environ[name]
        os.environ["MPLBACKEND"] = "agg"  # figures are drawn into files
    # without a home it tells, in its own words, that it makes do with a folder that it removes
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    if arguments is None and not sys.warnoptions:  # of libraries, about numbers: no user's concern
        warnings.filterwarnings("ignore", category=RuntimeWarning)
        warnings.filterwarnings("always", category=DeprecationWarning, module=r"fitting\b")
        # what is deprecated, and whatever else warns, in a line like every error
        warnings.showwarning = lambda message, category, *_, **__: print(
            f"fmu-fit: {message} ({category.__name__})", file=sys.stderr
        )
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


def _run(given: Sequence[str], interrupts: Interrupts) -> int:
    """Run a command; whatever happens is an exit code and a sentence."""
    if not given:
        print(overview())
        return 0
    try:
        for word in given:
            if word.startswith("--") and word.endswith("=--"):  # argparse makes an empty list of it
                raise BadInput(f"{word.removesuffix('=--')}: found '--', wanted a value")
        with contextlib.suppress(ImportError):  # Windows has no such limits
            import resource

            # with less, the library of linear algebra ends the process while it is loaded
            limit = resource.getrlimit(resource.RLIMIT_AS)[0]
            if limit != resource.RLIM_INFINITY and limit < LEAST_MEMORY:
                limited, wanted = (f"{size / 1e6:.0f} MB" for size in (limit, LEAST_MEMORY))
                raise BadInput(
                    f"memory is limited to {limited}, wanted {wanted} at least (ulimit -v)"
                )
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
    """What went wrong in a line, and the file with all of it: next to the results, or elsewhere."""
    what = " ".join(traceback.format_exception_only(error)[-1].split())
    text = (
        f"{shlex.join(['fmu-fit', *given])}\nfmu-fit {fitting.__version__}, "
        f"Python {platform.python_version()}, {platform.platform()}\n\n"
        + "".join(traceback.format_exception(error))
    )
    folders: list[str | None] = []
    for word, following in zip(given, [*given[1:], ""], strict=True):
        out = following if word == "--out" else word.removeprefix("--out=")
        folders += [out] if word.startswith("--out") and os.path.isdir(out) else []
    for folder in (*folders, None):  # None: that of temporary files
        with contextlib.suppress(OSError):
            handle, name = tempfile.mkstemp(FAULT_FILE[1], FAULT_FILE[0], folder)
            with os.fdopen(handle, "wb") as file:
                file.write(text.encode("utf-8", "backslashreplace"))
            return f"{what}; {name} has the traceback, please report it"
    return f"{what}; its traceback could not be kept in any folder"


def _complain(error: object, code: int) -> int:
    """A line on stderr for each error, as short as a reader can take in."""
    errors = (
        *(error.args if isinstance(error, BadInput) else (error,)),
        *getattr(error, "__notes__", ()),  # what the command knows to do about it
    )
    for each in errors[:MOST_ERRORS]:
        line = " ".join(str(each).split())
        if len(line) > LONGEST:
            line = f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"
        line = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in line)
        print(f"fmu-fit: {line}", file=sys.stderr)
    if len(errors) > MOST_ERRORS:
        print(f"fmu-fit: and {len(errors) - MOST_ERRORS} more errors", file=sys.stderr)
    return code
