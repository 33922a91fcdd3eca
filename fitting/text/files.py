"""Files that are read whole, and replaced whole or not at all; those that come with the program."""

from __future__ import annotations

import errno
import os
import re
import stat
import tempfile
from contextlib import suppress
from glob import escape
from pathlib import Path
from secrets import token_hex

import fitting
from fitting.text.errors import BadInput, MissingFile

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
        # not by `tempfile`, whose files are private: this one has the mode that any new file has
        part = path.with_name(f".{path.name}.{token_hex(4)}{PART}")
        try:
            with part.open("xb") as stream:
                stream.write(data)
                stream.flush()
                _sync(stream.fileno(), path.parent)
            os.replace(part, path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror}") from error


def remove_parts(path: Path) -> None:
    """Remove what processes left that were killed while they wrote a file, which none writes now.

    Args:
        path: of the file.
    """
    ours = re.compile(re.escape(f".{path.name}.") + "[a-z0-9_]{8}" + re.escape(PART))
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


#: A file that is larger is none of those that people mean here.
MOST_BYTES = 2 * 2**30
#: What there may be of a name that is no file.
KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def read_whole(path: Path, wanted: str = "a file", head: int | None = None) -> bytes:
    """Content of a file.

    Args:
        path: of the file.
        wanted: what it should be, for complaints.
        head: how many bytes are read at most, however large the file is; None: all.

    Raises:
        MissingFile: there is none of that name.
        BadInput: a folder, a pipe or a device (which may never end), too large, or not readable.
    """
    name = str(path) if str(path).strip() else repr(str(path))
    try:
        result = path.stat()
        if not stat.S_ISREG(result.st_mode):
            kind = KINDS.get(stat.S_IFMT(result.st_mode), "no file")
            raise BadInput(f"{name}: is {kind}, wanted {wanted}")
        if head is None and result.st_size > MOST_BYTES:
            raise BadInput(
                f"{name}: has {result.st_size / 1e6:.6g} MB, wanted {wanted} of at most "
                f"{MOST_BYTES / 1e6:.6g} MB"
            )
        with path.open("rb") as file:
            return file.read(head)
    except BadInput:  # a ValueError itself
        raise
    except (FileNotFoundError, NotADirectoryError) as error:
        raise MissingFile(f"{name}: no such file, wanted {wanted}") from error
    except OSError as error:
        raise BadInput(f"{name}: cannot be read: {error.strerror}; wanted {wanted}") from error
    except ValueError as error:  # a NUL character
        raise BadInput(f"{name}: no file can have this name; wanted {wanted}") from error


def path_from(folder: Path, path: Path) -> str:
    """A path as seen from a folder, with slashes on every system; absolute on another drive.

    Links are resolved first: what leads upwards from a folder behind one begins where that is.

    Args:
        folder: that holds what names the path; it need not be there yet.
        path: of a file.
    """
    there = path.parent.resolve() / path.name
    try:
        return Path(os.path.relpath(there, folder.resolve())).as_posix()
    except ValueError:
        return there.as_posix()


#: The folder of an installed package that holds what stands at the top of a checkout.
INSTALLED = "shipped"


def shipped(name: str) -> Path:
    """Path of a file or folder that comes with the program, as `name` at the top of a checkout.

    An installed package has a copy, made when it was packaged; a checkout has the file itself.

    Raises:
        BadInput: it is in neither place.
    """
    package = Path(fitting.__file__).resolve().parent
    for home in (package / INSTALLED, package.parent):
        if (home / name).exists():
            return home / name
    raise BadInput(
        f"{package / INSTALLED / name}: No such file or directory; wanted a whole installation of "
        "fmu-fit, or its checkout"
    )
