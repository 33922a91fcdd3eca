"""Runs of an FMU, and the places where independent items run."""

from __future__ import annotations

from fitting.api.direct import HOLD_STEPS
from fitting.api.fmu import opened_fmu
from fitting.api.problem import fmu_of
from fitting.engine.run import NeededFile, Where, opened, place_of, run
from fitting.fmu.archive import compiled
from fitting.fmu.description import (
    FmuDescription,
    FmuVariable,
    read_description,
    validation_problems,
)
from fitting.fmu.models import built_model
from fitting.fmu.pool import FmuWorkers, OutOfTime
from fitting.fmu.runs import Handling, Run, SampledSignal, Segment
from fitting.measurements.time_record import is_late
from fitting.simulate.response import USUAL_ACCURACY

__all__ = [
    "HOLD_STEPS",
    "USUAL_ACCURACY",
    "FmuDescription",
    "FmuVariable",
    "FmuWorkers",
    "Handling",
    "NeededFile",
    "OutOfTime",
    "Run",
    "SampledSignal",
    "Segment",
    "Where",
    "built_model",
    "compiled",
    "fmu_of",
    "is_late",
    "opened",
    "opened_fmu",
    "place_of",
    "read_description",
    "run",
    "validation_problems",
]
