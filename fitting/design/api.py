"""The next measurement: what would make a value better known, within an instrument's limits."""

from __future__ import annotations

import importlib
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
from fitting.design.proposal import proposed, write_report
from fitting.design.result import Design, Proposal, Ways, design_csv, write_design
from fitting.design.ways import TOGETHER, alone, in_order, together, way_of
from fitting.design.weighing import Goal, Start, Weighed, weigh
from fitting.extension.problem import (
    Result,
    Valued,
    one_thread,
    read_result,
    require_same_data,
)
from fitting.extension.records import BoundCampaign, bind
from fitting.extension.report import phrases
from fitting.text.arguments import checked
from fitting.text.choices import CRITERIA
from fitting.text.errors import BadInput
from fitting.text.results_folder import remove_earlier, results_folder, write_all, write_whole

__all__ = ["Goal", "Limits", "NextMeasurements", "WaysToMeasure", "design", "limits", "ways"]

CAMPAIGN_FOLDER, TABLE_NAME = "campaign", "design.csv"


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
                figures = figure.save_figures(design, folder / "figures")
                written.append(write_report(design, figures, folder))
            remove_earlier(folder, FILES)
        return written


@dataclass(frozen=True)
class WaysToMeasure:
    """Ways to use the same time: the table ``ways``, and measurements ``by_name``.

    Each has its measurements by kind, the mixture "together" of several kinds.
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


@checked
def limits(problem: Problem, candidates: str | Path | None = None) -> Limits:
    """Limits of the instrument: by the campaign's table [design], else by its measurements.

    Args:
        problem: Of campaigns; the first is to be continued, others count as measured.
        candidates: A TOML file with a table [design], whose keys replace the campaign's; None: the
            campaign's.

    Raises:
        BadInput: no campaign, something wrong with a table, or limits in the file that are wider
            than the campaign's own.
    """
    return _limits(problem, _bound(problem)[0], candidates)[0]


@checked
@one_thread()
def design(
    problem: Problem,
    goal: Goal | str = "",
    *,
    limits: Limits | str | Path | None = None,
    at: Valued | Result | str | Path | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> NextMeasurements:
    """Which measurements next for a better known value, with the expected errors.

    Args:
        problem: Of campaigns; the first is to be continued, others count as measured.
        goal: A parameter or derived output, or a `Goal`.
        limits: `Limits`, or a TOML file with a table [design]; None: the campaign's. Not wider than
            the campaign's.
        at: A fit to start from, or its result.json; None: the fit nearest to the references.
        progress: Called with a line at every step.

    Returns:
        ``proposals`` in order, each with the expected error.

    Raises:
        BadInput: no campaign, limits that are wider than the campaign's own or mean nothing, a fit
            of another problem or of other data.
        FmuFailure: the FMU failed.
    """
    bounds = _bound(problem)
    instrument, wanted = _request(problem, bounds[0], goal, limits)
    start = _start(bounds[0], at)
    [weighed] = weigh(bounds, problem.fmu.workers, [instrument], wanted, start, progress)
    made = proposed(
        bounds[0],
        weighed.choosing(wanted.criterion),
        wanted,
        _unit(problem, bounds[0], wanted.target),
        _provenance(problem, wanted, "design"),
        is_given=start is not None,
    )
    return NextMeasurements(made, problem, instrument)


@checked
@one_thread()
def ways(
    problem: Problem,
    goal: Goal | str = "",
    *,
    limits: Mapping[str, Limits | str | Path],
    at: Valued | Result | str | Path | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> WaysToMeasure:
    """Which kind of measurement determines a value best in the same time.

    Args:
        problem: Of campaigns; the first is to be continued, others count as measured.
        goal: A parameter or derived output, or a `Goal`, with the time if the limits do not state
            it.
        limits: Of two or more kinds of measurement by name, as of `design`.
        at: A fit to start from, or its result.json; None: the fit nearest to the references.
        progress: Called with a line at every step.

    Returns:
        The ways, that of the least expected error first, with their measurements.

    Raises:
        BadInput: see `design`; fewer than two kinds, no time or several of them.
        FmuFailure: the FMU failed.
    """
    bounds = _bound(problem)
    if len(limits) < 2 or TOGETHER in limits:
        raise BadInput(
            f"ways: found {', '.join(limits) or 'none'}, wanted two kinds of measurement at least, "
            f"none of them called '{TOGETHER}'"
        )
    # the time, the target and the criterion are the same for all kinds
    kinds = {name: _request(problem, bounds[0], goal, one) for name, one in limits.items()}
    (first, wanted), *_ = kinds.values()
    for name, (_, other) in kinds.items():
        if (other.target, other.criterion) != (wanted.target, wanted.criterion):
            raise BadInput(
                f"ways: {name} is for {other.target} by {other.criterion}, another for "
                f"{wanted.target} by {wanted.criterion}; wanted one target and criterion"
            )
    instruments, time_s = {name: each for name, (each, _) in kinds.items()}, first.time_s
    if time_s is None or any(each.time_s != time_s for each in instruments.values()):
        raise BadInput(
            "ways: wanted the time that all kinds have, --time or one [design] time for all"
        )
    start, criterion = _start(bounds[0], at), wanted.criterion
    progress("ways")
    every = list(instruments.values())
    weighed = weigh(bounds, problem.fmu.workers, every, wanted, start, progress)
    progress("choosing")
    single = {name: alone(name, w, criterion) for name, w in zip(kinds, weighed, strict=True)}
    chosen = {name: {name: each} for name, each in single.items()}
    mixture = together(list(single.values()), criterion)
    if mixture is not None:
        chosen[TOGETHER] = dict(zip(kinds, mixture, strict=True))
    unit, provenance = (
        _unit(problem, bounds[0], wanted.target),
        _provenance(problem, wanted, "ways"),
    )

    def measurements(each: Weighed) -> NextMeasurements:
        is_given = start is not None
        made = proposed(bounds[0], each, wanted, unit, provenance, is_given=is_given)
        return NextMeasurements(made, problem, each.limits)

    table = Ways(
        title=bounds[0].title,
        synthetic=bounds[0].synthetic,
        target=wanted.target,
        unit=unit,
        criterion=criterion,
        time_s=time_s,
        before=weighed[0].expected([]),
        ways=in_order([way_of(name, each) for name, each in chosen.items()]),
        sentences=phrases("design/text", "times", instruments, mixture is not None),
        provenance=provenance,
    )
    by_name = {
        name: {kind: measurements(each) for kind, each in choices.items() if each.chosen}
        for name, choices in chosen.items()
    }
    return WaysToMeasure(table, by_name)


def _bound(problem: Problem) -> list[BoundCampaign]:
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
    problem: Problem, bound: BoundCampaign, goal: Goal | str, given: Limits | str | Path | None
) -> tuple[Limits, Goal]:
    """Limits and goal: as requested, else as the campaign has them; BadInput: they mean nothing."""
    goal = Goal(goal) if isinstance(goal, str) else goal
    instrument, table = _limits(problem, bound, given)
    if goal.time_s is not None:
        number = instrument.number if table.keys.number is not None else MOST_NUMBER
        instrument = replace(instrument, time_s=goal.time_s, number=number)
    if goal.number is not None:
        instrument = replace(instrument, number=goal.number)
    names = [*bound.derived, *(parameter.name for parameter in bound.parameters)]
    target = goal.target or table.keys.target or names[0]
    criterion = goal.criterion or table.keys.criterion or CRITERIA[0]
    return instrument, replace(goal, target=target, criterion=criterion)


def _start(bound: BoundCampaign, at: Valued | Result | str | Path | None) -> Start | None:
    """Where a fit ended: its alternative and its parameters; None without a fit.

    Raises:
        BadInput: a fit of another campaign or of other data.
    """
    if at is None:
        return None
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
            return alternative, np.array(start)
    raise BadInput(
        f"{where}: alternative {dict(result.alternative)} is none of those of {bound.path}; wanted "
        "a result of that campaign"
    )


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
