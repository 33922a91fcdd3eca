"""What each command prints on a terminal, by its template (`reconstruct`, `line`: their own)."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fitting.campaign.check import Check
from fitting.design.result import Design
from fitting.design.ways import Ways
from fitting.fmu import FmuDescription, FmuVariable
from fitting.fmu.findings import Severity
from fitting.fmu.tone_names import OtherTone
from fitting.fmu.trial.findings import ROUNDING
from fitting.fmu.trial.steps import SHIFT
from fitting.inference.likelihood.knowledge import Identification
from fitting.inference.posterior.summary import PosteriorSummary
from fitting.lab.tradeoff.records import Study
from fitting.report.documents import drive_document, sweep_document
from fitting.report.posterior import tables_of
from fitting.report.screen import lines_of, phrase, printed_lines
from fitting.report.summary import (
    EXPRESSED,
    Summary,
    design_command,
    warnings_of,
    with_values,
)
from fitting.report.table import table
from fitting.report.tradeoff import choice_tables
from fitting.result.calibration import Calibration
from fitting.result.ensemble import Ensemble
from fitting.simulate.budget import Budget
from fitting.simulate.drive_plan import DrivePlan
from fitting.simulate.frf import SweepResponse
from fitting.simulate.response import DriveResponse
from fitting.simulate.unsteady import Sideband
from fitting.simulate.words import (
    difference_in_words,
    remainder_in_words,
    settling_in_words,
    spectrum_in_words,
    warnings_in_words,
)
from fitting.text.controls import spelled_out
from fitting.text.error_bars import EVEN
from fitting.text.estimate import Verdict

#: Kinds of variables of an FMU that are listed, as far as they are no observed ones.
SHOWN = ("parameter", "input", "output", "calculatedParameter")
#: What sentences on an FMU need besides its record.
CHECKED = {"rounding": ROUNDING, "shift": SHIFT}


def check_lines(found: Check, *, verbose: bool = False, report: Path | None = None) -> list[str]:
    """What `fmu-fit check` prints.

    Args:
        found: of the FMU.
        verbose: whether all that was tried is printed, with a row for each variable.
        report: the page, if one was written.
    """
    careful = [f for f in found.findings if f.severity is Severity.CAREFUL]
    urgent = [phrase("check", "described", f) for f in careful]
    urgent += [f"the FMU reports: {warning}" for warning in found.warnings]
    numbers = {**CHECKED, "urgent": urgent}
    listed = table("variables", variables=variables_of(found.description), meaning=False)
    variables = lines_of(listed) if verbose else ""
    lines = printed_lines("check", "screen", found, numbers, verbose, variables, report)
    return [spelled_out(line) for line in lines]


def variables_of(description: FmuDescription) -> list[FmuVariable]:
    """Parameters, inputs and outputs, and what else is observed.

    Args:
        description: of the FMU.
    """
    observed = {v.name for v in description.seen}
    every = description.variables.values()
    return [v for v in every if v.causality in SHOWN or v.name in observed]


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
    found = drive_document(response, units)
    records = (ran, found, response, budget, verbose, texts, advice, details)
    return printed_lines("simulation", "drive", *records)


def _warnings(budget: Budget, ran: Ran) -> list[str]:
    """Those of the plan, and those of the FMU."""
    return [*warnings_in_words(budget), *(f"the FMU: {text}" for text in ran.warnings)]


def unsteady_words(
    response: DriveResponse, sideband: Sideband | None, names: Collection[str]
) -> str:
    """Why amplitudes do not settle, and what helps.

    Args:
        response: of the FMU.
        sideband: what its line apart from the tones is, if that is known.
        names: of the FMU's variables.
    """
    return phrase("simulation", "unsteady", response, sideband, names)


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
    found = sweep_document(response, unit)
    records = (ran, found, budget, verbose, difference, _warnings(budget, ran), longer)
    return printed_lines("simulation", "sweep", *records)


def design_lines(design: Design, files: Sequence[Path] = (), *, verbose: bool = False) -> list[str]:
    """What `fmu-fit design` prints: a row for each proposed measurement.

    Args:
        design: the proposed next measurements.
        files: design.json, design.csv, the campaign to be filled in, the report if there is one.
        verbose: whether candidates, points of equal fit and assumptions are printed.
    """
    rows = table("expected", of=design, rows=design.proposals)
    return printed_lines("design", "screen", design, rows, verbose, files)


def ways_lines(ways: Ways, files: Sequence[Path] = (), *, verbose: bool = False) -> list[str]:
    """What `fmu-fit design` prints of several kinds of measurements that are compared.

    Args:
        ways: to spend the same time, the least expected error first.
        files: ways.json, and the campaigns to be filled in.
        verbose: whether the times of each kind are printed.
    """
    rows = table("expected", of=ways, rows=ways.ways, takes=True)
    return printed_lines("design", "ways", ways, rows, verbose, files)


def calibration_lines(
    title: str, found: Calibration, files: Sequence[Path], *, compiled: bool = False
) -> list[str]:
    """What `fmu-fit calibrate` prints: which values are written, and which are not.

    Args:
        title: of the fit.
        found: what is written.
        files: that were written.
        compiled: whether start values are compiled into the FMU, which is then not written.
    """
    return printed_lines("calibration", "screen", title, found, EVEN, compiled, files)


def identification_lines(
    found: Identification, files: Sequence[Path] = (), *, verbose: bool = False
) -> list[str]:
    """What `fmu-fit identify` prints: values with intervals, what is unconstrained, what is next.

    Args:
        found: what the data determine.
        files: identify.json, the report if there is one.
        verbose: whether directions, all intervals and their sentences are printed.
    """
    knowledge = found.knowledge
    # the outputs that the campaign asks for come first
    every = {n: v for n, v in {**found.derived, **found.parameters}.items() if n in found.scans}
    summary = Summary(
        title=found.title,
        status=phrase("identification", "status", found),
        synthetic=found.synthetic and "synthetic" not in found.title.lower(),
        warnings=warnings_of(
            (f for f in found.findings if f.severity != "note" and f.kind not in EXPRESSED), every
        ),
    )
    summary, left = with_values(summary, every)
    open_ = [name for name, value in left.items() if value.status is not Verdict.BOUNDED]
    words = shlex.split(found.provenance.get("command", ""))
    if open_ and words[:2] == ["fmu-fit", "identify"] and knowledge.adequacy.gives_values:
        at = found.at if "--at" in words else ""
        command = design_command(words[2:3], at, open_[0])
        summary = replace(
            summary, advice=phrase("next", "determine", open_[0], False), command=command
        )
    return printed_lines(
        "identification",
        "screen",
        found,
        summary,
        verbose,
        table("directions", knowledge=knowledge, tried=False) if knowledge.directions else None,
        None if found.part is None else table("part", whole=found, part=found.part),
        files,
    )


def posterior_lines(
    found: PosteriorSummary, files: Sequence[Path] = (), *, again: str = "", verbose: bool = False
) -> list[str]:
    """What `fmu-fit posterior` prints: values with intervals, and how to continue.

    Args:
        found: the draws, summarised.
        files: that were written, the report last.
        again: the command that continues; empty where there are enough draws.
        verbose: whether convergence, outputs and minima are printed.
    """
    short, tables = tables_of(found, short=True)[0], tables_of(found)
    return printed_lines("posterior", "screen", found, short, tables, verbose, again, files)


def ensemble_lines(
    found: Ensemble, files: Sequence[Path] = (), *, resumed: int = 0, again: str = ""
) -> list[str]:
    """What `fmu-fit ensemble` prints: coverage where the truth is known, else values.

    Args:
        found: many fits.
        files: that were written, the report last.
        resumed: items that an earlier run had finished.
        again: the command that continues; empty where all items have ended.
    """
    first = table("coverage" if found.coverage else "fitted", ensemble=found)
    return printed_lines("ensemble", "screen", found, first, resumed, again, files)


def tradeoff_lines(study: Study, files: Sequence[Path] = ()) -> list[str]:
    """What `fmu-fit tradeoff` prints: for each accuracy the cheapest settings, and the plan's.

    Args:
        study: errors and costs of every setting.
        files: that were written.
    """
    return printed_lines("tradeoff", "screen", study, choice_tables(study), files)
