"""What the data determine: from an objective and a solution to `Knowledge`.

Most likely point, other minima, profiles of every parameter and derived output, directions that
the data do not see, verdicts. Generic: it knows rows, parameters and outputs, no oscillator.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.fit.likelihood.descent import Optimum, most_likely
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective, evaluate_many
from fitting.inference.likelihood import identifiability
from fitting.inference.likelihood.bootstrap import bootstrap as bootstrap_of
from fitting.inference.likelihood.exploration import (
    OTHER_STARTS,
    Exploration,
    explore,
    other_minima,
)
from fitting.inference.likelihood.knowledge import Effort, Equivalent, Knowledge
from fitting.inference.likelihood.profiles import ROOT_95, ProfilePoint
from fitting.inference.likelihood.ranges import OutputRange, output_ranges
from fitting.inference.verdicts import profiles as profiles_of
from fitting.text.arrays import FloatArray

#: Decrease of chi square along a profile from which the search begins anew at the better point.
BETTER = 1.0
#: Evaluations at most, by default.
BUDGET = 12000


@dataclass(frozen=True, kw_only=True)
class InferenceOptions:
    """What is asked of the inference: units of outputs, seed, evaluations at most, bootstrap.

    `others` are search vectors to begin at besides; `alternatives` points of other models that fit
    as well. Without `data` the measurements are taken to be what the model says at the solution.
    `bootstrap` synthetic data sets are fitted anew, through `executor` if there is one. `only`
    names the values that are profiled (all, if empty); other minima are looked
    for from `starts` seeded points. `widening`: by how much the noise of a sweep was taken
    wider because its residuals hang together.
    """

    units: Mapping[str, str] = field(default_factory=dict)
    seed: int = 1
    budget: int = BUDGET
    others: Sequence[FloatArray] = ()
    alternatives: tuple[Equivalent, ...] = ()
    data: bool = True
    bootstrap: int = 0
    executor: Executor | None = None
    only: tuple[str, ...] = ()
    starts: int = OTHER_STARTS
    directions: bool = True
    widening: float = 1.0


def determine(
    objective: Objective,
    solution: FloatArray,
    noise: RowNoise,
    options: InferenceOptions | None = None,
) -> Knowledge:
    """Verdict, interval and profile for every parameter and derived output.

    Args:
        objective: response, parameters and data.
        solution: search vector where the search begins, e.g. the end of Algorithm 2.
        noise: of the rows.
        options: units, seed, limits.

    Raises:
        FmuFailure: the model failed at more points of the box than can be left out.
    """
    options = options or InferenceOptions()
    parameters = objective.parameters
    ranges = output_ranges(objective.response, parameters, options.seed, [solution])
    likelihood = likelihood_of(objective, noise.sigma, noise.common, tuple(ranges))
    if not options.data:
        [point] = evaluate_many(objective, [solution])
        likelihood = replace(likelihood, shift=point.residuals)
    evaluator = LikelihoodEvaluator(likelihood, options.budget)
    optimum = most_likely(evaluator, [solution, *options.others])
    found = _explored(evaluator, optimum, ranges, options)
    optimum = found.optimum
    equivalents = (*identifiability.equivalents(found), *options.alternatives)
    profiles = profiles_of(found, equivalents, options.units)
    if options.only:  # what nobody asked for was not walked: nothing is said of it
        profiles = {name: p for name, p in profiles.items() if name in options.only}
    directions = identifiability.directions(evaluator, optimum) if options.directions else ()
    idle = identifiability.without_effect(evaluator, optimum, profiles)
    resampled = None
    if options.bootstrap > 1:
        resampled = bootstrap_of(
            optimum, profiles, options.bootstrap, options.seed, options.executor
        )
    spent = Effort(evaluator.evaluations, evaluator.derived, evaluator.runs)
    named = [p.name for p in parameters]
    return Knowledge(
        data=options.data,
        chi_square=optimum.chi_square,
        freedom=optimum.degrees_of_freedom,
        inflation=optimum.likelihood.inflation,
        parameters={name: p for name, p in profiles.items() if name in named},
        derived={name: p for name, p in profiles.items() if name not in named},
        directions=directions,
        without_effect=idle,
        equivalents=equivalents,
        sentences=identifiability.sentences(
            optimum, profiles, directions, idle, equivalents, options.widening
        ),
        effort=spent,
        bootstrap=resampled,
    )


def _explored(
    evaluator: LikelihoodEvaluator,
    optimum: Optimum,
    ranges: Mapping[str, OutputRange],
    options: InferenceOptions,
) -> Exploration:
    """Other minima, then profiles around the best; once more, should they come by a better one."""
    minima = other_minima(evaluator, optimum, options.seed, options.starts)
    begin = _better(optimum, minima)
    if begin is not None:
        optimum, minima = _moved(evaluator, optimum, begin, minima)
    found = explore(evaluator, optimum, ranges, minima, options.only)
    begin = _better(optimum, found.points)
    if begin is None:
        return found
    optimum, minima = _moved(evaluator, optimum, begin, minima)
    return explore(evaluator, optimum, ranges, minima, options.only)


def _better(optimum: Optimum, points: Sequence[ProfilePoint]) -> ProfilePoint | None:
    """A point that is clearly more likely, or as likely with a value for every output.

    Where an output exists at the optimum it has to exist at the better point.
    """
    exists = np.isfinite(optimum.expansion.sample.outputs)
    possible = [s for s in points if s.outputs.size == 0 or np.all(np.isfinite(s.outputs[exists]))]
    lowest = min(possible, key=lambda point: point.delta, default=None)
    if lowest is not None and lowest.delta < -BETTER:
        return lowest
    if np.all(exists):
        return None
    whole = [s for s in possible if s.delta < BETTER and s.outputs.size == exists.size]
    whole = [s for s in whole if np.all(np.isfinite(s.outputs))]
    return min(whole, key=lambda point: point.delta, default=None)


def _moved(
    evaluator: LikelihoodEvaluator,
    optimum: Optimum,
    begin: ProfilePoint,
    minima: Sequence[ProfilePoint],
) -> tuple[Optimum, tuple[ProfilePoint, ...]]:
    """The optimum at a better point, and the other minima, their chi square counted from there."""
    again = most_likely(evaluator, [begin.x])
    gain = optimum.least - again.least
    moved = replace(
        again,
        chi_square=optimum.chi_square - gain * optimum.likelihood.inflation**2,
        degrees_of_freedom=optimum.degrees_of_freedom,
    )
    fitting = [replace(point, delta=point.delta + gain) for point in minima]
    return moved, tuple(point for point in fitting if point.delta <= ROOT_95**2)
