"""From profiles to verdicts: interval, shrinkage and word for parameters and derived outputs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from fitting.campaign.parameters import Parameter, canonical, to_model
from fitting.fit.likelihood.descent import Optimum
from fitting.fit.linearisation import IDENTIFIABLE, in_words
from fitting.inference.equivalent_fits import contradicts, exchange_words
from fitting.inference.likelihood.exploration import Exploration
from fitting.inference.likelihood.knowledge import Equivalent, Interval, Profile
from fitting.inference.likelihood.profiles import (
    ROOT_68,
    ROOT_95,
    ProfileBranch,
    ProfilePoint,
    Quantity,
    interval,
)
from fitting.text.arrays import FloatArray

#: Where an end of the range fits, a value whose interval is narrower than this is still determined.
ONE_SIDED = 0.1
ENDS_IN_WORDS = {
    "crossed": "the data end it",
    "bound": "it ends at the bound of the box",
    "round": "it goes round",
    "lost": "no point was found beyond",
    "cost": "the walk was cut for its cost",
}


def profiles(
    explored: Exploration, equivalents: Sequence[Equivalent], units: Mapping[str, str]
) -> dict[str, Profile]:
    """A `Profile` for every quantity, in its own unit, parameters first.

    An equivalent minimum at which every output exists and that lies outside an interval widens it:
    nothing in the data is against it. Where an output has no value the point says nothing of it.

    Args:
        explored: branches and range ends of all quantities.
        equivalents: other points that fit as well.
        units: of the outputs, by name.
    """
    parameters = {p.name: p for p in explored.optimum.likelihood.parameters}
    turn = _turn(explored.optimum)
    made = {}
    for quantity in explored.quantities:
        parameter = parameters.get(quantity.name)
        unit = parameter.unit if parameter is not None else units.get(quantity.name, "")
        made[quantity.name] = _profile(explored, quantity, parameter, unit, equivalents, turn)
    for name in explored.optimum.likelihood.names:
        if name not in made:
            made[name] = _without_value(explored, name, units.get(name, ""))
    return made


def _turn(optimum: Optimum) -> FloatArray:
    """What brings the optimum into the canonical period, (n,), in the parameters' units."""
    parameters = optimum.likelihood.parameters
    p = to_model(parameters, optimum.expansion.x)
    return np.asarray(canonical(parameters, p) - p)


def _profile(
    explored: Exploration,
    quantity: Quantity,
    parameter: Parameter | None,
    unit: str,
    equivalents: Sequence[Equivalent],
    turn: FloatArray,
) -> Profile:
    branches, range_ends = explored.branches[quantity.name], explored.range_ends[quantity.name]
    goes_round = quantity.round and all(branch.end == "bound" for branch in branches)
    fits, ends = _ends_of(branches, range_ends, goes_round)
    tight = tuple(point is not None and point.delta <= ROOT_68**2 for point in range_ends)
    wide = interval(quantity, branches, fits)
    narrow = interval(quantity, branches, (tight[0], tight[1]), "68")
    scale, shift = 1.0, 0.0
    prior = quantity.width
    if parameter is not None:
        scale = parameter.scale
        shift = parameter.reference + float(turn[quantity.index])
        sigma = parameter.prior_sigma
        if sigma is not None:
            prior = min(prior, 2.0 * ROOT_95 * sigma / scale)
    low, high = (shift + scale * value for value in wide)
    outside = [] if goes_round else _outside(quantity, parameter, (low, high), equivalents)
    if outside and not quantity.round:
        low, high = min(low, *outside), max(high, *outside)
    share = min(1.0, (high - low) / (scale * prior))
    verdict, reason = _verdict(share, ends, quantity, bool(outside))
    best = shift + scale * quantity.best
    exchange = _exchange(best, parameter, (low, high), equivalents, unit, quantity.name)
    if exchange and verdict == IDENTIFIABLE[0]:
        verdict, reason = IDENTIFIABLE[1], exchange
    points = _in_order(explored, quantity)
    return Profile(
        kind="parameter" if parameter is not None else "derived",
        unit=unit,
        best=best,
        sigma=scale * quantity.sigma,
        interval68=(shift + scale * narrow[0], shift + scale * narrow[1]),
        interval95=(low, high),
        box=(shift + scale * quantity.low, shift + scale * quantity.high),
        ends=(ends[0], ends[1]),
        shrinkage=1.0 - share**2,
        verdict=verdict,
        reason=reason,
        values=tuple(shift + scale * point.value for point in points),
        delta=tuple(max(0.0, point.delta) for point in points),
        path=_path(explored, points, turn),
    )


def _ends_of(
    branches: tuple[ProfileBranch, ProfileBranch],
    range_ends: tuple[ProfilePoint | None, ProfilePoint | None],
    goes_round: bool,
) -> tuple[tuple[bool, bool], tuple[str, str]]:
    """Which ends of the range fit the data, and the word for how each branch ended.

    Where one end fits, noise alone cuts the other off one time in twenty: it then counts as
    fitting, too, unless the data exclude it for good.
    """
    inside = [point is not None and point.delta <= ROOT_95**2 for point in range_ends]
    if any(inside) or "crossed" not in [branch.end for branch in branches]:
        inside = [point is not None for point in range_ends]
    words = [
        "round" if goes_round else "bound" if fit else branch.end
        for branch, fit in zip(branches, inside, strict=True)
    ]
    return (inside[0], inside[1]), (words[0], words[1])


def _outside(
    quantity: Quantity,
    parameter: Parameter | None,
    bounds: Interval,
    equivalents: Sequence[Equivalent],
) -> list[float]:
    """Values at equivalent minima of this model that the interval does not hold."""
    margin = 1e-6 * quantity.width * (parameter.scale if parameter is not None else 1.0)
    values = []
    for other in equivalents:
        if other.origin != "start" or not all(map(math.isfinite, other.derived.values())):
            continue
        value = (other.parameters if parameter is not None else other.derived)[quantity.name]
        inside = any(
            bounds[0] - margin <= value + turns <= bounds[1] + margin for turns in _turns(parameter)
        )
        if not inside:
            values.append(value)
    return values


def _exchange(
    best: float,
    parameter: Parameter | None,
    bounds: Interval,
    equivalents: Sequence[Equivalent],
    unit: str,
    name: str,
) -> str:
    """What another alternative that fits as well has against an interval, in words.

    Where there is such an alternative, points without a value of some output count, too: they may
    have one in the alternative.
    """
    if not any(other.origin == "alternative" for other in equivalents):
        return ""
    period = parameter.period if parameter is not None else None
    for other in sorted(equivalents, key=lambda each: each.origin != "alternative"):
        there = (other.parameters if parameter is not None else other.derived).get(name, math.nan)
        if contradicts(there, bounds, period):
            where = other.where or "another minimum"
            return exchange_words(best, there, where, unit)
    return ""


def _turns(parameter: Parameter | None) -> tuple[float, ...]:
    if parameter is None or parameter.period is None:
        return (0.0,)
    return (-parameter.period, 0.0, parameter.period)


def _verdict(
    share: float, ends: Sequence[str], quantity: Quantity, outside: bool
) -> tuple[str, str]:
    """The word and why, from the width of the interval over the width without data."""
    percent = f"{100.0 * share:.2g} %"
    if quantity.round and ends[0] == "round":
        return IDENTIFIABLE[2], "every value around its period fits"
    open_ = [end for end in ends if end != "crossed"]
    if len(open_) == 2:
        if open_ == ["bound", "bound"]:
            return IDENTIFIABLE[2], "both ends of its range fit"
        said = " and ".join(dict.fromkeys(ENDS_IN_WORDS[end] for end in open_))
        return IDENTIFIABLE[2], f"the data end it on neither side: {said}"
    word = in_words(1.0 - share**2)
    reason = f"the 95 % interval is {percent} of the range without data"
    if open_:
        reason += f"; on one side {ENDS_IN_WORDS[open_[0]]}"
        if word == IDENTIFIABLE[0] and share > ONE_SIDED:
            word = IDENTIFIABLE[1]
    if outside:
        reason += "; another minimum fits as well"
        word = IDENTIFIABLE[1] if word == IDENTIFIABLE[0] else word
    return word, reason


def _in_order(explored: Exploration, quantity: Quantity) -> list[ProfilePoint]:
    """All points of a profile, the optimum and the reached ends among them, in rising order."""
    expansion = explored.optimum.expansion
    down, up = explored.branches[quantity.name]
    middle = ProfilePoint(
        value=quantity.best, delta=0.0, x=expansion.x, outputs=expansion.sample.outputs
    )
    points = [*down.points, middle, *up.points]
    low, high = min(p.value for p in points), max(p.value for p in points)
    near = 1e-3 * quantity.width
    for point in explored.range_ends[quantity.name]:
        if point is not None and not low - near <= point.value <= high + near:
            points.append(point)
    return sorted(points, key=lambda point: point.value)


def _path(
    explored: Exploration, points: Sequence[ProfilePoint], turn: FloatArray
) -> dict[str, tuple[float, ...]]:
    """Parameters and outputs along a profile."""
    likelihood = explored.optimum.likelihood
    table = np.array([to_model(likelihood.parameters, point.x) + turn for point in points])
    path = {p.name: tuple(map(float, table[:, i])) for i, p in enumerate(likelihood.parameters)}
    for k, name in enumerate(likelihood.names):
        path[name] = tuple(float(point.outputs[k]) for point in points)
    return path


def _without_value(explored: Exploration, name: str, unit: str) -> Profile:
    """An output that has no value where the data lead, or that nothing moves."""
    k = explored.optimum.likelihood.names.index(name)
    best = float(explored.optimum.expansion.sample.outputs[k])
    nan = math.nan
    box = (explored.ranges[name].low, explored.ranges[name].high)
    if math.isfinite(best) and not box[1] > box[0]:  # it does not depend on what is fitted
        return Profile(
            kind="derived",
            unit=unit,
            best=best,
            sigma=0.0,
            interval68=(best, best),
            interval95=(best, best),
            box=(best, best),
            ends=("crossed", "crossed"),
            shrinkage=1.0,
            verdict=IDENTIFIABLE[0],
            reason="it does not depend on the parameters",
            values=(best,),
            delta=(0.0,),
            path={},
        )
    where = "value" if math.isnan(best) else "slope"
    return Profile(
        kind="derived",
        unit=unit,
        best=best,
        sigma=nan,
        interval68=box,
        interval95=box,
        box=box,
        ends=("lost", "lost"),
        shrinkage=0.0,
        verdict=IDENTIFIABLE[2],
        reason=f"it has no {where} at the most likely point",
        values=(),
        delta=(),
        path={},
    )
