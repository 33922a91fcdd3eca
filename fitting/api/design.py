"""The next measurement: what would make a value better known, within an instrument's limits."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from fitting.api.choices import CRITERIA
from fitting.api.fitted import Valued
from fitting.api.jobs import check_problem
from fitting.api.problem import Problem
from fitting.api.written import DESIGN_FILES
from fitting.campaign import BoundCampaign, bind
from fitting.design.campaign import CAMPAIGN_NAME, campaign_files
from fitting.design.candidates import Limits
from fitting.design.goal import goal_of, start_of, variable_of
from fitting.design.limits import (
    DesignTable,
    check_names,
    limits_of,
    read_candidates,
    read_design_table,
    refuse_wider,
)
from fitting.design.proposal import propose
from fitting.design.result import Design, Proposal, design_csv, write_design
from fitting.design.weighing import DesignGoal, weigh
from fitting.result.result import Result, read_result
from fitting.text.errors import BadInput
from fitting.text.files import write_all, write_whole
from fitting.text.results_folder import remove_earlier, results_folder

__all__ = ["Goal", "Limits", "NextMeasurements", "design", "limits"]

CAMPAIGN_FOLDER, TABLE_NAME = "campaign", "design.csv"


@dataclass(frozen=True)
class Goal:
    """What the next measurements are for.

    Args:
        target: A parameter or derived output; empty: as the campaign says, else its first output.
        criterion: "target": error of the target; "D" or "A" of all parameters; empty: as the
            campaign says, else the target's.
        number: Measurements at most, 1 to 50; None: as the limits say.
        seed: Of points of equal fit, at least 0.

    Raises:
        BadInput: a criterion, number or seed that there is not.
    """

    target: str = ""
    criterion: str = ""
    number: int | None = None
    seed: int = 1

    def __post_init__(self) -> None:
        if self.criterion and self.criterion not in CRITERIA:
            raise BadInput(
                f"goal: criterion {self.criterion!r}, wanted one of {', '.join(CRITERIA)}"
            )
        if self.seed < 0:
            raise BadInput(f"goal: seed {self.seed}, wanted at least 0")


@dataclass(frozen=True)
class NextMeasurements:
    """What to measure next: the `design`, and the problem and limits that it was made for."""

    design: Design
    problem: Problem
    limits: Limits

    @property
    def proposals(self) -> tuple[Proposal, ...]:
        """The measurements in their order, each with the error that is expected then."""
        return self.design.proposals

    def write(self, out: str | Path, *, report: bool = True) -> list[Path]:
        """Write what the command line writes: the campaign to be filled in first, figures last.

        Args:
            out: Folder, made where there is none.
            report: Draw figures and report.html, too.

        Returns:
            The paths of design.json, design.csv, the campaign, and of report.html.

        Raises:
            BadInput: the folder cannot be written, or holds files of these names that no design
                wrote, or that were filled in since.
        """
        folder, design = Path(out), self.design
        campaign = folder / CAMPAIGN_FOLDER
        command = design.provenance["command"]
        bound = _bound(self.problem)[0]
        files = campaign_files(design, bound, self.limits, campaign, command)
        with results_folder(folder, "design", DESIGN_FILES):
            written = [write_design(design, folder), folder / TABLE_NAME, campaign / CAMPAIGN_NAME]
            write_whole(folder / TABLE_NAME, design_csv(design))
            write_all(campaign, files)
            if report:
                # matplotlib takes a second to import: only where something is drawn
                drawn = importlib.import_module("fitting.report.figures.design")
                page = importlib.import_module("fitting.report.design")
                figures = drawn.save_figures(design, folder / "figures")
                written.append(page.write_report(design, figures, folder))
            remove_earlier(folder, DESIGN_FILES)
        return written


def limits(problem: Problem, candidates: str | Path | None = None) -> Limits:
    """What the instrument can do: as the campaign's table [design] says, else as it kept to.

    ``dataclasses.replace`` of what it returns gives other limits to `design`.

    Args:
        problem: Of campaigns; the first is to be continued.
        candidates: A TOML file with a table [design], whose keys go before the campaign's; None:
            the campaign's alone.

    Raises:
        BadInput: no campaign, something wrong with a table, or limits in the file that are wider
            than the campaign's own.
    """
    bound = _bound(problem)[0]
    own = read_design_table(bound.path)
    if candidates is None:
        return _limits(problem, bound, own)
    table = own.with_keys_of(read_candidates(Path(candidates)))
    found = _limits(problem, bound, table)
    kept = own.beside(table)
    refuse_wider(found, _limits(problem, bound, kept), own, table.where, bound.amplitude_unit)
    return found


def design(
    problem: Problem,
    goal: Goal | str = "",
    *,
    limits: Limits | str | Path | None = None,
    at: Valued | Result | str | Path | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> NextMeasurements:
    """Which measurements next, to know a value better, and how well it would then be known.

    Args:
        problem: Of campaigns; the first is to be continued, the others count as measured.
        goal: What is to be known: a parameter or derived output, or a `Goal`.
        limits: Of the instrument: a record as `fitting.limits` gives it, or a TOML file with a
            table [design]; None: those of the campaign. No wider than the campaign's [design].
        at: A fit to set out from, or its result.json; None: the fit nearest to the references.
        progress: Is called with a line of what is under way.

    Returns:
        ``proposals`` in their order, each with the error that is expected then.

    Raises:
        BadInput: no campaign, limits that are wider than the campaign's own or mean nothing, a
            fit of another problem.
        FmuFailure: the FMU failed.
    """
    asked = Goal(goal) if isinstance(goal, str) else goal
    bound, *also = _bound(problem)
    kept, table = _kept(problem, bound, limits)
    if asked.number is not None:
        kept = replace(kept, number=asked.number)
    wanted = replace(goal_of(bound, table.keys, asked.target, asked.criterion), seed=asked.seed)
    wanted = _set_out(wanted, bound, at)
    description = problem.fmu.description
    weighed = weigh(bound, problem.fmu.workers, kept, wanted, progress, also)
    provenance = {
        "command": "fitting.design",
        "FMU": description.model_name,
        "FMU sha256": description.sha256,
        "seed": str(asked.seed),
    }
    # a coefficient of laws is no variable of the FMU
    variable = description.variables.get(variable_of(bound, wanted.target))
    own = {p.name: p.unit for p in bound.parameters}
    unit = own.get(wanted.target, "") if variable is None else variable.unit or ""
    found = propose(bound, weighed, kept, wanted, unit, provenance)
    return NextMeasurements(found, problem, kept)


def _bound(problem: Problem) -> list[BoundCampaign]:
    check_problem("design", problem)
    if not problem.campaigns:
        raise BadInput("design: wanted a problem made of a campaign, Problem.of(...)")
    return [bind(campaign, problem.fmu.variables) for campaign in problem.campaigns]


def _limits(problem: Problem, bound: BoundCampaign, table: DesignTable) -> Limits:
    lines = problem.campaigns[0].file.driven.lines
    return limits_of(bound, problem.fmu.variables, table, lines)


def _kept(
    problem: Problem, bound: BoundCampaign, given: Limits | str | Path | None
) -> tuple[Limits, DesignTable]:
    """The limits, and the table that says what else is asked."""
    own = read_design_table(bound.path)
    if isinstance(given, Limits):
        check_names(given, problem.fmu.variables, bound.setup.laws.controls)
        if own.said or given.sweeps is None:
            known = _limits(problem, bound, own)
            refuse_wider(given, known, own, lambda key: f"limits: {key}", bound.amplitude_unit)
        return given, own
    table = own if given is None else own.with_keys_of(read_candidates(Path(given)))
    return limits(problem, given), table


def _set_out(
    goal: DesignGoal, bound: BoundCampaign, at: Valued | Result | str | Path | None
) -> DesignGoal:
    if at is None:
        return goal
    where = str(at) if isinstance(at, str | Path) else "at"
    fitted = read_result(Path(at)) if isinstance(at, str | Path) else at
    result = fitted.result if isinstance(fitted, Valued) else fitted
    return replace(goal, start=start_of(result, bound, where))
