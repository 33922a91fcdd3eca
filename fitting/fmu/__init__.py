"""FMUs in worker processes: describe a file, run batches of simulations, fail in sentences.

The only part of `fitting` that knows fmpy. FMI 2.0 and 3.0, co-simulation and model exchange. Its
names are loaded when they are first used: a worker process needs few of them, and starts sooner.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fitting.fmu.accuracy import read_accuracy_annotation as read_accuracy_annotation
    from fitting.fmu.description import FmuDescription as FmuDescription
    from fitting.fmu.description import FmuVariable as FmuVariable
    from fitting.fmu.description import read_description as read_description
    from fitting.fmu.description import validation_problems as validation_problems
    from fitting.fmu.pool import FmuWorkers as FmuWorkers
    from fitting.fmu.runs import Counts as Counts
    from fitting.fmu.runs import InputSignal as InputSignal
    from fitting.fmu.runs import Run as Run
    from fitting.fmu.runs import SampledSignal as SampledSignal
    from fitting.fmu.runs import Segment as Segment
    from fitting.fmu.runs import row_times as row_times
else:
    _NAMES = {
        "accuracy": ("read_accuracy_annotation",),
        "description": ("FmuDescription", "FmuVariable", "read_description", "validation_problems"),
        "pool": ("FmuWorkers",),
        "runs": ("Counts", "SampledSignal", "InputSignal", "Segment", "Run", "row_times"),
    }
    _MODULES = {name: module for module, names in _NAMES.items() for name in names}

    def __getattr__(name: str) -> object:
        """A public name, loaded from its module and kept."""
        if name not in _MODULES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module = importlib.import_module(f"{__name__}.{_MODULES[name]}")
        return globals().setdefault(name, getattr(module, name))
