"""From profiles to verdicts: interval, precision and word for parameters and derived outputs.

What the data say follows from where they end an interval, and from nothing else: not from the box,
in which a fit is only looked for, nor from how much was spent on it. A walk that was cut or lost is
said to be so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fitting.campaign.parameters import (
    Parameter,
    canonical,
    drift_square,
    next_to,
    spans_decades,
    to_model,
)
from fitting.fit.likelihood.descent import Optimum
from fitting.inference.equivalent_fits import contradicts, turned_to
from fitting.inference.likelihood.exploration import Exploration
from fitting.inference.likelihood.inverses import Branches
from fitting.inference.likelihood.knowledge import (
    CLOSED,
    STOPPED,
    Equivalent,
    Interval,
    Profile,
    Scan,
)
from fitting.inference.likelihood.profiles import ProfilePoint, Quantity, interval
from fitting.signal.student import ROOT_68
from fitting.text.arrays import FloatArray
from fitting.text.error_bars import ROOT_95
from fitting.text.estimate import (
    NOWHERE,
    FittedEstimate,
    OutputEstimate,
    ParameterEstimate,
    Verdict,
)
from fitting.text.rendering import phrase

#: Ratio of the ends of an interval up to which a value that cannot change its sign is determined
#: (half the width is then half the value), and share of its period for one that goes round.
NARROW, NARROW_ROUND = 3.0, 0.25
#: Share of what the model can have, over the room of profiles, from which an interval is all of it.
NEARLY_ALL = 0.9
#: Share of the width of its prior from which an interval is that of the prior alone, and up to
#: which the prior has no part in it: the data answer for a tenth and for nine of the variance.
PRIOR_ALONE, PRIOR_IDLE = math.sqrt(0.9), math.sqrt(0.1)
#: Ends of branches that say nothing of what lies beyond.
CUT = ("lost", "cost")
#: Share of an increase of chi square by priors of what drifts from which they end an interval.
BY_PRIORS = 0.5
#: A walk has gone through the box where it comes this close to its end, as a share of it.
NEAR_BOX = 1e-3


@dataclass(frozen=True, kw_only=True)
class Basis:
    """What verdicts are decided on, beside the profiles themselves.

    `equivalents` fit as well elsewhere, `boxes` are the ranges of the outputs over the campaign's
    box, `units` those of outputs; `withdrawn`: why no verdict is given, where the model does not
    describe the data; `redundant`: whether there are more data than unknowns.
    """

    equivalents: Sequence[Equivalent] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    boxes: Mapping[str, Interval] = field(default_factory=dict)
    withdrawn: str = ""
    redundant: bool = True


@dataclass(frozen=True, kw_only=True)
class _Subject:
    """One quantity in its own unit: `scale` and `shift` lead from x, `box` is the campaign's."""

    quantity: Quantity
    parameter: Parameter | None
    unit: str
    scale: float
    shift: float
    box: Interval

    def shown(self, value: float) -> float:
        """A value in its unit, brought into its first period with the optimum."""
        return self.shift + self.scale * value

    @property
    def period(self) -> float | None:
        return self.parameter.period if self.parameter is not None else None


@dataclass(frozen=True, kw_only=True)
class _Found:
    """What was found of a quantity: its interval, how it ends, and what speaks against it.

    `others` are values of separate minima outside the interval around the optimum, `exchange` the
    value of another alternative and what leads there; `held` names parameters at a limit of their
    room; `seen` are the least and the largest value of all points in hand that fit.
    """

    interval: Interval
    ends: tuple[str, str]
    others: Sequence[float]
    exchange: tuple[float, str] | None
    held: Sequence[str]
    seen: Interval


def profiles(explored: Exploration, basis: Basis) -> dict[str, Profile]:
    """Value and profile of every quantity, in its own unit, parameters first.

    Args:
        explored: branches and range ends of all quantities.
        basis: what else the verdicts rest on.
    """
    parameters = {p.name: p for p in explored.optimum.likelihood.parameters}
    # what brings the optimum into the canonical period, (n,), in the parameters' units
    every = explored.optimum.likelihood.parameters
    here = to_model(every, explored.optimum.expansion.x)
    turn = np.asarray(canonical(every, here) - here)
    made = {}
    for quantity in explored.quantities:
        subject = _subject(quantity, parameters.get(quantity.name), basis, turn)
        made[quantity.name] = _profile(explored, subject, basis, turn)
    for name in explored.optimum.likelihood.names:
        if name not in made:
            made[name] = _without_value(explored, name, basis)
    why = basis.withdrawn
    return {n: p._replace(value=p.value.withdrawn(why)) for n, p in made.items()} if why else made


def _subject(
    quantity: Quantity, parameter: Parameter | None, basis: Basis, turn: FloatArray
) -> _Subject:
    if parameter is None:
        return _Subject(
            quantity=quantity,
            parameter=None,
            unit=basis.units.get(quantity.name, ""),
            scale=1.0,
            shift=0.0,
            box=basis.boxes.get(quantity.name, (quantity.low, quantity.high)),
        )
    shift = parameter.reference + float(turn[quantity.index])
    box = (parameter.lower, parameter.upper)
    if quantity.round:
        box = (shift + parameter.scale * quantity.low, shift + parameter.scale * quantity.high)
    return _Subject(
        quantity=quantity,
        parameter=parameter,
        unit=parameter.unit,
        scale=parameter.scale,
        shift=shift,
        box=box,
    )


def _profile(explored: Exploration, subject: _Subject, basis: Basis, turn: FloatArray) -> Profile:
    quantity = subject.quantity
    branches = explored.branches[quantity.name]
    range_ends = explored.range_ends[quantity.name]
    goes_round = quantity.round and all(branch.end == "bound" for branch in branches)
    fits, ends = _ends_of(branches, range_ends, goes_round)
    fits, ends = _beyond_the_simulation(quantity, branches, fits, ends)
    ends = _of_the_data(explored.optimum, branches, ends)
    periods = explored.optimum.likelihood.periods
    seen = [subject.shown(quantity.of(point, periods)) for point in explored.fitting]
    ends = _over_the_box(subject, branches, ends, seen)
    if quantity.round and "bound" in ends:  # half a period up and down is one and the same system
        ends = (
            "bound" if ends[0] == "lost" else ends[0],
            "bound" if ends[1] == "lost" else ends[1],
        )
    wide = _interval(subject, branches, fits, ends)
    tight = tuple(point is not None and point.delta <= ROOT_68**2 for point in range_ends)
    narrow = interval(quantity, branches, (tight[0], tight[1]), "68")
    low68, high68 = (min(max(subject.shown(end), wide[0]), wide[1]) for end in narrow)
    others = [] if goes_round else _elsewhere(explored, subject, basis.equivalents)
    # where one end is cut the width of the interval is no measure: the other end is a bound
    sides = (low68 - wide[0], wide[1] - high68)
    cut = [side for end, side in zip(ends, sides, strict=True) if end == "crossed"]
    slack = 0.5 * cut[0] if len(cut) == 1 else None
    exchange = _exchange(subject, wide, basis.equivalents, slack)
    if (others or exchange) and len(cut) == 1:  # another fit lies beyond the only end that is cut
        wide = min(wide[0], subject.box[0]), max(wide[1], subject.box[1])
    found = _Found(
        interval=wide,
        ends=ends,
        others=others,
        exchange=exchange,
        held=[explored.optimum.likelihood.parameters[i].name for b in branches for i in b.held],
        seen=(min(seen, default=math.nan), max(seen, default=math.nan)),
    )
    verdict, reason = _verdict(subject, found, basis)
    shrinkage = 1.0 - min(1.0, (wide[1] - wide[0]) / (subject.box[1] - subject.box[0])) ** 2
    points = _in_order(explored, quantity)
    parameter = subject.parameter
    known: dict[str, Any] = {
        "name": quantity.name,
        "value": subject.shown(quantity.best),
        "unit": subject.unit,
        "std": 0.5 * (high68 - low68) if verdict.has_value else math.nan,
        "ci68": (low68, high68),
        "ci95": wide,
        "closed_by": (CLOSED[ends[0]], CLOSED[ends[1]]),
        "shrinkage": shrinkage,
        "status": verdict,
        "reason": reason,
        "method": "profile",
        "simulation": subject.scale * quantity.reach * quantity.sigma,
    }
    value: FittedEstimate
    if parameter is None:
        value = OutputEstimate(**known, lower=subject.box[0], upper=subject.box[1])
    else:
        value = ParameterEstimate(
            **known,
            lower=parameter.lower,
            upper=parameter.upper,
            period=parameter.period,
            reference=parameter.reference,
            start=parameter.start,
            asked=parameter.moves_model,
        )
    scan = Scan(
        sigma=subject.scale * quantity.sigma,
        held=tuple(dict.fromkeys(found.held)) if "held" in ends else (),
        stopped=(STOPPED.get(ends[0], ""), STOPPED.get(ends[1], "")),
        values=tuple(subject.shown(point.value) for point in points),
        delta_chi2=tuple(max(0.0, point.delta) for point in points),
        path=_path(explored, points, turn),
    )
    return Profile(value, scan)


def _ends_of(
    branches: Branches,
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


def _beyond_the_simulation(
    quantity: Quantity, branches: Branches, fits: tuple[bool, bool], ends: tuple[str, str]
) -> tuple[tuple[bool, bool], tuple[str, str]]:
    """The same; an end that the simulation's own error takes to the end of the range fits there."""
    reached = interval(quantity, branches, fits)
    away = [at == limit for at, limit in zip(reached, (quantity.low, quantity.high), strict=True)]
    moved = [far and end == "crossed" for far, end in zip(away, ends, strict=True)]
    words = ["bound" if gone else end for gone, end in zip(moved, ends, strict=True)]
    return (fits[0] or moved[0], fits[1] or moved[1]), (words[0], words[1])


def _of_the_data(optimum: Optimum, branches: Branches, ends: tuple[str, str]) -> tuple[str, str]:
    """The same; a crossing to which priors of what drifts lead, and no data, is theirs.

    Priors that hold what differs between experiments are stated for lack of anything better, of
    offsets that may are correlated: what they alone exclude is not known of the sample.
    """
    parameters = optimum.likelihood.parameters
    least = drift_square(parameters, optimum.expansion.x)
    words = list(ends)
    for side, branch in enumerate(branches):
        beyond = next((p for p in branch.points if p.root > ROOT_95), None)
        if words[side] == "crossed" and beyond is not None:
            more = drift_square(parameters, beyond.x) - least
            if more > BY_PRIORS * beyond.delta:
                words[side] = "prior"
    return words[0], words[1]


def _over_the_box(
    subject: _Subject, branches: Branches, ends: tuple[str, str], seen: Sequence[float]
) -> tuple[str, str]:
    """The same; a walk that ended beyond the box, or close to its end, all of which fits, is whole.

    Models end there often: laws have no value beyond, an output is the largest that it can be. Not
    where the data end the other side: they might end this one beyond. What other walks `seen` there
    that fits says the same of a walk that was cut before: it could have come by no less.
    """
    if "crossed" in ends:
        return ends
    low, high = subject.box
    near = [NEAR_BOX * (high - low)] * 2
    if subject.period is None:
        near = [next_to(end, subject.box, NEAR_BOX) for end in subject.box]
    words = list(ends)
    for side, branch in enumerate(branches):
        values = [subject.shown(point.value) for point in branch.points]
        fits = all(point.root <= ROOT_95 for point in branch.points)
        values += seen
        if words[side] not in CUT or not values or not fits:
            continue
        if (min(values) <= low + near[0]) if side == 0 else (max(values) >= high - near[1]):
            words[side] = "bound"
    return words[0], words[1]


def _interval(
    subject: _Subject, branches: Branches, fits: tuple[bool, bool], ends: tuple[str, str]
) -> Interval:
    """The 95 % interval: what the data cut, else the end of the box.

    Where another value was held nothing is known beyond; where the most likely value lies beyond
    the box on that side, the interval goes as far as the walk came.
    """
    reached = [subject.shown(v) for v in interval(subject.quantity, branches, fits)]
    best = subject.shown(subject.quantity.best)
    low, high = reached
    if ends[0] != "crossed":
        limit = max(low, subject.box[0]) if ends[0] == "held" else subject.box[0]
        low = limit if limit <= best else low
    if ends[1] != "crossed":
        limit = min(high, subject.box[1]) if ends[1] == "held" else subject.box[1]
        high = limit if limit >= best else high
    return low, high


def _elsewhere(
    explored: Exploration, subject: _Subject, equivalents: Sequence[Equivalent]
) -> list[float]:
    """Values at separate minima of this model that the interval around the optimum does not hold.

    Where an output has no value the point says nothing of it; nor does one whose whole valley is
    without a value of some output.
    """
    quantity = subject.quantity
    down, up = explored.around[quantity.name]
    low = subject.shown(down.at_95) if math.isfinite(down.at_95) else -math.inf
    high = subject.shown(up.at_95) if math.isfinite(up.at_95) else math.inf
    margin = 1e-6 * quantity.width * subject.scale
    values = []
    for other in equivalents:
        named = other.parameters if subject.parameter is not None else other.derived
        value = named.get(quantity.name, math.nan)
        if other.origin != "start" or not other.possible or not math.isfinite(value):
            continue
        value = turned_to(value, subject.shown(quantity.best), subject.period)
        if not low - margin <= value <= high + margin:
            values.append(value)
    return values


def _exchange(
    subject: _Subject, bounds: Interval, equivalents: Sequence[Equivalent], slack: float | None
) -> tuple[float, str] | None:
    """A value against an interval at another alternative that fits as well, and what leads there.

    Where there is such an alternative, points without a value of some output count, too: they may
    have one in the alternative.
    """
    if not any(other.origin == "alternative" for other in equivalents):
        return None
    name, best = subject.quantity.name, subject.shown(subject.quantity.best)
    for other in sorted(equivalents, key=lambda each: each.origin != "alternative"):
        values = other.parameters if subject.parameter is not None else other.derived
        there = values.get(name, math.nan)
        if contradicts(there, bounds, subject.period, slack):
            return turned_to(there, best, subject.period), other.where or "another minimum"
    return None


def _verdict(subject: _Subject, found: _Found, basis: Basis) -> tuple[Verdict, str]:
    """The status and why."""
    ends, held = found.ends, list(dict.fromkeys(found.held))
    if not basis.redundant:  # where a scan then ends is a matter of the bounds
        return Verdict.UNKNOWN, phrase("status", "no_redundancy")
    if ends == ("round", "round"):
        return Verdict.UNCONSTRAINED, phrase("status", "any_of_period")
    if any(end in CUT for end in ends):
        if _is_nearly_all(subject, found.seen, subject.box):  # no scan makes that narrower
            return Verdict.UNCONSTRAINED, phrase("status", "near_both_ends")
        return Verdict.UNKNOWN, phrase("status", "sides", ends, held)
    cut = [end == "crossed" for end in ends]
    if not any(cut):
        both_fit = ends == ("bound", "bound")
        reason = (
            phrase("status", "both_ends") if both_fit else phrase("status", "sides", ends, held)
        )
        return Verdict.UNCONSTRAINED, reason
    # width of the interval over that of the Gaussian prior
    prior = None if subject.parameter is None else subject.parameter.prior_sigma
    low, high = found.interval
    share = 0.0 if prior is None else (high - low) / (2.0 * ROOT_95 * prior)
    if share > PRIOR_ALONE:
        return Verdict.UNCONSTRAINED, phrase("status", "prior_alone")
    if found.exchange is not None or found.others:
        return (Verdict.SEVERAL if all(cut) else Verdict.UNKNOWN), _of_others(subject, found)
    if _is_nearly_all(subject, found.interval, (subject.quantity.low, subject.quantity.high)):
        return Verdict.UNCONSTRAINED, phrase("status", "nearly_all")
    if not all(cut):
        verdict, side = (Verdict.BELOW, "above") if cut[0] else (Verdict.ABOVE, "below")
        return verdict, phrase("status", side, ends, held)
    if share > PRIOR_IDLE:
        return Verdict.BOUNDED, phrase("status", "prior_part")
    return _by_width(subject, found)


def _is_nearly_all(subject: _Subject, wide: Interval, room: Interval) -> bool:
    """Whether an output's interval is what the model can have: what the data cut off says little.

    An eigenfrequency of two coupled modes lies between those of the lines, whatever was measured.
    What may have any size, over decades, is measured by ratios: a width as the Q that goes with it.
    """
    if subject.parameter is not None:
        return False
    low, high = room
    begin, end = max(wide[0], low), min(wide[1], high)
    if spans_decades(low, high) and 0.0 < begin < end:
        return math.log(end / begin) > NEARLY_ALL * math.log(high / low)
    return end - begin > NEARLY_ALL * (high - low)


def _by_width(subject: _Subject, found: _Found) -> tuple[Verdict, str]:
    """Determined, or only bounded, where the data cut both ends."""
    low, high = found.interval
    half, best = 0.5 * (high - low), abs(subject.shown(subject.quantity.best))
    if subject.period is not None:
        if high - low <= NARROW_ROUND * subject.period:
            return Verdict.DETERMINED, phrase("status", "precise", half / subject.period, True)
        return Verdict.BOUNDED, phrase("status", "wide_period")
    if low * high <= 0.0:
        return Verdict.BOUNDED, phrase("status", "zero_inside")
    if max(abs(low), abs(high)) <= NARROW * min(abs(low), abs(high)):
        share = half / best if best > 0.0 else math.inf
        return Verdict.DETERMINED, phrase("status", "precise", share, False)
    return Verdict.BOUNDED, phrase("status", "wide", max(low / high, high / low))


def _of_others(subject: _Subject, found: _Found) -> str:
    """What other minima have that fit as well: a bound is none that one of them does not keep."""
    there, where = [*found.others], "another minimum"
    if found.exchange is not None:
        there, where = [found.exchange[0]], found.exchange[1]
    error = _own_error(subject, found.interval)
    known = (there, error, subject.unit)
    if found.ends != ("crossed", "crossed"):
        return phrase("status", "no_bound", *known, where)
    determined = _by_width(subject, found)[0] is Verdict.DETERMINED
    best, (low, high) = subject.shown(subject.quantity.best), found.interval
    if found.exchange is None and all(low <= value <= high for value in there):
        return phrase("status", "several_within", best, *known, low, high)
    if found.exchange is None and determined:
        return phrase("status", "several", best, *known)
    return phrase("status", "exchange", best, *known, low, high, where, determined)


def _own_error(subject: _Subject, interval: Interval) -> float:
    """Standard deviation at one of several minima, as the slopes there have it; NaN for none.

    It is no more than a tenth of the interval that holds them all.
    """
    error = subject.scale * subject.quantity.sigma
    widest = 0.1 * (interval[1] - interval[0])
    return min(error, widest) if 0.0 < error < math.inf and widest > 0.0 else math.nan


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


def _without_value(explored: Exploration, name: str, basis: Basis) -> Profile:
    """An output that has no value where the data lead, or that nothing moves."""
    k = explored.optimum.likelihood.names.index(name)
    best = float(explored.optimum.expansion.sample.outputs[k])
    box = basis.boxes.get(name, NOWHERE)
    value = OutputEstimate(
        name=name,
        value=best,
        unit=basis.units.get(name, ""),
        ci68=box,
        ci95=box,
        lower=box[0],
        upper=box[1],
        shrinkage=0.0,
        status=Verdict.UNKNOWN,
        reason=phrase("status", "no_value"),
        method="profile",
    )
    if not (math.isfinite(best) and not box[1] > box[0]):
        lost = (STOPPED["lost"], STOPPED["lost"])
        none = Scan(sigma=math.nan, values=(), delta_chi2=(), path={}, stopped=lost)
        return Profile(value, none)
    exact = replace(
        value,
        std=0.0,
        ci68=(best, best),
        ci95=(best, best),
        lower=best,
        upper=best,
        closed_by=("data", "data"),
        shrinkage=1.0,
        status=Verdict.DETERMINED,
        reason=phrase("status", "exact"),
    )
    return Profile(exact, Scan(sigma=0.0, values=(best,), delta_chi2=(0.0,), path={}))
