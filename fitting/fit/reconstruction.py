"""The whole job as a function: bound campaign and response in, `Result` out.

Writes nothing and draws nothing: progress, finished levels and the clock are handed in.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from fitting.campaign import BoundCampaign
from fitting.fit import assembly, corrections
from fitting.fit.choice import chosen
from fitting.fit.continuation import ContinuationStep, Journal, Outcome, Schedule, run_alternative
from fitting.fit.evaluator import Counts, Evaluator
from fitting.fit.job import Identity, Options, provenance_of
from fitting.fit.objective import Objective, make_objective
from fitting.fit.problem import Problem
from fitting.fit.result import (
    STATUSES,
    AlternativeResult,
    Cost,
    OffsetResult,
    Peak,
    Result,
    Scale,
    SweepCurves,
)
from fitting.fit.sweep_line import line_of_sweep, line_warnings
from fitting.inference.consistency import consistency, warnings_of
from fitting.inference.equivalent_fits import with_equivalent_fits
from fitting.measurements.data_warnings import data_warnings
from fitting.measurements.measurement import Response
from fitting.signal.scale import LaboratoryMaximum, laboratory_maximum
from fitting.text.arrays import Scalar


@dataclass(frozen=True)
class Progress:
    """State of a running reconstruction, handed out before and after every level.

    `done` of at most `of` levels; `left_s` an estimate that starts go on alone (NaN at first).
    """

    alternative: int
    alternatives: int
    start: int
    starts: int
    level: int
    levels: int
    nu: float
    j_fit: float
    j_reg: float
    evaluations: int
    done: int
    of: int
    elapsed_s: float
    left_s: float


class Memory(Protocol):
    """Where finished levels are kept (`fitting.fit.checkpoint.Checkpoint`)."""

    def recall(self, alternative: int, start: int, level: int) -> ContinuationStep | None:
        """The finished step of that place, None if there is none."""
        ...

    def record(self, step: ContinuationStep) -> None:
        """Keep a finished step."""
        ...


@dataclass(frozen=True)
class Hooks:
    """Watching and resuming, and what is asked of the data at the end, all optional.

    `inform(result, solution)` adds what the data determine to the result.
    """

    progress: Callable[[Progress], None] = lambda state: None
    memory: Memory | None = None
    inform: Callable[[Result, assembly.Solution], Result] | None = None
    clock: Callable[[], float] = time.perf_counter


def reconstruct(
    problem: Problem,
    respond: Callable[[Mapping[str, Scalar]], Response],
    identity: Identity,
    options: Options,
    hooks: Hooks | None = None,
) -> Result:
    """Algorithms 1 and 2 for every alternative and start; the best is reported, all are listed.

    `respond` makes the response of one alternative. A KeyboardInterrupt ends the search: what was
    finished is reported, with that status.

    Raises:
        FmuFailure: the model failed inside the box.
        BadInput: nothing to fit.

    Source: the paper, Algorithms 1 and 2.
    """
    hooks = hooks or Hooks()
    begun = hooks.clock()
    watch = _Watch(len(problem.alternatives), options.schedule, hooks, begun)
    objectives: list[Objective] = []
    outcomes: list[Outcome] = []
    for k, alternative in enumerate(problem.alternatives):
        try:
            objectives.append(
                make_objective(respond(alternative), problem.parameters, problem.data)
            )
        except KeyboardInterrupt:
            break
        journal = Journal(watch.recall, watch.record, watch.entering, hooks.clock)
        outcomes.append(
            run_alternative(objectives[-1], options.schedule, options.solve, k, journal)
        )
        if outcomes[-1].interrupted:
            break
    if not outcomes:
        raise KeyboardInterrupt
    del objectives[len(outcomes) :]
    result, solution = _finish(problem, identity, options, objectives, outcomes)
    if problem.is_joint:
        joint = consistency(problem, solution)
        said = (*warnings_of(joint), *result.warnings, *problem.notes)
        result = replace(result, joint=joint, warnings=said)
    if hooks.inform is not None and result.status != STATUSES[2]:
        result = hooks.inform(result, solution)
    return replace(result, seconds=hooks.clock() - begun)


class _Watch:
    """Counts levels and time for the progress, and passes steps to and from the memory."""

    def __init__(self, alternatives: int, schedule: Schedule, hooks: Hooks, begun: float) -> None:
        self.alternatives, self.schedule, self.hooks, self.begun = (
            alternatives,
            schedule,
            hooks,
            begun,
        )
        self.done = self.fresh = self.evaluations = 0
        self.spent = 0.0
        self.last: ContinuationStep | None = None

    def recall(self, alternative: int, start: int, level: int) -> ContinuationStep | None:
        if self.hooks.memory is None:
            return None
        step = self.hooks.memory.recall(alternative, start, level)
        if step is not None:
            self._count(step)
        return step

    def record(self, step: ContinuationStep) -> None:
        if self.hooks.memory is not None:
            self.hooks.memory.record(step)
        self.fresh += 1
        self.spent += step.seconds
        self._count(step)
        self._tell(step.alternative, step.start, step.level)

    def entering(self, alternative: int, start: int, level: int) -> None:
        self._tell(alternative, start, level)

    def _count(self, step: ContinuationStep) -> None:
        self.done += 1
        self.evaluations += step.evaluations
        self.last = step

    def _tell(self, alternative: int, start: int, level: int) -> None:
        schedule = self.schedule
        # starts mostly meet in the first level: count one chain per alternative beyond it
        whole = self.alternatives * (schedule.starts + schedule.levels - 1)
        mean = self.spent / self.fresh if self.fresh else float("nan")
        self.hooks.progress(
            Progress(
                alternative,
                self.alternatives,
                start,
                schedule.starts,
                level,
                schedule.levels,
                schedule.nu(level),
                self.last.j_fit if self.last else float("nan"),
                self.last.j_reg if self.last else float("nan"),
                self.evaluations,
                self.done,
                max(whole, self.done),
                self.hooks.clock() - self.begun,
                max(whole - self.done, 0) * mean,
            )
        )


def _finish(
    problem: Problem,
    identity: Identity,
    options: Options,
    objectives: list[Objective],
    outcomes: list[Outcome],
) -> tuple[Result, assembly.Solution]:
    outcomes, reported = chosen(objectives, outcomes)
    objective, outcome = objectives[reported], outcomes[reported]
    maximum = _maximum(problem)
    chain = outcome.best or outcome.chains[0]
    evaluator, misfit = Evaluator(objective), options.solve.misfit
    solution = assembly.solution_of(evaluator, chain, options.schedule, misfit)
    parameters = assembly.parameter_results(solution)
    derived = assembly.derived_results(solution, identity.units, options.schedule.seed)
    alternatives = assembly.alternative_results(
        objectives, outcomes, problem.alternatives, reported
    )
    parameters, derived, told = with_equivalent_fits(
        parameters, derived, problem.parameters, alternatives
    )
    said = assembly.warning_sentences(solution, outcome, parameters, derived) + told
    line = line_of_sweep(problem.sweep) if problem.sweep is not None else None
    offsets = corrections.offset_results(solution)
    said += _drift_warnings(problem, offsets)
    warnings = data_warnings(tuple(problem.campaigns.values()), maximum, solution.final.scale_bias)
    warnings += [*said, *corrections.outlier_warnings(problem, solution), *_ties(alternatives)]
    warnings += (
        line_warnings(line, fitted=any(m.rows for m in problem.measurements if m.is_curve))
        if line
        else []
    )
    status, message = _status(solution, outcomes)
    last = solution.last
    result = Result(
        title=problem.title,
        synthetic=problem.synthetic,
        status=status,
        message=message,
        parameters=parameters,
        derived=derived,
        alternative=dict(problem.alternatives[reported]),
        deviations=assembly.deviations(problem, solution),
        j_fit=solution.final.j_fit,
        j_reg=last.j_reg if last is not None else float("nan"),
        optimality=last.optimality if last is not None else float("nan"),
        scale=_scale(problem, solution, maximum),
        peaks=_peaks(problem, solution),
        sweep=_sweep(problem, solution),
        history=assembly.history_rows(solution),
        alternatives=alternatives,
        correlation=_correlation(solution),
        evaluations=_cost(outcomes, evaluator.counts),
        seconds=float("nan"),
        warnings=tuple(warnings),
        provenance=provenance_of(problem, identity, options),
        line=line,
        offsets=offsets,
    )
    return result, solution


def _drift_warnings(problem: Problem, offsets: tuple[OffsetResult, ...]) -> list[str]:
    """Of every campaign, by its name where there are several."""
    said = []
    for name, bound in problem.campaigns.items():
        labels = {e.label for e in bound.experiments}
        own = tuple(o for o in offsets if o.experiments[0] in labels)
        told = corrections.drift_warnings(bound, own, _width_hz(bound))
        said += [f"{name}: {text}" if name else text for text in told]
    return said


def _width_hz(bound: BoundCampaign) -> float:
    """Line width: of the sweep's fit, else the declared one; NaN where neither is known."""
    line = line_of_sweep(bound.sweep) if bound.sweep is not None else None
    if line is not None and line.width_hz > 0.0:
        return line.width_hz
    return bound.setup.line_width_hz or float("nan")


def _status(solution: assembly.Solution, outcomes: list[Outcome]) -> tuple[str, str]:
    last = solution.last
    if any(outcome.interrupted for outcome in outcomes):
        reached = "the start" if last is None else f"nu = {last.nu:.1e}, J_fit = {last.j_fit:.6g}"
        return STATUSES[2], f"Interrupted: the best so far is reported, reached at {reached}."
    if last is None:
        return STATUSES[1], "No level of nu was done."
    where = f"J_fit = {last.j_fit:.6g}, J_reg = {last.j_reg:.3g} at nu = {last.nu:.1e}"
    missed = solution.objective.data.unexplained(solution.final.residuals)
    if missed:
        return STATUSES[1], (
            f"The fit does not describe the data: {missed}; {where}. Wanted a start nearer to the "
            "solution, a wider box, or data above the noise."
        )
    if last.status == "optimal":
        promise = f"a linearised step promises no more than {last.optimality:.1e}"
        return STATUSES[0], f"{solution.chain.ended.capitalize()}; {where}; {promise}."
    return STATUSES[1], (
        f"Not optimal at the last nu: a linearised step still promises {last.optimality:.2e} "
        f"({last.message}); {where}."
    )


def _maximum(problem: Problem) -> LaboratoryMaximum | None:
    if problem.sweep is None:
        return None
    return laboratory_maximum(problem.sweep.frequency_hz, problem.sweep.amplitude_v)


def _scale(
    problem: Problem, solution: assembly.Solution, maximum: LaboratoryMaximum | None
) -> Scale:
    own = problem.sweep.scale if problem.sweep is not None else "none"
    return Scale(
        kind="one per campaign" if problem.is_joint else own,
        initial=solution.initial.chi,
        final=solution.final.chi,
        grid_bias=solution.final.scale_bias,
        maximum_v=maximum.value_v if maximum is not None else float("nan"),
        maximum_bias=maximum.bias if maximum is not None else float("nan"),
        maximum_bias_std=maximum.bias_std if maximum is not None else float("nan"),
    )


def _peaks(problem: Problem, solution: assembly.Solution) -> tuple[Peak, ...]:
    data = problem.data
    lines = [(e.label, float(f)) for e in problem.experiments for f in e.read_hz]
    columns = (
        np.concatenate([np.empty(0), *(t.peaks_v for t in data.tones)]),
        np.concatenate([np.empty(0), *(t.sigmas_v for t in data.tones)]),
        data.peaks(solution.initial.scaled),
        data.peaks(solution.final.scaled),
    )
    return tuple(
        Peak(label, frequency_hz, *map(float, values))
        for (label, frequency_hz), *values in zip(lines, *columns, strict=True)
    )


def _sweep(problem: Problem, solution: assembly.Solution) -> SweepCurves | None:
    if problem.sweep is None:
        return None
    [k] = [k for k, m in enumerate(problem.measurements) if m.is_curve]
    columns = (
        problem.sweep.frequency_hz,
        problem.sweep.amplitude_v,
        solution.initial.scaled[k],
        solution.final.scaled[k],
    )
    return SweepCurves(*(tuple(map(float, column)) for column in columns))


def _correlation(solution: assembly.Solution) -> tuple[tuple[float, ...], ...]:
    own = [i for i, p in enumerate(solution.parameters) if not p.experiments]
    total = solution.errors.total[np.ix_(own, own)]
    std = np.sqrt(np.diag(total))
    return tuple(tuple(map(float, row)) for row in total / np.outer(std, std))


def _cost(outcomes: list[Outcome], rest: Counts) -> Cost:
    counts = rest
    for outcome in outcomes:
        for chain in outcome.chains:
            for step in chain.steps:
                counts += step.counts
    return Cost(counts.evaluations, counts.jacobians, counts.runs)


def _ties(alternatives: tuple[AlternativeResult, ...]) -> list[str]:
    equal = [a for a in alternatives if a.equal_to_best and not a.reported]
    return [
        "The data do not tell the alternatives apart: "
        + ", ".join(f"{name} = {value}" for name, value in a.settings.items())
        + " reaches the same J."
        for a in equal
    ]
