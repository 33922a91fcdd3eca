"""Temporary folders that do not stay: what a killed process left is removed by the next one."""

from __future__ import annotations

import atexit
import os
import platform
import secrets
import stat
import tempfile
import weakref
from contextlib import suppress
from pathlib import Path

from filelock import FileLock, Timeout

from fitting.text.errors import BadInput

PREFIX = "fmu-fit-"
#: In the folder: locked as long as its owner lives; tells on which machine that is.
OWNER_NAME = "owner"


class Scratch:
    """A new temporary folder of this process.

    Before it is made, those are removed whose owners are gone without having removed them, as after
    ``kill -9``. The system frees their locks, so that no living process is taken for a dead one.

    Args:
        parent: where it is made; None: in the folder of temporary files (``TMPDIR``).

    Raises:
        BadInput: there is no room or no permission for one.
    """

    def __init__(self, parent: Path | None = None) -> None:
        try:
            # not as seen from here: others look for it from their own folders
            place = Path(tempfile.gettempdir() if parent is None else parent).absolute()
            _remove_abandoned(place)
            self.path = place / f"{PREFIX}{secrets.token_hex(8)}"
            # before there is one: what asks the process to end may come at any moment
            _MADE[self.path] = os.getpid()
            self._remove = weakref.finalize(self, _remove, self.path, os.getpid())
            self.path.mkdir(mode=0o700)
            self._lock = _locked(self.path)
        except OSError as error:
            # asked again, Python would raise again where no place for temporary files will do
            where = parent or error.filename or tempfile.tempdir or "TMPDIR"
            raise BadInput(
                f"{where}: no folder for temporary files can be made: {error.strerror} (set TMPDIR)"
            ) from error

    def remove(self) -> None:
        """Remove the folder with all that is in it; nothing if it is gone already."""
        self._remove()
        self._lock.release()

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *_: object) -> None:
        self.remove()


#: Folders that were made, each with the process that made it.
_MADE: dict[Path, int] = {}


@atexit.register
def _remove_all() -> None:
    """What threads have made anew that an interrupt had left running: by now they have ended."""
    for folder, owner in list(_MADE.items()):
        _remove(folder, owner)


def _remove(folder: Path, owner: int) -> None:
    if os.getpid() != owner:  # a fork of it
        return
    # `shutil.rmtree` takes two files open for every level: this takes one in all, and passes over
    # what another process, as a worker that ends, removes at the same time
    for place, folders, files in os.walk(folder, topdown=False):
        for path in (Path(place, name) for name in (*folders, *files)):
            with suppress(OSError):
                path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()
    with suppress(OSError):
        folder.rmdir()


def _locked(folder: Path) -> FileLock:
    """A lock in the folder that has its name only once it is locked: it is never met unlocked."""
    draft = folder / f"{OWNER_NAME}.draft"
    draft.write_text(platform.node(), "utf-8")
    lock = FileLock(draft, blocking=False, thread_local=False)  # a finaliser may free it
    lock.acquire()
    with suppress(PermissionError):  # Windows renames no open file: such a folder is never removed
        draft.rename(folder / OWNER_NAME)
    return lock


def _remove_abandoned(place: Path) -> None:
    """Remove what processes of this machine left that are gone."""
    for owner in place.glob(f"{PREFIX}*/{OWNER_NAME}"):
        with suppress(OSError, Timeout):
            status = owner.lstat()
            if owner.parent.is_symlink() or not stat.S_ISREG(status.st_mode):
                continue  # a pipe of others would be waited for without end
            if hasattr(os, "getuid") and status.st_uid != os.getuid():
                continue
            if owner.read_text("utf-8") != platform.node():
                continue  # a lock may mean nothing to other machines that share the folder
            with FileLock(owner, blocking=False):
                _remove(owner.parent, os.getpid())
