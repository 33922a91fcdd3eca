"""One discrete alternative: the most likely point, from the campaign's values and from a search.

Chi square is lowered from the reference and from the campaign's start. Further starts are the
lowest minima of a search of the box; with one start the box is searched only where noise does not
explain what these descents leave.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.campaign.parameters import Parameter, search_bounds, to_model
from fitting.fit.evaluator import Counts, Evaluator
from fitting.fit.interior_point import inside
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of, likelihood_with
from fitting.fit.noise import RowNoise, noise_of, shared
from fitting.fit.objective import Objective, Point, evaluate_many
from fitting.fit.optimum import Optimum, most_likely
from fitting.fit.outputs import mean
from fitting.fit.path import Schedule, named, own_start
from fitting.fit.search.minima import Minimum, Search, search_box
from fitting.fit.search.twins import Twin, find_twins
from fitting.signal.least_squares import damped_step
from fitting.text.arrays import FloatArray, Scalar

_log = logging.getLogger(__name__)

#: Jacobians by central differences after which a search begins no further screen; one that only
#: confirms that a campaign's own start is the best has one screen.
BUDGET = 300
#: Minima of a search that are followed to the last digits.
LOWEST = 2
#: Chi square that the last step across the whole box costs: along what the data leave open it goes
#: nowhere.
LAST_DAMPING = 0.1
#: Difference of chi square below which two fits are the same but for rounding.
EQUAL = 1e-2


@dataclass(frozen=True)
class Outcome:
    """The most likely point of one alternative, `x` (n,), and what was looked for besides.

    `converged` where no linearised step promises a decrease of chi square; `interrupted` where the
    user stopped it. `search` is that of the box, None where none was made; `twins` are the exact
    symmetries of the model.
    """

    x: FloatArray
    converged: bool = False
    interrupted: bool = False
    search: Search | None = None
    twins: tuple[Twin, ...] = ()
    counts: Counts = field(default_factory=Counts)


@dataclass(frozen=True)
class Solved:
    """An alternative that is done: its objective and its outcome."""

    objective: Objective
    outcome: Outcome


@dataclass(frozen=True, kw_only=True)
class StartResult:
    """Where descents led: from where the first began (canonical values), and how many ended there.

    `chi_square` by the noise as it is stated, `equivalent` where that is no higher than the lowest.
    """

    begun: Mapping[str, float]
    parameters: Mapping[str, float]
    chi_square: float
    descents: int
    equivalent: bool


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """How a box was searched in one alternative.

    `screened` points of the box were looked at in `screens` rounds (screens, scans along its edges,
    evolutions), `descents` begun from the best of them. `explained`: whether noise explains the
    lowest; `twins` number of exact symmetries of the model.
    """

    screened: int
    screens: int
    descents: int
    explained: bool
    twins: int
    evaluations: int
    fmu_runs: int


@dataclass(frozen=True, kw_only=True)
class AlternativeResult:
    """One discrete alternative at its most likely point; `equal_to_best` within `EQUAL`.

    `chi_square` by the noise of the reported one; `starts` are the minima of its search, which is
    None where the box was not searched.
    """

    settings: Mapping[str, Scalar]
    parameters: Mapping[str, float]
    derived: Mapping[str, float]
    chi_square: float
    j_fit: float
    converged: bool
    reported: bool
    equal_to_best: bool
    starts: tuple[StartResult, ...]
    search: SearchResult | None = None


def search_alternative(
    objective: Objective, schedule: Schedule, solved: Sequence[Solved] = ()
) -> Outcome:
    """The most likely point of one alternative.

    A KeyboardInterrupt ends it with what is finished and `interrupted` set.

    Args:
        objective: response, parameters and data.
        schedule: number of starts, and seed of the search.
        solved: alternatives that are done. The image of one that mirrors this one exactly is taken
            over: nothing is searched again.

    Raises:
        FmuFailure: the model failed inside the box.
    """
    outcome = Outcome(own_start(objective.parameters))
    try:
        for other in solved:
            evaluator = Evaluator(other.objective)
            mirrors = find_twins(evaluator, schedule.seed, objective)
            outcome = replace(outcome, counts=outcome.counts + evaluator.counts)
            image = _image(objective, outcome, other.outcome, mirrors[0]) if mirrors else None
            if image is not None:
                return image
        evaluator = Evaluator(objective)
        twins = find_twins(evaluator, schedule.seed)
        outcome = replace(outcome, twins=tuple(twins), counts=outcome.counts + evaluator.counts)
        # of ends that are as likely, as along an open valley, that from the reference is reported
        begins = [_reference(objective.parameters), outcome.x]
        outcome, optimum, point = _lowered(objective, outcome, begins)
        explained = optimum.likelihood.inflation == 1.0 and not objective.data.unexplained(
            point.residuals
        )
        if schedule.starts > 1 or not explained:
            budget = BUDGET * (2 * len(begins[0]) + 1) if schedule.starts > 1 else 0
            outcome = _searched(objective, outcome, optimum, schedule.seed, budget)
    except KeyboardInterrupt:
        return replace(outcome, interrupted=True)
    return outcome


def _reference(parameters: Sequence[Parameter]) -> FloatArray:
    """Search vector of the reference, strictly inside the box."""
    return inside(np.zeros(len(parameters)), *search_bounds(parameters))


def _lowered(
    objective: Objective, outcome: Outcome, begins: Sequence[FloatArray]
) -> tuple[Outcome, Optimum, Point]:
    """The outcome at the lowest end of descents from some places; its optimum and its point."""
    [point] = evaluate_many(objective, begins[:1])
    noise = noise_of(objective, point)
    # a start may be anywhere: what rows share is that of a model that fits
    common = shared(objective.data, np.zeros(point.residuals.size))
    stated = likelihood_of(objective, noise.sigma, common)
    evaluator = LikelihoodEvaluator(replace(stated, scatter=noise.scatter))
    optimum = most_likely(evaluator, begins)
    here, width = optimum.expansion, stated.widths
    room = (stated.lower - here.x) / width, (stated.upper - here.x) / width
    step = width * damped_step(here.matrix * width, here.sample.rows, LAST_DAMPING, room)
    places = [stated.folded(here.x), stated.folded(here.x + step)]
    # descents end where a step promises little: that little is taken, too
    ends = evaluate_many(objective, places)
    squares = [float(np.sum(optimum.likelihood.rows(end) ** 2)) for end in ends]
    x, end = min(zip(places, ends, squares, strict=True), key=lambda each: each[2])[:2]
    runs = evaluator.runs + point.runs + sum(each.runs for each in ends)
    spent = Counts(evaluator.evaluations + 1 + len(ends), 0, runs)
    counts = outcome.counts + spent
    return replace(outcome, x=x, converged=optimum.converged, counts=counts), optimum, end


def _searched(
    objective: Objective, outcome: Outcome, optimum: Optimum, seed: int, budget: int
) -> Outcome:
    """The outcome with a search of the box, at the lowest of all minima."""
    evaluator = LikelihoodEvaluator(optimum.likelihood.stated)
    rows = evaluator.one(outcome.x).rows
    own = float(rows @ rows)
    search = search_box(evaluator, [outcome.x], seed, budget)
    _log.info(
        "box searched from %d points by %d descents, %d minima, %d evaluations",
        *(search.screened, search.descents, len(search.minima), search.evaluations),
    )
    spent = Counts(evaluations=search.evaluations, runs=search.runs)
    outcome = replace(outcome, search=search, counts=outcome.counts + spent)
    lowest = [m.x for m in search.minima[:LOWEST] if m.chi_square < own - EQUAL * (1.0 + own)]
    return _lowered(objective, outcome, lowest)[0] if lowest else outcome


def _image(objective: Objective, own: Outcome, other: Outcome, mirror: Twin) -> Outcome | None:
    """The outcome of an alternative as that of the one which mirrors it; None outside the box."""
    parameters = objective.parameters
    x = mirror.of(parameters, other.x)
    if x is None:
        return None
    _log.info("mirrors an alternative that is done")
    search = other.search
    if search is not None:
        minima = [
            replace(minimum, x=place, begun=minimum.begun if begun is None else begun)
            for minimum in search.minima
            if (place := mirror.of(parameters, minimum.x)) is not None
            for begun in [mirror.of(parameters, minimum.begun)]
        ]
        search = replace(search, minima=tuple(minima), evaluations=0, runs=0, mirrored=True)
    return replace(other, x=x, search=search, counts=own.counts)


def with_values(objective: Objective, outcome: Outcome) -> Outcome:
    """The outcome where every derived output has a value, among places of one chi square.

    Images of its end by the model's symmetries come first, then other minima of its search.

    Args:
        objective: of the alternative.
        outcome: that is done.
    """
    minima = () if outcome.search is None else outcome.search.minima
    level = [m.x for m in minima if m.chi_square <= minima[0].chi_square + EQUAL]
    images = [twin.of(objective.parameters, outcome.x) for twin in outcome.twins]
    places = [outcome.x, *(x for x in images if x is not None), *level]
    if is_complete(objective, outcome.x):
        return outcome
    chosen = next((x for x in places[1:] if is_complete(objective, x)), outcome.x)
    return replace(outcome, x=chosen)


def is_complete(objective: Objective, x: FloatArray) -> bool:
    """Whether every derived output has a value at a place.

    Args:
        objective: whose outputs they are.
        x: search vector (n,).
    """
    [outputs] = objective.response.derived_many([to_model(objective.parameters, x)])
    return all(bool(np.all(np.isfinite(values))) for values in outputs.values())


def distances(parameters: Sequence[Parameter], x: FloatArray, y: FloatArray) -> FloatArray:
    """Differences of two search vectors, (n,), periodic ones modulo their period.

    Args:
        parameters: the fitted parameters.
        x: search vector (n,).
        y: another search vector (n,).
    """
    gap = np.abs(x - y)
    for i, parameter in enumerate(parameters):
        if parameter.period is not None:
            period = parameter.period / parameter.scale
            rest = float(np.mod(gap[i], period))
            gap[i] = min(rest, period - rest)
    return gap


def chi_squares(
    objectives: Sequence[Objective], outcomes: Sequence[Outcome]
) -> tuple[list[float], list[Point]]:
    """Chi square of every alternative, by the noise of the first; and the points.

    Args:
        objectives: one per alternative.
        outcomes: what came of each, in the same order.

    Raises:
        FmuFailure: the model failed at the end of one.
    """
    noise: RowNoise | None = None
    values, points = [], []
    for objective, outcome in zip(objectives, outcomes, strict=True):
        [point] = evaluate_many(objective, [outcome.x])
        noise = noise or noise_of(objective, point)
        rows = likelihood_with(objective, noise).rows(point)
        values.append(float(rows @ rows))
        points.append(point)
    return values, points


def best_alternative(values: Sequence[float], complete: Sequence[bool]) -> int:
    """Index of the least chi square.

    Between equal ones those decide at which every output has a value, then the campaign's order.

    Args:
        values: chi square of every alternative.
        complete: whether every derived output has a value there.
    """
    least = min(values)
    level = [k for k, value in enumerate(values) if value <= least + EQUAL * (1.0 + least)]
    return next((k for k in level if complete[k]), level[0])


def alternative_results(
    objectives: Sequence[Objective],
    outcomes: Sequence[Outcome],
    settings: Sequence[Mapping[str, Scalar]],
    reported: int,
) -> tuple[AlternativeResult, ...]:
    """One record per alternative, the reported one marked.

    Args:
        objectives: one per alternative.
        outcomes: what came of each alternative, in the same order.
        settings: of each alternative, by name.
        reported: number of the alternative that is reported.
    """
    values, points = chi_squares(objectives, outcomes)
    enough = values[reported] + EQUAL * (1.0 + values[reported])
    results = []
    for k, (objective, outcome) in enumerate(zip(objectives, outcomes, strict=True)):
        [outputs] = objective.response.derived_many([points[k].parameters])
        search = outcome.search
        results.append(
            AlternativeResult(
                settings=dict(settings[k]),
                parameters=named(objective.parameters, points[k].parameters),
                derived={name: mean(each) for name, each in outputs.items()},
                chi_square=values[k],
                j_fit=points[k].j_fit,
                converged=outcome.converged,
                reported=k == reported,
                equal_to_best=values[k] <= enough,
                starts=_starts(objective.parameters, search),
                search=None if search is None else _search(search, len(outcome.twins)),
            )
        )
    return tuple(results)


def _starts(parameters: Sequence[Parameter], search: Search | None) -> tuple[StartResult, ...]:
    if search is None:
        return ()
    low, _ = search.apart_by_height()

    def shown(x: FloatArray) -> dict[str, float]:
        return named(parameters, to_model(parameters, x))

    def result(minimum: Minimum) -> StartResult:
        return StartResult(
            begun=shown(minimum.begun),
            parameters=shown(minimum.x),
            chi_square=minimum.chi_square,
            descents=minimum.descents,
            equivalent=any(minimum is each for each in low),
        )

    return tuple(map(result, search.minima))


def _search(search: Search, twins: int) -> SearchResult:
    return SearchResult(
        screened=search.screened,
        screens=search.screens,
        descents=search.descents,
        explained=search.explained,
        twins=twins,
        evaluations=search.evaluations,
        fmu_runs=search.runs,
    )
