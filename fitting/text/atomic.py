"""A file that is replaced whole or not at all."""

from __future__ import annotations

import errno
import os
import re
import stat
import tempfile
from contextlib import suppress
from glob import escape
from pathlib import Path

from fitting.text.errors import BadInput
from fitting.text.once import alone

#: What the temporary name of a file ends with.
PART = ".part"
#: What file systems answer that know no `fsync`, as many of networks, of phones and in containers.
NO_SYNC = {errno.EINVAL, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EROFS, errno.EPERM}


def replace_file(path: Path, data: bytes) -> None:
    """Write a file under a temporary name next to it, then rename: never half a file.

    Folders are made as needed.

    Args:
        path: of the file.
        data: its content.

    Raises:
        BadInput: the folder or file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(PART, f".{path.name}.", path.parent)
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(data)
                stream.flush()
                _sync(stream.fileno(), path.parent)
            # mkstemp makes files private; give this one the mode any new file has
            with suppress(OSError):  # some mounts have no modes, or keep them as they are
                os.chmod(name, 0o666 & ~_umask())
            os.replace(name, path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror}") from error


def remove_parts(path: Path) -> None:
    """Remove what processes left that were killed while they wrote a file, which none writes now.

    Args:
        path: of the file.
    """
    ours = re.compile(re.escape(f".{path.name}.") + "[a-z0-9_]{8}" + re.escape(PART))  # mkstemp
    for part in path.parent.glob(f".{escape(path.name)}.*{PART}"):
        with suppress(OSError):
            if ours.fullmatch(part.name) and stat.S_ISREG(part.lstat().st_mode):
                part.unlink()


def add_to_file(path: Path, data: bytes) -> None:
    """Add to the end of a file, on the disk when this returns: what is noted of it stays true.

    Args:
        path: of the file.
        data: what is added.

    Raises:
        BadInput: the file cannot be written.
    """
    try:
        with path.open("ab") as file:
            file.write(data)
            file.flush()
            _sync(file.fileno(), path.parent)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror}") from error


def _sync(handle: int, folder: Path) -> None:
    """Have the data on the disk where its file system can report that.

    A refusal is no fault of the data, unless it is one that a file without any does not meet.

    Raises:
        OSError: the data are not on the disk, as where that is full or broken.
    """
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno in NO_SYNC:
            return
        if error.errno == errno.EIO:
            with tempfile.NamedTemporaryFile(prefix=".sync.", suffix=PART, dir=folder) as empty:
                try:
                    os.fsync(empty.fileno())
                except OSError:
                    return
        raise


def _umask() -> int:
    with alone():  # of two threads the second would take 0 for it, and leave the process with that
        mask = os.umask(0)
        os.umask(mask)
    return mask
