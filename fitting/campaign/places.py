"""What the parts of a campaign are called where it was said: in a file, or in a program."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

#: Parts of a campaign as a file names them; ``measurement`` is the table of a further kind.
IN_FILE = {
    "parameters": "[[parameters]]",
    "parameter": "[parameters '{}']",
    "start": "[fmu.start]",
    "drive": "[drive]",
    "sweep": "[sweep.set]",
    "measurement": "[{}]",
    "alternatives": "[alternatives]",
    "laws": "[laws]",
}
#: The same as arguments of a program.
IN_PROGRAM = {
    "parameters": "parameters",
    "parameter": "parameter '{}'",
    "start": "the setup's start_values",
    "drive": "the setup's drive",
    "sweep": "the sweep's settings",
    "measurement": "the measurement {}",
    "alternatives": "alternatives",
    "laws": "laws",
}


@dataclass(frozen=True)
class Places:
    """Words for complaints: ``top`` opens them all, ``parts`` are called so."""

    top: str
    parts: Mapping[str, str]

    def of(self, part: str, name: str = "") -> str:
        """What a part is called.

        Args:
            part: as "drive".
            name: of it, where there are several.
        """
        return self.parts[part].format(name)


def places_of_file(path: Path) -> Places:
    """The tables of a campaign file.

    Args:
        path: of the file.
    """
    return Places(f"{path}: ", IN_FILE)


def places_of_series(name: str) -> Places:
    """The arguments of a program, of one of its series of measurements.

    Args:
        name: of the series, empty where there is but one.
    """
    return Places(f"series '{name}': " if name else "", IN_PROGRAM)
