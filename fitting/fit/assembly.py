"""From the end of Algorithm 2 to a `Result`: values, errors, deviations, warnings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitting.campaign.parameters import (
    Parameter,
    canonical,
    prior_widths,
    search_bounds,
    starts,
    to_model,
    to_search,
)
from fitting.fit.continuation import Chain, ContinuationStep, Outcome, Schedule, distance, equal_j
from fitting.fit.evaluator import Evaluator
from fitting.fit.noise import noise_of
from fitting.fit.objective import Objective, Point, j_reg, weights
from fitting.fit.problem import Problem
from fitting.fit.result import (
    IDENTIFIABLE,
    AlternativeResult,
    DerivedResult,
    Deviations,
    DeviationSet,
    HistoryRow,
    ParameterResult,
    StartResult,
)
from fitting.fit.symmetry import secants
from fitting.inference.ranges import output_ranges
from fitting.inference.uncertainty import Covariance, covariance, in_words
from fitting.measurements.dataset import Dataset
from fitting.signal.residual_tests import Structure, residual_structure
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.notation import probability

#: Starts of equal J whose parameters differ by more than this (units of x) are told apart.
APART = 0.1


@dataclass(frozen=True)
class Solution:
    """The reported end: objective, chain, last level, and what was evaluated there.

    `initial` is the campaign's start, `final` the solution; `matrix` dr/dx there; `structure` that
    of the sweep's residuals, None where the sweep is not fitted; `held` the weights nu_i (n,);
    `beside` the points that tell of variables without a first-order effect (`symmetry.secants`).
    """

    objective: Objective
    chain: Chain
    nu: float
    initial: Point
    final: Point
    matrix: FloatArray
    errors: Covariance
    structure: Structure | None
    held: FloatArray
    beside: Mapping[int, FloatArray]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The fitted parameters."""
        return self.objective.parameters

    @property
    def last(self) -> ContinuationStep | None:
        """The last finished level, None before the first."""
        return self.chain.steps[-1] if self.chain.steps else None


def solution_of(
    evaluator: Evaluator, chain: Chain, schedule: Schedule, misfit: str = "slack"
) -> Solution:
    """Evaluate start and end of a chain, with Jacobian and covariance at the end."""
    objective = evaluator.objective
    parameters = objective.parameters
    begun = to_search(parameters, starts(parameters))
    x = np.array(chain.steps[-1].x if chain.steps else chain.begun)
    nu = chain.steps[-1].nu if chain.steps else schedule.nu(0)
    initial, final = evaluator.whole([begun, x])
    matrix = evaluator.jacobian(x)
    structure = _curve_structure(objective.data, final, matrix)
    common = noise_of(objective, final).common
    seen, beside = secants(evaluator, x, matrix)
    errors = covariance(
        seen,
        final.residuals,
        objective.data.sigma,
        prior_widths(parameters),
        nu,
        0.0,
        objective.data.curve_rows,
        structure.widening if structure is not None else 1.0,
        common,
    )
    held = weights(objective, nu, misfit)
    return Solution(objective, chain, nu, initial, final, matrix, errors, structure, held, beside)


def _curve_structure(data: Dataset, final: Point, matrix: FloatArray) -> Structure | None:
    """Structure of the residuals along curves; a scale taken from them is one more unknown."""
    mine = data.curve_rows
    rows, columns = final.residuals[mine], matrix[mine]
    if not rows.size:
        return None
    if any(m.rows and m.takes_scale_from_rows for m in data.measurements if m.is_curve):
        columns = np.column_stack([columns, rows + data.level[mine]])  # d r/d ln chi
    return residual_structure(rows, columns)


def parameter_results(solution: Solution) -> dict[str, ParameterResult]:
    """Value, error and provenance of every parameter of the whole campaign, by name."""
    results = {}
    shown = canonical(solution.parameters, solution.final.parameters)
    for i, parameter in enumerate(solution.parameters):
        if parameter.experiments:
            continue
        gradient = np.zeros(len(solution.parameters))
        gradient[i] = parameter.scale
        std, shrinkage = solution.errors.of(gradient)
        raw = float(solution.final.parameters[i])
        results[parameter.name] = ParameterResult(
            value=float(shown[i]),
            unit=parameter.unit,
            std=std if _held(shrinkage) else float("nan"),
            ci95=_interval(parameter, raw, float(shown[i]), std),
            reference=parameter.reference,
            start=parameter.start,
            lower=parameter.lower,
            upper=parameter.upper,
            shrinkage=shrinkage,
            identifiable=in_words(shrinkage),
        )
    return results


def _held(shrinkage: float) -> bool:
    """Whether the data say anything: else a linearised error would be one of the box's width."""
    return in_words(shrinkage) != IDENTIFIABLE[2]


def _interval(parameter: Parameter, raw: float, shown: float, std: float) -> tuple[float, float]:
    """95 % interval within the box, shifted with the value into its canonical period."""
    low = max(raw - 1.96 * std, parameter.lower)
    high = min(raw + 1.96 * std, parameter.upper)
    if parameter.period is not None and high - low >= parameter.period:
        return 0.0, parameter.period
    return low + (shown - raw), high + (shown - raw)


def derived_results(
    solution: Solution, units: Mapping[str, str], seed: int
) -> dict[str, DerivedResult]:
    """Derived outputs at the solution, with errors from their gradient and range over the box."""
    parameters, response = solution.parameters, solution.objective.response
    x = solution.final.x
    lower, upper = search_bounds(parameters)
    n = len(parameters)
    nodes = []
    for i in range(n):
        if i in solution.beside:  # as the covariance saw it
            nodes += [solution.beside[i], x]
            continue
        step = min(1e-4, 0.25 * float(upper[i] - lower[i]))
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[i] = np.clip(x[i] + sign * step, lower[i], upper[i])
            nodes.append(moved)
    everything = [x, np.clip(np.zeros(n), lower, upper), *nodes]
    answers = response.derived_many([to_model(parameters, y) for y in everything])
    ranges = output_ranges(response, parameters, seed, everything)
    results = {}
    for name, values in answers[0].items():
        means = np.array([_mean(answer[name]) for answer in answers])
        around = means[2 : 2 + 2 * n]
        spans = np.array([nodes[2 * i][i] - nodes[2 * i + 1][i] for i in range(n)])
        gradient = (around[0::2] - around[1::2]) / spans
        box = (ranges[name].low, ranges[name].high)
        results[name] = _derived(solution, values, gradient, means, units.get(name, ""), box)
    return results


def _mean(values: FloatArray) -> float:
    return float(np.mean(values)) if values.size else float("nan")


def _derived(
    solution: Solution,
    values: FloatArray,
    gradient: FloatArray,
    means: FloatArray,
    unit: str,
    box: tuple[float, float],
) -> DerivedResult:
    known = bool(np.all(np.isfinite(gradient)) and np.isfinite(means[0]))
    std, shrinkage = solution.errors.of(gradient) if known else (float("nan"), 0.0)
    std = std if _held(shrinkage) else float("nan")
    value = float(means[0])
    return DerivedResult(
        value=value,
        unit=unit,
        values=tuple(map(float, values)),
        mean=value,
        spread=float(np.std(values, ddof=1)) if values.size > 1 else 0.0,
        std=std,
        ci95=_within(box, value, std),
        reference=float(means[1]),
        shrinkage=shrinkage,
        identifiable=in_words(shrinkage) if known else IDENTIFIABLE[2],
        box=box,
    )


def _within(box: tuple[float, float], value: float, std: float) -> tuple[float, float]:
    """95 % interval of a derived value, cut to its range over the box; without data, that range."""
    if np.isnan(value):
        return float("nan"), float("nan")
    if np.isnan(std):
        return box
    return max(value - 1.96 * std, box[0]), min(value + 1.96 * std, box[1])


def deviations(problem: Problem, solution: Solution) -> Deviations:
    """Relative deviations before and after, by peak and by experiment; of curves without peaks.

    Source: the paper's Definition of the relative deviation and of its mean.
    """
    before = _deviation_set(problem, solution.initial)
    after = _deviation_set(problem, solution.final)
    gain = 100.0 * (1.0 - after.mean / before.mean) if before.mean > 0.0 else 0.0
    return Deviations(before, after, gain)


def _deviation_set(problem: Problem, point: Point) -> DeviationSet:
    rows = [np.abs(point.residuals[k]) for k in problem.data.slices]
    peaks = problem.data.peaks(rows)
    everything = peaks if peaks.size else np.concatenate(rows)
    counts = [e.peaks_v.size for e in problem.experiments]
    groups = np.split(everything, np.cumsum(counts)[:-1]) if counts else [everything]
    return DeviationSet(
        tuple(map(float, everything)),
        tuple(_mean(group) for group in groups),
        _mean(everything),
    )


def history_rows(solution: Solution) -> tuple[HistoryRow, ...]:
    """A row per nu of the reported chain, level -1 being the start, with derived means."""
    parameters = solution.parameters
    begun = np.array(solution.chain.begun)
    places = [begun, *(np.array(step.x) for step in solution.chain.steps)]
    values = [to_model(parameters, x) for x in places]
    derived = solution.objective.response.derived_many(values)
    rows = []
    for k, (p, outputs) in enumerate(zip(values, derived, strict=True)):
        means = {name: _mean(values) for name, values in outputs.items()}
        named = _named(parameters, p)
        if k == 0:
            start = solution.initial
            rows.append(
                HistoryRow(
                    -1,
                    float("nan"),
                    named,
                    means,
                    start.j_fit,
                    j_reg(begun, solution.held),
                    float("nan"),
                    float("nan"),
                    "start",
                    "where the search began",
                    0,
                    0,
                    0.0,
                )
            )
            continue
        step = solution.chain.steps[k - 1]
        rows.append(
            HistoryRow(
                step.level,
                step.nu,
                named,
                means,
                step.j_fit,
                step.j_reg,
                step.change,
                step.optimality,
                step.status,
                step.message,
                step.iterations,
                step.evaluations,
                step.seconds,
            )
        )
    return tuple(rows)


def _named(parameters: Sequence[Parameter], p: FloatArray) -> dict[str, float]:
    shown = canonical(parameters, p)
    return {q.name: float(value) for q, value in zip(parameters, shown, strict=True)}


def alternative_results(
    objectives: Sequence[Objective],
    outcomes: Sequence[Outcome],
    settings: Sequence[Mapping[str, Scalar]],
    reported: int,
) -> tuple[AlternativeResult, ...]:
    """One record per alternative that got anywhere, the reported one marked."""
    least = outcomes[reported].best
    best_j = least.steps[-1].j if least is not None else float("inf")
    results = []
    for k, (objective, outcome) in enumerate(zip(objectives, outcomes, strict=True)):
        chain = outcome.best
        if chain is None:
            continue
        last = chain.steps[-1]
        outputs = objective.response.derived_many([np.array(last.parameters)])[0]
        results.append(
            AlternativeResult(
                settings=dict(settings[k]),
                parameters=_named(objective.parameters, np.array(last.parameters)),
                derived={name: _mean(values) for name, values in outputs.items()},
                j_fit=last.j_fit,
                j_reg=last.j_reg,
                status=last.status,
                message=f"{last.message}; {chain.ended}" if chain.ended else last.message,
                reported=k == reported,
                equal_to_best=equal_j(last.j, best_j),
                starts=tuple(_start(objective, c, chain) for c in outcome.chains if c.steps),
            )
        )
    return tuple(results)


def _start(objective: Objective, chain: Chain, best: Chain) -> StartResult:
    """Where a start led; `equivalent` where J and the simulated rows are those of the best."""
    last, top = chain.steps[-1], best.steps[-1]
    return StartResult(
        begun=_named(objective.parameters, to_model(objective.parameters, np.array(chain.begun))),
        parameters=_named(objective.parameters, np.array(last.parameters)),
        j_fit=last.j_fit,
        j_reg=last.j_reg,
        levels=len(chain.steps),
        joined=chain.joined,
        ended=chain.ended,
        equivalent=chain is best or chain.joined is not None or equal_j(last.j, top.j),
    )


def verdict_sentences(values: Mapping[str, ParameterResult | DerivedResult]) -> list[str]:
    """Which values the data do not determine, or only partly."""
    said = []
    for verdict in IDENTIFIABLE[1:]:
        names = [name for name, value in values.items() if value.identifiable == verdict]
        if names:
            said.append(
                f"{verdict.capitalize()} by these data: {', '.join(names)}. Prior and start decide "
                "where these values are reported."
            )
    return said


def warning_sentences(
    solution: Solution,
    outcome: Outcome,
    parameters: Mapping[str, ParameterResult],
    derived: Mapping[str, DerivedResult],
) -> list[str]:
    """What a reader of the numbers must know."""
    said = verdict_sentences({**parameters, **derived})
    for i, parameter in enumerate(solution.parameters):
        p, width = float(solution.final.parameters[i]), parameter.upper - parameter.lower
        if min(p - parameter.lower, parameter.upper - p) < 1e-3 * width:
            said.append(f"{parameter.name} ended on a bound of its box ({p:.9g} {parameter.unit}).")
    if solution.errors.inflation > 1.5:
        said.append(
            f"The residuals are {solution.errors.inflation:.3g} times what the noise explains: the "
            "model, or the interpolated drift, does not describe these data; errors are widened."
        )
    told = solution.structure
    count = solution.final.residuals[solution.objective.data.curve_rows].size
    if told is not None and told.widening > 1.5:
        said.append(
            "The residuals of the fitted sweep are not noise, they hang together "
            f"({probability(told.p_value)} for white noise): its "
            f"{count} points are worth {told.points:.2g} "
            f"independent ones, and errors are {told.widening:.3g} times as wide for it."
        )
    said += _other_minima(solution, outcome)
    return said


def _other_minima(solution: Solution, outcome: Outcome) -> list[str]:
    best = outcome.best
    said = []
    for chain in outcome.chains:
        if best is None or chain is best or chain.joined is not None or not chain.steps:
            continue
        there = np.array(chain.steps[-1].x)
        apart = distance(solution.parameters, there, np.array(best.steps[-1].x))
        values = _named(solution.parameters, np.array(chain.steps[-1].parameters))
        own = [p.name for p in solution.parameters if not p.experiments]
        shown = ", ".join(f"{name} = {values[name]:.7g}" for name in own)
        if equal_j(chain.steps[-1].j, best.steps[-1].j) and apart > APART:
            said.append(f"Start {chain.start + 1} found an equal J elsewhere: {shown}.")
        elif len(chain.steps) == len(best.steps):
            said.append(
                f"Start {chain.start + 1} ended in another minimum, "
                f"J = {chain.steps[-1].j:.4g}: {shown}."
            )
    return said
