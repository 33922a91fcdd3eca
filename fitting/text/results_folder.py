"""A folder of results: one command at a time writes there, and replaces only what it wrote.

A small file next to the results, `RECORD_NAME`, holds for every file the command that wrote it and
the digest of what it wrote. A file that is not in it, was changed since, or is another command's is
kept, and the command that would replace it ends with a sentence. `LOCK_NAME` is there while a
command writes; the system frees it when the process ends, however it ends.

A folder may come from anywhere, and its record with it, so the record alone removes nothing: a file
goes only where its name matches one of the command's own patterns, no link leads to it, and the
digest of all of it is the one recorded.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import re
import stat
import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path, PurePath
from typing import Any

from fitting.text.errors import BadInput
from fitting.text.files import add_to_file, remove_parts, replace_file

_log = logging.getLogger(__name__)

RECORD_NAME, LOCK_NAME = ".fmu-fit-files.json", ".fmu-fit.lock"
ELSEWHERE = "wanted another folder (--out)"
#: Models of this project, which any command builds into its folder where it needs one.
BUILT = ("fmu/*.fmu",)
#: A record that is larger is none: an entry takes 150 bytes.
MOST_RECORD_BYTES = 16 * 2**20
_COMMAND = re.compile(r"[a-z][a-z0-9_-]{0,39}")


@dataclass(frozen=True)
class OwnFile:
    """A file that was written: by which command, with which content.

    ``digests`` are two while it is replaced or added to, so that whichever of the two contents a
    process leaves that is killed meanwhile is known. ``added`` is the text that is added last to a
    file that grows: a process that is killed leaves a part of it.
    """

    command: str
    digests: tuple[str, ...]
    added: str = ""


class ResultsFolder:
    """An open folder of results, of one command.

    Args:
        folder: Where it is, as complaints name it.
        command: Who writes.

    Raises:
        BadInput: its record cannot be read, or names files outside the folder.
    """

    def __init__(self, folder: Path, command: str) -> None:
        self.folder, self.command = folder, command
        self.path = folder.resolve()
        self.thread = threading.get_ident()
        self._own = _read_record(folder / RECORD_NAME)
        self._written: set[str] = set()
        #: Digests of files that this process adds to, each of all that is in it.
        self._growing: dict[str, Any] = {}

    def remove_parts(self, patterns: Iterable[str]) -> None:
        """Remove what killed processes left of files that they were writing.

        Args:
            patterns: relative names of the files that this command writes.
        """
        remove_parts(self.path / RECORD_NAME)
        for name in self._removable((*patterns, *BUILT)):
            remove_parts(self.path / name)

    def refuse_foreign(self, patterns: Iterable[str]) -> None:
        """Complain of the first file that is there and not this command's to replace.

        Also of what is in the place of a folder, and of a folder that takes no files.

        Args:
            patterns: relative names, as "figures/1_*.png".

        Raises:
            BadInput: there is one.
        """
        for pattern in map(PurePath, patterns):
            parent = self.folder / pattern.parent
            self._name(parent / RECORD_NAME)  # nothing in it leads outside
            inside = [parent, *parent.parents][: len(pattern.parts) - 1]
            for folder in reversed(inside):
                if os.path.lexists(folder) and not folder.is_dir():
                    raise BadInput(f"{folder}: is there and no folder, so it is kept; {ELSEWHERE}")
                if folder.is_dir() and not os.access(folder, os.W_OK | os.X_OK):
                    wanted = "wanted permission, or another folder"
                    raise BadInput(f"{folder}: cannot be written, {wanted}")
            for path in sorted(parent.glob("*")) if parent.is_dir() else ():
                if fnmatch(path.name, pattern.name):
                    self._refuse_foreign(path)

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

    def add_to(self, path: Path, text: str) -> None:
        """Add text to the end of a file that this command wrote below the folder.

        Args:
            path: of the file.
            text: what is added.

        Raises:
            BadInput: it cannot be written.
        """
        name, data = self._name(path), text.encode()
        if name not in self._growing:
            self._refuse_foreign(path)
            self._growing[name] = _hashed(path)
        digest = self._growing[name]
        before = digest.hexdigest()
        digest.update(data)
        self._note(path, before, digest.hexdigest(), added=text)
        add_to_file(path, data)

    def remove_earlier(self, patterns: Iterable[str]) -> None:
        """Remove what this command wrote earlier and has not written since it was opened.

        A file that others wrote, that was changed since, or that cannot be removed stays.

        Args:
            patterns: relative names of what may go, as "figures/1_*.png".
        """
        for name in self._removable(patterns):
            path = self.path / name
            with suppress(OSError, BadInput):
                if name not in self._written and _is_as_written(path, self._own[name]):
                    path.unlink()
                    if path.parent != self.path:
                        path.parent.rmdir()  # only an empty one goes

    def _removable(self, patterns: Iterable[str]) -> list[str]:
        """Names of the record that are this command's, match a pattern, and that no link leads to.

        Whether they hold what the command wrote is another question.
        """
        names, wanted = [], [PurePath(pattern) for pattern in patterns]
        for name, own in self._own.items():
            place = PurePath(name)
            matches = any(place.parent == p.parent and fnmatch(place.name, p.name) for p in wanted)
            parent = (self.path / name).parent
            with suppress(BadInput):
                if own.command == self.command and matches and _resolved(parent) == parent:
                    names.append(name)
        return names

    def forget_missing(self) -> None:
        """Take files out of the record that are gone, as a checkpoint when the job is done.

        Where the disk takes no record any more, it names a file too many, which does no harm: that
        must not hide the command's error about the disk.
        """
        missing = [name for name in self._own if not os.path.lexists(self.path / name)]
        for name in missing:
            del self._own[name]
        with suppress(OSError, BadInput):
            if missing and self._own:
                self._write_record()
            elif missing:
                (self.path / RECORD_NAME).unlink()

    def _refuse_foreign(self, path: Path) -> None:
        own = self._own.get(self._name(path))
        if not os.path.lexists(path):
            return
        if path.is_symlink():  # whatever it leads to: no command writes links
            why = "is a link and no file"
        elif not path.is_file():
            why = "is there and no file"
        elif own is None:
            why = f"is there already, and fmu-fit {self.command} did not write it"
        elif own.command != self.command:
            why = f"was written by fmu-fit {own.command}, not by {self.command}"
        elif not _is_as_written(path, own):
            why = f"was changed since fmu-fit {self.command} wrote it"
        else:
            return
        raise BadInput(f"{path}: {why}, so it is kept; {ELSEWHERE}")

    def _name(self, path: Path) -> str:
        place = _resolved(path.parent) / path.name
        if not place.is_relative_to(self.path):
            raise BadInput(
                f"{path}: a link leads outside {self.folder}, to {place.parent}, where nothing is "
                f"written; {ELSEWHERE}"
            )
        return place.relative_to(self.path).as_posix()

    def _note(self, path: Path, *digests: str, added: str = "") -> None:
        """Into the record before the file itself: a process that is killed leaves both known."""
        self._own[self._name(path)] = OwnFile(self.command, digests, added)
        self._write_record()

    def _write_record(self) -> None:
        files = {
            name: {"command": own.command, "sha256": list(own.digests)}
            | ({"added": own.added} if own.added else {})
            for name, own in sorted(self._own.items())
        }
        text = json.dumps({"files": files}, indent=1) + "\n"
        replace_file(self.path / RECORD_NAME, text.encode())


def _resolved(folder: Path) -> Path:
    """Where a folder is, behind its links."""
    try:
        return folder.resolve()
    except (OSError, RuntimeError):
        raise BadInput(f"{folder}: its links lead nowhere; {ELSEWHERE}") from None


def _is_as_written(path: Path, own: OwnFile) -> bool:
    """Whether a file holds what its command wrote, all of it, or less of what was added last."""
    if path.is_symlink() or not path.is_file():
        return False
    if _digest(path) in own.digests:
        return True
    added = own.added.encode()
    if not added:
        return False
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            file.seek(max(0, size - len(added)))
            end = file.read(len(added))
        cut = end[end.rfind(b"\n") + 1 :]
        return added.startswith(cut) and _hashed(path, size - len(cut)).hexdigest() in own.digests
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror}; {ELSEWHERE}") from error


def _hashed(path: Path, size: int = -1) -> Any:
    """SHA-256 of a file, or of so many bytes of it."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        left = os.fstat(file.fileno()).st_size if size < 0 else size
        while left and (block := file.read(min(left, 2**20))):
            digest.update(block)
            left -= len(block)
    return digest


def _digest(path: Path) -> str | None:
    """SHA-256 of a file, None where there is none."""
    try:
        return _hashed(path).hexdigest() if path.is_file() else None
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror}; {ELSEWHERE}") from error


def _read_record(path: Path) -> dict[str, OwnFile]:
    """The record of a folder, empty where there is none.

    Raises:
        BadInput: it is no plain file, too large, no record, or names files outside its folder.
    """
    own = {}
    try:
        _require_plain(path)
        flags = os.O_RDONLY
        for flag in ("O_NONBLOCK", "O_NOFOLLOW", "O_CLOEXEC", "O_BINARY"):  # not all everywhere
            flags |= getattr(os, flag, 0)
        with os.fdopen(os.open(path, flags), "rb") as file:
            data = file.read(MOST_RECORD_BYTES + 1)
        if len(data) > MOST_RECORD_BYTES:
            raise ValueError
        for name, entry in json.loads(data.decode())["files"].items():
            place = PurePath(name)
            # no name leads outside, and there is one name for one file
            if place.anchor or ".." in place.parts or not place.parts or "\0" in name:
                raise ValueError
            command, digests, added = entry["command"], entry["sha256"], entry.get("added", "")
            if place.as_posix() != name or not _COMMAND.fullmatch(command):
                raise ValueError
            if not isinstance(digests, list):
                raise TypeError
            if not all(isinstance(text, str) for text in [*digests, added]):
                raise TypeError
            own[name] = OwnFile(command, tuple(digests), added)
    except FileNotFoundError:
        return {}
    except BadInput:
        raise
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
        raise BadInput(
            f"{path}: is no list of the files that fmu-fit wrote there; {ELSEWHERE}"
        ) from None
    return own


def _require_plain(path: Path) -> None:
    """Refuse links, pipes, devices and folders, before anything opens them."""
    if not stat.S_ISREG(path.lstat().st_mode):
        raise ValueError


#: Folders that this process has open, by their absolute path.
_OPEN: dict[Path, ResultsFolder] = {}


def open_folder_of(path: Path) -> ResultsFolder | None:
    """The innermost folder of results, of those that this process has open, that a path is below.

    Args:
        path: of a file.
    """
    known = list(_OPEN.values())
    opened = {each.path: each for each in known}
    opened |= {Path(os.path.abspath(each.folder)): each for each in known}
    # where its links lead, else where it is written: the folder itself refuses to write elsewhere
    for parent in (_resolved(path.parent), Path(os.path.abspath(path.parent))) if known else ():
        for place in (parent, *parent.parents):
            if place in opened:
                return opened[place]
    return None


def remove_earlier(folder: Path, names: Iterable[str]) -> None:
    """Remove from an open folder what its command wrote there earlier, and not this time.

    To be called when all that a command writes is written: results of an earlier job next to those
    of this one would be taken for its own. Files that the command did not write are never touched.

    Args:
        folder: That `results_folder` has opened.
        names: Relative names and patterns of what may go.
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
    path, names = folder.resolve(), tuple(names)
    known = _OPEN.get(path)
    if known is not None and known.thread == threading.get_ident():
        known.refuse_foreign(names)
        yield
        return
    made = [p for p in (path, *path.parents) if not p.exists()]
    try:
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BadInput(f"{path}: cannot be written: {error.strerror}") from error
        with _locked(path, folder):
            opened = ResultsFolder(folder, command)
            opened.remove_parts(names)
            opened.refuse_foreign(names)
            _OPEN[path] = opened
            try:
                yield
            finally:
                del _OPEN[path]
                opened.forget_missing()
    finally:
        with suppress(OSError):  # those that hold something stay
            for empty in made:
                empty.rmdir()


@contextmanager
def _locked(path: Path, shown: Path) -> Iterator[None]:
    # takes a fifth of a second to import, and most processes that write lock nothing
    from filelock import FileLock, Timeout

    lock = FileLock(path / LOCK_NAME, blocking=False)
    try:
        with suppress(FileNotFoundError):
            _require_plain(path / LOCK_NAME)
        lock.acquire()
    except Timeout:
        raise BadInput(
            f"{shown}: another fmu-fit command is writing there; wanted another folder (--out), or "
            "to wait until it has ended"
        ) from None
    except BadInput:
        raise
    except ValueError:
        raise BadInput(
            f"{shown / LOCK_NAME}: is there and no file, so it is kept; {ELSEWHERE}"
        ) from None
    except OSError as error:
        raise BadInput(f"{shown}: cannot be written: {error.strerror}") from error
    try:
        yield
    finally:
        # before it is free: whoever waits for this very file sees that it is gone, and makes anew
        with suppress(OSError):  # Windows lets go of an open file only when it is closed
            (path / LOCK_NAME).unlink()
        lock.release()


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file under a temporary name next to it, then rename: never half a file.

    Text is written as UTF-8 with line feeds on every system. Folders are made as needed. Below a
    folder that `results_folder` has opened, a file that others wrote is not replaced.

    Args:
        path: of the file.
        content: of the file.

    Raises:
        BadInput: the folder or file cannot be written, or is not this command's to replace.
    """
    data = content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
    folder = open_folder_of(path)
    if folder is None:
        replace_file(path, data)
    else:
        folder.write(path, data)
    _log.debug("written: %s", path)


def write_all(folder: Path, texts: Mapping[str, str] | Mapping[str, str | bytes]) -> None:
    """Write several texts by relative file name below ``folder``.

    Args:
        folder: where the files go.
        texts: contents by file name.

    Raises:
        BadInput: a file cannot be written, or would not be below the folder.
    """
    for name in texts:
        if Path(name).is_absolute() or ".." in Path(name).parts:
            raise BadInput(f"{folder}: {name!r} would be written outside this folder")
    for name, text in texts.items():
        write_whole(folder / name, text)
