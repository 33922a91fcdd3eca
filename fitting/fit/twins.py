"""Exact symmetries of a problem: other parameters of the box at which every prediction is the same.

    p'_i = s_i p_order(i) + t_i

Tried are fractions of a period with either sign, quarters of a turn for an angle without a period,
reversed signs in boxes that are symmetric about zero, and exchanges of parameters of one unit whose
boxes overlap, and products of these; where there are too many, exchanges in pairs first. What
leaves the rows unchanged at points drawn from the box, to rounding at most of them, is a symmetry
of the model, found without knowing the model. The data distinguish no point from its twins,
whatever they are.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import Parameter, bounds, to_model, to_search
from fitting.fit.objective import Evaluator, Objective
from fitting.fit.search import Box
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
    every = np.arange(len(parameters))
    twins = [t for t in _candidates(parameters) if other is not None or not t.leaves(every)]
    points = Box(parameters).spread(DRAWN, seed)
    try:
        # one point sifts the candidates
        twins = _unchanged(evaluator, target, twins, points, slice(1))
        twins = _unchanged(evaluator, target, twins, points, slice(1, POINTS))
    except NoAnswer:
        raise
    except (FmuFailure, NoScale):
        twins = []
    evaluator.counts += target.counts
    return twins


def sampling_twins(parameters: Sequence[Parameter], rates_hz: Iterable[float]) -> list[Twin]:
    """Frequencies that samples do not distinguish: f, and f plus or minus one or two rates.

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
    has_prior = [p.is_searched and p.prior_sigma is not None for p in parameters]
    if not any(has_prior):
        return []
    bare = tuple(
        replace(p, prior=None) if has_own else p
        for p, has_own in zip(parameters, has_prior, strict=True)
    )
    without = Evaluator(replace(evaluator.objective, parameters=bare))
    twins = find_twins(without, seed)
    evaluator.counts += without.counts
    index = np.flatnonzero(has_prior)
    return [twin for twin in twins if not twin.leaves(index)]


def _unchanged(
    evaluator: Evaluator,
    target: Evaluator,
    candidates: Sequence[Twin],
    points: Sequence[FloatArray],
    which: slice,
) -> list[Twin]:
    """Those candidates that change no row at some of the points that they keep in the box."""
    parameters = evaluator.objective.parameters
    tried: list[tuple[int, int, FloatArray]] = []
    for number, candidate in enumerate(candidates):
        images = [(k, candidate.of(parameters, x)) for k, x in enumerate(points)]
        tried += [(number, k, image) for k, image in images if image is not None][which]
    places = sorted({k for _, k, _ in tried})
    here = dict(zip(places, evaluator.points([points[k] for k in places]), strict=True))
    there = target.points([image for _, _, image in tried])
    changes: list[list[float]] = [[] for _ in candidates]
    for (number, k, _), point in zip(tried, there, strict=True):
        rows = here[k].residuals
        change = np.abs(rows - point.residuals) / (1.0 + np.abs(rows))
        changes[number].append(float(np.max(change, initial=0.0)))
    # a model may compute less exactly at single places
    return [
        candidate
        for candidate, change in zip(candidates, changes, strict=True)
        if change
        and max(change) <= INEXACT
        and (which.stop == 1 or float(np.median(change)) <= ROUNDING)
    ]


def _candidates(parameters: Sequence[Parameter]) -> list[Twin]:
    """Products of exchanges, turns and reversed signs, the simplest first."""
    turns = list(itertools.islice(itertools.product(*map(_turns, parameters)), MOST + 1))
    if len(turns) > MOST:
        return []
    # parameters that may be exchanged: of one unit, each box a tenth of the narrower one in common
    groups: list[list[int]] = []
    for i, p in enumerate(parameters):
        if p.prior_sigma is None and p.moves_model and p.period is None and not p.experiments:
            mine = next((g for g in groups if all(_alike(p, parameters[j]) for j in g)), None)
            if mine is None:
                groups.append([i])
            else:
                mine.append(i)
    place, orders = np.arange(len(parameters)), []
    choices = itertools.product(*map(itertools.permutations, groups))
    for choice in itertools.islice(choices, LISTED):
        order = place.copy()
        for group, chosen in zip(groups, choice, strict=True):
            order[group] = chosen
        orders.append(order)
    # exchanges in pairs come first, as relabelled modes are, then those that move fewer
    orders.sort(key=lambda o: (not np.array_equal(o[o], place), np.count_nonzero(o != place)))
    pairs = itertools.product(orders, [np.array(turn).reshape(-1, 2).T for turn in turns])
    return [Twin(order, *turn) for order, turn in itertools.islice(pairs, MOST)]


def _turns(parameter: Parameter) -> list[tuple[float, float]]:
    """Signs and shifts of one parameter that are tried."""
    low, high = parameter.lower, parameter.upper
    if parameter.prior_sigma is not None or not parameter.moves_model or parameter.experiments:
        return [(1.0, 0.0)]
    if parameter.period is not None:
        return [(sign, f * parameter.period) for sign in (1.0, -1.0) for f in FRACTIONS]
    if not parameter.is_angle:
        return [(1.0, 0.0), (-1.0, 0.0)] if low == -high else [(1.0, 0.0)]
    # an angle without a period: its reversal about the middle of the box, and quarters of a turn
    # either way that keep some of the box in it
    wide, quarter = high - low, 0.5 * math.pi
    turns = [(1.0, 0.0), (-1.0, low + high)]
    most = math.ceil(wide / quarter)
    turns += [(1.0, k * quarter) for k in range(1 - most, most) if k]
    reversals = range(math.floor(2.0 * low / quarter) + 1, math.ceil(2.0 * high / quarter))
    shifts = [k * quarter for k in reversals]
    turns += [(-1.0, s) for s in shifts if abs(s - low - high) > SAME * wide]
    return turns if len(turns) <= MOST_TURNS else turns[:2]


def _alike(one: Parameter, other: Parameter) -> bool:
    """Whether two parameters could be exchanged over a tenth of the narrower box."""
    common = min(one.upper, other.upper) - max(one.lower, other.lower)
    narrower = min(one.upper - one.lower, other.upper - other.lower)
    return one.unit == other.unit and common >= LIKE * narrower
