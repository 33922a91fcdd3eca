"""What a command hands to other programs where its results are no record of their own: plain data.

Numbers stand in the units that are named beside them; whatever is not known is NaN.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fitting.campaign.check import Check
from fitting.fmu import FmuVariable
from fitting.fmu.trial.steps import Repeatability
from fitting.signal.combinations import combination_name
from fitting.simulate.budget import record_of
from fitting.simulate.drive_plan import DrivePlan
from fitting.simulate.frf import SweepResponse
from fitting.simulate.response import DriveResponse
from fitting.simulate.words import warnings_in_words
from fitting.text.arrays import FloatArray


def check_document(found: Check) -> dict[str, Any]:
    """What a doctor found of an FMU.

    Args:
        found: of the FMU.
    """
    d = found.description
    return {
        "fmu": str(d.path),
        "model_name": d.model_name,
        "fmi_version": d.fmi_version,
        "guid": d.guid,
        "sha256": d.sha256,
        "platforms": d.platforms,
        "variables": {v.name: _variable(v) for v in d.variables.values()},
        "sound": found.sound,
        "findings": found.findings,
        "trial": found.examination.trial,
        "resets": found.examination.resets,
        "repeats": found.examination.repeats and _repeats(found.examination.repeats),
        "effects": found.examination.effects,
        "costs": found.examination.costs,
        "failure": None if found.failure is None else str(found.failure),
        "suits": found.suits and {**vars(found.suits), "campaign": str(found.suits.campaign)},
        "unsuited": found.unsuited,
        "warnings": found.warnings,
    }


def _repeats(repeats: Repeatability) -> dict[str, Any]:
    """Without what is there for a figure."""
    left = ("outputs", "times_s", "differences")
    return {name: value for name, value in vars(repeats).items() if name not in left}


def plan_document(plan: DrivePlan) -> dict[str, Any]:
    """How an FMU is simulated, and what that promises.

    Args:
        plan: settings, settling and windows.
    """
    return {
        "kept": plan.budget.kept,
        "settle_s": plan.settle_s,
        **vars(record_of(plan.budget, plan.settings)),
        "warnings": tuple(warnings_in_words(plan.budget)),
    }


def drive_document(response: DriveResponse, units: Mapping[str, str]) -> dict[str, Any]:
    """The steady response to some tones: peaks, constants, lines at combinations of the tones.

    Args:
        response: of the FMU.
        units: of the outputs by name, empty where there is none.
    """
    drive = response.drive
    outputs = {
        name: {
            "unit": units[name],
            "constant": response.constants.get(name),
            "peaks": dict(zip(drive.names, map(float, column), strict=True)),
        }
        for name, column in zip(drive.outputs, response.peaks.T, strict=True)
    }
    return {
        "steady": response.steady,
        "accuracy": float(response.accuracy),
        "tones_hz": dict(zip(drive.names, map(float, drive.tones_hz), strict=True)),
        "outputs": outputs,
        "lines": [
            {
                "name": combination_name(line.factors, drive.names),
                "frequency_hz": float(line.frequency_hz),
                "amplitudes": dict(zip(drive.outputs, _numbers(line.amplitudes), strict=True)),
            }
            for line in response.lines
        ],
        "plan": plan_document(response.plan),
    }


def sweep_document(response: SweepResponse, unit: str) -> dict[str, Any]:
    """A frequency response, each way.

    Args:
        response: of the FMU.
        unit: of the output, empty where there is none.
    """
    what = response.sweep
    return {
        "steady": response.steady,
        "accuracy": float(response.accuracy),
        "tone": what.tone,
        "output": what.output,
        "unit": unit,
        "frequency_hz": _numbers(what.frequencies_hz),
        "amplitude": {curve.direction: _numbers(curve.amplitudes) for curve in response.curves},
        "jumps": response.jumps,
        "difference": response.difference,
        "plan": plan_document(response.plan),
    }


def _variable(v: FmuVariable) -> dict[str, Any]:
    names = ("causality", "variability", "kind", "unit", "start", "min", "max", "description")
    return {name: getattr(v, name) for name in names}


def _numbers(values: FloatArray | Sequence[float]) -> list[float]:
    return [float(value) for value in np.asarray(values)]
