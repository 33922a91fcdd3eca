"""What the parts of a campaign are called where it was said: in a file, or in a program."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class Places:
    """Words for complaints: ``top`` opens them all, the others are its parts.

    ``parameter`` takes the name of one as ``parameter.format(name)``, ``measurement`` that of the
    table of a further kind.
    """

    top: str
    parameters: str
    parameter: str
    start: str
    drive: str
    sweep: str
    measurement: str
    alternatives: str
    laws: str
    constants: str

    def of_parameter(self, name: str) -> str:
        """Where one parameter was said.

        Args:
            name: of the parameter.
        """
        return f"{self.top}{self.parameter.format(name)}"


def places_of_file(path: Path) -> Places:
    """The tables of a campaign file.

    Args:
        path: of the file.
    """
    return Places(
        top=f"{path}: ",
        parameters="[[parameters]]",
        parameter="[parameters '{}']",
        start="[fmu.start]",
        drive="[drive]",
        sweep="[sweep.set]",
        measurement="[{}]",
        alternatives="[alternatives]",
        laws="[laws]",
        constants="[constants]",
    )


def places_of_series(name: str) -> Places:
    """The arguments of a program, of one of its series of measurements.

    Args:
        name: of the series, empty where there is but one.
    """
    return Places(
        top=f"series '{name}': " if name else "",
        parameters="parameters",
        parameter="parameter '{}'",
        start="the setup's start_values",
        drive="the setup's drive",
        sweep="the sweep's settings",
        measurement="the measurement {}",
        alternatives="alternatives",
        laws="laws:",
        constants="constants:",
    )
