"""A fault, and whether the command survives it: what it says, its exit code, what it leaves."""

from __future__ import annotations

import contextlib
import io
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TextIO

from fitting.cli.main import main
from fitting.text.errors import BadInput
from fitting.text.results_folder import LOCK_NAME, RECORD_NAME
from tests.faults.scene import Scene

DOCUMENTED = (0, 1, 2, 3, 4)
COMPLAINTS = (2, 3)
MOST_LINES = 21
#: An interrupt is told in one line; a second one has another, that the command is ending.
INTERRUPTED, MOST_INTERRUPTED = 130, 2
MOST_S = 300
#: What a folder of results holds beside them.
KEPT = (RECORD_NAME, LOCK_NAME)
ROOT = Path(__file__).parents[2]
#: Where a case's files are, in the words of its command.
HERE = "{here}"
OUT = "out"


@dataclass(frozen=True, kw_only=True)
class Case:
    """A fault: ``words`` of the command, after ``change`` of the files in its folder.

    ``about`` are words of which every complaint has to hold one: file, key or option (none: nobody
    hears it). ``codes`` are the exit codes that are right. ``says``: words that the only complaint
    has to hold, all of them, beside what is wanted (the first one of ``complaints``). ``shell``:
    the word is a line for a shell, in which {run} is the command. ``during``: what the machine does
    while it runs. ``writes``: whether files that are whole may be left by a command that was
    refused, as those before a disk is full. ``call``: of Python, in place of words.
    """

    kind: str
    name: str
    words: tuple[str, ...]
    change: Callable[[Path], None] = lambda folder: None
    about: tuple[str, ...]
    codes: tuple[int, ...] = DOCUMENTED
    says: tuple[str, ...] = ()
    complaints: int = 1
    shell: bool = False
    during: Callable[[], AbstractContextManager[None]] = contextlib.nullcontext
    writes: bool = False
    call: Callable[[], object] | None = None


def drawn(every: Iterable[Any], count: int, seed: int) -> list[Any]:
    """So many of some, at most all, in an order drawn by the seed."""
    found = list(every)
    return random.Random(seed).sample(found, min(count, len(found)))


@dataclass(frozen=True)
class Ending:
    """How a command ended."""

    code: int
    said: str
    complained: str


class _Late(BaseException):
    """The command did not end."""


def problems(case: Case, scene: Scene, folder: Path) -> list[str]:
    """What was not right about the command's ending; empty if it survived the fault.

    ``folder`` is not there before and not there afterwards.
    """
    try:
        if case.call is not None:
            return _problems_of_call(case.call)
        return _problems(case, scene, folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _problems_of_call(call: Callable[[], object]) -> list[str]:
    """Of Python: it is taken, or refused in one sentence."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a caller may have arrays that overflow
            call()
    except BadInput as error:
        text = str(error)
        return [] if text and "\n" not in text else [f"no sentence: {text[:300]}"]
    except Exception as error:
        return [f"left by {type(error).__name__}: {error}"]
    return []


def _problems(case: Case, scene: Scene, folder: Path) -> list[str]:
    scene.laid_out(folder)
    temporary = folder / "temporary"
    temporary.mkdir()
    case.change(folder)
    words = [word.replace(HERE, str(folder)) for word in case.words]
    case = replace(case, about=tuple(word.replace(HERE, str(folder)) for word in case.about))
    try:
        with case.during():
            ending = (_in_a_shell if case.shell else _in_process)(words, temporary)
    except (_Late, subprocess.TimeoutExpired):
        return [f"did not end within {MOST_S} s"]
    except SystemExit as error:
        return [f"left by SystemExit({error.code!r})"]
    except Exception as error:
        return [f"left by {type(error).__name__}: {error}"]
    found = judged(case, ending)
    if ending.code != 70 and any(temporary.iterdir()):
        found.append(f"left in the temporary folder: {sorted(os.listdir(temporary))}")
    refused = ending.code == 2 and not case.shell and not case.writes
    return found + _left(folder / OUT, refused=refused)


def judged(case: Case, ending: Ending) -> list[str]:
    """What is not right about code and words."""
    found = []
    lines = ending.complained.splitlines()
    if ending.code not in case.codes:
        found.append(f"exit code {ending.code}: {ending.complained[-300:].strip()}")
    if ending.code in COMPLAINTS and case.about:
        if not 0 < len(lines) <= MOST_LINES:
            found.append(f"{len(lines)} lines of complaint")
        found += [f"unlike a complaint: {t[:300]}" for t in lines if not t.startswith("fmu-fit: ")]
        found += [
            f"names nothing: {text[:300]}"
            for text in lines
            if not text.endswith("more errors") and not any(w in text for w in case.about)
        ]
    elif ending.code == INTERRUPTED or INTERRUPTED in case.codes:
        found += [f"unlike a complaint: {t[:300]}" for t in lines if not t.startswith("fmu-fit: ")]
        if ending.code == INTERRUPTED and not 0 < len(lines) <= MOST_INTERRUPTED:
            found.append(f"{len(lines)} lines of an interrupt")
    elif lines and ending.code in case.codes:
        found.append(f"exit code {ending.code}, but stderr: {ending.complained[:300]}")
    return found + (_unsaid(case, lines) if case.says else [])


def _unsaid(case: Case, lines: Sequence[str]) -> list[str]:
    """What the first of the sentences that there have to be does not name."""
    if len(lines) != case.complaints:
        return [f"{len(lines)} lines, wanted {case.complaints}: {' | '.join(lines)[:600]}"]
    missing = [word for word in case.says if word not in lines[0]]
    return [f"does not say {missing}: {lines[0][:600]}"] if missing else []


def _left(out: Path, *, refused: bool) -> list[str]:
    """What should not be in the folder of the results: of a command that was refused, anything."""
    files = [path for path in out.rglob("*") if path.is_file()] if out.is_dir() else []
    half = [p.name for p in files if p.name.startswith(".") and p.name not in KEPT]
    found = [f"half-written in --out: {half}"] if half else []
    if refused and files:
        found.append(f"left in --out: {sorted(path.name for path in files)}")
    return found


def _in_process(words: Sequence[str], temporary: Path) -> Ending:
    output, errors = io.StringIO(), io.StringIO()
    with (
        contextlib.chdir(temporary.parent),  # whatever a word may be taken for is written there
        _temporary_files_in(temporary),
        _limited(),
        warnings.catch_warnings(),
        contextlib.redirect_stdout(output),
        contextlib.redirect_stderr(errors),
    ):
        warnings.simplefilter("always")  # each one is a line on stderr that nobody asked for
        warnings.filterwarnings("ignore", category=DeprecationWarning, module="fitting")
        warnings.showwarning = _on_stderr
        code = main(words)
    return Ending(code, output.getvalue(), errors.getvalue())


def _in_a_shell(words: Sequence[str], temporary: Path) -> Ending:
    environment = {
        "TMPDIR": str(temporary),
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONPATH": str(ROOT),
        **{name: os.environ[name] for name in ("PATH", "HOME", "LANG") if name in os.environ},
    }
    told = subprocess.run(
        ["bash", "-c", words[0].replace("{run}", f"'{sys.executable}' -P -m fitting")],
        capture_output=True,
        text=True,
        errors="replace",
        cwd=temporary.parent,
        env=environment,
        timeout=MOST_S,
        check=False,
    )
    return Ending(told.returncode, told.stdout, told.stderr)


def _on_stderr(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """As Python does it, also where the tests' own frame would collect warnings."""
    print(f"{filename}:{lineno}: {category.__name__}: {message}", file=sys.stderr)


@contextlib.contextmanager
def _temporary_files_in(folder: Path) -> Iterator[None]:
    before, tempfile.tempdir = tempfile.tempdir, str(folder)
    try:
        yield
    finally:
        tempfile.tempdir = before


@contextlib.contextmanager
def _limited() -> Iterator[None]:
    """What hangs is stopped; nothing is claimed about time."""

    def late(*_: object) -> None:
        raise _Late

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(MOST_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
