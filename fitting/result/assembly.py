"""From a fit and what was inferred from it to the `Result` that is written and reported."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from fitting.fit.fit import Fit, Solution
from fitting.fit.objective import Point
from fitting.fit.outputs import mean
from fitting.fit.problem import Problem
from fitting.inference.infer import Inference, in_order
from fitting.inference.likelihood.knowledge import Inferred
from fitting.measurements.sweep import Sweep
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
from fitting.text.finding import Finding, Kind
from fitting.text.rendering import warning_sentences


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
        tuple(map(float, everything)),
        tuple(mean(group) for group in groups),
        mean(everything),
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
