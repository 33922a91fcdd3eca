"""A file that is replaced whole or not at all."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from glob import escape
from pathlib import Path

from fitting.text.errors import BadInput

#: What the temporary name of a file ends with.
PART = ".part"


def replace_file(path: Path, data: bytes) -> None:
    """Write a file under a temporary name beside it, then rename: never half a file.

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
                os.fsync(stream.fileno())
            # mkstemp makes files private; give this one the mode any new file has
            os.chmod(name, 0o666 & ~_umask())
            os.replace(name, path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror}") from error


def remove_parts(path: Path) -> None:
    """Remove what processes left that were killed while they wrote a file, which nobody writes now.

    Args:
        path: of the file.
    """
    for part in path.parent.glob(f".{escape(path.name)}.*{PART}"):
        with suppress(OSError):
            part.unlink()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
