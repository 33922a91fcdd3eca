"""What the data determine: from an objective and a solution to `Determined`.

Most likely point, other minima, profiles of every parameter and derived output, directions that
the data do not see, verdicts. Generic: it knows rows, parameters and outputs, no oscillator.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.campaign.parameters import canonical, outside_box, to_model
from fitting.fit.fit import Status
from fitting.fit.likelihood.descent import Optimum, let_out, most_likely
from fitting.fit.likelihood.likelihood import (
    LikelihoodEvaluator,
    Spent,
    likelihood_of,
)
from fitting.fit.likelihood.lockstep import Exhausted, Request
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective, evaluate_many
from fitting.fit.search.minima import DESCENTS, SCREENED, screened
from fitting.fit.search.twins import Twin, find_twins, twins_but_for_priors
from fitting.fit.solver.evaluator import Evaluator
from fitting.inference.adequacy import adequacy_of, ending_of, is_redundant
from fitting.inference.budget import Stage, usual_budget
from fitting.inference.equivalent_fits import sampling_findings
from fitting.inference.likelihood import identifiability
from fitting.inference.likelihood.bootstrap import bootstrap as bootstrap_of
from fitting.inference.likelihood.exploration import (
    OTHER_STARTS,
    Exploration,
    Extent,
    cut_sides,
    explore,
    extended,
    other_minima,
)
from fitting.inference.likelihood.identifiability import with_values_nearby
from fitting.inference.likelihood.knowledge import (
    Adequacy,
    Determined,
    Effort,
    Equivalent,
    Knowledge,
)
from fitting.inference.likelihood.outside import (
    Model,
    Surroundings,
    beyond,
    beyond_findings,
    held_findings,
    mirrored,
    taken_in,
    with_boxes,
)
from fitting.inference.likelihood.profiles import EXCLUDED, ProfilePoint
from fitting.inference.likelihood.ranges import OutputRange, output_ranges
from fitting.inference.verdicts import Basis
from fitting.inference.verdicts import profiles as profiles_of
from fitting.signal.residual_tests import Structure
from fitting.text.arrays import FloatArray
from fitting.text.error_bars import ROOT_95
from fitting.text.errors import OutOfBudget
from fitting.text.estimate import OutputEstimate, ParameterEstimate
from fitting.text.notation import span

_log = logging.getLogger(__name__)

#: Decrease of chi square along a profile from which the search begins anew at the better point.
BETTER = 1.0
#: Share of the evaluations for other minima and for the ends of ranges.
FOR_MINIMA = 0.25
#: Share of those that are left for walks of a model that does not describe the data: to find a
#: better point, and, once one was found, for a look around it.
FOR_MISFIT, FOR_A_LOOK = 0.1, 0.02


@dataclass(frozen=True, kw_only=True)
class Limits:
    """How much is spent on what data determine, and who is told.

    `budget` is of simulation runs, None the usual one; `bootstrap` synthetic data sets are fitted
    anew; `progress` is told how far it is, the stages those of `fitting.inference.budget`.
    """

    budget: int | None = None
    bootstrap: int = 0
    progress: Callable[[Spent], None] = lambda spent: None


@dataclass(frozen=True, kw_only=True)
class InferenceOptions(Limits):
    """What is asked of the inference: units of outputs, seed, limits.

    `others` are search vectors to begin at besides; `alternatives`
    points of other models that fit as well; `twins` are the model's exact symmetries, looked for if
    None. Without `data` the measurements are taken to be what the model says at the solution.
    Synthetic data sets are fitted anew through `executor` if there is one. `only`
    names the values that are profiled (all, if empty); other minima are looked for from `starts`
    seeded points. `beyond`: whether fits beyond the box are looked for. `structure` is that of the
    residuals of curves, by which their noise was taken wider. `closer` is another form of a line
    that leaves far less of a sweep than the model, `scale_off` the factor by which the scale of
    peaks may be off for the top of its sweep. `models` are the alternatives among which exact twins
    beyond the box are looked for.
    """

    units: Mapping[str, str] = field(default_factory=dict)
    seed: int = 1
    others: Sequence[FloatArray] = ()
    minima: Sequence[FloatArray] = ()
    twins: Sequence[Twin] | None = None
    alternatives: tuple[Equivalent, ...] = ()
    data: bool = True
    executor: Executor | None = None
    only: tuple[str, ...] = ()
    starts: int = OTHER_STARTS
    directions: bool = True
    beyond: bool = True
    structure: Structure | None = None
    closer: Adequacy | None = None
    scale_off: float = math.nan
    models: tuple[Model, ...] = ()


def determine(
    objective: Objective,
    solution: FloatArray,
    noise: RowNoise,
    options: InferenceOptions | None = None,
) -> Determined:
    """Verdict, interval and profile for every parameter and derived output.

    Args:
        objective: response, parameters and data.
        solution: search vector where the search begins, e.g. the end of Algorithm 2.
        noise: of the rows.
        options: units, seed, limits.

    Raises:
        OutOfBudget: it was spent before the best fit was found.
        FmuFailure: the model failed at more points of the box than can be left out.
    """
    options = options or InferenceOptions()
    parameters = objective.parameters
    # the model's symmetries, and those of the data that priors break: other minima begin there
    search = Evaluator(objective)
    exact = find_twins(search, options.seed) if options.twins is None else options.twins
    twins = [*exact, *twins_but_for_priors(search, options.seed)]
    boxes = output_ranges(objective.response, parameters, options.seed, [solution])
    # the likelihood of the data, or of what the model gives at the solution
    likelihood = likelihood_of(objective, noise.sigma, noise.common, tuple(boxes), noise.bounded)
    if options.data:
        likelihood = replace(likelihood, scatter=noise.scatter)
    else:
        [point] = evaluate_many(objective, [solution])
        likelihood = replace(likelihood, shift=point.residuals)
    limit = options.budget
    if limit is None:
        [point] = evaluate_many(likelihood.objective, [solution])
        limit = usual_budget(point.runs)
    evaluator = LikelihoodEvaluator(likelihood, limit, options.progress)

    evaluator.begin(Stage.MINIMA)
    optimum = let_out(evaluator, most_likely(evaluator, [solution, *options.others]))
    if evaluator.cuts and not optimum.converged and not _adequacy(optimum, options).describes:
        raise OutOfBudget(
            f"budget: found {evaluator.limit}, wanted more: it was spent before the best fit was "
            "found"
        )
    _log.info(
        "profiles: most likely point at χ² = %.6g on %.6g degrees of freedom",
        optimum.chi_square,
        optimum.degrees_of_freedom,
    )
    found = _explored(evaluator, optimum, boxes, replace(options, twins=twins))

    evaluator.begin(Stage.BEYOND)
    outside = Surroundings()  # what fits beyond the bounds: exact twins, then what is come by
    if options.beyond and cut_sides(found):
        images = mirrored(found.optimum, options.models, options.seed)
        around = beyond(evaluator, found)
        outside = replace(around, found=(*images, *around.found))
    # profiles continue from where fits beyond the bounds come into them
    inside = taken_in(evaluator, found, outside.found)
    begin = _better(found.optimum, inside)
    if begin is not None and begin.delta < -BETTER:
        found = _anew(evaluator, found, begin, boxes, options)
    elif inside:
        found = extended(evaluator, found, inside)

    optimum = found.optimum
    separate = identifiability.equivalents(found)
    separate = with_values_nearby(evaluator, found, twins, separate)
    equivalents = (*separate, *options.alternatives)
    adequacy = _adequacy(optimum, options)
    basis = Basis(
        equivalents=equivalents,
        units=options.units,
        boxes={name: (range_.low, range_.high) for name, range_ in boxes.items()},
        withdrawn="" if adequacy.describes else adequacy.why_not,
        redundant=is_redundant(optimum),
    )
    profiles = with_boxes(optimum.likelihood, outside, profiles_of(found, basis))
    if options.only:  # what was not requested was not scanned: nothing is known of it
        profiles = {name: p for name, p in profiles.items() if name in options.only}
    values = {name: p.value for name, p in profiles.items()}
    for name, value in values.items():
        interval = span(*value.ci95, value.unit).replace("\u00a0", " ")
        _log.info("profile of %s: %s, %s", name, interval, value.status)

    evaluator.begin(Stage.DIRECTIONS)
    directions = identifiability.directions(evaluator, optimum) if options.directions else ()
    idle = identifiability.without_effect(evaluator, optimum, values)
    resampled = None
    if options.bootstrap > 1:
        evaluator.begin(Stage.REFITS)
        drawn = (options.bootstrap, options.seed, options.executor)
        resampled = bootstrap_of(optimum, values, *drawn, options.progress)
    rates = [rate for m in objective.data.measurements for rate in m.sampled_hz]
    here = canonical(parameters, to_model(parameters, optimum.expansion.x))
    knowledge = Knowledge(
        data=options.data,
        chi_square=optimum.chi_square,
        freedom=optimum.degrees_of_freedom,
        adequacy=adequacy,
        most_likely={p.name: float(v) for p, v in zip(parameters, here, strict=True)},
        inflation=optimum.likelihood.inflation,
        scans={name: p.scan for name, p in profiles.items()},
        directions=directions,
        without_effect=idle,
        equivalents=equivalents,
        effort=Effort(evaluator.evaluations, evaluator.derived, evaluator.runs),
        units={p.name: p.unit for p in parameters},
        of_experiments=tuple(p.name for p in parameters if p.experiments),
        bootstrap=resampled,
    )
    return Determined(
        parameters={n: v for n, v in values.items() if isinstance(v, ParameterEstimate)},
        derived={n: v for n, v in values.items() if isinstance(v, OutputEstimate)},
        findings=(
            *sampling_findings(rates, values, equivalents),
            *beyond_findings(optimum.likelihood, outside, profiles),
            *held_findings(profiles),
            *identifiability.incomplete_findings(profiles),
        ),
        knowledge=knowledge,
        ending=ending_of(
            Status.CONVERGED if adequacy.describes else Status.MISFIT,
            adequacy,
            inflation=optimum.likelihood.inflation,
            structure=options.structure,
            data=objective.data,
        ),
    )


def _explored(
    evaluator: LikelihoodEvaluator,
    optimum: Optimum,
    boxes: Mapping[str, OutputRange],
    options: InferenceOptions,
) -> Exploration:
    """Other minima, then profiles around the best; once more, should they come by a better one."""
    with evaluator.within(FOR_MINIMA):
        minima = other_minima(evaluator, optimum, _beginnings(evaluator, optimum, options))
    begin = _better(optimum, minima)
    if begin is not None:
        optimum, minima = _moved(evaluator, optimum, begin, minima)
    found = _explore(evaluator, optimum, minima, boxes, options)
    begin = _better(optimum, found.points)
    return found if begin is None else _anew(evaluator, found, begin, boxes, options)


def _explore(
    evaluator: LikelihoodEvaluator,
    optimum: Optimum,
    minima: Sequence[ProfilePoint],
    boxes: Mapping[str, OutputRange],
    options: InferenceOptions,
    known: Sequence[ProfilePoint] | None = None,
) -> Exploration:
    """Profiles around a point; a look around it where the model does not describe the data.

    No interval is told then: walks serve to find a better point, if the search of the box did not,
    and to draw what is around it. `known` are points of an exploration before; without one, a
    better point may end this one.
    """
    evaluator.begin(Stage.WALKS)
    ranges = _ranges(optimum, boxes, options)
    share = 1.0
    if not _adequacy(optimum, options).describes:
        share = FOR_MISFIT if known is None else FOR_A_LOOK
    extent = Extent(options.only)
    if known is None:
        extent = replace(extent, until=lambda points: _better(optimum, points) is not None)
    with evaluator.within(share):
        return explore(evaluator, optimum, ranges, minima, extent, known or ())


def _adequacy(optimum: Optimum, options: InferenceOptions) -> Adequacy:
    """Whether the model will do."""
    return adequacy_of(optimum, options.structure, options.closer, options.scale_off)


def _anew(
    evaluator: LikelihoodEvaluator,
    found: Exploration,
    begin: ProfilePoint,
    boxes: Mapping[str, OutputRange],
    options: InferenceOptions,
) -> Exploration:
    """Profiles around a better point than those that were explored around."""
    optimum, minima = _moved(evaluator, found.optimum, begin, found.minima)
    known = _counted(evaluator, optimum, found.near)
    return _explore(evaluator, optimum, minima, boxes, options, known)


def _beginnings(
    evaluator: LikelihoodEvaluator, optimum: Optimum, options: InferenceOptions
) -> list[FloatArray]:
    """Where other minima are looked for: twins of the optimum, and what a search found or finds."""
    parameters, x = optimum.likelihood.parameters, optimum.expansion.x
    twins = options.twins or ()
    begins = [image for twin in twins if (image := twin.of(parameters, x)) is not None]
    if options.minima:
        return [*begins, *options.minima]
    try:
        for screens in range(math.ceil(options.starts / DESCENTS)):
            begins += screened(evaluator, options.seed, skip=SCREENED * screens)
    except Exhausted:
        return begins
    return begins[: len(twins) + options.starts]


def _ranges(
    optimum: Optimum, boxes: Mapping[str, OutputRange], options: InferenceOptions
) -> dict[str, OutputRange]:
    """Ranges of the outputs over the room that profiles have; extremes of the box count in it."""
    likelihood, x = optimum.likelihood, optimum.expansion.x
    goes_round = np.isfinite(likelihood.periods)
    half = np.where(goes_round, 0.5 * likelihood.periods, 0.0)
    room = (
        np.where(goes_round, x - half, likelihood.lower),
        np.where(goes_round, x + half, likelihood.upper),
    )
    extremes = [
        np.where(box.depends, at, x) for box in boxes.values() for at in (box.x_low, box.x_high)
    ]
    inside = [
        at
        for at in extremes
        if np.all(np.isfinite(at))
        and np.all(goes_round | ((at >= likelihood.lower) & (at <= likelihood.upper)))
    ]
    return output_ranges(
        likelihood.objective.response,
        likelihood.parameters,
        options.seed,
        [x, *inside],
        room,
    )


def _better(optimum: Optimum, points: Sequence[ProfilePoint]) -> ProfilePoint | None:
    """A point that is clearly more likely, or as likely with a value for every output.

    Where an output exists at the optimum it has to exist at the better point. The box may be
    knowledge, as which of two twins it is: while noise as it is stated lets the optimum be in the
    box, what lies outside is another value that fits, and not the most likely one.
    """
    exists = np.isfinite(optimum.expansion.sample.outputs)
    possible = [s for s in points if s.outputs.size == 0 or np.all(np.isfinite(s.outputs[exists]))]
    possible = [s for s in possible if _may_be_best(optimum, s)]
    lowest = min(possible, key=lambda point: point.delta, default=None)
    if lowest is not None and lowest.delta < -BETTER:
        return lowest
    if np.all(exists):
        return None
    whole = [s for s in possible if s.delta < BETTER and s.outputs.size == exists.size]
    whole = [s for s in whole if np.all(np.isfinite(s.outputs))]
    return min(whole, key=lambda point: point.delta, default=None)


def _may_be_best(optimum: Optimum, point: ProfilePoint) -> bool:
    """Whether a point is in the box, or the optimum is not, or the point excludes it for good."""
    likelihood = optimum.likelihood
    if not outside_box(likelihood.parameters, likelihood.folded(point.x)):
        return True
    if outside_box(likelihood.parameters, likelihood.folded(optimum.expansion.x)):
        return True
    return -point.delta * likelihood.inflation**2 > EXCLUDED


def _moved(
    evaluator: LikelihoodEvaluator,
    optimum: Optimum,
    begin: ProfilePoint,
    minima: Sequence[ProfilePoint],
) -> tuple[Optimum, tuple[ProfilePoint, ...]]:
    """The optimum at a better point, and the other minima, their chi square counted from there.

    What noise the residuals ask for is judged anew there.
    """
    evaluator.likelihood = optimum.likelihood.stated
    moved = let_out(evaluator, most_likely(evaluator, [begin.x]))
    here = optimum.expansion
    left = ProfilePoint(value=math.nan, delta=0.0, x=here.x, outputs=here.sample.outputs)
    counted = _counted(evaluator, moved, [*minima, left])
    return moved, tuple(p for p in counted if p.delta <= ROOT_95**2)


def _counted(
    evaluator: LikelihoodEvaluator, optimum: Optimum, points: Sequence[ProfilePoint]
) -> tuple[ProfilePoint, ...]:
    """Points, chi square counted from another optimum than before; none if that costs too much."""
    try:
        samples = evaluator([Request(tuple(p.x for p in points), outputs=False)])[0]
    except Exhausted:
        return ()
    return tuple(
        replace(p, delta=optimum.delta(float(s.rows @ s.rows)))
        for p, s in zip(points, samples, strict=True)
    )
