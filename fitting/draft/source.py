"""The FMU of a draft, and who runs it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from fitting.fmu import FmuWorkers
from fitting.text.files import path_from


@dataclass(frozen=True)
class Source:
    """The FMU of a draft: a model of this project by its name, or a file; and who runs it.

    ``interface`` is the one that was asked for, None: nobody asked.
    """

    name: str
    is_model: bool
    workers: FmuWorkers
    interface: str | None = None

    def table(self, folder: Path | None) -> dict[str, str]:
        """What a campaign calls it under ``[fmu]``.

        Args:
            folder: where the campaign stands; None: the path is absolute.
        """
        if self.is_model:
            return {"model": self.name}
        made = {"file": relative_path(Path(self.name), folder)}
        return made if self.interface is None else made | {"interface": self.interface}


def relative_path(path: Path, folder: Path | None) -> str:
    """A path as seen from the campaign, with slashes on every system.

    Args:
        path: of a file.
        folder: where the campaign stands; None: the path is absolute.
    """
    return Path(os.path.abspath(path)).as_posix() if folder is None else path_from(folder, path)
