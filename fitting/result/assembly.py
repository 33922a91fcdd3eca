"""From a fit and what was inferred from it to the `Result` that is written and reported."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace

import numpy as np

from fitting.campaign.parameters import canonical
from fitting.fit.fit import Fit, Solution
from fitting.fit.objective import Point
from fitting.fit.outputs import mean
from fitting.fit.problem import PlannedFmu, Problem
from fitting.fmu.pool import DROPPED, FmuWorkers
from fitting.inference.infer import Inference, in_order
from fitting.inference.likelihood.knowledge import Inferred
from fitting.measurements.fmu_response import FmuResponse
from fitting.measurements.plan import Plan
from fitting.measurements.sweep import Sweep
from fitting.measurements.time_record import Traces
from fitting.result.provenance import provenance_of
from fitting.result.result import (
    Cost,
    Deviations,
    DeviationSet,
    Peak,
    Provenance,
    Result,
    Scale,
    SweepCurves,
)
from fitting.signal.scale import laboratory_maximum
from fitting.simulate.budget import PlanRecord
from fitting.text.arrays import FloatArray
from fitting.text.choices import INTERFACES
from fitting.text.finding import Finding, Kind, note, warning
from fitting.text.rendering import phrase, warning_sentences


def result_of(
    fit: Fit,
    inference: Inference,
    provenance: Provenance,
    further: Sequence[Finding] = (),
    plan: PlanRecord | None = None,
) -> Result:
    """Everything that is known of a fit as the one record that is written and reported.

    Args:
        fit: the solved problem.
        inference: what its data determine.
        provenance: where all of it comes from.
        further: findings from outside the fit, as the FMU's own warnings.
        plan: how the FMU was simulated.
    """
    problem, solution = fit.problem, fit.solution
    data, sweep = problem.data, problem.sweep
    findings = in_order(*inference.findings, *further)
    shared = {each.name: getattr(inference, each.name) for each in fields(Inferred)}
    # the sweep, and the scale that simulated amplitudes take from it
    scale_kind, maximum, curves = "none", None, None
    if sweep is not None:
        scale_kind, maximum = sweep.scale, laboratory_maximum(sweep.frequency_hz, sweep.amplitude_v)
        [k] = [k for k, m in enumerate(problem.measurements) if isinstance(m, Sweep)]
        curves = SweepCurves(
            frequency_hz=tuple(map(float, sweep.frequency_hz)),
            measured_v=tuple(map(float, sweep.amplitude_v)),
            initial_v=tuple(map(float, solution.initial.scaled[k])),
            final_v=tuple(map(float, solution.final.scaled[k])),
        )
    scale = Scale(
        kind="one per campaign" if problem.is_joint else scale_kind,
        initial=solution.initial.chi,
        final=solution.final.chi,
        grid_bias=solution.final.scale_bias,
        maximum_v=maximum.value_v if maximum is not None else math.nan,
        maximum_bias=maximum.bias if maximum is not None else math.nan,
        maximum_bias_std=maximum.bias_std if maximum is not None else math.nan,
    )
    lines = ((e.label, float(f)) for e in problem.experiments for f in e.read_hz)
    columns = (
        np.concatenate([np.empty(0), *(tones.peaks_v for tones in data.tones)]),
        np.concatenate([np.empty(0), *(tones.sigmas_v for tones in data.tones)]),
        data.peaks(solution.initial.scaled),
        data.peaks(solution.final.scaled),
    )
    peaks = tuple(
        Peak(
            experiment=label,
            frequency_hz=frequency_hz,
            measured_v=float(measured),
            sigma_v=float(sigma),
            initial_v=float(initial),
            final_v=float(final),
        )
        for (label, frequency_hz), measured, sigma, initial, final in zip(
            lines, *columns, strict=True
        )
    )
    return Result(
        title=problem.title,
        synthetic=problem.synthetic,
        alternative=dict(fit.alternative),
        deviations=deviations(problem, solution),
        j_fit=solution.final.j_fit,
        j_reg=solution.j_reg,
        optimality=solution.predicted_decrease,
        scale=scale,
        peaks=peaks,
        sweep=curves,
        history=fit.path,
        global_history=fit.global_path,
        alternatives=fit.alternatives,
        correlation=correlation_of(solution),
        evaluations=Cost(fit.cost.evaluations, fit.cost.jacobians, fit.cost.runs),
        seconds=fit.seconds,
        warnings=warning_sentences(findings),
        provenance=provenance,
        line=None if problem.is_joint else next(iter(inference.sweeps.lines.values()), None),
        plan=plan,
        **{**shared, "findings": findings},
    )


def without_profiles(result: Result, why: str) -> Result:
    """The result of a fit whose profiles were not completed.

    Args:
        result: of a reconstruction.
        why: "pending" where it is written before they are, "budget" where it was spent.
    """
    finding = Finding(kind=Kind.profiles_missing, severity="warning", subject=why)
    findings = in_order(*result.findings, finding)
    return replace(result, findings=findings, warnings=warning_sentences(findings))


def deviations(problem: Problem, solution: Solution) -> Deviations:
    """Relative deviations before and after, by peak and by experiment; of curves without peaks.

    Source: the paper's Definition of the relative deviation and of its mean.

    Args:
        problem: parameters, measurements and alternatives.
        solution: end of the fit.
    """
    before = _deviation_set(problem, solution.initial)
    after = _deviation_set(problem, solution.final)
    gain = 100.0 * (1.0 - after.mean / before.mean) if before.mean > 0.0 else 0.0
    return Deviations(before, after, gain)


def _deviation_set(problem: Problem, point: Point) -> DeviationSet:
    rows = np.abs(point.residuals)
    peaks = problem.data.peaks_of_rows(rows)
    everything = peaks if peaks.size else rows
    counts = [e.peaks_v.size for e in problem.experiments]
    groups = np.split(everything, np.cumsum(counts)[:-1]) if counts else [everything]
    return DeviationSet(
        tuple(map(float, everything)), tuple(mean(group) for group in groups), mean(everything)
    )


def correlation_of(solution: Solution) -> tuple[tuple[float, ...], ...]:
    """Correlations of the parameters of all experiments, in their order.

    Args:
        solution: end of the fit.
    """
    own = [i for i, p in enumerate(solution.parameters) if not p.experiments]
    total = solution.errors.covariance[np.ix_(own, own)]
    std = np.sqrt(np.diag(total))
    return tuple(tuple(map(float, row)) for row in total / np.outer(std, std))


# --- through an FMU -------------------------------------------------------------------------------

#: Kinds of warnings that a note tells of.
MOST_KINDS = 3
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


def result_through(
    planned: PlannedFmu, fit: Fit, inference: Inference, command: str, seconds: float
) -> Result:
    """The result of a fit through an FMU, with the plan and the FMU's warnings.

    Only what the FMU warns of at the solution is a warning; what it logged elsewhere is a note.

    Args:
        planned: the FMU, and how it was driven.
        fit: the solved problem.
        inference: what its data determine.
        command: command line that made it, for the record.
        seconds: what planning, fit and inference took, s.

    Raises:
        FmuFailure: the FMU failed at the solution.
    """
    workers, problem = planned.workers, planned.problem
    response = planned.response(fit.alternative)
    p = canonical(problem.parameters, inference.reported)  # as the model takes them
    here = _messages_at(response, p, workers)
    # what the FMU warned of at starts, steps and samples only
    kinds = _by_kind(workers.warnings).items()
    rest = [alike for kind, alike in kinds if kind not in here]
    notes: tuple[str, ...] = ()
    if rest:
        dropped = DROPPED in workers.warnings
        notes = (phrase("findings", "fmu_elsewhere", rest, MOST_KINDS, dropped),)
    reuse = workers.verdict.note
    provenance = replace(
        provenance_of(problem, workers.description, command, fit.options),
        plan=(*planned.sentences, f"{reuse[0].upper()}{reuse[1:]}."),
        notes=notes,
    )
    plans = list(planned.plans.values())
    # warnings of the FMU that differ in numbers together
    further = [
        Finding(
            kind=Kind.fmu_warning,
            severity="warning",
            subject="FMU",
            numbers={"count": float(len(alike))},
            names={"text": (alike[0],)},
        )
        for alike in here.values()
    ]
    misfit = response.misfit(p)
    if misfit > max(100.0 * problem.accuracy, 1e-4):
        numbers, kind = {"error": misfit}, Kind.not_periodic
        further.append(Finding(kind=kind, severity="warning", subject="samples", numbers=numbers))
    further += _of_plans(plans)
    # the commonest mistake of hand-written FMUs
    for m in (m for m in response.measurements if isinstance(m, Traces)):
        for trace in m.traces:
            steps = response.models[m.series].plan.step_plan(m.key(trace))
            if steps is not None and steps.delay_steps:
                numbers = {"step_s": steps.step_s}
                further.append(warning(Kind.output_late, m.output_of(trace), None, **numbers))
    # the equations of the FMU could be integrated here, where its own solver does not do
    other, description = INTERFACES[1], workers.description
    short = any(plan.budget is not None and not plan.budget.kept for plan in plans)
    if description.instead_of_s:
        further.append(note(Kind.model_exchange_taken, other, step_s=description.instead_of_s))
    if short and description.interface != other and other in description.offers:
        further.append(note(Kind.model_exchange_offered, other))
    result = result_of(fit, inference, provenance, further, plans[0].record)
    return replace(result, seconds=seconds)


def _of_plans(plans: Sequence[Plan]) -> Iterator[Finding]:
    """An accuracy that cannot be promised, and reductions that are forced beyond their bound."""
    for budget in (plan.budget for plan in plans if plan.budget is not None):
        missed = () if budget.kept else (max(budget.decisions, key=lambda d: d.cost),)
        forced = (d for d in budget.decisions if d.taken and d.forced and d.bound > budget.wanted)
        goal = {"promised": budget.promised, "wanted": budget.wanted}
        for kind, decisions in ((Kind.accuracy_missed, missed), (Kind.accuracy_forced, forced)):
            for decision in decisions:
                yield Finding(
                    kind=kind,
                    severity="warning",
                    subject=phrase("plan", "subject", decision),
                    numbers={**goal, "bound": decision.bound},
                    names={"choice": (phrase("plan", "choice", decision),)},
                )


def _messages_at(response: FmuResponse, p: FloatArray, workers: FmuWorkers) -> dict[str, list[str]]:
    """What the FMU warns of at these parameters, by kind.

    The runs were all made before, so that none is made of other parameters to try a reset; what was
    read before is read again.
    """
    replace(response).derived_many([p])
    response.misfit(p)
    stated = list(workers.latest_warnings)
    replace(response).derived_many([p])
    stated += workers.latest_warnings
    return _by_kind(list(dict.fromkeys(stated)))


def _by_kind(warnings: Sequence[str]) -> dict[str, list[str]]:
    """Warnings that differ in their numbers only, together."""
    kinds: dict[str, list[str]] = {}
    for stated in (text for text in warnings if text != DROPPED):
        kinds.setdefault(NUMBER.sub("#", stated), []).append(stated)
    return kinds
