"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path

from fitting.text.errors import BadInput


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file under a temporary name beside it, then rename: never half a file.

    Text is written as UTF-8 with line feeds on every system. Folders are made as needed.

    Args:
        path: of the file.
        content: of the file.

    Raises:
        BadInput: the folder or file cannot be written.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
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


def write_all(folder: Path, texts: Mapping[str, str] | Mapping[str, str | bytes]) -> None:
    """Write several texts by relative file name below ``folder``.

    Args:
        folder: where the files go.
        texts: contents by file name.
    """
    for name, text in texts.items():
        write_whole(folder / name, text)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
