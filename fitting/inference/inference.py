"""What the data determine: from an objective and a solution to `Knowledge`.

Most likely point, other minima, profiles of every parameter and derived output, directions that
the data do not see, verdicts. Generic: it knows rows, parameters and outputs, no oscillator.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from fitting.campaign.parameters import Parameter
from fitting.fit.assembly import Solution, verdict_sentences
from fitting.fit.noise import RowNoise, noise_of
from fitting.fit.objective import Objective, evaluate_many
from fitting.fit.result import IDENTIFIABLE, DerivedResult, ParameterResult, Result
from fitting.inference import identifiability
from fitting.inference.bootstrap import bootstrap as bootstrap_of
from fitting.inference.descent import Optimum, most_likely
from fitting.inference.equivalent_fits import (
    exchange_reasons,
    is_reason,
    reason_sentences,
    with_lower_verdicts,
)
from fitting.inference.exploration import OTHER_STARTS, Exploration, explore, other_minima
from fitting.inference.knowledge import Effort, Equivalent, Knowledge, Profile
from fitting.inference.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.inference.nu_choice import choose_nu
from fitting.inference.profiles import ROOT_95, ProfilePoint
from fitting.inference.ranges import OutputRange, output_ranges
from fitting.inference.verdicts import profiles as profiles_of
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure

Valued = TypeVar("Valued", ParameterResult, DerivedResult)

#: Decrease of chi square along a profile from which the search begins anew at the better point.
BETTER = 1.0
#: Evaluations at most, by default.
BUDGET = 12000


@dataclass(frozen=True)
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


def know(
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


def inform(
    result: Result, solution: Solution, *, budget: int = BUDGET, bootstrap: int = 0
) -> Result:
    """The result with what the data determine: verdicts and intervals are those of the profiles.

    A failure or an interruption on the way costs the profiles, not the result: it then keeps its
    linearised errors, and a warning says so.
    """
    objective, chosen = solution.objective, solution.final
    noise = noise_at(solution)
    options = InferenceOptions(
        {name: d.unit for name, d in result.derived.items()},
        result.provenance.seed,
        budget,
        alternatives=_alternatives(result),
        bootstrap=bootstrap,
        widening=1.0 if solution.structure is None else solution.structure.widening,
        only=(*result.parameters, *result.derived),  # what one experiment holds has a table
    )
    try:
        knowledge = know(objective, chosen.x, noise, options)
        plain = likelihood_of(objective, noise.sigma, noise.common)
        nu = choose_nu(plain, solution.chain.steps, result.history)
    except KeyboardInterrupt:
        return _warned(result, "Interrupted before the profiles were done")
    except FmuFailure as failure:
        return _warned(result, f"The FMU failed while profiles were walked ({failure})")
    return informed(result, replace(knowledge, nu=nu), objective.parameters)


def noise_at(solution: Solution) -> RowNoise:
    """Noise of the rows at a solution; a sweep whose residuals hang together weighs less."""
    noise = noise_of(solution.objective, solution.final)
    if solution.structure is None:
        return noise
    sigma = noise.sigma.copy()
    sigma[solution.objective.data.curve_rows] *= solution.structure.widening
    return RowNoise(sigma, noise.common)


def _alternatives(result: Result) -> tuple[Equivalent, ...]:
    """Alternatives of the model that reach the same J."""
    found = []
    for other in result.alternatives:
        if other.reported or not other.equal_to_best:
            continue
        settings = ", ".join(f"{name} = {value}" for name, value in other.settings.items())
        values = ", ".join(f"{name} = {value:.5g}" for name, value in other.parameters.items())
        found.append(
            Equivalent(
                other.parameters,
                other.derived,
                float("nan"),
                "alternative",
                f"{settings} with {values} reaches the same J",
                settings,
            )
        )
    return tuple(found)


def informed(result: Result, knowledge: Knowledge, fitted: Sequence[Parameter] = ()) -> Result:
    """The result whose verdicts, shrinkages and intervals are those of the profiles."""
    before = verdict_sentences({**result.parameters, **result.derived})
    parameters = {
        name: _of_profile(value, knowledge.parameters.get(name))
        for name, value in result.parameters.items()
    }
    derived = {
        name: _of_profile(value, knowledge.derived.get(name))
        for name, value in result.derived.items()
    }
    reasons = {n: p.reason for n, p in knowledge.profiles.items() if is_reason(p.reason)}
    missed = exchange_reasons({**parameters, **derived}, fitted, result.alternatives)
    parameters, derived = with_lower_verdicts(parameters, derived, missed)
    rest = [said for said in result.warnings if said not in before and not is_reason(said)]
    verdicts = verdict_sentences({**parameters, **derived})
    warnings = (*verdicts, *reason_sentences({**reasons, **missed}), *rest)
    return replace(
        result, parameters=parameters, derived=derived, warnings=warnings, knowledge=knowledge
    )


def _of_profile(value: Valued, profile: Profile | None) -> Valued:
    """A value with the verdict, shrinkage and interval of its profile."""
    if profile is None:
        return value
    low, high = profile.interval95
    open_ = profile.verdict == IDENTIFIABLE[2]
    std = value.std if math.isfinite(value.std) else (high - low) / (2.0 * ROOT_95)
    return replace(
        value,
        std=math.nan if open_ else std,
        ci95=(low, high),
        shrinkage=profile.shrinkage,
        identifiable=profile.verdict,
    )


def _warned(result: Result, why: str) -> Result:
    said = f"{why}: intervals and verdicts are those of the linearised problem."
    return replace(result, warnings=(*result.warnings, said))
