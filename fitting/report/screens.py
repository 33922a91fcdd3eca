"""What each command prints on a terminal, by its template (`reconstruct`, `line`: their own)."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fitting.fmu.description import OtherTone
from fitting.inference.likelihood.knowledge import Identification
from fitting.report.documents import drive_document, sweep_document
from fitting.report.screen import phrase, printed_lines
from fitting.report.summary import (
    EXPRESSED,
    Summary,
    design_command,
    warnings_of,
    with_values,
)
from fitting.report.table import table
from fitting.result.calibration import Calibration
from fitting.simulate.budget import Budget
from fitting.simulate.frf import SweepResponse
from fitting.simulate.planner import DrivePlan
from fitting.simulate.response import DriveResponse, Sideband
from fitting.simulate.words import (
    difference_in_words,
    remainder_in_words,
    settling_in_words,
    spectrum_in_words,
    warnings_in_words,
)
from fitting.text.estimate import EVEN, Verdict


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
    details = (
        spectrum_in_words(response.spectrum),
        settling_in_words(response.plan),
        remainder,
    )
    result = drive_document(response, units)
    records = (ran, result, response, budget, verbose, texts, advice, details)
    return printed_lines("simulation", "drive", *records)


def _warnings(budget: Budget, ran: Ran) -> list[str]:
    """Those of the plan, and those of the FMU."""
    return [*warnings_in_words(budget), *(f"the FMU: {text}" for text in ran.warnings)]


def unsteady_words(
    response: DriveResponse,
    sideband: Sideband | None,
    names: Collection[str],
    undamped: Sequence[str] = (),
) -> str:
    """Why amplitudes do not settle, and what helps.

    Args:
        response: of the FMU.
        sideband: what its line apart from the tones is, if that is known.
        names: of the FMU's variables.
        undamped: parameters that are 0 and would damp that line.
    """
    return phrase("simulation", "unsteady", response, sideband, names, undamped)


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


def calibration_lines(
    title: str, result: Calibration, files: Sequence[Path], *, compiled: bool = False
) -> list[str]:
    """What `fmu-fit calibrate` prints: which values are written, and which are not.

    Args:
        title: of the fit.
        result: what is written.
        files: that were written.
        compiled: whether start values are compiled into the FMU, which is then not written.
    """
    return printed_lines("calibration", "screen", title, result, EVEN, compiled, files)


def identification_lines(
    result: Identification, files: Sequence[Path] = (), *, verbose: bool = False
) -> list[str]:
    """What `fmu-fit identify` prints: values with intervals, what is unconstrained, what is next.

    Args:
        result: what the data determine.
        files: identify.json, the report if there is one.
        verbose: whether directions, all intervals and their sentences are printed.
    """
    knowledge = result.knowledge
    # the outputs that the campaign asks for come first
    every = {n: v for n, v in {**result.derived, **result.parameters}.items() if n in result.scans}
    summary = Summary(
        title=result.title,
        status=phrase("identification", "status", result),
        synthetic=result.synthetic and "synthetic" not in result.title.lower(),
        warnings=warnings_of(
            (f for f in result.findings if f.severity != "note" and f.kind not in EXPRESSED), every
        ),
    )
    summary, left = with_values(summary, every)
    open_ = [name for name, value in left.items() if value.status is not Verdict.BOUNDED]
    words = shlex.split(result.provenance.get("command", ""))
    if open_ and words[:2] == ["fmu-fit", "identify"] and knowledge.adequacy.gives_values:
        at = result.at if "--at" in words else ""
        command = design_command(words[2:3], at, open_[0])
        summary = replace(
            summary, advice=phrase("next", "determine", open_[0], False), command=command
        )
    return printed_lines(
        "identification",
        "screen",
        result,
        summary,
        verbose,
        table("directions", knowledge=knowledge, tried=False) if knowledge.directions else None,
        None if result.part is None else table("part", whole=result, part=result.part),
        files,
    )
