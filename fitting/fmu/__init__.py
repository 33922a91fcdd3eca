"""FMUs in worker processes: describe a file, run batches of simulations, fail in sentences.

The only part of `fitting` that knows fmpy. FMI 2.0 and 3.0, co-simulation.
"""

from fitting.fmu.annotation import read_hints
from fitting.fmu.description import (
    FmuDescription,
    FmuVariable,
    read_description,
    validation_problems,
)
from fitting.fmu.records import Counts, InputSignal, Leg, Run, row_times
from fitting.fmu.workers import FmuWorkers

__all__ = [
    "Counts",
    "FmuDescription",
    "FmuVariable",
    "FmuWorkers",
    "InputSignal",
    "Leg",
    "Run",
    "read_description",
    "read_hints",
    "row_times",
    "validation_problems",
]
