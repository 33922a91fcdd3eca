"""What a command hands to other programs where its results are no record of their own: plain data.

Numbers stand in the units that are named next to them; whatever is not known is NaN.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fitting.signal.combinations import combination_name
from fitting.simulate.frf import SweepResponse
from fitting.simulate.planner import DrivePlan
from fitting.simulate.response import DriveResponse
from fitting.simulate.words import warnings_in_words
from fitting.text.arrays import FloatArray


def plan_document(plan: DrivePlan) -> dict[str, Any]:
    """How an FMU is simulated, and what that promises.

    Args:
        plan: settings, settling and windows.
    """
    return {
        "kept": plan.budget.kept,
        "settle_s": plan.settle_s,
        **vars(plan.record),
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


def _numbers(values: FloatArray | Sequence[float]) -> list[float]:
    return [float(value) for value in np.asarray(values)]
