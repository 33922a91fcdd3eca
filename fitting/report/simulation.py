"""A drive or a sweep of an FMU: the document for other programs, the screen, the files.

Numbers are in the units that are named next to them; whatever is not known is NaN.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fitting.fmu.description import FmuDescription, OtherTone
from fitting.report.screen import printed_lines
from fitting.signal.combinations import combination_name
from fitting.simulate.budget import Budget
from fitting.simulate.frf import SweepResponse
from fitting.simulate.planner import DrivePlan
from fitting.simulate.response import DriveResponse
from fitting.simulate.words import (
    difference_in_words,
    remainder_in_words,
    settling_in_words,
    spectrum_in_words,
    warnings_in_words,
)
from fitting.text.arrays import FloatArray
from fitting.text.results_folder import write_whole
from fitting.text.tables import csv_text

# --- documents ------------------------------------------------------------------------------------


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


# --- screens --------------------------------------------------------------------------------------


def plan_lines(model: str, plan: DrivePlan, *, verbose: bool = False) -> list[str]:
    """What `fmu-fit simulate --plan` prints.

    Args:
        model: name of the FMU's model.
        plan: settings, settling and windows, with what they promise.
        verbose: whether each decision is printed with its reason.
    """
    warnings = warnings_in_words(plan.budget)
    return printed_lines("simulation", "planned", model, plan.budget, verbose, warnings)


@dataclass(frozen=True, kw_only=True)
class Ran:
    """What a screen of `simulate` or `sweep` shows besides the response.

    Args:
        model: name of the FMU's model.
        warnings: of the FMU.
        others: tones by which the FMU may drive, too.
        files: that were written.
    """

    model: str
    warnings: Sequence[str]
    others: Sequence[OtherTone]
    files: Sequence[Path]


def drive_lines(
    response: DriveResponse,
    units: Mapping[str, str],
    ran: Ran,
    *,
    advice: str = "",
    verbose: bool = False,
) -> list[str]:
    """What `fmu-fit simulate` prints: every peak, the largest mixed lines, warnings.

    Args:
        response: of the FMU.
        units: of the outputs by name, empty where there is none.
        ran: the FMU's model and warnings, and the files.
        advice: why it is not steady, and what helps; mostly empty.
        verbose: whether plan, spectrum and all mixed lines are printed.
    """
    budget, remainder = response.plan.budget, remainder_in_words(response.remainder)
    texts = _warnings(budget, ran) + ([] if response.remainder.explained else [remainder])
    details = (spectrum_in_words(response.spectrum), settling_in_words(response.plan), remainder)
    result = drive_document(response, units)
    records = (ran, result, response, budget, verbose, texts, advice, details)
    return printed_lines("simulation", "drive", *records)


def _warnings(budget: Budget, ran: Ran) -> list[str]:
    """Those of the plan, and those of the FMU."""
    return [*warnings_in_words(budget), *(f"the FMU: {text}" for text in ran.warnings)]


def sweep_lines(
    response: SweepResponse, unit: str, ran: Ran, *, verbose: bool = False
) -> list[str]:
    """What `fmu-fit sweep` prints: the largest amplitude each way, the jumps, warnings.

    Args:
        response: of the FMU.
        unit: of the output, empty where there is none.
        ran: the FMU's model and warnings, and the files.
        verbose: whether the plan is printed.
    """
    budget, difference = response.plan.budget, difference_in_words(response)
    longer = not (response.steady or response.plan.settles)
    result = sweep_document(response, unit)
    records = (ran, result, budget, verbose, difference, _warnings(budget, ran), longer)
    return printed_lines("simulation", "sweep", *records)


# --- files ----------------------------------------------------------------------------------------


def write_drive(
    response: DriveResponse, description: FmuDescription, out: Path
) -> tuple[Path, ...]:
    """Traces, spectrum, peaks and lines of a drive as CSV, and figures; the files written.

    Args:
        response: of the FMU.
        description: of the FMU, for units and the model's name.
        out: folder.

    Raises:
        BadInput: the folder cannot be written.
    """
    drive, spectrum, beating = response.drive, response.spectrum, response.beating
    units = [_unit(description, name) for name in drive.outputs]
    columns = [f"{name} ({unit})" for name, unit in zip(drive.outputs, units, strict=True)]
    titles = [combination_name(line.factors, drive.names) for line in response.lines]
    paths = []
    if response.lines:
        rows = [
            [title, *map(repr, [line.frequency_hz, *line.amplitudes.tolist()])]
            for title, line in zip(titles, response.lines, strict=True)
        ]
        paths.append(_write(out / "lines.csv", ["combination", "frequency (Hz)", *columns], rows))
    tables: list[tuple[str, str, list[FloatArray]]] = [
        ("carrier.csv", "time (s)", [response.carrier.times_s, response.carrier.values]),
        ("spectrum.csv", "frequency (Hz)", [spectrum.frequencies_hz, spectrum.amplitudes]),
        ("peaks.csv", "frequency (Hz)", [np.array(drive.tones_hz), response.peaks]),
    ]
    if beating is not None:
        tables.append(("beating.csv", "time (s)", [beating.times_s, beating.values]))
    for name, first, arrays in tables:
        paths.append(_write(out / name, [first, *columns], _cells(np.column_stack(arrays))))
    named = list(zip(titles, response.lines, strict=True))
    return (*paths, *_figures().save_figures(response, description.model_name, units, out, named))


def write_sweep(
    response: SweepResponse, description: FmuDescription, out: Path
) -> tuple[Path, ...]:
    """Curves of a sweep as CSV, and a figure; the files written.

    Args:
        response: of the FMU.
        description: of the FMU, for units and the model's name.
        out: folder.

    Raises:
        BadInput: the folder cannot be written.
    """
    sweep = response.sweep
    unit = _unit(description, sweep.output)
    head = ["frequency (Hz)", *(f"{sweep.output} {c.direction} ({unit})" for c in response.curves)]
    table = np.column_stack([sweep.frequencies_hz, *(c.amplitudes for c in response.curves)])
    path = _write(out / "sweep.csv", head, _cells(table))
    return (path, *_figures().save_frf(response, description.model_name, unit, out))


def _unit(description: FmuDescription, name: str) -> str:
    return description.variables[name].unit or "1"


def _cells(table: FloatArray) -> Iterable[Sequence[str]]:
    return (list(map(repr, row)) for row in table.tolist())


def _write(path: Path, head: Sequence[str], rows: Iterable[Sequence[str]]) -> Path:
    write_whole(path, csv_text([head, *rows]))
    return path


def _figures() -> Any:
    # matplotlib takes a second to import: only where something is drawn
    return importlib.import_module("fitting.report.figures.simulate")
