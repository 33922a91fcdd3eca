"""Files that workers need: by their path on this machine, by their content on others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from fitting.text.errors import BadInput
from fitting.text.files import read_whole


@dataclass(frozen=True)
class NeededFile:
    """A file by its path, and by the SHA-256 of its content."""

    path: str
    digest: str

    @classmethod
    def of(cls, path: Path) -> NeededFile:
        """The file as it is now.

        Args:
            path: of the file.

        Raises:
            BadInput: it cannot be read.
        """
        return cls(str(path.resolve()), sha256(read_whole(path)).hexdigest())


#: Where this process has files that were sent to it, by their digests.
_SENT: dict[str, Path] = {}


def keep(contents: Mapping[NeededFile, bytes], folder: Path) -> None:
    """Write files that were sent to this process.

    Args:
        contents: of the files.
        folder: of this process.
    """
    for file, content in contents.items():
        path = folder / file.digest / Path(file.path).name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        _SENT[file.digest] = path


def place_of(file: NeededFile) -> Path:
    """Where this process finds a file.

    Args:
        file: that is needed.

    Raises:
        BadInput: it was not sent, and nothing is at its path.
    """
    path = _SENT.get(file.digest, Path(file.path))
    if not path.is_file():
        raise BadInput(f"{path}: no such file on the machine of this worker")
    return path
