"""The FMU of a draft, and who runs it."""

from __future__ import annotations

from dataclasses import dataclass

from fitting.fmu import FmuWorkers


@dataclass(frozen=True)
class Source:
    """The FMU of a draft: a model of this project by its name, or a file; and who runs it."""

    name: str
    is_model: bool
    workers: FmuWorkers
