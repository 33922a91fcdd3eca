"""The next measurement: what would make a value better known, within an instrument's limits."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fitting import Problem
from fitting.design import FILES, WAYS_FILES
from fitting.design.campaign import CAMPAIGN_NAME, campaign_files
from fitting.design.limits import (
    MOST_NUMBER,
    DesignTable,
    Limits,
    check_names,
    limits_of,
    read_candidates,
    read_design_table,
    refuse_wider,
)
from fitting.design.proposal import proposed
from fitting.design.result import Design, Proposal, Ways, design_csv, write_design
from fitting.design.ways import TOGETHER, Choice, alone, in_order, together, way_of
from fitting.design.weighing import DesignGoal, weigh
from fitting.extension.problem import (
    Result,
    Valued,
    check_problem,
    one_thread,
    read_result,
    require_same_data,
)
from fitting.extension.records import BoundCampaign, bind
from fitting.extension.report import phrases
from fitting.text.arguments import checked
from fitting.text.choices import CRITERIA
from fitting.text.errors import BadInput
from fitting.text.files import write_all, write_whole
from fitting.text.results_folder import remove_earlier, results_folder

__all__ = ["Goal", "Limits", "NextMeasurements", "WaysToMeasure", "design", "limits", "ways"]

CAMPAIGN_FOLDER, TABLE_NAME = "campaign", "design.csv"


@checked
@dataclass(frozen=True)
class Goal:
    """What the next measurements are for.

    Args:
        target: A parameter or derived output; empty: as the campaign states, else its first output.
        criterion: "target": error of the target; "D" or "A" of all parameters; empty: as the
            campaign states, else the target's.
        number: Measurements at most, 1 to 50; None: as the limits state.
        seed: Of points of equal fit, at least 0.
        time_s: What the measurements may take of the laboratory together, s; None: as the limits
            state.

    Raises:
        BadInput: a criterion, number, seed or time that there is not.
    """

    target: str = ""
    criterion: str = ""
    number: int | None = None
    seed: int = 1
    time_s: float | None = None

    def __post_init__(self) -> None:
        if self.criterion and self.criterion not in CRITERIA:
            raise BadInput(
                f"goal: criterion {self.criterion!r}, wanted one of {', '.join(CRITERIA)}"
            )
        if self.seed < 0:
            raise BadInput(f"goal: seed {self.seed}, wanted at least 0")
        if self.time_s is not None and not 0.0 < self.time_s < math.inf:
            raise BadInput(f"goal: time_s {self.time_s}, wanted a positive number of seconds")


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

    def made_by(self, command: str) -> NextMeasurements:
        """The same, with a command line for the record.

        Args:
            command: that made it.
        """
        provenance = {**self.design.provenance, "command": command}
        return replace(self, design=replace(self.design, provenance=provenance))

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
        campaign, bound = folder / CAMPAIGN_FOLDER, _bound(self.problem)[0]
        variables, command = self.problem.fmu.variables, design.provenance["command"]
        files = campaign_files(design, bound, variables, self.limits, campaign, command)
        with results_folder(folder, "design", FILES):
            written = [write_design(design, folder), folder / TABLE_NAME, campaign / CAMPAIGN_NAME]
            write_whole(folder / TABLE_NAME, design_csv(design))
            write_all(campaign, files)
            if report:
                # matplotlib takes a second to import: only where something is drawn
                figure = importlib.import_module("fitting.design.figure")
                page = importlib.import_module("fitting.design.report")
                figures = figure.save_figures(design, folder / "figures")
                written.append(page.write_report(design, figures, folder))
            remove_earlier(folder, FILES)
        return written


@dataclass(frozen=True)
class WaysToMeasure:
    """Ways to spend the same time: the table ``ways``, and what to measure ``by_name``.

    Each has what is to be measured of every kind, by the name of the kind: one, of the mixture
    "together" several.
    """

    ways: Ways
    by_name: Mapping[str, Mapping[str, NextMeasurements]]

    def made_by(self, command: str) -> WaysToMeasure:
        """The same, with a command line for the record.

        Args:
            command: that made it.
        """
        provenance = {**self.ways.provenance, "command": command}
        named = {
            name: {kind: each.made_by(command) for kind, each in kinds.items()}
            for name, kinds in self.by_name.items()
        }
        return WaysToMeasure(replace(self.ways, provenance=provenance), named)

    def write(self, out: str | Path, *, report: bool = True) -> list[Path]:
        """Write a folder for each way and kind, and the table of the ways.

        Args:
            out: Folder, made where there is none.
            report: Draw figures and report.html of each, too.

        Returns:
            The path of ways.json, then the campaigns of the best way.

        Raises:
            BadInput: a folder cannot be written, or holds files of these names that no design
                wrote, or that were filled in since.
        """
        folder, campaigns = Path(out), []
        for name, kinds in self.by_name.items():
            for kind, each in kinds.items():
                own = folder / name / kind if len(kinds) > 1 else folder / name
                written = each.write(own, report=report)
                campaigns += [written[2]] * (name == self.ways.best.name)
        with results_folder(folder, "design", WAYS_FILES):
            return [write_design(self.ways, folder), *campaigns]


def limits(problem: Problem, candidates: str | Path | None = None) -> Limits:
    """What the instrument can do: as the campaign's table [design] states, else as it kept to.

    ``dataclasses.replace`` of what it returns gives other limits to `design`.

    Args:
        problem: Of campaigns; the first is to be continued.
        candidates: A TOML file with a table [design], whose keys go before the campaign's; None:
            the campaign's alone.

    Raises:
        BadInput: no campaign, something wrong with a table, or limits in the file that are wider
            than the campaign's own.
    """
    return _limits(problem, _bound(problem)[0], candidates)[0]


@one_thread()
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
            fit of another problem or of other data.
        FmuFailure: the FMU failed.
    """
    wanted = Goal(goal) if isinstance(goal, str) else goal
    bound, *also = _bound(problem)
    instrument, target = _request(problem, bound, wanted, limits, at)
    [weighed] = weigh(bound, problem.fmu.workers, [instrument], target, progress, also)
    unit, provenance = _unit(problem, bound, target.target), _provenance(problem, wanted, "design")
    chosen = weighed.chosen_by(target.criterion)
    made = proposed(bound, weighed, chosen, target, unit, provenance)
    return NextMeasurements(made, problem, instrument)


@one_thread()
def ways(
    problem: Problem,
    goal: Goal | str = "",
    *,
    limits: Mapping[str, Limits | str | Path],
    at: Valued | Result | str | Path | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> WaysToMeasure:
    """Which kind of measurement determines a value best in the same time of the laboratory.

    Args:
        problem: Of campaigns; the first is to be continued, the others count as measured.
        goal: What is to be known, and the time, if the limits do not state it.
        limits: Of each kind of measurement by its name, two at least, as `design` takes them.
        at: A fit to set out from, or its result.json; None: the fit nearest to the references.
        progress: Is called with a line of what is under way.

    Returns:
        The ways, the one with the least expected error first, and what to measure in each.

    Raises:
        BadInput: see `design`; fewer than two kinds, no time or several of them.
        FmuFailure: the FMU failed.
    """
    wanted = Goal(goal) if isinstance(goal, str) else goal
    bound, *also = _bound(problem)
    if len(limits) < 2 or TOGETHER in limits:
        raise BadInput(
            f"ways: found {', '.join(limits) or 'none'}, wanted two kinds of measurement at least, "
            f"none of them called '{TOGETHER}'"
        )
    kinds = {name: _request(problem, bound, wanted, one, at) for name, one in limits.items()}
    time_s, target = _same(kinds)
    progress("ways")
    every = [instrument for instrument, _ in kinds.values()]
    weighed = weigh(bound, problem.fmu.workers, every, target, progress, also)
    progress("choosing")
    criterion = target.criterion
    single = {name: alone(name, w, criterion) for name, w in zip(kinds, weighed, strict=True)}
    chosen: dict[str, dict[str, Choice]] = {name: {name: c} for name, c in single.items()}
    mixture = together(list(single.values()), criterion)
    if mixture is not None:
        chosen[TOGETHER] = dict(zip(kinds, mixture, strict=True))
    unit, provenance = _unit(problem, bound, target.target), _provenance(problem, wanted, "ways")
    by_name = {
        name: {
            kind: NextMeasurements(
                proposed(bound, choice.weighed, choice.chosen, target, unit, provenance),
                problem,
                choice.weighed.limits,
            )
            for kind, choice in choices.items()
            if choice.chosen
        }
        for name, choices in chosen.items()
    }
    instruments = dict(zip(kinds, every, strict=True))
    table = Ways(
        title=bound.title,
        synthetic=bound.synthetic,
        target=target.target,
        unit=unit,
        criterion=criterion,
        time_s=time_s,
        before=weighed[0].expected([]),
        ways=in_order([way_of(name, each) for name, each in chosen.items()]),
        sentences=phrases("design/text", "times", instruments, mixture is not None),
        provenance=provenance,
    )
    return WaysToMeasure(table, by_name)


def _bound(problem: Problem) -> list[BoundCampaign]:
    check_problem("design", problem)
    if not problem.campaigns:
        raise BadInput("design: wanted a problem made of a campaign, Problem.of(...)")
    return [bind(campaign, problem.fmu.variables) for campaign in problem.campaigns]


def _limits(
    problem: Problem, bound: BoundCampaign, given: Limits | str | Path | None
) -> tuple[Limits, DesignTable]:
    """The limits, no wider than the campaign's own, and the table that states the rest."""
    own, drive = read_design_table(bound.path), problem.campaigns[0].file.drive
    lines, unit = () if drive is None else drive.lines, bound.amplitude_unit
    variables = problem.fmu.variables
    if isinstance(given, Limits):
        check_names(given, variables, bound.setup.laws.controls)
        if own.written or (given.sweeps is None and given.traces is None):
            known = limits_of(bound, variables, own, lines)
            refuse_wider(given, known, own, lambda key: f"limits: {key}", unit)
        return given, own
    if given is None:
        return limits_of(bound, variables, own, lines), own
    table = own.with_keys_of(read_candidates(Path(given)))
    instrument = limits_of(bound, variables, table, lines)
    known = limits_of(bound, variables, own.of_kind(table), lines)
    refuse_wider(instrument, known, own, table.where, unit)
    return instrument, table


def _request(
    problem: Problem,
    bound: BoundCampaign,
    goal: Goal,
    given: Limits | str | Path | None,
    at: Valued | Result | str | Path | None,
) -> tuple[Limits, DesignGoal]:
    """Limits, target and criterion: as requested, else as the campaign has them.

    Raises:
        BadInput: limits that mean nothing, a fit of another campaign or of other data.
    """
    instrument, table = _limits(problem, bound, given)
    if goal.time_s is not None:
        number = instrument.number if table.keys.number is not None else MOST_NUMBER
        instrument = replace(instrument, time_s=goal.time_s, number=number)
    if goal.number is not None:
        instrument = replace(instrument, number=goal.number)
    names = [*bound.derived, *(parameter.name for parameter in bound.parameters)]
    target = DesignGoal(
        target=goal.target or table.keys.target or names[0],
        criterion=goal.criterion or table.keys.criterion or CRITERIA[0],
        seed=goal.seed,
    )
    if at is None:
        return instrument, target
    where = str(at) if isinstance(at, str | Path) else "at"
    fitted = read_result(Path(at)) if isinstance(at, str | Path) else at
    result = fitted.result if isinstance(fitted, Valued) else fitted
    require_same_data(result, [bound])
    values, start = {name: e.value for name, e in result.parameters.items()}, []
    for parameter in bound.parameters:
        if parameter.name not in values and not parameter.experiments:
            raise BadInput(
                f"{where}: has no parameter '{parameter.name}'; wanted a result of {bound.path}"
            )
        start.append(values.get(parameter.name, parameter.reference))
    for alternative in bound.alternatives:
        if dict(alternative) == dict(result.alternative):
            return instrument, replace(target, start=(alternative, np.array(start)))
    raise BadInput(
        f"{where}: alternative {dict(result.alternative)} is none of those of {bound.path}; wanted "
        "a result of that campaign"
    )


def _same(kinds: Mapping[str, tuple[Limits, DesignGoal]]) -> tuple[float, DesignGoal]:
    """The time and the goal, which are the same for all kinds.

    Raises:
        BadInput: they are not.
    """
    (instrument, goal), *_ = kinds.values()
    for name, (_, other) in kinds.items():
        if (other.target, other.criterion) != (goal.target, goal.criterion):
            raise BadInput(
                f"ways: {name} is for {other.target} by {other.criterion}, another for "
                f"{goal.target} by {goal.criterion}; wanted one target and criterion"
            )
    time_s = instrument.time_s
    if time_s is None or any(other.time_s != time_s for other, _ in kinds.values()):
        raise BadInput(
            "ways: wanted the time that all kinds have, --time or one [design] time for all"
        )
    return time_s, goal


def _unit(problem: Problem, bound: BoundCampaign, target: str) -> str:
    own = {p.name: p for p in bound.parameters}.get(target)
    name = target if own is None or own.adds_to else own.target
    variable = problem.fmu.description.variables.get(name)
    if variable is not None:
        return variable.unit or ""
    return "" if own is None else own.unit  # a coefficient of laws is no variable of the FMU


def _provenance(problem: Problem, goal: Goal, function: str) -> dict[str, str]:
    description = problem.fmu.description
    return {
        "command": f"fitting.{function}",
        "FMU": description.model_name,
        "FMU sha256": description.sha256,
        "seed": str(goal.seed),
    }
