"""Exact symmetries of a problem: other parameters of the box at which every prediction is the same.

    p'_i = s_i p_order(i) + t_i

Tried are fractions of a period with either sign, quarters of a turn for an angle without a period,
reversed signs in boxes that are symmetric about zero, and exchanges of parameters of one unit whose
boxes overlap, and products of these; where there are too many, exchanges in pairs first. What
leaves the rows unchanged at points drawn from the box, to rounding at most of them, is a symmetry
of the model, found without knowing the model. The data tell no point from its twins, whatever they
are.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import Parameter, bounds, to_model, to_search
from fitting.fit.evaluator import Evaluator
from fitting.fit.objective import Objective
from fitting.fit.search.box import Box
from fitting.text.arrays import FloatArray, IntArray
from fitting.text.errors import FmuFailure, NoAnswer, NoScale

#: Points of the box that are drawn, and at how many of them with an image in the box a symmetry has
#: to hold; the first sifts the candidates.
DRAWN, POINTS = 32, 4
#: Rows that differ by no more than this (of one and their own size) are the same but for rounding,
#: at most places; at all of them by no more than the second, where a model computes less exactly (a
#: mode that is damped beyond its frequency).
ROUNDING, INEXACT = 1e-9, 1e-6
#: Candidates that are tried, at most, and how many of each kind these are taken from.
MOST, LISTED = 128, 1024
#: Share of the narrower of two boxes that the other one shares, for an exchange to be tried.
LIKE = 0.1
#: Turns of an angle that are tried, at most: in a box of many turns none is like another by chance.
MOST_TURNS = 32
#: Share of a box by which two shifts are one.
SAME = 1e-9
#: Fractions of a period.
FRACTIONS = (0.0, 0.25, 0.5, 0.75)


@dataclass(frozen=True)
class Twin:
    """A change of parameters that no prediction sees; arrays (n,), in the parameters' units."""

    order: IntArray
    signs: FloatArray
    shifts: FloatArray

    def leaves(self, index: IntArray) -> bool:
        """Whether it leaves these parameters as they are.

        Args:
            index: numbers of parameters.
        """
        stay = (self.order[index] == index) & (self.signs[index] == 1.0)
        return bool(np.all(stay & (self.shifts[index] == 0.0)))

    def of(self, parameters: Sequence[Parameter], x: FloatArray) -> FloatArray | None:
        """The twin of a search vector in the box, the image nearest to it; None outside.

        Args:
            parameters: the fitted parameters.
            x: search vector, shape (n,).
        """
        p = to_model(parameters, x)
        image = self.signs * p[self.order] + self.shifts
        lower, upper = bounds(parameters)
        for i, parameter in enumerate(parameters):
            if parameter.period is not None:
                image[i] -= parameter.period * np.round((image[i] - p[i]) / parameter.period)
                for side, past in ((1.0, image[i] < lower[i]), (-1.0, image[i] > upper[i])):
                    image[i] += side * parameter.period if past else 0.0
        margin = 1e-9 * (upper - lower)
        if np.any(image < lower - margin) or np.any(image > upper + margin):
            return None
        return to_search(parameters, np.clip(image, lower, upper))


def find_twins(evaluator: Evaluator, seed: int, other: Objective | None = None) -> list[Twin]:
    """The symmetries of an objective, or those that lead from it to another, each tried anew.

    An empty list where the model fails at a point of the box.

    Args:
        evaluator: of the objective; counts what is evaluated of both.
        seed: of the points that are tried.
        other: of the same parameters and data, e.g. of another alternative.
    """
    parameters = evaluator.objective.parameters
    target = Evaluator(evaluator.objective if other is None else other)
    candidates = [t for t in _candidates(parameters) if other is not None or not _is_identity(t)]
    points = Box(parameters).spread(DRAWN, seed)
    try:
        left = _unchanged(evaluator, target, candidates, points, slice(1))
        found = _unchanged(evaluator, target, left, points, slice(1, POINTS))
    except NoAnswer:
        raise
    except (FmuFailure, NoScale):
        found = []
    evaluator.counts += target.counts
    return found


def sampling_twins(parameters: Sequence[Parameter], rates_hz: Iterable[float]) -> list[Twin]:
    """What a record of samples does not tell apart: a frequency, and once or twice the rate beside.

    Args:
        parameters: the fitted parameters.
        rates_hz: of the samples.
    """
    count = len(parameters)
    return [
        Twin(np.arange(count), np.ones(count), turns * rate * np.eye(count)[i])
        for rate in dict.fromkeys(rates_hz)
        for i, parameter in enumerate(parameters)
        if parameter.unit == "Hz" and parameter.is_searched
        for turns in (-2, -1, 1, 2)
    ]


def twins_but_for_priors(evaluator: Evaluator, seed: int) -> list[Twin]:
    """Symmetries of the measured rows that a prior breaks: there a fit is less likely by it alone.

    Empty where no searched parameter has a prior, and where the model fails at a point of the box.

    Args:
        evaluator: of the objective; counts what is evaluated.
        seed: of the points that are tried.
    """
    parameters = evaluator.objective.parameters
    held = [p.is_searched and p.prior_sigma is not None for p in parameters]
    if not any(held):
        return []
    bare = tuple(
        replace(p, prior=None) if has_prior else p
        for p, has_prior in zip(parameters, held, strict=True)
    )
    without = Evaluator(replace(evaluator.objective, parameters=bare))
    found = find_twins(without, seed)
    evaluator.counts += without.counts
    index = np.flatnonzero(held)
    return [twin for twin in found if not twin.leaves(index)]


def _unchanged(
    evaluator: Evaluator,
    target: Evaluator,
    candidates: Sequence[Twin],
    points: Sequence[FloatArray],
    which: slice,
) -> list[Twin]:
    """Those candidates that change no row at some of the points that they keep in the box."""
    parameters = evaluator.objective.parameters
    asked: list[tuple[Twin, int, FloatArray]] = []
    for candidate in candidates:
        images = [(k, candidate.of(parameters, x)) for k, x in enumerate(points)]
        inside = [(candidate, k, image) for k, image in images if image is not None]
        asked += inside[which]
    places = sorted({k for _, k, _ in asked})
    here = dict(zip(places, evaluator.points([points[k] for k in places]), strict=True))
    there = target.points([image for _, _, image in asked])
    moved: dict[int, list[float]] = {id(candidate): [] for candidate in candidates}
    for (candidate, k, _), point in zip(asked, there, strict=True):
        rows = here[k].residuals
        change = np.abs(rows - point.residuals) / (1.0 + np.abs(rows))
        moved[id(candidate)].append(float(np.max(change, initial=0.0)))
    return [candidate for candidate in candidates if _is_still(moved[id(candidate)], which)]


def _is_still(moved: Sequence[float], which: slice) -> bool:
    """Whether rows do not move, by what they did at each place; of one place alone not much."""
    if not moved or not max(moved) <= INEXACT:
        return False
    return which.stop == 1 or bool(np.median(moved) <= ROUNDING)


def _is_identity(twin: Twin) -> bool:
    return _keeps(twin) and bool(np.all(twin.shifts == 0.0))


def _keeps(twin: Twin) -> bool:
    """Whether every parameter stays where it is, but for shifts."""
    kept = np.array_equal(twin.order, np.arange(twin.order.size))
    return kept and bool(np.all(twin.signs == 1.0))


def _candidates(parameters: Sequence[Parameter]) -> list[Twin]:
    """Products of exchanges, turns and reversed signs, the simplest first."""
    orders = sorted(itertools.islice(_orders(parameters), LISTED), key=_effort)[:MOST]
    turns = list(itertools.islice(itertools.product(*map(_turns, parameters)), MOST + 1))
    if len(turns) > MOST:
        return []
    return [
        Twin(
            np.array(order, dtype=np.intp),
            np.array([sign for sign, _ in turn]),
            np.array([shift for _, shift in turn]),
        )
        for order in orders
        for turn in turns
    ][:MOST]


def _effort(order: Sequence[int]) -> tuple[bool, int]:
    """Whether an order is more than exchanges in pairs, as relabelled modes are; how many move."""
    pairs = all(order[taken] == place for place, taken in enumerate(order))
    return not pairs, sum(taken != place for place, taken in enumerate(order))


def _turns(parameter: Parameter) -> list[tuple[float, float]]:
    """Signs and shifts of one parameter."""
    if parameter.prior_sigma is not None or not parameter.moves_model or parameter.experiments:
        return [(1.0, 0.0)]
    if parameter.period is not None:
        return [(sign, f * parameter.period) for sign in (1.0, -1.0) for f in FRACTIONS]
    if parameter.is_angle:
        return _quarter_turns(parameter)
    if parameter.lower == -parameter.upper:
        return [(1.0, 0.0), (-1.0, 0.0)]
    return [(1.0, 0.0)]


def _quarter_turns(parameter: Parameter) -> list[tuple[float, float]]:
    """Signs and shifts of an angle without a period that keep some of its box in it.

    Quarters of a turn from zero either way, and its reversal about the middle of the box.
    """
    low, high = parameter.lower, parameter.upper
    wide, quarter = high - low, 0.5 * math.pi
    ways = [(1.0, 0.0), (-1.0, low + high)]
    ways += [(1.0, k * quarter) for k in _within(-wide / quarter, wide / quarter) if k]
    turned = [k * quarter for k in _within(2.0 * low / quarter, 2.0 * high / quarter)]
    near = [abs(shift - low - high) <= SAME * wide for shift in turned]
    ways += [(-1.0, shift) for shift, same in zip(turned, near, strict=True) if not same]
    return ways if len(ways) <= MOST_TURNS else ways[:2]


def _within(low: float, high: float) -> range:
    """Whole numbers between two, these left out."""
    return range(math.floor(low) + 1, math.ceil(high))


def _orders(parameters: Sequence[Parameter]) -> Iterator[tuple[int, ...]]:
    """Exchanges within the groups of like parameters, those of several groups combined."""
    groups: list[list[int]] = []
    for i, p in enumerate(parameters):
        if p.prior_sigma is None and p.moves_model and p.period is None and not p.experiments:
            mine = next((g for g in groups if all(_alike(p, parameters[j]) for j in g)), None)
            if mine is None:
                groups.append([i])
            else:
                mine.append(i)
    several = [group for group in groups if len(group) > 1]
    for choice in itertools.product(*(itertools.permutations(group) for group in several)):
        order = list(range(len(parameters)))
        for group, chosen in zip(several, choice, strict=True):
            for place, taken in zip(group, chosen, strict=True):
                order[place] = taken
        yield tuple(order)


def _alike(one: Parameter, other: Parameter) -> bool:
    """Whether two parameters could stand for each other over a tenth of the narrower box."""
    common = min(one.upper, other.upper) - max(one.lower, other.lower)
    narrower = min(one.upper - one.lower, other.upper - other.lower)
    return one.unit == other.unit and common >= LIKE * narrower
