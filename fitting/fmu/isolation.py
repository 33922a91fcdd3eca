"""What an FMU may take while it is isolated: an FMU is somebody else's program."""

from __future__ import annotations

import math
from dataclasses import dataclass

from fitting.text.arguments import checked
from fitting.text.errors import BadInput

MB = 10**6


@checked
@dataclass(frozen=True, kw_only=True)
class Isolation:
    """Limits of an FMU that runs isolated; its worker processes keep to them, each by itself.

    Beside them it writes into a folder of its own alone, and has no network, where the system can
    hold that (Linux); what the system cannot is told as a warning.

    Attributes:
        memory_mb: Memory beyond that of the worker itself, MB.
        processor_s: Processor time of one run, s.
        files: Files that are open at a time.
        written_mb: What it has written into its folder, MB.

    Raises:
        BadInput: a number that is not positive.
    """

    memory_mb: float = 2000.0
    processor_s: float = 60.0
    files: int = 64
    written_mb: float = 200.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0.0 < value < math.inf:
                raise BadInput(f"isolate: {name} is {value!r}, wanted a positive number")
        if self.files < LEAST_FILES:
            raise BadInput(
                f"isolate: files is {self.files!r}, wanted {LEAST_FILES} at least, for the worker"
            )

    @property
    def words(self) -> str:
        """The limits in words."""
        return (
            f"{self.memory_mb:g} MB of memory, {self.processor_s:g} s of processor time a run, "
            f"{self.files} open files, {self.written_mb:g} MB written"
        )


#: Files that a worker itself has open while it loads an FMU.
LEAST_FILES = 24
