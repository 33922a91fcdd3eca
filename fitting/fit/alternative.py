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

from fitting.campaign.parameters import search_bounds, to_model
from fitting.fit.interior_point import inside
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import RowNoise, noise_of, shared
from fitting.fit.objective import Counts, Evaluator, Objective, Point, evaluate_many
from fitting.fit.optimum import Optimum, most_likely
from fitting.fit.options import Schedule
from fitting.fit.outputs import mean
from fitting.fit.path import named, own_start
from fitting.fit.search import Minimum, SearchResult, lowest, search_box
from fitting.fit.twins import Twin, find_twins
from fitting.signal.least_squares import damped_step
from fitting.text.arrays import FloatArray, Scalar

_log = logging.getLogger(__name__)

#: Jacobians by central differences after which a search begins no further round; one that only
#: confirms that a campaign's own start is the best has one round.
BUDGET = 300
#: Minima of a search that are followed to the last digits.
LOWEST = 2
#: Chi square that the last step across the whole box costs: along what the data leave open it goes
#: nowhere.
LAST_DAMPING = 0.1
#: Difference of chi square below which two fits are the same but for rounding.
EQUAL = 1e-2


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The most likely point of one alternative, `x` (n,), and what was searched.

    `converged` where no linearised step promises a decrease of chi square; `interrupted` where the
    user stopped it. `search` is that of the box, with its `minima`, the lowest first; None where
    none was made. `twins` are the exact symmetries of the model.
    """

    objective: Objective
    x: FloatArray
    converged: bool = False
    interrupted: bool = False
    search: SearchResult | None = None
    minima: tuple[Minimum, ...] = ()
    twins: tuple[Twin, ...] = ()
    counts: Counts = field(default_factory=Counts)


@dataclass(frozen=True, kw_only=True)
class StartResult:
    """A minimum: the start of the first search that led to it, and their number `descents`.

    `chi_square` by the stated noise; `equivalent`: whether it is no higher than the lowest.
    """

    begun: Mapping[str, float]
    parameters: Mapping[str, float]
    chi_square: float
    descents: int
    equivalent: bool


@dataclass(frozen=True, kw_only=True)
class AlternativeResult:
    """One discrete alternative at its most likely point.

    `chi_square` by the noise of the reported one; `starts`: minima of its search, which is None
    without one.
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
    objective: Objective, schedule: Schedule, others: Sequence[Outcome] = ()
) -> Outcome:
    """The most likely point of one alternative.

    A KeyboardInterrupt ends it with what is finished and `interrupted` set.

    Args:
        objective: response, parameters and data.
        schedule: number of starts, and seed of the search.
        others: alternatives that are done. The image of one that mirrors this one exactly is used:
            nothing is searched again.

    Raises:
        FmuFailure: the model failed inside the box.
    """
    parameters = objective.parameters
    outcome = Outcome(objective=objective, x=own_start(parameters))
    try:
        for other in others:
            evaluator = Evaluator(other.objective)
            mirrors = find_twins(evaluator, schedule.seed, objective)
            outcome = replace(outcome, counts=outcome.counts + evaluator.counts)
            image = _image(outcome, other, mirrors[0]) if mirrors else None
            if image is not None:
                return image
        evaluator = Evaluator(objective)
        twins = tuple(find_twins(evaluator, schedule.seed))
        outcome = replace(outcome, twins=twins, counts=outcome.counts + evaluator.counts)
        # of ends that are as likely, as along an open valley, that from the reference is reported
        reference = inside(np.zeros(len(parameters)), *search_bounds(parameters))
        outcome, optimum, point = _descend(outcome, [reference, outcome.x])
        is_wide = optimum.likelihood.inflation > 1.0
        if schedule.starts == 1 and not is_wide and not objective.data.unexplained(point.residuals):
            return outcome
        stated = LikelihoodEvaluator(optimum.likelihood.stated)
        rows = stated.one(outcome.x).rows
        own = float(rows @ rows)
        budget = BUDGET * (2 * len(parameters) + 1) if schedule.starts > 1 else 0
        minima, search = search_box(stated, [outcome.x], schedule.seed, budget)
        _log.info(
            "box searched from %d points by %d descents, %d minima, %d evaluations",
            *(search.screened, search.descents, len(minima), search.evaluations),
        )
        spent = Counts(evaluations=search.evaluations, runs=search.fmu_runs)
        search = replace(search, twins=len(twins))
        outcome = replace(outcome, search=search, minima=minima, counts=outcome.counts + spent)
        lower = [m.x for m in minima[:LOWEST] if m.chi_square < own - EQUAL * (1.0 + own)]
        return _descend(outcome, lower)[0] if lower else outcome
    except KeyboardInterrupt:
        return replace(outcome, interrupted=True)


def _descend(outcome: Outcome, begins: Sequence[FloatArray]) -> tuple[Outcome, Optimum, Point]:
    """The outcome at the lowest end of descents from some places; its optimum and its point."""
    objective = outcome.objective
    [point] = evaluate_many(objective, begins[:1])
    noise = noise_of(objective, point)
    # a start may be anywhere: what rows share is that of a model that fits
    common = shared(objective.data, np.zeros(point.residuals.size))
    stated = likelihood_of(objective, replace(noise, common=common))
    evaluator = LikelihoodEvaluator(stated)
    optimum = most_likely(evaluator, begins)
    # descents end where a step promises little: that little is taken, too
    here, width = optimum.expansion, stated.widths
    room = (stated.lower - here.x) / width, (stated.upper - here.x) / width
    step = width * damped_step(here.matrix * width, here.sample.rows, LAST_DAMPING, room)
    ends = evaluate_many(objective, [stated.folded(here.x), stated.folded(here.x + step)])
    end = min(ends, key=lambda each: float(np.sum(optimum.likelihood.rows(each) ** 2)))
    runs = evaluator.runs + point.runs + sum(each.runs for each in ends)
    spent = Counts(evaluator.evaluations + 1 + len(ends), 0, runs)
    counts = outcome.counts + spent
    return replace(outcome, x=end.x, converged=optimum.converged, counts=counts), optimum, end


def _image(own: Outcome, other: Outcome, mirror: Twin) -> Outcome | None:
    """The outcome of an alternative as that of the one which mirrors it; None outside the box."""
    parameters = own.objective.parameters
    x = mirror.of(parameters, other.x)
    if x is None:
        return None
    _log.info("mirrors an alternative that is done")
    minima = []
    for minimum in other.minima:
        place, start = mirror.of(parameters, minimum.x), mirror.of(parameters, minimum.start)
        if place is not None:
            minima.append(
                replace(minimum, x=place, start=minimum.start if start is None else start)
            )
    search = None if other.search is None else replace(other.search, evaluations=0, fmu_runs=0)
    return replace(
        other, objective=own.objective, x=x, search=search, minima=tuple(minima), counts=own.counts
    )


def with_values(outcome: Outcome) -> Outcome:
    """The outcome where every derived output has a value, among places of one chi square.

    Images of its end by the model's symmetries come first, then other minima of its search.

    Args:
        outcome: that is done.
    """
    level = [m.x for m in outcome.minima if m.chi_square <= outcome.minima[0].chi_square + EQUAL]
    images = [twin.of(outcome.objective.parameters, outcome.x) for twin in outcome.twins]
    for x in [outcome.x, *(image for image in images if image is not None), *level]:
        if is_complete(outcome.objective, x):
            return replace(outcome, x=x)
    return outcome


def is_complete(objective: Objective, x: FloatArray) -> bool:
    """Whether every derived output has a value at a place.

    Args:
        objective: whose outputs they are.
        x: search vector (n,).
    """
    [outputs] = objective.response.derived_many([to_model(objective.parameters, x)])
    return all(bool(np.all(np.isfinite(values))) for values in outputs.values())


def chi_squares(outcomes: Sequence[Outcome]) -> tuple[list[float], list[Point]]:
    """Chi square of every alternative, by the noise of the first; and the points.

    Args:
        outcomes: of the alternatives.

    Raises:
        FmuFailure: the model failed at the end of one.
    """
    noise: RowNoise | None = None
    values, points = [], []
    for outcome in outcomes:
        [point] = evaluate_many(outcome.objective, [outcome.x])
        noise = noise or noise_of(outcome.objective, point)
        rows = likelihood_of(outcome.objective, noise).rows(point)
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
    outcomes: Sequence[Outcome], settings: Sequence[Mapping[str, Scalar]]
) -> tuple[AlternativeResult, ...]:
    """One record per alternative, that of the best one marked as reported.

    Args:
        outcomes: what came of each alternative.
        settings: of each alternative, by name.

    Raises:
        FmuFailure: the model failed at the end of one.
    """
    values, points = chi_squares(outcomes)
    reported = best_alternative(values, [is_complete(o.objective, o.x) for o in outcomes])
    results = []
    for k, outcome in enumerate(outcomes):
        parameters = outcome.objective.parameters
        [outputs] = outcome.objective.response.derived_many([points[k].parameters])
        low = lowest(outcome.minima)
        starts = [
            StartResult(
                begun=named(parameters, to_model(parameters, minimum.start)),
                parameters=named(parameters, to_model(parameters, minimum.x)),
                chi_square=minimum.chi_square,
                descents=minimum.descents,
                equivalent=any(minimum is each for each in low),
            )
            for minimum in outcome.minima
        ]
        results.append(
            AlternativeResult(
                settings=dict(settings[k]),
                parameters=named(parameters, points[k].parameters),
                derived={name: mean(each) for name, each in outputs.items()},
                chi_square=values[k],
                j_fit=points[k].j_fit,
                converged=outcome.converged,
                reported=k == reported,
                equal_to_best=values[k] <= values[reported] + EQUAL * (1.0 + values[reported]),
                starts=tuple(starts),
                search=outcome.search,
            )
        )
    return tuple(results)
