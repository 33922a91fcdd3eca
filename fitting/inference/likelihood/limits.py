"""Limits of other parameters at which a profile ended: whether they end it, or the data do.

Slopes do not tell that. What a parameter does may have come to its end at the limit, as of a mode
that is damped so much that nothing is left of it: then nothing fits beyond the limit, either.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitting.campaign.parameters import spans_decades
from fitting.fit.likelihood.descent import (
    Constraint,
    Expansion,
    Optimum,
    descend,
    expansion_at,
)
from fitting.fit.likelihood.likelihood import Likelihood, LikelihoodEvaluator
from fitting.fit.likelihood.lockstep import Exhausted, Task, run_in_lockstep
from fitting.inference.likelihood.inverses import Branches
from fitting.inference.likelihood.profiles import ProfileBranch, ProfilePoint, Quantity
from fitting.text.arrays import FloatArray
from fitting.text.error_bars import ROOT_95

#: How far a parameter is taken beyond a limit that holds it: by a factor of 2^10.
DOUBLINGS = 10
#: How much farther from the best value than its crossing a value is tried, as a share of that way.
MORE = 0.03


def released(
    evaluator: LikelihoodEvaluator,
    optimum: Optimum,
    quantities: Sequence[Quantity],
    branches: Mapping[str, Branches],
) -> dict[str, Branches]:
    """The branches; those held at a limit count as crossed where nothing fits beyond it, either.

    Beyond means at the value `MORE` farther out: there such a branch then ends. Nothing is released
    where the other side goes to the end of its range: noise alone may cut one side of a valley.

    Args:
        evaluator: of the likelihood; counts what is evaluated.
        optimum: what chi square is counted from.
        quantities: whose branches they are.
        branches: downward and upward, by name.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    sides = [
        (quantity, side)
        for quantity in quantities
        for side in (0, 1)
        if branches[quantity.name][side].end == "held"
        and branches[quantity.name][1 - side].end in ("crossed", "held")
    ]
    made = dict(branches)
    if not sides:
        return made
    likelihood = evaluator.likelihood
    held = {i for quantity, side in sides for i in branches[quantity.name][side].held}
    tasks = [_fits_beyond(optimum, q, branches[q.name][side]) for q, side in sides]
    evaluator.likelihood = likelihood.farther(sorted(held), 2.0**DOUBLINGS)
    try:
        fits = run_in_lockstep(tasks, evaluator)
    finally:
        evaluator.likelihood = likelihood
    for (quantity, side), fit in zip(sides, fits, strict=True):
        if fit is False:  # None: cut for its cost
            both = list(made[quantity.name])
            end = _farther(optimum, quantity, both[side])
            both[side] = replace(both[side], end="crossed", at_95=end, held=())
            made[quantity.name] = (both[0], both[1])
    return made


def _farther(optimum: Optimum, quantity: Quantity, branch: ProfileBranch) -> float:
    """The value `MORE` of the way beyond a crossing, inside its range.

    In ratios where the range spans decades: there a share of the way down from the best may be
    many times what is left to nought.
    """
    end, best = branch.at_95, quantity.best
    zero = _nought(optimum, quantity)
    if zero is None:
        farther = end + MORE * (end - best)
    else:
        farther = float(zero + (end - zero) * ((end - zero) / (best - zero)) ** MORE)
    if quantity.round:
        return farther
    # not beyond the end of its range, where there is nothing: half of the way there at most
    last = 0.5 * (end + (quantity.high if end > best else quantity.low))
    return min(farther, last) if end > best else max(farther, last)


def _nought(optimum: Optimum, quantity: Quantity) -> float | None:
    """Where a quantity whose range spans decades is nought, in x or its unit; None for others."""
    if quantity.index < 0:
        return 0.0 if spans_decades(quantity.low, quantity.high) else None
    parameter = optimum.likelihood.parameters[quantity.index]
    return -parameter.reference / parameter.scale if parameter.spans_decades else None


def _fits_beyond(optimum: Optimum, quantity: Quantity, branch: ProfileBranch) -> Task[bool]:
    """Whether a farther value fits once the parameters at a limit go beyond it, in doublings.

    What is not found out counts as a fit.
    """
    room = optimum.likelihood
    target = _farther(optimum, quantity, branch)
    constraint = quantity.constraint(target, target - branch.at_95)
    x = _beyond(branch).x

    def least(limits: Likelihood, begin: FloatArray, kept: Constraint) -> Task[Expansion | None]:
        here = yield from expansion_at(limits, begin, constraint.output >= 0)
        return (yield from descend(limits, here, kept))

    def fits(found: Expansion | None) -> bool:
        if found is None:
            return True
        return optimum.delta(found.chi_square, quantity.freedom) <= ROOT_95**2

    try:
        found = yield from least(room.farther(branch.held, 2.0**DOUBLINGS), x, constraint)
        for doubling in range(1, DOUBLINGS + 1):
            if fits(found):
                return True
            free = room.farther(branch.held, 2.0**doubling)
            moved = _at_limits(free, x, branch.held)
            found = yield from least(free, moved, replace(constraint, frozen=branch.held))
            x = x if found is None else found.x
    except Exhausted:
        return True
    return fits(found)


def _beyond(branch: ProfileBranch) -> ProfilePoint:
    """The point beyond a crossing; a branch that was gone on with has crossed more than once."""
    excluded = [point for point in branch.points if point.root > ROOT_95]
    return min(excluded, key=lambda point: abs(point.value - branch.at_95))


def _at_limits(likelihood: Likelihood, x: FloatArray, held: Sequence[int]) -> FloatArray:
    """A point with some parameters taken to their nearer limits."""
    index = list(held)
    up = likelihood.upper - x < x - likelihood.lower
    moved = x.copy()
    moved[index] = np.where(up, likelihood.upper, likelihood.lower)[index]
    return moved
