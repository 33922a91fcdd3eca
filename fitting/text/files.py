"""Files that are read whole, and written whole or not at all."""

from __future__ import annotations

import logging
import math
import os
import stat
from collections.abc import Mapping
from pathlib import Path

from fitting.text.atomic import replace_file
from fitting.text.errors import BadInput, MissingFile
from fitting.text.results_folder import open_folder_of

_log = logging.getLogger(__name__)

#: A file that is larger is none of those that people mean here.
MOST_BYTES = 2 * 2**30


def read_whole(path: Path, wanted: str = "a file") -> bytes:
    """Content of a file.

    Args:
        path: of the file.
        wanted: what it should be, for complaints.

    Raises:
        MissingFile: there is none of that name.
        BadInput: a folder, a pipe or a device (which may never end), too large, or not readable.
    """
    return _read(path, wanted, MOST_BYTES, -1)


def read_head(path: Path, size: int, wanted: str = "a file") -> bytes:
    """The first bytes of a file, however large it is.

    Args:
        path: of the file.
        size: how many bytes at most.
        wanted: what it should be, for complaints.

    Raises:
        MissingFile: there is none of that name.
        BadInput: a folder, a pipe or a device, or not readable.
    """
    return _read(path, wanted, math.inf, size)


def _read(path: Path, wanted: str, most: float, size: int) -> bytes:
    name = str(path) if str(path).strip() else repr(str(path))
    try:
        result = path.stat()
        if not stat.S_ISREG(result.st_mode):
            raise BadInput(f"{name}: is {_kind(result.st_mode)}, wanted {wanted}")
        if result.st_size > most:
            raise BadInput(
                f"{name}: has {result.st_size / 1e6:.6g} MB, wanted {wanted} of at most "
                f"{MOST_BYTES / 1e6:.6g} MB"
            )
        with path.open("rb") as file:
            return file.read(size)
    except BadInput:  # a ValueError itself
        raise
    except (FileNotFoundError, NotADirectoryError) as error:
        raise MissingFile(f"{name}: no such file, wanted {wanted}") from error
    except OSError as error:
        raise BadInput(f"{name}: cannot be read: {error.strerror}; wanted {wanted}") from error
    except ValueError as error:  # a NUL character
        raise BadInput(f"{name}: no file can have this name; wanted {wanted}") from error


def _kind(mode: int) -> str:
    kinds = {
        stat.S_IFDIR: "a folder",
        stat.S_IFIFO: "a pipe",
        stat.S_IFSOCK: "a socket",
        stat.S_IFCHR: "a device",
        stat.S_IFBLK: "a device",
    }
    return kinds.get(stat.S_IFMT(mode), "no file")


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
