"""The next measurement: what would make a value better known, within an instrument's limits."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

import fitting as ff
from fitting import Problem
from fitting.design import FILES
from fitting.design.campaign import CAMPAIGN_NAME, campaign_files
from fitting.design.information import DataSoFar, Place
from fitting.design.limits import (
    MOST_NUMBER,
    DesignTable,
    Limits,
    check_names,
    limits_of,
    read_candidates,
    read_design_table,
    refuse_wider,
    unit_of,
)
from fitting.design.result import (
    Design,
    DriveChoice,
    Kind,
    PlacePoint,
    Proposal,
    write_design,
)
from fitting.design.weighing import Goal, Weighed, expected_of, known_of, weigh
from fitting.extension.problem import (
    Result,
    Valued,
    canonical,
    one_thread,
    read_result,
    require_same_data,
)
from fitting.extension.records import BoundCampaign
from fitting.extension.report import (
    Table,
    csv_text,
    phrase,
    phrases,
    printed_lines,
    table,
    write_page,
)
from fitting.text.arguments import checked
from fitting.text.choices import CRITERIA
from fitting.text.errors import BadInput
from fitting.text.results_folder import remove_earlier, results_folder, write_all, write_whole

__all__ = ["Goal", "Limits", "NextMeasurements", "design", "limits"]

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
        campaign, variables = folder / CAMPAIGN_FOLDER, self.problem.fmu.variables
        files = campaign_files(design, _bound(self.problem), variables, self.limits, campaign)
        with results_folder(folder, "design", FILES):
            written = [write_design(design, folder), folder / TABLE_NAME, campaign / CAMPAIGN_NAME]
            write_whole(folder / TABLE_NAME, csv_text(table("design/csv", design=design)))
            write_all(campaign, files)
            if report:
                # matplotlib takes a second to import: only where something is drawn
                figure = importlib.import_module("fitting.design.figure")
                page = write_page(
                    folder,
                    "design/page.html.j2",
                    title=f"Next measurement: {design.title}",
                    kind="next measurement",
                    status=f"{len(design.proposals)} measurements proposed",
                    message=phrase("design/text", "promise", design),
                    synthetic=design.synthetic,
                    figures=figure.save_figures(design, folder / "figures"),
                    design=design,
                )
                written.append(page)
            remove_earlier(folder, FILES)
        return written


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
    return _limits(problem, _bound(problem), candidates)[0]


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
    bound = _bound(problem)
    instrument, stated = _limits(problem, bound, limits)
    goal = Goal(goal) if isinstance(goal, str) else goal
    if goal.time_s is not None:
        number = instrument.number if stated.keys.number is not None else MOST_NUMBER
        instrument = replace(instrument, time_s=goal.time_s, number=number)
    if goal.number is not None:
        instrument = replace(instrument, number=goal.number)
    names = [*bound.derived, *(parameter.name for parameter in problem.record.parameters)]
    target = goal.target or stated.keys.target or names[0]
    criterion = goal.criterion or stated.keys.criterion or CRITERIA[0]
    goal = replace(goal, target=target, criterion=criterion)

    def search() -> Place:
        best = ff.fit(problem, ff.Tikhonov(quick=True), starts=1, seed=goal.seed).record
        return Place(best.alternative, best.x)

    start = _start(problem, bound, at)
    data = DataSoFar(problem.record, problem.planned, problem.objective.steps)
    known = known_of(data, goal, start, search, progress)
    progress("candidates")
    weighed = weigh(known, instrument).choosing()
    description, own = problem.fmu.description, dict(zip(names, names, strict=True))
    own |= {p.name: p.target for p in problem.record.parameters if not p.adds_to}
    variable = description.variables.get(own[target])
    units = {p.name: p.unit for p in problem.record.parameters}  # of coefficients of laws
    unit = units.get(target, "") if variable is None else variable.unit or ""
    provenance = {
        "command": "fitting.design",
        "FMU": description.model_name,
        "FMU sha256": description.sha256,
        "seed": str(goal.seed),
    }
    return NextMeasurements(proposed(weighed, unit, provenance), problem, instrument)


def _bound(problem: Problem) -> BoundCampaign:
    """The campaign that is to be continued."""
    if not problem.campaigns:
        raise BadInput("design: wanted a problem made of a campaign, Problem.of(...)")
    return next(iter(problem.record.campaigns.values()))


def _limits(
    problem: Problem, bound: BoundCampaign, given: Limits | str | Path | None
) -> tuple[Limits, DesignTable]:
    """The limits, no wider than the campaign's own, and the table that states the rest."""
    own, drive = read_design_table(bound.path), problem.campaigns[0].file.drive
    lines, variables = () if drive is None else drive.lines, problem.fmu.variables
    if isinstance(given, Limits):
        check_names(given, variables, bound.setup.laws.controls)
        refuse_wider(given, own, "limits: {}".format, unit_of(bound, given))
        return given, own
    table = own if given is None else own.with_keys_of(read_candidates(Path(given)))
    instrument = limits_of(bound, variables, table, lines)
    refuse_wider(instrument, own, table.where, unit_of(bound, instrument))
    return instrument, table


def _start(
    problem: Problem, bound: BoundCampaign, at: Valued | Result | str | Path | None
) -> Place | None:
    """Where a fit ended; None without a fit.

    Raises:
        BadInput: a fit of another campaign or of other data.
    """
    if at is None:
        return None
    where = str(at) if isinstance(at, str | Path) else "at"
    fitted = read_result(Path(at)) if isinstance(at, str | Path) else at
    result = fitted.result if isinstance(fitted, Valued) else fitted
    require_same_data(result, [bound])
    values, parameters = result.fitted_values, problem.record.parameters
    for parameter in parameters:
        if parameter.name not in values and not parameter.experiments:
            raise BadInput(
                f"{where}: has no parameter '{parameter.name}'; wanted a result of {bound.path}"
            )
    start = [values.get(parameter.name, parameter.reference) for parameter in parameters]
    for alternative in bound.alternatives:
        if dict(alternative) == dict(result.alternative):
            return Place(alternative, problem.to_search(start))
    raise BadInput(
        f"{where}: alternative {dict(result.alternative)} is none of those of {bound.path}; wanted "
        "a result of that campaign"
    )


# --- the proposal -------------------------------------------------------------------------------


def proposed(weighed: Weighed, unit: str, provenance: Mapping[str, str]) -> Design:
    """The design of chosen candidates.

    Args:
        weighed: the candidates, with those that are chosen.
        unit: of the target.
        provenance: what it was made from and with.
    """
    known, limits, chosen = weighed.known, weighed.limits, weighed.chosen
    bound, goal, parameters = known.data.bound, known.goal, known.data.parameters
    values = known.spread_values[np.isfinite(known.spread_values)]
    amplitude_unit = unit_of(bound, limits)
    lines = phrases("design/text", "limits", limits, amplitude_unit, np.nan)
    proposals = []
    for rank, k in enumerate(chosen, 1):
        candidate = weighed.candidates[k]
        proposals.append(
            Proposal(
                rank=rank,
                repeats=candidate.repeats,
                peaks_v=tuple(map(float, candidate.peaks)),
                sigmas_v=tuple(map(float, candidate.sigmas)),
                expected=weighed.expected(chosen[:rank]),
                **{f.name: getattr(candidate.choice, f.name) for f in fields(DriveChoice)},
            )
        )
    along = np.array([weighed.sigmas(chosen[:rank]) for rank in range(len(chosen) + 1)])
    places = []
    ps = known.data.table([place.x for place in known.places])
    for place, p, value, sigmas in zip(known.places, ps, known.values, along.T, strict=True):
        in_period = map(float, canonical(parameters, p))
        places.append(
            PlacePoint(
                alternative=dict(place.alternative),
                parameters=dict(zip([q.name for q in parameters], in_period, strict=True)),
                target=float(value),
                sigmas=tuple(map(float, sigmas)),
            )
        )
    made = Design(
        title=bound.title,
        synthetic=bound.synthetic,
        campaign=str(bound.path),
        target=goal.target,
        unit=unit,
        amplitude_unit=amplitude_unit,
        criterion=goal.criterion,
        before=weighed.expected([]),
        spread=known.spread,
        span=(float(np.min(values)), float(np.max(values))) if values.size else (np.nan, np.nan),
        proposals=tuple(proposals),
        kinds=_kinds(weighed),
        places=tuple(places),
        equal_fits=int(known.spread_values.size),
        valueless=int(known.spread_values.size - values.size),
        setups=weighed.setups,
        candidates=len(weighed.candidates),
        sentences=(),
        limits=dict(line.split(" ¦ ") for line in lines),
        provenance=dict(provenance),
    )
    usual = float(np.nanmedian(along[0] / along[-1]))
    sentences = phrases("design/text", "assumptions", made, weighed, usual, bound.drift.units)
    return replace(made, sentences=sentences)


def _kinds(weighed: Weighed) -> tuple[Kind, ...]:
    """Candidates by output, resonance and level, sweeps by controls, alone and with the rest.

    The rest are the proposed ones but the last.
    """
    chosen, groups = weighed.chosen, dict[tuple[Any, ...], list[int]]()
    alone, last = (
        np.array([expected_of(sigmas).mean for sigmas in weighed.sigmas(so_far, and_each=True)])
        for so_far in ((), chosen[:-1])
    )
    if weighed.problem.once:  # a proposed one is the last of all, never measured twice
        last[list(chosen)] = weighed.expected(chosen).mean
    for i, candidate in enumerate(weighed.candidates):
        c, recording = candidate.choice, candidate.choice.recording
        settings = tuple(c.settings.items()) if c.points else ()
        traced = ("", 0.0) if recording is None else (recording.trace, recording.spacing_s)
        groups.setdefault((c.output, c.centre_hz, c.level, settings, *traced), []).append(i)
    names = ("output", "centre_hz", "level", "settings", "trace", "spacing_s")
    return tuple(
        Kind(
            best=float(np.min(alone[mine])),
            worst=float(np.max(alone[mine])),
            beside=float(np.min(last[mine])),
            count=len(mine),
            **{**dict(zip(names, key, strict=True)), "settings": dict(key[3])},
        )
        for key, mine in groups.items()
    )


# --- what is printed ----------------------------------------------------------------------------


def proposal_table(design: Design) -> Table:
    """A row per proposed measurement, under one for the data so far.

    Args:
        design: the proposed next measurement.
    """
    return table("design/proposals", design=design)


def screen_lines(design: Design, files: Sequence[Path] = (), *, verbose: bool = False) -> list[str]:
    """What `fmu-fit design` prints: a row for each proposed measurement.

    Args:
        design: the proposed next measurements.
        files: design.json, design.csv, the campaign to be filled in, the report if there is one.
        verbose: whether candidates, points of equal fit and assumptions are printed.
    """
    expected = table("design/expected", design=design)
    return printed_lines("design/text", "screen", design, expected, verbose, files)
