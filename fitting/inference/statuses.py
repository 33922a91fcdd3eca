"""From profiles to statuses: interval, precision and status of parameters and derived outputs.

A status follows from what closes the two sides of an interval (`STATUS`), and where both are closed
by the data from how wide it is and whether another fit lies beyond it. Intervals are conditional on
the bounds of the campaign: parameters whose bounds are active along one are named with it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fitting.campaign.parameters import Parameter, canonical, spans_decades, to_model
from fitting.inference.equivalent_fits import contradicts, nearest_image
from fitting.inference.likelihood.knowledge import STOPPED, Equivalent, Interval, Profile, Scan
from fitting.inference.likelihood.profile import Quantity, ScanPoint, Scans, Side
from fitting.text.arrays import FloatArray
from fitting.text.error_bars import ROOT_95
from fitting.text.estimate import (
    NOWHERE,
    Closed,
    FittedEstimate,
    OutputEstimate,
    ParameterEstimate,
    Verdict,
)
from fitting.text.rendering import phrase

#: Ratio of the ends of an interval up to which a value that cannot change its sign is determined
#: (half the width is then half the value), and share of its period for one that goes round.
NARROW, NARROW_ROUND = 3.0, 0.25
#: Share of what the model can have from which an interval is all of it.
NEARLY_ALL = 0.9
#: Share of the width of its prior from which an interval is that of the prior alone, and up to
#: which the prior has no part in it: the data answer for a tenth and for nine of the variance.
PRIOR_ALONE, PRIOR_IDLE = math.sqrt(0.9), math.sqrt(0.1)
#: Sides that nothing closes: priors of what drifts say nothing of the sample.
OPEN = ("bound", "prior")
#: (lower side, upper side) -> status, by what closes them; pairs that are missing leave the value
#: unconstrained, and (data, data) is determined or bounded by its width.
STATUS: Mapping[tuple[str, str], Verdict] = {
    ("data", "data"): Verdict.DETERMINED,
    **{("data", other): Verdict.BELOW for other in OPEN},
    **{(other, "data"): Verdict.ABOVE for other in OPEN},
    **{
        pair: Verdict.UNKNOWN
        for ended in ("failed", "budget")
        for other in ("data", "prior", "bound", "periodic", "failed", "budget")
        for pair in ((ended, other), (other, ended))
    },
}


@dataclass(frozen=True, kw_only=True)
class Basis:
    """What statuses are decided on, beside the profiles themselves.

    `equivalents` fit as well elsewhere; `units` are those of outputs; `redundant`: whether there
    are more data than unknowns.
    """

    equivalents: Sequence[Equivalent] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    redundant: bool = True


@dataclass(frozen=True, kw_only=True)
class _Subject:
    """One quantity in its own unit: `scale` and `shift` lead from x, `box` is its range."""

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
        """By which values may differ and be the same."""
        return self.parameter.period if self.parameter is not None else None


@dataclass(frozen=True, kw_only=True)
class _Interval:
    """Interval and what closes it, and what speaks against it.

    `others` are values of separate minima outside the interval around the optimum, whose own valley
    the data close where it `is_closed`; `exchange` the value of another alternative and what leads
    there; `active` names parameters at their bounds.
    """

    interval: Interval
    closed: tuple[str, str]
    others: Sequence[float]
    exchange: tuple[float, str] | None
    active: Sequence[str]
    is_closed: bool


def profiles(scans: Scans, basis: Basis) -> dict[str, Profile]:
    """Value and profile of every quantity, in its own unit, parameters first.

    Args:
        scans: both sides of all quantities.
        basis: what else the statuses rest on.
    """
    every = scans.optimum.likelihood.parameters
    parameters = {p.name: p for p in every}
    # what brings the optimum into the canonical period, (n,), in the parameters' units
    here = to_model(every, scans.optimum.expansion.x)
    turn = np.asarray(canonical(every, here) - here)
    made = {}
    for quantity in scans.quantities:
        subject = _subject(quantity, parameters.get(quantity.name), basis, turn)
        made[quantity.name] = _profile(scans, subject, basis, turn)
    for name in scans.optimum.likelihood.names:
        if name not in made and name not in {q.name for q in scans.quantities}:
            made[name] = _without_value(scans, name, basis)
    return made


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
            box=(quantity.low, quantity.high),
        )
    shift = parameter.reference + float(turn[quantity.index])
    box = (parameter.lower, parameter.upper)
    if quantity.is_periodic:
        box = (shift + parameter.scale * quantity.low, shift + parameter.scale * quantity.high)
    return _Subject(
        quantity=quantity,
        parameter=parameter,
        unit=parameter.unit,
        scale=parameter.scale,
        shift=shift,
        box=box,
    )


def _profile(scans: Scans, subject: _Subject, basis: Basis, turn: FloatArray) -> Profile:
    quantity = subject.quantity
    low, high = scans.sides[quantity.name]
    closed = _closed(low, high)
    low68, low95 = (_end(subject, 0, end) for end in (low.end68, low.end95))
    high68, high95 = (_end(subject, 1, end) for end in (high.end68, high.end95))
    others = [] if closed[0] == "periodic" else _elsewhere(scans, subject, basis.equivalents)
    # where one end is closed the width of the interval is no measure: the other end is a bound
    sides = (low68 - low95, high95 - high68)
    by_data = [side for word, side in zip(closed, sides, strict=True) if word == "data"]
    slack = 0.5 * by_data[0] if len(by_data) == 1 else None
    exchange = _exchange(subject, (low95, high95), basis.equivalents, slack)
    if (others or exchange) and len(by_data) == 1:  # another fit lies beyond the only closed end
        low95, high95 = min(low95, subject.box[0]), max(high95, subject.box[1])
    names = [p.name for p in scans.optimum.likelihood.parameters]
    active = tuple(dict.fromkeys(names[i] for side in (low, high) for i in side.active))
    ends = _Interval(
        interval=(low95, high95),
        closed=closed,
        others=others,
        exchange=exchange,
        active=active,
        is_closed=math.isfinite(low.own95) and math.isfinite(high.own95),
    )
    status, reason = _status(subject, ends, basis)
    wide = (high95 - low95) / (subject.box[1] - subject.box[0])
    points = _in_order(scans, quantity)
    parameter = subject.parameter
    known: dict[str, Any] = {
        "name": quantity.name,
        "value": subject.shown(quantity.best),
        "unit": subject.unit,
        "std": 0.5 * (high68 - low68) if status.has_value else math.nan,
        "ci68": (low68, high68),
        "ci95": (low95, high95),
        "closed_by": (_word(closed[0]), _word(closed[1])),
        "shrinkage": 1.0 - min(1.0, wide) ** 2,
        "status": status,
        "reason": reason,
        "method": "linearised, verified" if low.is_verified and high.is_verified else "profile",
        "simulation": subject.scale * quantity.reach * quantity.sigma,
        "active_bounds": active,
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
        held=active,
        stopped=(STOPPED.get(closed[0], ""), STOPPED.get(closed[1], "")),
        values=tuple(subject.shown(point.value) for point in points),
        delta_chi2=tuple(max(0.0, point.delta) for point in points),
        path=_path(scans, points, turn),
    )
    return Profile(value, scan)


def _end(subject: _Subject, side: int, value: float) -> float:
    """An end of an interval in its unit: the very bound where it is one."""
    limit = (subject.quantity.low, subject.quantity.high)[side]
    return subject.box[side] if value == limit else subject.shown(value)


def _closed(low: Side, high: Side) -> tuple[str, str]:
    """What closes the sides; half a period up and down is one and the same system."""
    closed = (low.closed, high.closed)
    if "periodic" not in closed or closed == ("periodic", "periodic"):
        return closed
    # the half turn fits from one side: it does from the other, where a scan found no way
    words = ["bound" if word in ("periodic", "failed") else word for word in closed]
    return words[0], words[1]


def _word(closed: str) -> Closed:
    """What closes a side, as an estimate has it: empty where a search ended before anything did."""
    words: Mapping[str, Closed] = {
        "data": "data",
        "prior": "prior",
        "bound": "bound",
        "periodic": "periodic",
    }
    return words.get(closed, "")


def _elsewhere(scans: Scans, subject: _Subject, equivalents: Sequence[Equivalent]) -> list[float]:
    """Values at separate minima of this model that the interval around the optimum does not hold.

    Where an output has no value the point says nothing of it; nor does one whose whole valley is
    without a value of some output.
    """
    quantity = subject.quantity
    down, up = scans.sides[quantity.name]
    low = subject.shown(down.own95) if math.isfinite(down.own95) else -math.inf
    high = subject.shown(up.own95) if math.isfinite(up.own95) else math.inf
    margin = 1e-6 * quantity.width * subject.scale
    values = []
    for other in equivalents:
        named = other.parameters if subject.parameter is not None else other.derived
        value = named.get(quantity.name, math.nan)
        if other.origin != "start" or not other.possible or not math.isfinite(value):
            continue
        value = nearest_image(value, subject.shown(quantity.best), subject.period)
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
            return nearest_image(there, best, subject.period), other.where or "another minimum"
    return None


def _status(subject: _Subject, ends: _Interval, basis: Basis) -> tuple[Verdict, str]:
    """The status and why."""
    closed, active = ends.closed, list(ends.active)
    if not basis.redundant:  # where a scan then ends is a matter of the bounds
        return Verdict.UNKNOWN, phrase("status", "no_redundancy")
    if ends.others and ends.is_closed:
        return Verdict.SEVERAL, _of_others(subject, ends)
    status = STATUS.get(closed, Verdict.UNCONSTRAINED)
    if status is Verdict.UNKNOWN:
        return status, phrase("status", "sides", closed, active)
    if status is Verdict.UNCONSTRAINED:
        word = "any_of_period" if "periodic" in closed else "both_ends"
        return status, phrase(
            "status", word if closed != ("prior", "prior") else "sides", closed, active
        )
    # width of the interval over that of the Gaussian prior
    prior = None if subject.parameter is None else subject.parameter.prior_sigma
    low, high = ends.interval
    share = 0.0 if prior is None else (high - low) / (2.0 * ROOT_95 * prior)
    if share > PRIOR_ALONE:
        return Verdict.UNCONSTRAINED, phrase("status", "prior_alone")
    if ends.exchange is not None or ends.others:
        several = Verdict.SEVERAL if closed == ("data", "data") else Verdict.UNKNOWN
        return several, _of_others(subject, ends)
    if _is_nearly_all(subject, ends.interval, subject.box):
        return Verdict.UNCONSTRAINED, phrase("status", "nearly_all")
    if status is not Verdict.DETERMINED:
        side = "above" if status is Verdict.BELOW else "below"
        return status, phrase("status", side, closed, active)
    if share > PRIOR_IDLE:
        return Verdict.BOUNDED, phrase("status", "prior_part")
    return _by_width(subject, ends)


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


def _by_width(subject: _Subject, ends: _Interval) -> tuple[Verdict, str]:
    """Determined, or only bounded, where the data cut both ends."""
    low, high = ends.interval
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


def _of_others(subject: _Subject, ends: _Interval) -> str:
    """What other minima have that fit as well: a bound is none that one of them does not keep."""
    there, where = [*ends.others], "another minimum"
    if ends.exchange is not None:
        there, where = [ends.exchange[0]], ends.exchange[1]
    error = _own_error(subject, ends.interval)
    known = (there, error, subject.unit)
    if ends.closed != ("data", "data"):
        return phrase("status", "no_bound", *known, where)
    determined = _by_width(subject, ends)[0] is Verdict.DETERMINED
    best, (low, high) = subject.shown(subject.quantity.best), ends.interval
    if ends.exchange is None and all(low <= value <= high for value in there):
        return phrase("status", "several_within", best, *known, low, high)
    if ends.exchange is None and determined:
        return phrase("status", "several", best, *known)
    return phrase("status", "exchange", best, *known, low, high, where, determined)


def _own_error(subject: _Subject, interval: Interval) -> float:
    """Standard deviation at one of several minima, as the slopes there have it; NaN for none.

    It is no more than a tenth of the interval that holds them all.
    """
    error = subject.scale * subject.quantity.sigma
    widest = 0.1 * (interval[1] - interval[0])
    return min(error, widest) if 0.0 < error < math.inf and widest > 0.0 else math.nan


def _in_order(scans: Scans, quantity: Quantity) -> list[ScanPoint]:
    """All points of a profile, the optimum among them, in rising order."""
    down, up = scans.sides[quantity.name]
    middle = ScanPoint(value=quantity.best, delta=0.0, at=scans.optimum.expansion)
    return sorted([*down.points, middle, *up.points], key=lambda point: point.value)


def _path(
    scans: Scans, points: Sequence[ScanPoint], turn: FloatArray
) -> dict[str, tuple[float, ...]]:
    """Parameters and outputs along a profile; NaN where an output was not read."""
    likelihood = scans.optimum.likelihood
    table = np.array([to_model(likelihood.parameters, point.x) + turn for point in points])
    path = {p.name: tuple(map(float, table[:, i])) for i, p in enumerate(likelihood.parameters)}
    for k, name in enumerate(likelihood.names):
        path[name] = tuple(
            float(point.outputs[k]) if point.outputs.size else math.nan for point in points
        )
    return path


def _without_value(scans: Scans, name: str, basis: Basis) -> Profile:
    """An output that has no value where the data lead, or that nothing moves."""
    k = scans.optimum.likelihood.names.index(name)
    best = float(scans.optimum.expansion.sample.outputs[k])
    range_ = scans.ranges.get(name)
    box = NOWHERE if range_ is None else (range_.low, range_.high)
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
        lost = (STOPPED["failed"], STOPPED["failed"])
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
