"""From walks to verdicts: interval, shrinkage and word for every parameter and derived output."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from fitting.campaign.parameters import Parameter, canonical, to_model
from fitting.fit.result import IDENTIFIABLE
from fitting.inference.elsewhere import contradicts, exchange_words
from fitting.inference.exploration import Found
from fitting.inference.knowledge import Equivalent, Interval, Profile
from fitting.inference.profiles import ROOT_68, ROOT_95, Quantity, Side, Stop, interval
from fitting.inference.uncertainty import in_words
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
    found: Found, equivalents: Sequence[Equivalent], units: Mapping[str, str]
) -> dict[str, Profile]:
    """A `Profile` for every quantity, in its own unit, parameters first.

    An equivalent minimum at which every output exists and that lies outside an interval widens it:
    nothing in the data is against it. Where an output has no value the point says nothing of it.
    """
    parameters = {p.name: p for p in found.optimum.likelihood.parameters}
    turn = _turn(found)
    made = {}
    for quantity in found.quantities:
        parameter = parameters.get(quantity.name)
        unit = parameter.unit if parameter is not None else units.get(quantity.name, "")
        made[quantity.name] = _profile(found, quantity, parameter, unit, equivalents, turn)
    for name in found.optimum.likelihood.names:
        if name not in made:
            made[name] = _without_value(found, name, units.get(name, ""))
    return made


def _turn(found: Found) -> FloatArray:
    """What brings the optimum into the canonical period, (n,), in the parameters' units."""
    parameters = found.optimum.likelihood.parameters
    p = to_model(parameters, found.optimum.local.x)
    return np.asarray(canonical(parameters, p) - p)


def _profile(
    found: Found,
    quantity: Quantity,
    parameter: Parameter | None,
    unit: str,
    equivalents: Sequence[Equivalent],
    turn: FloatArray,
) -> Profile:
    sides, reached = found.sides[quantity.name], found.reached[quantity.name]
    goes_round = quantity.round and all(side.end == "bound" for side in sides)
    fits, ends = _ends_of(sides, reached, goes_round)
    tight = tuple(stop is not None and stop.delta <= ROOT_68**2 for stop in reached)
    wide = interval(quantity, sides, fits)
    narrow = interval(quantity, sides, (tight[0], tight[1]), "68")
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
    stops = _in_order(found, quantity)
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
        values=tuple(shift + scale * stop.value for stop in stops),
        delta=tuple(max(0.0, stop.delta) for stop in stops),
        path=_path(found, stops, turn),
    )


def _ends_of(
    sides: tuple[Side, Side], reached: tuple[Stop | None, Stop | None], goes_round: bool
) -> tuple[tuple[bool, bool], tuple[str, str]]:
    """Which ends of the range fit the data, and the word for how each side ended.

    Where one end fits, noise alone cuts the other off one time in twenty: it then counts as
    fitting, too, unless the data exclude it for good.
    """
    inside = [stop is not None and stop.delta <= ROOT_95**2 for stop in reached]
    if any(inside) or "crossed" not in [side.end for side in sides]:
        inside = [stop is not None for stop in reached]
    words = [
        "round" if goes_round else "bound" if fit else side.end
        for side, fit in zip(sides, inside, strict=True)
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


def _in_order(found: Found, quantity: Quantity) -> list[Stop]:
    """All points of a profile, the optimum and the reached ends among them, in rising order."""
    local = found.optimum.local
    down, up = found.sides[quantity.name]
    middle = Stop(quantity.best, 0.0, local.x, local.sample.outputs)
    points = [*down.points, middle, *up.points]
    low, high = min(p.value for p in points), max(p.value for p in points)
    near = 1e-3 * quantity.width
    for stop in found.reached[quantity.name]:
        if stop is not None and not low - near <= stop.value <= high + near:
            points.append(stop)
    return sorted(points, key=lambda stop: stop.value)


def _path(found: Found, stops: Sequence[Stop], turn: FloatArray) -> dict[str, tuple[float, ...]]:
    """Parameters and outputs along a profile."""
    likelihood = found.optimum.likelihood
    table = np.array([to_model(likelihood.parameters, stop.x) + turn for stop in stops])
    path = {p.name: tuple(map(float, table[:, i])) for i, p in enumerate(likelihood.parameters)}
    for k, name in enumerate(likelihood.names):
        path[name] = tuple(float(stop.outputs[k]) for stop in stops)
    return path


def _without_value(found: Found, name: str, unit: str) -> Profile:
    """An output that has no value where the data lead, or that nothing moves."""
    k = found.optimum.likelihood.names.index(name)
    best = float(found.optimum.local.sample.outputs[k])
    nan = math.nan
    box = (found.ranges[name].low, found.ranges[name].high)
    if math.isfinite(best) and not box[1] > box[0]:  # it does not depend on what is fitted
        return Profile(
            "derived",
            unit,
            best,
            0.0,
            (best, best),
            (best, best),
            (best, best),
            ("crossed", "crossed"),
            1.0,
            IDENTIFIABLE[0],
            "it does not depend on the parameters",
            (best,),
            (0.0,),
            {},
        )
    where = "value" if math.isnan(best) else "slope"
    return Profile(
        "derived",
        unit,
        best,
        nan,
        box,
        box,
        box,
        ("lost", "lost"),
        0.0,
        IDENTIFIABLE[2],
        f"it has no {where} at the most likely point",
        (),
        (),
        {},
    )
