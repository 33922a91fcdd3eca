"""A folder of results: one command at a time writes there, and replaces only what it wrote.

A small file beside the results, `RECORD_NAME`, holds for every file the command that wrote it and
the digest of what it wrote. A file that is not in it, was changed since, or is another command's is
kept, and the command that would replace it ends with a sentence. `LOCK_NAME` is there while a
command writes; the system frees it when the process ends, however it ends.
"""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from fitting.text.atomic import remove_parts, replace_file
from fitting.text.errors import BadInput

RECORD_NAME, LOCK_NAME = ".fmu-fit-files.json", ".fmu-fit.lock"
ELSEWHERE = "wanted another folder (--out)"
#: Before the digest of a file's first line, where the rest of it grows.
FIRST_LINE = "first line "


@dataclass(frozen=True)
class OwnFile:
    """A file that was written: by which command, with which content.

    ``digests`` are two while it is replaced, so that whichever of the two contents a process leaves
    that is killed meanwhile is known. Of a file that grows it is that of its first line.
    """

    command: str
    digests: tuple[str, ...]


class ResultsFolder:
    """An open folder of results, of one command.

    Args:
        folder: Where it is, as complaints name it.
        command: Who writes.

    Raises:
        BadInput: its record cannot be read.
    """

    def __init__(self, folder: Path, command: str) -> None:
        self.folder, self.command = folder, command
        self.path = folder.resolve()
        self.thread = threading.get_ident()
        self._own = _read_record(folder / RECORD_NAME)
        self._written: set[str] = set()

    def remove_parts(self) -> None:
        """Remove what killed processes left of files that they were writing."""
        for name in (*self._own, RECORD_NAME):
            remove_parts(self.path / name)

    def refuse_foreign(self, patterns: Iterable[str]) -> None:
        """Complain of the first file that is there and not this command's to replace.

        Args:
            patterns: relative names, as "figures/1_*.png".

        Raises:
            BadInput: there is one.
        """
        for pattern in patterns:
            parent = self.folder / Path(pattern).parent
            for found in sorted(parent.glob("*")) if parent.is_dir() else ():
                if fnmatch(found.name, Path(pattern).name):
                    self._refuse_foreign(found)

    def write(self, path: Path, data: bytes) -> None:
        """Write a file below the folder, or leave the very same one.

        Args:
            path: of the file.
            data: its content.

        Raises:
            BadInput: it cannot be written, or is there and not this command's to replace.
        """
        new = hashlib.sha256(data).hexdigest()
        old = _digest(path)
        self._written.add(self._name(path))
        if old == new:  # nothing is lost, whoever wrote it
            return
        self._refuse_foreign(path)
        self._note(path, *([] if old is None else [old]), new)
        replace_file(path, data)
        if old is not None:
            self._note(path, new)

    def let_grow(self, path: Path) -> None:
        """A file that was written is added to from now on: it is known by its first line.

        Args:
            path: of the file.
        """
        self._note(path, FIRST_LINE + _digest_of_first_line(path))

    def remove_earlier(self, patterns: Iterable[str] | None = None) -> None:
        """Remove what this command wrote earlier and has not written since it was opened.

        A file that others wrote, that was changed since, or that cannot be removed stays.

        Args:
            patterns: relative names of what may go, as "figures/1_*.png"; None: all.
        """
        wanted = None if patterns is None else [Path(pattern) for pattern in patterns]
        for name, own in list(self._own.items()):
            path = self.path / name
            if own.command != self.command or name in self._written:
                continue
            if wanted is not None and not any(_matches(Path(name), p) for p in wanted):
                continue
            with suppress(OSError, BadInput):
                if _is_as_written(path, own):
                    path.unlink()
                    if path.parent != self.path:
                        path.parent.rmdir()  # only an empty one goes

    def forget_what_is_gone(self) -> None:
        """Take files out of the record that are gone, as a checkpoint when the job is done."""
        gone = [name for name in self._own if not (self.path / name).exists()]
        for name in gone:
            del self._own[name]
        if gone and self._own:
            self._write_record()
        elif gone:
            (self.path / RECORD_NAME).unlink()

    def _refuse_foreign(self, path: Path) -> None:
        own = self._own.get(self._name(path))
        found = _digest(path)
        if path.exists() and not path.is_file():
            raise BadInput(f"{path}: is there and no file, so it is kept; {ELSEWHERE}")
        if found is None:
            return
        if own is None:
            why = f"is there already, and fmu-fit {self.command} did not write it"
        elif own.command != self.command:
            why = f"was written by fmu-fit {own.command}, not by {self.command}"
        elif not _is_as_written(path, own):
            why = f"was changed since fmu-fit {self.command} wrote it"
        else:
            return
        raise BadInput(f"{path}: {why}, so it is kept; {ELSEWHERE}")

    def _name(self, path: Path) -> str:
        return (path.parent.resolve() / path.name).relative_to(self.path).as_posix()

    def _note(self, path: Path, *digests: str) -> None:
        """Into the record before the file itself: a process that is killed leaves both known."""
        self._own[self._name(path)] = OwnFile(self.command, digests)
        self._write_record()

    def _write_record(self) -> None:
        files = {
            name: {"command": own.command, "sha256": list(own.digests)}
            for name, own in sorted(self._own.items())
        }
        text = json.dumps({"files": files}, indent=1) + "\n"
        replace_file(self.path / RECORD_NAME, text.encode())


def _matches(name: Path, pattern: Path) -> bool:
    return name.parent == pattern.parent and fnmatch(name.name, pattern.name)


def _is_as_written(path: Path, own: OwnFile) -> bool:
    """Whether a file holds what its command wrote, or at its head where lines are added to it."""
    if _digest(path) in own.digests:
        return True
    grows = any(digest.startswith(FIRST_LINE) for digest in own.digests)
    return grows and FIRST_LINE + _digest_of_first_line(path) in own.digests


def _digest_of_first_line(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.sha256(file.readline()).hexdigest()


def _digest(path: Path) -> str | None:
    """SHA-256 of a file, None where there is none."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror}; {ELSEWHERE}") from error


def _read_record(path: Path) -> dict[str, OwnFile]:
    if not path.exists():
        return {}
    try:
        files: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))["files"]
        return {n: OwnFile(str(f["command"]), tuple(f["sha256"])) for n, f in files.items()}
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        raise BadInput(
            f"{path}: is no list of the files that fmu-fit wrote there; {ELSEWHERE}"
        ) from None


#: Folders that this process has open, by their absolute path.
_OPEN: dict[Path, ResultsFolder] = {}


def open_folder_of(path: Path) -> ResultsFolder | None:
    """The innermost folder of results, of those that this process has open, that a path is below.

    Args:
        path: of a file.
    """
    parent = path.parent.resolve() if _OPEN else path.parent
    return next((_OPEN[p] for p in (parent, *parent.parents) if p in _OPEN), None)


def remove_earlier(folder: Path, names: Iterable[str] | None = None) -> None:
    """Remove from an open folder what its command wrote there earlier, and not this time.

    To be called when all that a command writes is written: results of an earlier job beside those
    of this one would be taken for its own. Files that the command did not write are never touched.

    Args:
        folder: That `results_folder` has opened.
        names: Relative names and patterns of what may go; None: all.
    """
    opened = _OPEN.get(folder.resolve())
    if opened is not None:
        opened.remove_earlier(names)


@contextmanager
def results_folder(folder: Path, command: str, names: Iterable[str] = ()) -> Iterator[None]:
    """While it is open, this process alone writes there, and replaces only what ``command`` wrote.

    Opening it again within itself opens nothing new. The folder is made where there is none, and is
    gone again if nothing was written.

    Args:
        folder: Where results go.
        command: Who writes, as "reconstruct".
        names: Relative names and patterns of the files that will be written: of a foreign one among
            them it is complained now, not when the work is done.

    Raises:
        BadInput: the folder cannot be written, another command is writing there, or a file that is
            there is not this command's to replace.
    """
    path = folder.resolve()
    known = _OPEN.get(path)
    if known is not None and known.thread == threading.get_ident():
        known.refuse_foreign(names)
        yield
        return
    made = _make(path)
    try:
        with _locked(path, folder):
            opened = ResultsFolder(folder, command)
            opened.remove_parts()
            opened.refuse_foreign(names)
            _OPEN[path] = opened
            try:
                yield
            finally:
                del _OPEN[path]
                opened.forget_what_is_gone()
    finally:
        with suppress(OSError):  # those that hold something stay
            for empty in made:
                empty.rmdir()


def _make(folder: Path) -> list[Path]:
    """The folder with all above it; those that were not there, innermost first."""
    made = [p for p in (folder, *folder.parents) if not p.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{folder}: cannot be written: {error.strerror}") from error
    return made


@contextmanager
def _locked(path: Path, shown: Path) -> Iterator[None]:
    # takes a fifth of a second to import, and most processes that write lock nothing
    from filelock import FileLock, Timeout

    lock = FileLock(path / LOCK_NAME, blocking=False)
    try:
        lock.acquire()
    except Timeout:
        raise _busy(shown) from None
    except OSError as error:
        raise BadInput(f"{shown}: cannot be written: {error.strerror}") from error
    try:
        yield
    finally:
        # before it is free: whoever waits for this very file sees that it is gone, and makes anew
        with suppress(OSError):  # Windows lets go of an open file only when it is closed
            (path / LOCK_NAME).unlink()
        lock.release()


def _busy(folder: Path) -> BadInput:
    return BadInput(
        f"{folder}: another fmu-fit command is writing there; wanted another folder (--out), or to "
        "wait until it has ended"
    )
