"""FMUs in worker processes: describe a file, run batches of simulations, fail in sentences.

The only part of `fitting` that knows fmpy. FMI 2.0 and 3.0, co-simulation and model exchange. Its
names are loaded when they are first used: a worker process needs few of them, and starts sooner.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fitting.fmu.accuracy import read_accuracy_annotation
    from fitting.fmu.description import (
        FmuDescription,
        FmuVariable,
        read_description,
        validation_problems,
    )
    from fitting.fmu.pool import FmuWorkers
    from fitting.fmu.runs import Counts, HeldSignal, InputSignal, Run, Segment, row_times
else:
    _MODULES = {
        "accuracy": ("read_accuracy_annotation",),
        "description": ("FmuDescription", "FmuVariable", "read_description", "validation_problems"),
        "pool": ("FmuWorkers",),
        "runs": ("Counts", "HeldSignal", "InputSignal", "Segment", "Run", "row_times"),
    }

    def __getattr__(name: str) -> object:
        """A public name, loaded from its module and kept."""
        for module, names in _MODULES.items():
            if name in names:
                found = getattr(importlib.import_module(f"{__name__}.{module}"), name)
                globals()[name] = found
                return found
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "Counts",
    "FmuDescription",
    "FmuVariable",
    "FmuWorkers",
    "HeldSignal",
    "InputSignal",
    "Run",
    "Segment",
    "read_accuracy_annotation",
    "read_description",
    "row_times",
    "validation_problems",
]
