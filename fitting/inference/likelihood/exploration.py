"""Searches around one optimum: other minima, ends of ranges, profiles, in few large batches."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.campaign.parameters import UNIFORM_WIDTH, own_count, search_bounds, to_model
from fitting.fit.covariance import WhitenedErrors
from fitting.fit.likelihood.descent import (
    AT_LIMIT,
    FEW_OWN,
    Expansion,
    Optimum,
    expansion_at,
    lower,
)
from fitting.fit.likelihood.likelihood import Likelihood, LikelihoodEvaluator
from fitting.fit.likelihood.lockstep import Exhausted, Request, Task, run_in_lockstep
from fitting.fit.linearisation import Linearisation
from fitting.fit.search.box import Box
from fitting.inference.likelihood.inverses import Branches, inverses, told_twice
from fitting.inference.likelihood.limits import released
from fitting.inference.likelihood.profiles import (
    EXCLUDED,
    STEPS,
    ProfileBranch,
    ProfilePoint,
    Quantity,
    fit_at_end,
    last_crossing,
    trace_branch,
)
from fitting.inference.likelihood.ranges import OutputRange
from fitting.inference.likelihood.ways import turned, walked_to_ends
from fitting.signal.student import ROOT_68, reach
from fitting.text.arrays import BoolArray, FloatArray
from fitting.text.error_bars import ROOT_95

#: Where a search for a fit at the end of a range begins, and the axes that are to stay there.
Beginning = tuple[FloatArray, tuple[int, ...]]

#: Points of the box from which other minima are looked for, where no search was made before.
OTHER_STARTS = 12
#: Linearised sigma over the way to an end of the range from which that end is tried outright.
WORTH_REACHING = 0.3
#: Share of an interval by which a point that fits lies beyond it; how often it is gone on from one.
BEYOND, EXTENSIONS = 0.02, 2
#: Points from which an end is tried once more where a branch lost its way.
NEAREST = 2
#: Share of what is left of a budget that a dear walk may take of what a linearisation calls open:
#: along a bent valley it takes any.
FOR_AN_OPEN_WALK = 0.5
#: Share of the way to the end of the room that counts as there.
AT_ROOM = 1e-6
#: Strides towards an end of a range that is known to fit: they only show what is between.
OPEN_STEPS = 4
#: A branch that nobody walked, to an end that is known to fit.
BOTH_FIT = ProfileBranch(points=(), end="bound", at_68=math.nan, at_95=math.nan)


@dataclass(frozen=True, kw_only=True)
class Exploration:
    """What was found around one optimum.

    `branches` (downward, upward) and `range_ends` (points at the low and high end that fit, None
    where none does) by quantity; `minima` are those from other starts that fit, `known` what was
    come by before. `around` are the branches of the optimum's own valley: `branches` go on from
    every point beyond that fits. `parameters` are all that do not go round and have no prior of
    their own (that excludes the ends of their room), also those that nobody asked for.
    """

    optimum: Optimum
    quantities: tuple[Quantity, ...]
    branches: Mapping[str, Branches]
    range_ends: Mapping[str, tuple[ProfilePoint | None, ProfilePoint | None]]
    minima: tuple[ProfilePoint, ...]
    ranges: Mapping[str, OutputRange]
    known: tuple[ProfilePoint, ...] = ()
    parameters: tuple[Quantity, ...] = ()
    around: Mapping[str, Branches] = field(default_factory=dict)

    @property
    def points(self) -> list[ProfilePoint]:
        """Every point that any profile came by."""
        points = [
            p for branches in self.branches.values() for branch in branches for p in branch.points
        ]
        return points + [s for both in self.range_ends.values() for s in both if s is not None]

    @property
    def fitting(self) -> list[ProfilePoint]:
        """Every point in hand inside the 95 % threshold at which no output is missing."""
        return self._up_to(ROOT_95**2)

    @property
    def near(self) -> list[ProfilePoint]:
        """The same of all points that the data do not exclude for good."""
        return self._up_to(EXCLUDED)

    def _up_to(self, delta: float) -> list[ProfilePoint]:
        exists = np.isfinite(self.optimum.expansion.sample.outputs)
        return [
            p
            for p in (*self.points, *self.minima, *self.known)
            if p.delta <= delta
            and p.outputs.size == exists.size
            and np.all(np.isfinite(p.outputs[exists]))
        ]


@dataclass(frozen=True)
class Extent:
    """How far an exploration goes.

    `only` names the values that are profiled, all if empty. Where walks are dear, `until` ends it
    by the points in hand.
    """

    only: tuple[str, ...] = ()
    until: Callable[[Sequence[ProfilePoint]], bool] = lambda points: False


def explore(
    evaluator: LikelihoodEvaluator,
    optimum: Optimum,
    ranges: Mapping[str, OutputRange],
    minima: Sequence[ProfilePoint],
    extent: Extent,
    known: Sequence[ProfilePoint] = (),
) -> Exploration:
    """Profiles, those first that the data see: each step is one set of batches.

    Values that a linearisation calls open are then tried at the ends of their ranges, and walked
    where these do not both fit: what lies between two ends that fit decides nothing. All parameters
    without a prior are taken to the ends of their room, asked for or not: what fits there may
    extend others. In the end every point in hand that fits and lies beyond an interval is gone on
    from. Outputs that are inverse to each other are walked once.

    Args:
        evaluator: of the likelihood; counts what is evaluated.
        optimum: the most likely point and its likelihood.
        ranges: of the outputs without data, by name.
        minima: from other starts that fit.
        extent: what is profiled, and what ends it.
        known: points not excluded which another exploration came by.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    every = quantities(optimum, ranges)
    free = ~(optimum.likelihood.inverse_prior_sigma > 0.0)
    wanted = tuple(q for q in every if not extent.only or q.name in extent.only)
    twice = inverses(evaluator, optimum, data_covariance(optimum), wanted)
    chosen = tuple(q for q in wanted if all(q is not inverse.quantity for inverse in twice))
    wide = [
        q
        for q in chosen
        if not q.round and q.sigma > WORTH_REACHING * min(q.high - q.best, q.best - q.low)
    ]
    nothing = Exploration(
        optimum=optimum,
        quantities=chosen,
        branches={},
        range_ends={q.name: (None, None) for q in chosen},
        minima=tuple(minima),
        known=tuple(known),
        parameters=tuple(q for q in every if q.index >= 0 and not q.round and free[q.index]),
        ranges=ranges,
    )
    explored = nothing
    for explored in _profiled(evaluator, nothing, wide):
        if _are_dear(optimum) and extent.until(explored.points):
            return explored
    explored = replace(explored, around=explored.branches)
    explored = _with_ways(evaluator, explored)
    explored = extended(evaluator, explored)
    explored = _with_ends(evaluator, explored, _lost_ends(explored), _nearest_to_end)
    explored = replace(explored, branches=released(evaluator, optimum, chosen, explored.branches))
    ends = explored.range_ends
    return replace(
        explored,
        quantities=wanted,
        branches=told_twice(explored.branches, twice),
        around=told_twice(explored.around, twice),
        range_ends={**ends, **{i.quantity.name: i.range_ends(ends[i.of]) for i in twice}},
    )


def _profiled(
    evaluator: LikelihoodEvaluator, explored: Exploration, wide: Sequence[Quantity]
) -> Iterator[Exploration]:
    """Further and further explored, to the profiles of all quantities around the optimum.

    Args:
        evaluator: of the likelihood; counts what is evaluated.
        explored: nothing yet.
        wide: quantities that a linearisation calls open.
    """
    optimum, chosen = explored.optimum, explored.quantities
    for part in _in_turn(optimum, [q for q in chosen if q not in wide]):
        explored = _with_outputs(evaluator, _with_walks(evaluator, explored, part))
        yield explored
    explored = _with_ends(evaluator, explored, _both_ends(chosen), _optimum_at_end)
    explored = _with_outputs(evaluator, explored)
    yield explored
    explored = _with_ends(evaluator, explored, _both_ends(wide), _nearest_to_end)
    yield explored
    shown = [q for q in wide if all(point is not None for point in explored.range_ends[q.name])]
    share = FOR_AN_OPEN_WALK if _are_dear(optimum) else 1.0
    for part in _in_turn(optimum, [q for q in wide if q not in shown]):
        with evaluator.within(share):
            explored = _with_walks(evaluator, explored, part)
        explored = _with_outputs(evaluator, explored)
        yield explored
    both_fit = {q.name: (BOTH_FIT, BOTH_FIT) for q in shown}
    yield _with_outputs(evaluator, replace(explored, branches={**explored.branches, **both_fit}))


def _are_dear(optimum: Optimum) -> bool:
    """Whether walks are, as those of a long series are, whose places have values of their own."""
    return own_count(optimum.likelihood.parameters) > FEW_OWN


def _in_turn(optimum: Optimum, chosen: Sequence[Quantity]) -> list[list[Quantity]]:
    """All side by side; where walks are dear one by one, so that a budget does not cut all of them.

    Outputs first, which are what is asked for; of these those first that the data see best.
    """
    if not _are_dear(optimum):
        return [list(chosen)]
    return [[q] for q in sorted(chosen, key=lambda q: (q.output < 0, q.sigma / q.width))]


def _both_ends(chosen: Sequence[Quantity]) -> list[tuple[Quantity, int]]:
    """Quantities with either side of their range: 0 low, 1 high."""
    return [(quantity, side) for quantity in chosen for side in (0, 1)]


def _lost_ends(explored: Exploration) -> list[tuple[Quantity, int]]:
    """Quantities and sides of the branches that lost their way."""
    return [
        (quantity, side)
        for quantity, side in _both_ends(explored.quantities)
        if explored.branches[quantity.name][side].end == "lost" and not quantity.round
    ]


def _with_ends(
    evaluator: LikelihoodEvaluator,
    explored: Exploration,
    sides: Sequence[tuple[Quantity, int]],
    beginnings: Callable[[Exploration, Quantity, int], list[Beginning]],
) -> Exploration:
    """Ends of ranges that are not known to fit, tried from some beginnings; those that do, kept."""
    tries: list[tuple[str, int]] = []
    tasks = []
    for quantity, side in sides:
        if explored.range_ends[quantity.name][side] is None:
            end = (quantity.low, quantity.high)[side]
            for begin, frozen in beginnings(explored, quantity, side):
                tries.append((quantity.name, side))
                tasks.append(fit_at_end(explored.optimum, quantity, begin, end, frozen))
    found = possible(evaluator, explored.optimum, run_in_lockstep(tasks, evaluator))
    range_ends = dict(explored.range_ends)
    for (name, side), reached in zip(tries, found, strict=True):
        if reached is not None:
            both = list(range_ends[name])
            both[side] = reached
            range_ends[name] = (both[0], both[1])
    return replace(explored, range_ends=range_ends)


def _nearest_to_end(explored: Exploration, quantity: Quantity, side: int) -> list[Beginning]:
    """Points in hand, moved to the end of a range, and the axes that are to stay there.

    An output is brought there by what it depends on, the rest being as some such point has it.
    """
    likelihood = explored.optimum.likelihood
    moved, there = _moved_to_end(explored.optimum, quantity, side, explored.ranges)
    if not np.all(np.isfinite(there[moved])):
        return []
    frozen = _frozen(quantity, moved)
    period = np.where(np.isfinite(likelihood.periods), likelihood.periods, 0.0)
    ways = []
    for point in explored.near:
        gap = there - point.x
        gap = gap - period * np.round(gap / likelihood.periods)  # no turns where there is none
        far = float(np.max(np.abs(gap / likelihood.widths)[moved], initial=0.0))
        ways.append((far, np.where(moved, point.x + gap, point.x)))
    ways.sort(key=lambda way: way[0])
    begins = [(begin, frozen) for _, begin in ways[:NEAREST]]
    if quantity.index < 0 and ways:  # or all follow the output from where it is nearest to its end
        end = (quantity.low, quantity.high)[side]
        nearest = min(explored.near, key=lambda p: abs(quantity.of(p, likelihood.periods) - end))
        begins.append((nearest.x, ()))
    return begins


def _with_walks(
    evaluator: LikelihoodEvaluator, explored: Exploration, chosen: Sequence[Quantity]
) -> Exploration:
    """The same with both branches of some quantities, in common batches.

    There are few strides to ends that fit.
    """
    traces = []
    for q in chosen:
        ends = explored.range_ends[q.name]
        for direction, end in zip((-1.0, 1.0), ends, strict=True):
            steps = STEPS if end is None else OPEN_STEPS
            traces.append(trace_branch(explored.optimum, q, direction, steps))
    none = ProfileBranch(points=(), end="cost", at_68=math.nan, at_95=math.nan)
    found = [branch or none for branch in run_in_lockstep(traces, evaluator)]
    walked = {q.name: (found[2 * k], found[2 * k + 1]) for k, q in enumerate(chosen)}
    return replace(explored, branches={**explored.branches, **walked})


def _with_ways(evaluator: LikelihoodEvaluator, explored: Exploration) -> Exploration:
    """The same with what fits on the ways of the parameters to the ends of their room."""
    optimum = explored.optimum
    walks = walked_to_ends(evaluator, optimum, explored.parameters, explored.fitting)
    found = [p for walk in walks for p in walk]
    explored = _knowing(evaluator, explored, found)
    # also beside those at which an output is missing: on the other side it may have a value
    fitting = [*explored.fitting, *(p for p in found if p.delta <= ROOT_95**2)]
    beside = turned(evaluator, optimum, explored.parameters, fitting)
    return _knowing(evaluator, explored, beside)


def _knowing(
    evaluator: LikelihoodEvaluator, explored: Exploration, points: Sequence[ProfilePoint]
) -> Exploration:
    """The same with further points, those at which no output is missing."""
    there = possible(evaluator, explored.optimum, points)
    return replace(explored, known=(*explored.known, *(p for p in there if p is not None)))


def extended(
    evaluator: LikelihoodEvaluator, explored: Exploration, more: Sequence[ProfilePoint] = ()
) -> Exploration:
    """Profiles gone on with from every point in hand that fits and lies beyond them.

    Args:
        evaluator: of the likelihood; counts what is evaluated.
        explored: profiles around the most likely point.
        more: points that were come by besides, with their outputs.

    Raises:
        FmuFailure: the model failed at more points than can be left out.
    """
    explored = replace(explored, known=(*explored.known, *more))
    for _ in range(EXTENSIONS):
        explored, gone_on = _extended(evaluator, explored)
        if not gone_on:
            break
    return explored


def cut_sides(explored: Exploration) -> list[tuple[Quantity, float]]:
    """Quantities with a value half as far again from the best as where the data cut them.

    Args:
        explored: profiles around the most likely point.
    """
    sides = []
    for quantity in explored.quantities:
        for branch in explored.branches[quantity.name]:
            if branch.end == "crossed" and math.isfinite(branch.at_95):
                sides.append((quantity, branch.at_95 + 0.5 * (branch.at_95 - quantity.best)))
    return sides


def _extended(evaluator: LikelihoodEvaluator, explored: Exploration) -> tuple[Exploration, bool]:
    """Branches gone on from the farthest point beyond their crossing that fits; whether any was."""
    optimum, fitting = explored.optimum, explored.fitting
    sides: list[tuple[Quantity, int]] = []
    traces = []
    for quantity in explored.quantities:
        for side, direction in enumerate((-1.0, 1.0)):
            begin = _farthest_beyond(explored, quantity, side, fitting)
            if begin is not None:
                sides.append((quantity, side))
                traces.append(trace_branch(optimum, quantity, direction, STEPS, begin))
    branches = dict(explored.branches)
    for (quantity, side), more in zip(sides, run_in_lockstep(traces, evaluator), strict=True):
        both = list(branches[quantity.name])
        both[side] = _gone_on(quantity, side, both[side], more)
        branches[quantity.name] = (both[0], both[1])
    return _with_outputs(evaluator, replace(explored, branches=branches)), bool(sides)


def _gone_on(
    quantity: Quantity, side: int, branch: ProfileBranch, more: ProfileBranch | None
) -> ProfileBranch:
    """A branch with the walk that went on beyond it; without one that turned back."""
    if more is None or not more.points:
        return branch
    direction = (-1.0, 1.0)[side]
    reached = more.points[-1].value if math.isnan(more.at_95) else more.at_95
    end = branch.points[-1].value if branch.points else quantity.best
    end = end if math.isnan(branch.at_95) else branch.at_95
    if direction * (reached - end) <= 0.0:
        return replace(branch, end="lost")
    points = tuple(sorted(branch.points + more.points, key=lambda p: direction * p.value))
    return replace(more, points=points, at_68=last_crossing(points, quantity.best, ROOT_68))


def _farthest_beyond(
    explored: Exploration, quantity: Quantity, side: int, fitting: Sequence[ProfilePoint]
) -> FloatArray | None:
    """Search vector of the farthest point in hand that fits beyond where a branch ended.

    None where a parameter is cut inside its box and only the end of its room fits, far beyond: by a
    coincidence, as a frequency whole rates of the samples away does. It leaves nothing open.
    """
    branch, direction = explored.branches[quantity.name][side], (-1.0, 1.0)[side]
    if branch.end == "bound" or explored.range_ends[quantity.name][side] is not None:
        return None
    periods = explored.optimum.likelihood.periods
    end = branch.at_95
    if math.isnan(end):
        end = branch.points[-1].value if branch.points else quantity.best
    margin = BEYOND * abs(end - quantity.best) + 1e-9 * quantity.width
    beyond = [(direction * (quantity.of(p, periods) - end), p) for p in fitting]
    beyond = [(gap, p) for gap, p in beyond if gap > margin]
    if not beyond or _is_apart(explored, quantity, side, end, min(gap for gap, _ in beyond)):
        return None
    point = max(beyond, key=lambda each: each[0])[1]
    begin = point.x.copy()
    if quantity.index >= 0:
        begin[quantity.index] = quantity.of(point, periods)
    return begin


def _is_apart(explored: Exploration, quantity: Quantity, side: int, end: float, gap: float) -> bool:
    """Whether a branch ends inside the box, and nothing fits from there to the end of the room."""
    if quantity.index < 0 or quantity.round:
        return False
    direction, room = (-1.0, 1.0)[side], (quantity.low, quantity.high)[side]
    limit = float(search_bounds(explored.optimum.likelihood.parameters)[side][quantity.index])
    whole = direction * (room - end)
    return 0.0 < direction * (limit - end) < gap and gap > (1.0 - AT_ROOM) * whole


def _worth_reaching(quantity: Quantity, end: float) -> bool:
    """Whether the linearisation lets a quantity go so far that the end is tried outright."""
    return not quantity.round and quantity.sigma > WORTH_REACHING * abs(end - quantity.best)


def _optimum_at_end(explored: Exploration, quantity: Quantity, side: int) -> list[Beginning]:
    """The optimum, moved to the end of a range, if the linearisation lets a quantity go so far."""
    optimum = explored.optimum
    if not _worth_reaching(quantity, (quantity.low, quantity.high)[side]):
        return []
    moved, there = _moved_to_end(optimum, quantity, side, explored.ranges)
    if not np.all(np.isfinite(there[moved])):
        return []
    return [(np.where(moved, there, optimum.expansion.x), _frozen(quantity, moved))]


def _frozen(quantity: Quantity, moved: BoolArray) -> tuple[int, ...]:
    """Axes that hold a quantity at the end it was moved to; a parameter is held by itself."""
    return () if quantity.index >= 0 else tuple(map(int, np.flatnonzero(moved)))


def _moved_to_end(
    optimum: Optimum, quantity: Quantity, side: int, ranges: Mapping[str, OutputRange]
) -> tuple[BoolArray, FloatArray]:
    """Which parameters lead a quantity to the end of its range, (n,), and where that is, (n,).

    Of an output those that it depends on, but for what has a prior: that is best where the data
    have it.
    """
    likelihood = optimum.likelihood
    if quantity.index >= 0:
        own = np.arange(likelihood.widths.size) == quantity.index
        return own, np.full(own.size, (quantity.low, quantity.high)[side])
    range_ = ranges[quantity.name]
    moved = range_.depends & ~(likelihood.inverse_prior_sigma > 0.0)
    return moved, np.asarray((range_.x_low, range_.x_high)[side])


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


def possible(
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
    covariance = data_covariance(optimum)
    steps = first_steps(likelihood, expansion.x)
    axes = np.eye(covariance.shape[0])
    made = []
    for i, parameter in enumerate(likelihood.parameters):
        best = float(expansion.x[i])
        low, high = float(likelihood.lower[i]), float(likelihood.upper[i])
        goes_round = bool(np.isfinite(likelihood.periods[i]))
        if goes_round:
            half = 0.5 * float(likelihood.periods[i])
            low, high = best - half, best + half
        made.append(
            Quantity(
                name=parameter.name,
                index=i,
                output=-1,
                best=best,
                sigma=math.sqrt(covariance[i, i]),
                low=low,
                high=high,
                first=float(steps[i]),
                round=goes_round,
                reach=_reach(optimum, covariance, axes[i]),
                freedom=optimum.freedom_along(axes[i], covariance),
            )
        )
    for k, name in enumerate(likelihood.names):
        best, slope = float(expansion.sample.outputs[k]), expansion.outward[k]
        if not math.isfinite(best) or not ranges[name].high > ranges[name].low:
            continue
        low, high = min(ranges[name].low, best), max(ranges[name].high, best)
        sigma = high - low  # at the edge of where it has a value, until it is tried
        if np.all(np.isfinite(slope)):
            sigma = math.sqrt(max(0.0, float(slope @ covariance @ slope)))
        made.append(
            Quantity(
                name=name,
                index=-1,
                output=k,
                best=best,
                sigma=max(sigma, 1e-12 * (high - low)),
                low=low,
                high=high,
                reach=_reach(optimum, covariance, slope),
                freedom=optimum.freedom_along(slope, covariance),
            )
        )
    return tuple(made)


def data_covariance(optimum: Optimum, *, stated: bool = False) -> FloatArray:
    """(J^T J + P)^-1 with the room of the profiles as a uniform prior, (n, n): never infinite.

    Args:
        optimum: where it is linearised.
        stated: whether the noise is taken as stated, not widened.
    """
    at, likelihood = optimum.expansion, optimum.likelihood
    matrix = at.matrix.copy()
    if stated:
        matrix[: likelihood.data_rows] *= likelihood.inflation
    room = np.where(
        np.isfinite(likelihood.periods), likelihood.periods, likelihood.upper - likelihood.lower
    )
    prior = np.maximum(room, AT_LIMIT * likelihood.widths) / UNIFORM_WIDTH
    return Linearisation(rows=at.sample.rows, matrix=matrix, prior=prior).covariance


def _reach(optimum: Optimum, covariance: FloatArray, slope: FloatArray) -> float:
    """By how many standard deviations the simulation's own error may move a value, at most.

    |g C J^T V^-1/2 B|_1/sqrt(g C g); along a slope that is not known, sum_j |V^-1/2 B_j|.
    """
    likelihood = optimum.likelihood
    if not likelihood.bounded.columns:
        return 0.0
    errors = WhitenedErrors(likelihood.bounded, likelihood.noise.times(likelihood.inflation))
    if not np.all(np.isfinite(slope)):
        return errors.reach
    variance = float(slope @ covariance @ slope)
    if not variance > 0.0:
        return 0.0
    pull = optimum.expansion.matrix[: likelihood.data_rows] @ (covariance @ slope)
    return errors.moved(pull) / math.sqrt(variance)


def first_steps(likelihood: Likelihood, x: FloatArray) -> FloatArray:
    """Longest first step of a profile in x, (n,): a tenth of the box or period, or of the value.

    Args:
        likelihood: with the parameters.
        x: where the profiles set out from, shape (n,).
    """
    steps = likelihood.widths / STEPS
    for i, parameter in enumerate(likelihood.parameters):
        value = abs(float(to_model(likelihood.parameters, x)[i]))
        if parameter.lower >= 0.0 and parameter.period is None and value > 0.0:
            steps[i] = min(steps[i], value / parameter.scale)
    return np.asarray(steps)


def other_minima(
    evaluator: LikelihoodEvaluator, optimum: Optimum, begins: Sequence[FloatArray]
) -> tuple[ProfilePoint, ...]:
    """Minima that fit as well, (Dchi^2 below the 95 % threshold), by descents.

    What fits better is told where a descent creeps along its valley, too.

    Args:
        evaluator: of the likelihood; counts what is evaluated.
        optimum: the most likely point and its likelihood.
        begins: search vectors to descend from, (n,) each.
    """
    likelihood = optimum.likelihood
    # offsets that a prior holds are looked for near the best
    searched = Box(likelihood.parameters).free
    starts = [np.where(searched, begin, optimum.expansion.x) for begin in begins]
    threshold = reach(ROOT_95, optimum.noise_freedom) ** 2

    def search(x: FloatArray) -> Task[Expansion | None]:
        try:
            here = yield from expansion_at(likelihood, x, False)
            if not math.isfinite(here.chi_square):
                return None
            ended = yield from lower(likelihood, here, wanted=optimum.least + threshold)
            if not ended.reached and not ended.chi_square < optimum.least:
                return None
            return (yield from expansion_at(likelihood, ended.end.x))
        except Exhausted:
            return None

    points = []
    for expansion in run_in_lockstep([search(x) for x in starts], evaluator):
        if expansion is not None:
            delta = optimum.delta(expansion.chi_square)
            if delta <= ROOT_95**2:
                points.append(
                    ProfilePoint(
                        value=math.nan, delta=delta, x=expansion.x, outputs=expansion.sample.outputs
                    )
                )
    return tuple(points)
