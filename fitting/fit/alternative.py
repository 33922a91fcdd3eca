"""One discrete alternative: Algorithm 2 from the campaign's start, and a search of the whole box.

At large nu the Tikhonov term pulls all starts to one place, so that further starts of Algorithm 2
explore nothing. The box is searched for minima of chi square instead, and the lowest of them are
lowered at the last nu; the least J is reported, wherever it was found.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.campaign.parameters import Parameter, to_model
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import noise_of, shared
from fitting.fit.objective import Objective, Point, evaluate_many, j_reg, weights
from fitting.fit.search.box import Box
from fitting.fit.search.minima import SAME, Minimum, Search, search_box
from fitting.fit.search.twins import Twin, find_twins
from fitting.fit.solver.continuation import (
    Chain,
    ContinuationStep,
    Course,
    distance,
    has_crept,
    is_lower,
    lowered,
    met,
    next_level,
    own_start,
    polished,
)
from fitting.fit.solver.evaluator import Counts, Evaluator, total
from fitting.text.arrays import FloatArray

_log = logging.getLogger(__name__)

#: Evaluations of a search, in those of Algorithm 2, after which no further screen is begun.
BUDGET_SHARE = 12.0
#: J of a minimum, in units of the least, from which lowering it at the last nu is in vain; and the
#: share of the noise that a descent may leave.
HOPELESS, LEFT = 2.0, 0.1
#: Search vectors, and shares of J, that differ by no more are the same.
ROUNDING = 1e-9
#: Places in a box over decades that are tried beside where J came to rest; the share of J by which
#: it may rise there; and from what distance along an edge a place is another one.
PLACES, FLAT, ANOTHER = (0.25, 0.5, 0.75), 1e-3, 0.1
#: Minima that are lowered, at most, for each further start: some end in a minimum that is known.
TRIED = 2


@dataclass(frozen=True)
class Outcome:
    """All chains of one alternative; `interrupted` where the user stopped it.

    The first chain is Algorithm 2 from the campaign's start. `search` is what was looked for in the
    box besides, None where nothing was; `twins` are the exact symmetries of the model, `further`
    the evaluations that no chain counts; `reported` a chain that is preferred to others of equal J.
    """

    chains: tuple[Chain, ...]
    interrupted: bool = False
    search: Search | None = None
    twins: tuple[Twin, ...] = ()
    further: Counts = field(default_factory=Counts)
    reported: Chain | None = None

    @property
    def best(self) -> Chain | None:
        """The chain of the least J at the last nu; None before the first level is done.

        Of chains of one J but for rounding the first: the campaign's own start, if it is among
        them.
        """
        if self.reported is not None:
            return self.reported
        done = [chain for chain in self.chains if chain.steps and chain.joined is None]
        furthest = min((chain.nu for chain in done), default=math.inf)
        done = [chain for chain in done if chain.nu == furthest]
        least = min((chain.steps[-1].j for chain in done), default=0.0)
        return next((chain for chain in done if not is_lower(least, chain.steps[-1].j)), None)


@dataclass(frozen=True)
class Solved:
    """An alternative that is done: its objective and its outcome."""

    objective: Objective
    outcome: Outcome


@dataclass(frozen=True)
class Mirrored:
    """An alternative that is done, and the change of parameters that leads from it to another."""

    outcome: Outcome
    twin: Twin


def run_alternative(course: Course, solved: Sequence[Solved] = ()) -> Outcome:
    """Algorithm 2 for one discrete alternative, then the lowest minima of its box.

    A KeyboardInterrupt ends it with what is finished and `interrupted` set.

    Args:
        course: objective, schedule, settings and journal.
        solved: alternatives that are done. Of one that mirrors this one exactly the minima are
            known, and where J is least: the box is not searched again, and what was lowered there
            is looked at here. So is Algorithm 2, if its start is a mirror image as well.

    Raises:
        FmuFailure: the model failed inside the box.

    Source: the paper's Algorithm 2.
    """
    parameters, schedule = course.objective.parameters, course.schedule
    outcome = Outcome((Chain(0, tuple(map(float, own_start(parameters)))),))
    try:
        outcome, mirrored = _mirroring(course, outcome, solved)
        if mirrored is not None:
            outcome = replace(outcome, chains=(_image(course, outcome.chains[0], mirrored),))
        while not outcome.chains[0].ended:
            outcome = replace(outcome, chains=(next_level(course, outcome.chains[0]),))
        outcome = _with_twins(course, outcome)
        if schedule.starts > 1:
            outcome = _searched(course, outcome, mirrored)
            known = outcome.search is not None and outcome.search.lowered
            outcome, begins = (outcome, known) if known else _promising(course, outcome)
            for x, begun in begins:
                outcome = _with_start(course, outcome, x, begun)
                if sum(chain.joined is None for chain in outcome.chains) == schedule.starts:
                    break
            outcome, places = (outcome, []) if known else _flat_places(course, outcome)
            for x in places:
                outcome = _lower_or_joined(_with_start(course, outcome, x, x), outcome.best)
    except KeyboardInterrupt:
        return replace(outcome, interrupted=True)
    return outcome


def with_starts(course: Course, outcome: Outcome, begins: Sequence[FloatArray]) -> Outcome:
    """An outcome with further starts, each lowered at the last nu.

    Args:
        course: objective, schedule, settings and journal.
        outcome: that is done.
        begins: search vectors in the box, (n,) each.

    Raises:
        FmuFailure: the model failed inside the box.
    """
    outcome = replace(outcome, reported=None)
    for x in begins:
        outcome = _with_start(course, outcome, x, x)
    return outcome


def polished_end(course: Course, outcome: Outcome) -> Outcome | None:
    """The outcome whose best chain went on along a curved valley, where straight steps crept.

    None where they did not. A KeyboardInterrupt leaves it as it was, with `interrupted` set.

    Args:
        course: objective, schedule, settings and journal.
        outcome: that is done.

    Raises:
        FmuFailure: the model failed inside the box.
    """
    best, chains = outcome.best, list(outcome.chains)
    if best is None or not has_crept(course, chains[best.start]):
        return None
    try:
        chains[best.start] = polished(course, chains[best.start])
    except KeyboardInterrupt:
        return replace(outcome, interrupted=True)
    return replace(outcome, chains=tuple(chains), reported=None)


def _with_start(course: Course, outcome: Outcome, x: FloatArray, begun: FloatArray) -> Outcome:
    """The outcome with one more chain, lowered from x, which was come to from `begun`."""
    chains = outcome.chains
    nu = chains[0].nu
    least = min(chain.steps[-1].j for chain in chains if chain.steps[-1].nu == nu)
    found = lowered(course, len(chains), nu, begun, x, least)
    images = _images(course.objective, outcome, np.array(found.steps[-1].x))
    found = met(course.objective.parameters, found, chains, images)
    return replace(outcome, chains=(*chains, found))


def _with_twins(course: Course, outcome: Outcome) -> Outcome:
    evaluator = Evaluator(course.objective)
    twins = find_twins(evaluator, course.schedule.seed)
    return replace(outcome, twins=tuple(twins), further=outcome.further + evaluator.counts)


def _mirroring(
    course: Course, outcome: Outcome, solved: Sequence[Solved]
) -> tuple[Outcome, Mirrored | None]:
    """The first one that is done and mirrors this one; the outcome has counted the look."""
    for other in solved:
        evaluator = Evaluator(other.objective)
        mirrors = find_twins(evaluator, course.schedule.seed, course.objective)
        outcome = replace(outcome, further=outcome.further + evaluator.counts)
        if mirrors:
            _log.info("alternative %d: mirrors one that is done", course.alternative + 1)
            return outcome, Mirrored(other.outcome, mirrors[0])
    return outcome, None


def _image(course: Course, own: Chain, mirrored: Mirrored) -> Chain:
    """The chain from the campaign's start as the image of the other one's; it costs nothing.

    As it was where the image begins elsewhere, leaves the box, or has another Tikhonov term.
    """
    parameters = course.objective.parameters
    chain, steps = mirrored.outcome.chains[0], []
    begun = mirrored.twin.of(parameters, np.array(chain.begun))
    if begun is None or distance(parameters, begun, np.array(own.begun)) > ROUNDING:
        return own
    for step in chain.steps:
        x = mirrored.twin.of(parameters, np.array(step.x))
        if x is None:
            return own
        pull = weights(course.objective, step.nu, course.settings.misfit)
        if abs(j_reg(x, pull) - step.j_reg) > ROUNDING * (1.0 + step.j):
            return own
        steps.append(_image_of_step(course, step, x))
    for step in steps:
        _keep(course, step)
    return replace(own, steps=tuple(steps), ended=chain.ended)


def _image_of_step(course: Course, step: ContinuationStep, x: FloatArray) -> ContinuationStep:
    """A level of another alternative as it is at its image x, which cost nothing."""
    return replace(
        step,
        alternative=course.alternative,
        x=tuple(map(float, x)),
        parameters=tuple(map(float, to_model(course.objective.parameters, x))),
        message=f"the image of that of alternative {step.alternative + 1}",
        iterations=0,
        evaluations=0,
        jacobians=0,
        runs=0,
        seconds=0.0,
    )


def _keep(course: Course, step: ContinuationStep) -> None:
    """Tell and record a level that was not solved here like any other."""
    key = (step.alternative, step.start, step.level)
    course.journal.entering(*key)
    if course.journal.recall(*key) is None:
        course.journal.record(step)


def _searched(course: Course, outcome: Outcome, mirrored: Mirrored | None) -> Outcome:
    """The outcome with a search of the box, or with that of an alternative which mirrors it."""
    if mirrored is not None and mirrored.outcome.search is not None:
        return replace(outcome, search=_mirrored(course, mirrored.outcome, mirrored.twin))
    own = outcome.chains[0]
    end = np.array(own.steps[-1].x)
    [point] = evaluate_many(course.objective, [end])
    noise = noise_of(course.objective, point)
    # Algorithm 2 may end anywhere: what rows share is that of a model that fits
    common = shared(course.objective.data, np.zeros(point.residuals.size))
    likelihood = likelihood_of(course.objective, noise.sigma, common)
    spent = sum(step.evaluations for step in own.steps)
    search = search_box(
        LikelihoodEvaluator(likelihood), [end], course.schedule.seed, int(BUDGET_SHARE * spent)
    )
    _log.info(
        "alternative %d: box searched from %d points by %d descents, %d minima, %d evaluations",
        course.alternative + 1,
        search.screened,
        search.descents,
        len(search.minima),
        search.evaluations,
    )
    counts = Counts(evaluations=1 + search.evaluations, runs=point.runs + search.runs)
    return replace(outcome, search=search, further=outcome.further + counts)


def _mirrored(course: Course, other: Outcome, mirror: Twin) -> Search | None:
    """The search of an alternative as that of the one which mirrors it; it cost nothing."""
    parameters, search = course.objective.parameters, other.search
    if search is None:
        return None
    minima = [
        replace(minimum, x=x, begun=minimum.begun if begun is None else begun)
        for minimum in search.minima
        if (x := mirror.of(parameters, minimum.x)) is not None
        for begun in [mirror.of(parameters, minimum.begun)]
    ]
    return replace(
        search,
        minima=tuple(minima),
        evaluations=0,
        runs=0,
        mirrored=True,
        lowered=_lowered_there(parameters, other, mirror),
    )


def _lowered_there(
    parameters: Sequence[Parameter], other: Outcome, mirror: Twin
) -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Images of where the chains of least J of an alternative ended, and of where they had begun.

    None where one of them has its image outside the box: what is lowest there is not known then.
    """
    chains = [chain for chain in other.chains if chain.joined is None]
    least, found = min(chain.steps[-1].j for chain in chains), []
    for chain in chains:
        if not is_lower(least, chain.steps[-1].j):
            x = mirror.of(parameters, np.array(chain.steps[-1].x))
            begun = mirror.of(parameters, np.array(chain.begun))
            if x is None:
                return ()
            found.append((x, x if begun is None else begun))
    return tuple(found)


def _evaluated(
    course: Course, outcome: Outcome, places: Sequence[FloatArray]
) -> tuple[Outcome, list[Point]]:
    """The objective at some places, and the outcome that has counted what it took."""
    points = evaluate_many(course.objective, places) if places else []
    spent = Counts(evaluations=len(points), runs=sum(point.runs for point in points))
    return replace(outcome, further=outcome.further + spent), points


def _promising(
    course: Course, outcome: Outcome
) -> tuple[Outcome, list[tuple[FloatArray, FloatArray]]]:
    """Minima that may have a lower J than Algorithm 2, and where they were come to from.

    None where it stands itself, and one of those that are twins of each other. What is as likely as
    the lowest is tried whatever its J is: an error of the scale that all peaks share costs chi
    square next to nothing, and each of them a part of J, until that is lowered. There are more than
    are wanted: some may end in what is known.
    """
    objective, own = course.objective, np.array(outcome.chains[0].steps[-1].x)
    box, search = Box(objective.parameters), outcome.search
    kept: list[Minimum] = []
    places = [own]
    for minimum in () if search is None else search.minima:
        if len(kept) == TRIED * (course.schedule.starts - 1):
            break
        images = [minimum.x, *_images(objective, outcome, minimum.x)]
        if any(box.apart(x, place) <= SAME for x in images for place in places):
            continue
        places.append(minimum.x)
        kept.append(minimum)
    outcome, points = _evaluated(course, outcome, [minimum.x for minimum in kept])
    least = min([outcome.chains[0].steps[-1].j_fit, *(point.j_fit for point in points)])
    enough = HOPELESS * least + LEFT * float(np.sum(objective.data.sigma))
    as_low, _ = search.apart_by_height() if search is not None else ([], [])
    return outcome, [
        (minimum.x, minimum.begun)
        for minimum, point in zip(kept, points, strict=True)
        if point.j_fit <= enough or any(minimum is low for low in as_low)
    ]


def _flat_places(course: Course, outcome: Outcome) -> tuple[Outcome, list[FloatArray]]:
    """Places far along an edge of the box where J is as low as at its least, but for a thousandth.

    Along what the data leave open a sum of absolute values is flat but for cusps, and which of them
    is the lowest is seen from nearby alone. Twins are gone through as well: from each of them
    another parameter is the open one.
    """
    best, settings = outcome.best, course.settings
    if best is None or settings.misfit == "squares":
        return outcome, []
    objective, x = course.objective, np.array(best.steps[-1].x)
    box, nu = Box(objective.parameters), weights(objective, best.nu, settings.misfit)
    places: list[FloatArray] = []
    for image in [x, *_images(objective, outcome, x)]:
        cube = box.to_cube(image)
        places += [
            box.moved(image, edge, place)
            for edge in box.open_ratios
            for place in PLACES
            if abs(cube[edge] - place) >= ANOTHER
        ]
    outcome, points = _evaluated(course, outcome, places)
    enough = (1.0 + FLAT) * best.steps[-1].j
    flat: list[FloatArray] = []
    for place, point in zip(places, points, strict=True):
        images = [place, *_images(objective, outcome, place)]
        known = any(box.apart(image, other) < ANOTHER / 2 for image in images for other in flat)
        if total(point, nu, settings.misfit) <= enough and not known:
            flat.append(place)
    return outcome, flat


def _lower_or_joined(outcome: Outcome, best: Chain | None) -> Outcome:
    """The outcome whose last chain is joined to what was best before it, unless it is lower."""
    *others, last = outcome.chains
    if best is None or last.joined is not None or is_lower(last.steps[-1].j, best.steps[-1].j):
        return outcome
    said = f"no lower than start {best.start + 1} along what leaves J flat"
    return replace(outcome, chains=(*others, replace(last, joined=best.start, ended=said)))


def _images(objective: Objective, outcome: Outcome, x: FloatArray) -> list[FloatArray]:
    """The twins of a search vector in the box."""
    images = (twin.of(objective.parameters, x) for twin in outcome.twins)
    return [image for image in images if image is not None]
