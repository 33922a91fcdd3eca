"""Searches around one optimum: other minima, ends of ranges, profiles, in few large batches."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import UNIFORM_WIDTH, search_bounds
from fitting.fit.likelihood.descent import Expansion, Optimum, descend, expansion_at
from fitting.fit.likelihood.likelihood import LikelihoodEvaluator
from fitting.fit.likelihood.lockstep import Exhausted, Request, Task, run_in_lockstep
from fitting.fit.linearisation import Linearisation
from fitting.inference.likelihood.profiles import (
    ROOT_95,
    STEPS,
    ProfileBranch,
    ProfilePoint,
    Quantity,
    fit_at_end,
    trace_branch,
)
from fitting.inference.likelihood.ranges import OutputRange
from fitting.text.arrays import FloatArray

#: Seeded points of the box from which other minima are looked for.
OTHER_STARTS = 12
#: Linearised sigma over the range from which the ends of the range are tried outright.
WORTH_REACHING = 0.05
#: Strides across a range whose ends are both known to fit: they only show what is between.
OPEN_STEPS = 6


@dataclass(frozen=True, kw_only=True)
class Exploration:
    """What was found around one optimum.

    `branches` (downward, upward) and `range_ends` (points at the low and high end that fit, None
    where none does) by quantity; `minima` are those from other starts that fit.
    """

    optimum: Optimum
    quantities: tuple[Quantity, ...]
    branches: Mapping[str, tuple[ProfileBranch, ProfileBranch]]
    range_ends: Mapping[str, tuple[ProfilePoint | None, ProfilePoint | None]]
    minima: tuple[ProfilePoint, ...]
    ranges: Mapping[str, OutputRange]

    @property
    def points(self) -> list[ProfilePoint]:
        """Every point that any profile came by."""
        points = [
            p for branches in self.branches.values() for branch in branches for p in branch.points
        ]
        return points + [s for both in self.range_ends.values() for s in both if s is not None]


def explore(
    evaluator: LikelihoodEvaluator,
    optimum: Optimum,
    ranges: Mapping[str, OutputRange],
    minima: Sequence[ProfilePoint],
    only: Sequence[str] = (),
) -> Exploration:
    """The ends of the ranges, then the profiles; each step one set of batches.

    Args:
        evaluator: of the likelihood; counts what is evaluated.
        optimum: the most likely point and its likelihood.
        ranges: of the outputs without data, by name.
        minima: from other starts that fit.
        only: names of the values that are profiled; all if empty.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    chosen = tuple(q for q in quantities(optimum, ranges) if not only or q.name in only)
    range_ends = _range_ends(evaluator, optimum, chosen, ranges, minima)
    traces = []
    for quantity in chosen:
        open_ = all(point is not None for point in range_ends[quantity.name])
        steps = OPEN_STEPS if open_ else STEPS
        traces += [trace_branch(optimum, quantity, direction, steps) for direction in (-1.0, 1.0)]
    none = ProfileBranch(points=(), end="cost", at_68=math.nan, at_95=math.nan)
    branches = [
        branch if branch is not None else none for branch in run_in_lockstep(traces, evaluator)
    ]
    pairs = {q.name: (branches[2 * k], branches[2 * k + 1]) for k, q in enumerate(chosen)}
    return _with_outputs(
        evaluator,
        Exploration(
            optimum=optimum,
            quantities=chosen,
            branches=pairs,
            range_ends=range_ends,
            minima=tuple(minima),
            ranges=ranges,
        ),
    )


def _range_ends(
    evaluator: LikelihoodEvaluator,
    optimum: Optimum,
    chosen: Sequence[Quantity],
    ranges: Mapping[str, OutputRange],
    minima: Sequence[ProfilePoint],
) -> dict[str, tuple[ProfilePoint | None, ProfilePoint | None]]:
    """Points at the ends of the ranges that fit; further beginnings only where the first failed."""
    ends: dict[tuple[str, int], ProfilePoint] = {}
    for attempt in range(3):
        tries: list[tuple[str, int, Task[ProfilePoint | None]]] = []
        for quantity in chosen:
            if quantity.round or not quantity.sigma > WORTH_REACHING * quantity.width:
                continue
            for which, end in enumerate((quantity.low, quantity.high)):
                begins = _beginnings(optimum, quantity, which, ranges, minima)
                if (quantity.name, which) not in ends and attempt < len(begins):
                    begin, frozen = begins[attempt]
                    task = fit_at_end(optimum, quantity, begin, end, frozen)
                    tries.append((quantity.name, which, task))
        ended = _possible(
            evaluator, optimum, run_in_lockstep([task for _, _, task in tries], evaluator)
        )
        for (name, which, _), point in zip(tries, ended, strict=True):
            if point is not None:
                ends[name, which] = point
    return {q.name: (ends.get((q.name, 0)), ends.get((q.name, 1))) for q in chosen}


def _with_outputs(evaluator: LikelihoodEvaluator, explored: Exploration) -> Exploration:
    """Every point with its outputs: searches for parameters did not ask for them."""
    bare = [
        p for branches in explored.branches.values() for branch in branches for p in branch.points
    ]
    bare += [point for both in explored.range_ends.values() for point in both if point is not None]
    bare = [point for point in bare if point.outputs.size == 0]
    if not explored.optimum.likelihood.names or not bare:
        return explored
    request = Request(tuple(point.x for point in bare), rows=False)
    read = {
        id(point): sample.outputs
        for point, sample in zip(bare, evaluator([request])[0], strict=True)
    }

    def whole(point: ProfilePoint) -> ProfilePoint:
        return replace(point, outputs=read.get(id(point), point.outputs))

    branches = {
        name: tuple(replace(branch, points=tuple(map(whole, branch.points))) for branch in both)
        for name, both in explored.branches.items()
    }
    range_ends = {
        name: tuple(None if point is None else whole(point) for point in both)
        for name, both in explored.range_ends.items()
    }
    return replace(
        explored,
        branches={name: (low, high) for name, (low, high) in branches.items()},
        range_ends={name: (low, high) for name, (low, high) in range_ends.items()},
    )


def _possible(
    evaluator: LikelihoodEvaluator, optimum: Optimum, points: Sequence[ProfilePoint | None]
) -> list[ProfilePoint | None]:
    """Those points at which every output exists that exists at the optimum, with their outputs.

    A fit at parameters for which the model has no such output is no fit of that model.
    """
    there = [point for point in points if point is not None]
    if not optimum.likelihood.names or not there:
        return list(points)
    kept: dict[int, ProfilePoint] = {}
    exists = np.isfinite(optimum.expansion.sample.outputs)
    request = Request(tuple(point.x for point in there), rows=False)
    for point, sample in zip(there, evaluator([request])[0], strict=True):
        outputs = point.outputs if point.outputs.size else sample.outputs
        if np.all(np.isfinite(outputs[exists])):
            kept[id(point)] = replace(point, outputs=outputs)
    return [None if point is None else kept.get(id(point)) for point in points]


def quantities(optimum: Optimum, ranges: Mapping[str, OutputRange]) -> tuple[Quantity, ...]:
    """Every parameter, and every output that has a value at the optimum and a range.

    Args:
        optimum: the most likely point and its likelihood.
        ranges: of the outputs without data, by name.
    """
    likelihood, expansion = optimum.likelihood, optimum.expansion
    lower, upper = search_bounds(likelihood.parameters)
    covariance = data_covariance(optimum)
    made = []
    for i, parameter in enumerate(likelihood.parameters):
        best, low, high = float(expansion.x[i]), float(lower[i]), float(upper[i])
        goes_round = bool(np.isfinite(likelihood.periods[i]))
        if goes_round:
            half = 0.5 * float(likelihood.periods[i])
            low, high = best - half, best + half
        sigma = math.sqrt(covariance[i, i])
        made.append(
            Quantity(
                name=parameter.name,
                index=i,
                output=-1,
                best=best,
                sigma=sigma,
                low=low,
                high=high,
                round=goes_round,
            )
        )
    for k, name in enumerate(likelihood.names):
        best, slope = float(expansion.sample.outputs[k]), expansion.outward[k]
        known = math.isfinite(best) and bool(np.all(np.isfinite(slope)))
        if not known or not ranges[name].high > ranges[name].low:
            continue
        sigma = math.sqrt(max(0.0, float(slope @ covariance @ slope)))
        low, high = min(ranges[name].low, best), max(ranges[name].high, best)
        made.append(
            Quantity(
                name=name,
                index=-1,
                output=k,
                best=best,
                sigma=max(sigma, 1e-12 * (high - low)),
                low=low,
                high=high,
            )
        )
    return tuple(made)


def data_covariance(optimum: Optimum) -> FloatArray:
    """(J^T J + P)^-1 with the box as a uniform prior, (n, n): linearised, never infinite.

    Args:
        optimum: where it is linearised.
    """
    at, prior = optimum.expansion, optimum.likelihood.widths / UNIFORM_WIDTH
    return Linearisation(rows=at.sample.rows, matrix=at.matrix, prior=prior).covariance


def other_minima(
    evaluator: LikelihoodEvaluator, optimum: Optimum, seed: int, number: int = OTHER_STARTS
) -> tuple[ProfilePoint, ...]:
    """Minima from seeded starts of the box that fit as well, (Dchi^2 below the 95 % threshold).

    Args:
        evaluator: of the likelihood; counts what is evaluated.
        optimum: the most likely point and its likelihood.
        seed: of the starts.
        number: of starts.
    """
    likelihood = optimum.likelihood
    lower, upper = search_bounds(likelihood.parameters)
    generator = np.random.default_rng(seed)
    # what has a prior of its own is looked for near the best
    has_prior = likelihood.inverse_prior_sigma > 0.0
    starts = [
        np.where(has_prior, optimum.expansion.x, generator.uniform(lower, upper))
        for _ in range(number)
    ]

    def search(x: FloatArray) -> Task[Expansion | None]:
        try:
            here = yield from expansion_at(likelihood, x, False)
            if not math.isfinite(here.chi_square):
                return None
            ended = yield from descend(likelihood, here)
            return None if ended is None else (yield from expansion_at(likelihood, ended.x))
        except Exhausted:
            return None

    points = []
    for expansion in run_in_lockstep([search(x) for x in starts], evaluator):
        if expansion is not None:
            delta = expansion.chi_square - optimum.least
            if delta <= ROOT_95**2:
                points.append(
                    ProfilePoint(
                        value=math.nan, delta=delta, x=expansion.x, outputs=expansion.sample.outputs
                    )
                )
    return tuple(points)


def _beginnings(
    optimum: Optimum,
    quantity: Quantity,
    which: int,
    ranges: Mapping[str, OutputRange],
    minima: Sequence[ProfilePoint],
) -> list[tuple[FloatArray, tuple[int, ...]]]:
    """Where to begin a search for a fit at an end of a range, and which axes it keeps."""
    end = (quantity.low, quantity.high)[which]
    if quantity.index >= 0:
        exists = np.isfinite(optimum.expansion.sample.outputs)
        possible = [point for point in minima if np.all(np.isfinite(point.outputs[exists]))]
        nearest = sorted(possible, key=lambda point: abs(point.x[quantity.index] - end))[:2]
        begins = [optimum.expansion.x.copy(), *(point.x.copy() for point in nearest)]
        for begin in begins:
            begin[quantity.index] = end
        return [(begin, ()) for begin in begins]
    range_ = ranges[quantity.name]
    there = (range_.x_low, range_.x_high)[which]
    if not np.all(np.isfinite(there)):
        return []
    # what the output does not depend on is best where the data have it
    mixed = np.where(range_.depends, there, optimum.expansion.x)
    return [(mixed, tuple(map(int, np.flatnonzero(range_.depends)))), (there, ()), (mixed, ())]
