"""Fits beyond the box: where what the data say of a value rests on where it was looked for.

The box of a campaign may be knowledge, then what lies beyond it is of no interest; or a guess, then
it is. Which one it is only the reader knows: so fits beyond it are told, and decide nothing.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import Parameter, canonical, outside_box, to_model, to_search
from fitting.fit.likelihood.descent import AT_LIMIT, Optimum
from fitting.fit.likelihood.few_places import of_few_places
from fitting.fit.likelihood.likelihood import QUARTER_TURN, Likelihood, LikelihoodEvaluator
from fitting.fit.likelihood.lockstep import Exhausted, Task, run_in_lockstep
from fitting.fit.objective import Objective
from fitting.fit.outputs import output_means_beyond
from fitting.fit.search.twins import find_twins
from fitting.fit.solver.evaluator import Evaluator
from fitting.inference.likelihood.exploration import (
    Exploration,
    cut_sides,
    possible,
)
from fitting.inference.likelihood.knowledge import Profile
from fitting.inference.likelihood.profiles import ProfilePoint, Quantity
from fitting.inference.likelihood.ways import turned, value_at, walked_to_ends
from fitting.text.arrays import FloatArray
from fitting.text.error_bars import ROOT_95
from fitting.text.estimate import FittedEstimate, Verdict
from fitting.text.finding import Finding, Kind, note

#: How many times as wide as the box the surroundings are that are looked at. In a box of ten times
#: the guess profiles go ten times as far again: what they would find there is told here.
TIMES = 100.0
#: The same of boxes whose ends are no ratio, in their half widths.
HALF_WIDTHS = 10.0
#: Ends of walks beyond the box, the best, from which values are brought beyond their intervals.
BEGINNINGS = 6
#: Share of an interval by which a value lies beyond it.
BEYOND = 0.02
#: Verdicts that claim something of a value, which may hold in a box alone.
CLAIMS = (
    Verdict.DETERMINED,
    Verdict.BOUNDED,
    Verdict.ABOVE,
    Verdict.BELOW,
    Verdict.SEVERAL,
)


@dataclass(frozen=True)
class Outside:
    """A point beyond the box that fits as well, and what leads to its model; empty: it is this."""

    point: ProfilePoint
    where: str = ""


@dataclass(frozen=True)
class Surroundings:
    """What fits beyond the box as well, and whether the search for it was cut for its cost."""

    found: tuple[Outside, ...] = ()
    was_cut: bool = False


def widened(parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """Parameters with much wider boxes, inside what the model declares.

    A positive one that may be ten times as large goes by a factor of 100 each way, an angle through
    half a turn, others by ten half widths; what goes round or has a prior of its own keeps its box.

    Args:
        parameters: with their boxes.
    """
    return tuple(map(_widened, parameters))


def _widened(parameter: Parameter) -> Parameter:
    if parameter.period is not None or parameter.prior_sigma is not None:
        return parameter
    low, high = parameter.lower, parameter.upper
    if parameter.is_angle:
        middle, half = 0.5 * (low + high), max(0.5 * (high - low), QUARTER_TURN)
        low, high = middle - half, middle + half
    elif parameter.spans_decades:
        low, high = low / TIMES, high * TIMES
    else:
        more = 0.5 * (HALF_WIDTHS - 1.0) * (high - low)
        low, high = low - more, high + more
        if parameter.lower >= 0.0:
            low = max(low, 0.0)
    return replace(
        parameter,
        lower=min(max(low, parameter.least), parameter.lower),
        upper=max(min(high, parameter.most), parameter.upper),
    )


def beyond(evaluator: LikelihoodEvaluator, explored: Exploration) -> Surroundings:
    """Points beyond the box that fit as well, where a value leaves the interval that data cut.

    From points in hand every parameter is brought to the ends of its wider box, the rest following;
    from where that fits, every value is brought half as far again as its interval goes, and
    angles are turned a little.

    Args:
        evaluator: of the likelihood; counts what is evaluated.
        explored: profiles around the most likely point.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    optimum = explored.optimum
    likelihood = optimum.likelihood
    wide = replace(optimum, likelihood=_with_room(likelihood))
    sides = cut_sides(explored)
    if not sides:
        return Surroundings()
    evaluator.likelihood = wide.likelihood
    before = evaluator.cuts
    try:
        walks = walked_to_ends(evaluator, wide, explored.parameters, explored.fitting)
        fitting = [[p for p in walk if _fits(p)] for walk in walks]
        reached = [p for walk in fitting for p in walk]
        ends = sorted((walk[-1] for walk in fitting if walk), key=lambda p: p.delta)[:BEGINNINGS]
        tasks = [value_at(wide, q, target, p.x) for q, target in sides for p in ends]
        found = [*reached, *(p for p in run_in_lockstep(tasks, evaluator) if p is not None)]
        found += turned(evaluator, wide, explored.parameters, reached)
        points = possible(evaluator, wide, found)
        fits = tuple(Outside(p) for p in points if p is not None and _fits(p))
        return Surroundings(fits, evaluator.cuts > before)
    except Exhausted:
        return Surroundings(was_cut=True)
    finally:
        evaluator.likelihood = likelihood


def taken_in(
    evaluator: LikelihoodEvaluator, explored: Exploration, found: Sequence[Outside]
) -> tuple[ProfilePoint, ...]:
    """What fits inside the box where fits beyond it come in: a valley that no profile went through.

    The parameter that is farthest out is held at the end of its room, the rest follows.

    Args:
        evaluator: of the likelihood; counts what is evaluated.
        explored: profiles around the most likely point.
        found: fits beyond the box of the same model.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    optimum = explored.optimum
    tasks: list[Task[ProfilePoint | None]] = []
    for each in sorted(found, key=lambda other: other.point.delta):
        if not each.where and len(tasks) < BEGINNINGS:
            tasks += _way_in(optimum, explored.parameters, each.point)
    try:
        reached = [p for p in run_in_lockstep(tasks, evaluator) if p is not None and _fits(p)]
        points = possible(evaluator, optimum, reached)
    except Exhausted:
        return ()
    return tuple(p for p in points if p is not None)


def _way_in(
    optimum: Optimum, parameters: Sequence[Quantity], point: ProfilePoint
) -> list[Task[ProfilePoint | None]]:
    likelihood = optimum.likelihood
    inside = np.clip(point.x, likelihood.lower, likelihood.upper)
    out = np.abs(point.x - inside) / likelihood.widths
    far = max(parameters, key=lambda q: float(out[q.index]), default=None)
    if far is None or out[far.index] <= AT_LIMIT:
        return []
    return [value_at(optimum, far, float(inside[far.index]), inside)]


def _fits(point: ProfilePoint) -> bool:
    return point.delta <= ROOT_95**2


def _with_room(likelihood: Likelihood) -> Likelihood:
    """The likelihood in the room of profiles, and in the wider boxes besides."""
    parameters = widened(likelihood.parameters)
    low = to_search(parameters, np.array([p.lower for p in parameters]))
    high = to_search(parameters, np.array([p.upper for p in parameters]))
    return replace(
        likelihood,
        lower=np.minimum(likelihood.lower, low),
        upper=np.maximum(likelihood.upper, high),
    )


def beyond_findings(
    likelihood: Likelihood, outside: Surroundings, profiles: Mapping[str, Profile]
) -> Iterator[Finding]:
    """Fits beyond the bounds that make statuses conditional on them, each with its news.

    Numbers are the values there by name, with ``error_NAME``, ``lower_NAME`` and ``upper_NAME`` of
    those outside; names are the ``values`` that differ, those ``outside`` their bounds, the
    ``units`` of both in this order, ``exchanged`` values one after the other, and ``where``.

    Args:
        likelihood: with the parameters and their bounds.
        outside: what fits as well beyond them.
        profiles: of parameters and outputs, by name.
    """
    known: set[str] = set()
    for other in _others(likelihood, outside, profiles):
        new = [name for name in other.names if name not in known]
        known.update(new)
        if not new:  # a better one has the same news
            continue
        every = dict.fromkeys((*new, *(p.name for p in other.out)))
        sigma = {n: profiles[n].scan.sigma if n in profiles else math.nan for n in every}
        numbers = {name: other.values[name] for name in every}
        numbers |= {f"error_{name}": value for name, value in sigma.items()}
        for p in other.out:
            numbers |= {f"lower_{p.name}": p.lower, f"upper_{p.name}": p.upper}
        units = (*(profiles[name].value.unit for name in new), *(p.unit for p in other.out))
        names = {
            "values": tuple(new),
            "outside": tuple(p.name for p in other.out),
            "units": units,
            "exchanged": tuple(itertools.chain(*_exchanged(new, other.values, profiles))),
            "where": (other.where,) if other.where else (),
        }
        yield note(Kind.fit_beyond_bounds, ", ".join(new), names, **numbers)
    if outside.was_cut:
        yield note(Kind.bounds_unsearched, "search")


def with_boxes(
    likelihood: Likelihood, outside: Surroundings, profiles: Mapping[str, Profile]
) -> dict[str, Profile]:
    """Profiles with the names of the parameters on whose boxes their verdicts rest.

    Args:
        likelihood: with the parameters and their boxes.
        outside: what fits as well beyond them.
        profiles: of parameters and outputs, by name.
    """
    boxes: dict[str, set[str]] = {name: set() for name in profiles}
    for other in _others(likelihood, outside, profiles):
        out = {p.name for p in other.out}
        for name in other.names:  # also what a better fit has said: that may lie beyond another box
            boxes[name] |= out - {name} or out  # the box of another excludes it as well
    order = [p.name for p in likelihood.parameters]
    return {
        name: p._replace(value=replace(p.value, active_bounds=_sorted(boxes[name], order)))
        if p.value.status in CLAIMS
        else p
        for name, p in profiles.items()
    }


def _sorted(names: set[str], order: Sequence[str]) -> tuple[str, ...]:
    return tuple(sorted(names, key=order.index))


@dataclass(frozen=True, kw_only=True)
class _Other:
    """A fit beyond the box: what leads there, its values, those that are told otherwise there.

    `out` are the parameters that lie beyond their boxes.
    """

    where: str
    values: Mapping[str, float]
    names: Sequence[str]
    out: Sequence[Parameter]


def _others(
    likelihood: Likelihood, outside: Surroundings, profiles: Mapping[str, Profile]
) -> Iterator[_Other]:
    """The fits beyond the box that say otherwise, the best first."""
    for each in sorted(outside.found, key=lambda other: other.point.delta):
        values = _values(likelihood, each.point)
        names = [n for n, p in profiles.items() if _against(values.get(n, math.nan), p.value)]
        out = [p for p in likelihood.parameters if _is_out(p, values)]
        if names and out:
            yield _Other(where=each.where, values=values, names=names, out=out)


def _exchanged(
    names: Sequence[str], values: Mapping[str, float], profiles: Mapping[str, Profile]
) -> list[tuple[str, str]]:
    """Pairs of values of which each is what the other one was; empty where not all are such."""
    left, pairs = list(names), []
    while left:
        one = left.pop(0)
        partner = next((other for other in left if _swapped(one, other, values, profiles)), None)
        if partner is None:
            return []
        left.remove(partner)
        pairs.append((one, partner))
    return pairs


def _swapped(
    one: str, other: str, values: Mapping[str, float], profiles: Mapping[str, Profile]
) -> bool:
    mine, theirs = profiles[one], profiles[other]
    near = mine.scan.sigma + theirs.scan.sigma
    return (
        mine.value.unit == theirs.value.unit
        and abs(values[one] - theirs.value.likely) < near
        and abs(values[other] - mine.value.likely) < near
    )


def held_findings(profiles: Mapping[str, Profile]) -> Iterator[Finding]:
    """Profiles that the data do not close where other parameters are at a limit of their room.

    Args:
        profiles: of parameters and outputs, by name.
    """
    by_limits: dict[tuple[str, ...], list[str]] = {}
    for name, profile in profiles.items():
        # its own limit is another matter than that of another parameter
        held = () if name in profile.scan.held else profile.scan.held
        if held and profile.value.status is not Verdict.WITHDRAWN:  # that fit determines nothing
            by_limits.setdefault(held, []).append(name)
    for held, names in by_limits.items():
        yield note(Kind.interval_at_bound, ", ".join(names), {"values": tuple(names), "held": held})


def _values(likelihood: Likelihood, point: ProfilePoint) -> dict[str, float]:
    parameters = likelihood.parameters
    shown = canonical(parameters, to_model(parameters, point.x))
    values = {p.name: float(v) for p, v in zip(parameters, shown, strict=True)}
    return values | dict(zip(likelihood.names, map(float, point.outputs), strict=True))


def _is_out(parameter: Parameter, values: Mapping[str, float]) -> bool:
    slack = 1e-9 * (parameter.upper - parameter.lower)
    inside = parameter.lower - slack <= values[parameter.name] <= parameter.upper + slack
    return parameter.period is None and not inside


def _against(value: float, known: FittedEstimate) -> bool:
    """Whether a value lies beyond an end of the interval that the data cut."""
    low, high = known.ci95
    margin = BEYOND * (high - low)
    below = known.closed_by[0] == "data" and value < low - margin
    above = known.closed_by[1] == "data" and value > high + margin
    return below or above


@dataclass(frozen=True)
class Model:
    """An alternative of the model: its objective, and what leads to it in words."""

    objective: Objective
    where: str


def mirrored(optimum: Optimum, others: Sequence[Model], seed: int) -> tuple[Outside, ...]:
    """The exact twins of the most likely point that lie beyond the box, in a much wider one.

    Left out are those at which an output is missing that exists at the optimum. Of data at many
    places a few tell what is a twin, of this model alone.

    Args:
        optimum: the most likely point and its likelihood.
        others: alternatives of the model.
        seed: of the points of the box at which twins are tried.
    """
    likelihood, here = optimum.likelihood, optimum.expansion
    few = of_few_places(likelihood)
    own = likelihood.objective if few is None else few.likelihood.objective
    exists = np.isfinite(here.sample.outputs)
    found = []
    for model in (Model(own, ""), *(others if few is None else ())):
        images = _images(own, model.objective, here.x, seed)
        means = output_means_beyond(
            model.objective.response, likelihood.parameters, images, likelihood.names
        )
        for k, x in enumerate(images):
            outputs = np.array([float(means[name][k]) for name in likelihood.names])
            if np.all(np.isfinite(outputs[exists])):
                point = ProfilePoint(value=float("nan"), delta=0.0, x=x, outputs=outputs)
                found.append(Outside(point, model.where))
    return tuple(found)


def _images(own: Objective, other: Objective, x: FloatArray, seed: int) -> list[FloatArray]:
    """Search vectors beyond the box at which another objective says what this one says at x.

    An angle half turns on is the same angle.
    """
    wide = widened(own.parameters)
    target = None if other is own else replace(other, parameters=wide)
    twins = find_twins(Evaluator(replace(own, parameters=wide)), seed, target)
    twins = [twin for twin in twins if not twin.is_turn]
    images = [twin.of(wide, x) for twin in twins]
    return [image for image in images if image is not None and outside_box(own.parameters, image)]
