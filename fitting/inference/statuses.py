"""From profiles to statuses: interval, precision and status of parameters and derived outputs.

A status follows from what closes the two sides of an interval (`STATUS`), and where both are closed
by the data from how wide it is and whether another fit lies beyond it. Intervals are conditional on
the bounds of the campaign: parameters whose bounds are active along one are named with it.

Fits that are as good are compared with the intervals: those of other alternatives, and frequencies
that a record of samples does not distinguish.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any

import numpy as np

from fitting.campaign.parameters import Parameter, canonical, spans_decades, to_model
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective
from fitting.fit.optimum import most_likely
from fitting.fit.outputs import output_means
from fitting.inference.likelihood.knowledge import (
    STOPPED,
    Equivalent,
    Interval,
    Profile,
    Scan,
    Values,
)
from fitting.inference.likelihood.profile import Quantity, ScanPoint, Scans
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.estimate import (
    NOWHERE,
    ROOT_95,
    FittedEstimate,
    OutputEstimate,
    ParameterEstimate,
    Verdict,
)
from fitting.text.finding import Finding, Kind
from fitting.text.notation import number, settings_words
from fitting.text.rendering import phrase

#: Ratio of the ends of an interval up to which a value that cannot change its sign is determined
#: (half the width is then half the value), and share of its period for one that goes round.
NARROW, NARROW_ROUND = 3.0, 0.25
#: Share of what the model can have from which an interval is all of it.
NEARLY_ALL = 0.9
#: Share of the width of its prior from which an interval is that of the prior alone, and up to
#: which the prior has no part in it: the data answer for a tenth and for nine of the variance.
PRIOR_ALONE, PRIOR_IDLE = math.sqrt(0.9), math.sqrt(0.1)
#: What leads to another fit of the same model.
ANOTHER = "another minimum"
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
class _Interval:
    """The interval of one quantity in its own unit, what closes it, and what speaks against it.

    `scale` and `shift` lead from x to the unit; `best` is the most likely value, `error` its
    linearised standard deviation, `box` the range without data. `others` are values of separate
    minima outside the interval around the optimum, whose own valley the data close where it
    `is_closed`; `exchange` the value of another alternative and what leads there; `active` names
    parameters at their bounds.
    """

    parameter: Parameter | None
    unit: str
    scale: float
    shift: float
    best: float
    error: float
    box: Interval
    ci68: Interval
    ci95: Interval
    closed: tuple[str, str]
    active: tuple[str, ...]
    is_closed: bool
    others: Sequence[float] = ()
    exchange: tuple[float, str] | None = None

    @property
    def period(self) -> float | None:
        """By which values may differ and be the same."""
        return self.parameter.period if self.parameter is not None else None


def profiles(
    scans: Scans,
    equivalents: Sequence[Equivalent],
    units: Mapping[str, str],
    *,
    is_redundant: bool,
) -> dict[str, Profile]:
    """Value and profile of every quantity, in its own unit, parameters first.

    Args:
        scans: both sides of all quantities.
        equivalents: other points that fit as well.
        units: of outputs, by name.
        is_redundant: whether there are more data than unknowns.
    """
    likelihood = scans.optimum.likelihood
    # what brings the optimum into the canonical period, (n,), in the parameters' units
    here = to_model(likelihood.parameters, scans.optimum.expansion.x)
    turn = np.asarray(canonical(likelihood.parameters, here) - here)
    made: dict[str, Profile] = {}
    for quantity in scans.quantities:
        name = quantity.name
        interval = _interval(scans, quantity, units.get(name, ""), turn)
        interval = _with_other_fits(scans, quantity, interval, equivalents)
        status, reason = _status(interval, is_redundant)
        value = _estimate(scans, quantity, interval, status, reason)
        made[name] = value, _points(scans, quantity, interval, turn)
    for name in likelihood.names:
        if name not in made:
            made[name] = _without_value(scans, name, units.get(name, ""))
    return made


def _interval(scans: Scans, quantity: Quantity, unit: str, turn: FloatArray) -> _Interval:
    """The interval as the sides were closed, in the quantity's own unit."""
    parameters, parameter = scans.optimum.likelihood.parameters, None
    scale, shift, box = 1.0, 0.0, (quantity.low, quantity.high)
    if quantity.index >= 0:
        parameter = parameters[quantity.index]
        unit, scale = parameter.unit, parameter.scale
        shift = parameter.reference + float(turn[quantity.index])
        box = (parameter.lower, parameter.upper)
        if quantity.is_periodic:
            box = (shift + scale * quantity.low, shift + scale * quantity.high)
    low, high = scans.sides[quantity.name]
    ends = np.array([[low.end68, low.end95], [high.end68, high.end95]])
    limits = np.array([[quantity.low], [quantity.high]])
    # the very bound where an end is one
    ends = np.where(ends == limits, np.reshape(box, (2, 1)), shift + scale * ends)
    ci68, ci95 = ends.T.tolist()
    closed = (low.closed, high.closed)
    if "periodic" in closed and closed != ("periodic", "periodic"):
        # half a period up and down is one and the same system: where the half turn fits from one
        # side it does from the other, where a scan found no way
        below, above = ("bound" if end in ("periodic", "failed") else end for end in closed)
        closed = (below, above)
    active = [parameters[i].name for side in (low, high) for i in side.active]
    return _Interval(
        parameter=parameter,
        unit=unit,
        scale=scale,
        shift=shift,
        best=shift + scale * quantity.best,
        error=scale * quantity.sigma,
        box=box,
        ci68=tuple(ci68),
        ci95=tuple(ci95),
        closed=closed,
        active=tuple(dict.fromkeys(active)),
        is_closed=math.isfinite(low.own95) and math.isfinite(high.own95),
    )


def _with_other_fits(
    scans: Scans, quantity: Quantity, here: _Interval, equivalents: Sequence[Equivalent]
) -> _Interval:
    """The interval with values that fit as well elsewhere, and as wide as these make it."""
    others, exchange = [], None
    has_alternative = any(other.origin == "alternative" for other in equivalents)
    down, up = scans.sides[quantity.name]
    low = here.shift + here.scale * down.own95 if math.isfinite(down.own95) else -math.inf
    high = here.shift + here.scale * up.own95 if math.isfinite(up.own95) else math.inf
    margin = 1e-6 * (quantity.high - quantity.low) * here.scale
    # where one end is closed the width of the interval is no measure: the other end is a bound
    sides = (here.ci68[0] - here.ci95[0], here.ci95[1] - here.ci68[1])
    by_data = [side for end, side in zip(here.closed, sides, strict=True) if end == "data"]
    slack = 0.5 * by_data[0] if len(by_data) == 1 else None
    # values of other alternatives come first
    for other in sorted(equivalents, key=lambda each: each.origin != "alternative"):
        named = other.parameters if here.parameter is not None else other.derived
        value = nearest_image(named.get(quantity.name, math.nan), here.best, here.period)
        # of separate minima of this model: those that the interval around the optimum does not
        # hold, where every output has a value
        is_own = other.origin == "start" and other.possible and math.isfinite(value)
        if is_own and "periodic" not in here.closed and not low - margin <= value <= high + margin:
            others.append(value)
        # where there is an alternative, points without a value of some output count, too: they may
        # have one there
        is_compared = exchange is None and has_alternative
        if is_compared and contradicts(value, here.ci95, here.period, slack):
            exchange = value, other.where or ANOTHER
    ends = here.ci95
    if (others or exchange) and len(by_data) == 1:  # another fit lies beyond the only closed end
        ends = min(ends[0], here.box[0]), max(ends[1], here.box[1])
    return replace(here, ci95=ends, others=others, exchange=exchange)


def _estimate(
    scans: Scans, quantity: Quantity, here: _Interval, status: Verdict, reason: str
) -> FittedEstimate:
    """The value as it is reported."""
    (low68, high68), (low95, high95) = here.ci68, here.ci95
    share = (high95 - low95) / (here.box[1] - here.box[0])
    is_verified = all(side.is_verified for side in scans.sides[quantity.name])
    known: dict[str, Any] = {
        "name": quantity.name,
        "value": here.best,
        "unit": here.unit,
        "std": 0.5 * (high68 - low68) if status.has_value else math.nan,
        "ci68": here.ci68,
        "ci95": here.ci95,
        # empty where a search ended before anything closed the side
        "closed_by": tuple("" if end in STOPPED else end for end in here.closed),
        "shrinkage": 1.0 - min(1.0, share) ** 2,
        "status": status,
        "reason": reason,
        "method": "linearised, verified" if is_verified else "profile",
        "simulation": here.scale * quantity.reach * quantity.sigma,
        "active_bounds": here.active,
    }
    p = here.parameter
    if p is None:
        return OutputEstimate(**known, lower=here.box[0], upper=here.box[1])
    return ParameterEstimate(
        **known,
        lower=p.lower,
        upper=p.upper,
        period=p.period,
        reference=p.reference,
        start=p.start,
        asked=p.moves_model,
    )


def _points(scans: Scans, quantity: Quantity, here: _Interval, turn: FloatArray) -> Scan:
    """All points of a profile in rising order, the optimum among them, with what moves along it."""
    likelihood, (down, up) = scans.optimum.likelihood, scans.sides[quantity.name]
    middle = ScanPoint(value=quantity.best, delta=0.0, at=scans.optimum.expansion)
    points = sorted([*down.points, middle, *up.points], key=attrgetter("value"))
    table = to_model(likelihood.parameters, np.array([point.x for point in points])) + turn
    read = np.full((len(points), len(likelihood.names)), np.nan)  # where outputs were not read
    for row, point in zip(read, points, strict=True):
        row[:] = point.outputs if point.outputs.size else np.nan
    names = (*(p.name for p in likelihood.parameters), *likelihood.names)
    path = dict(zip(names, map(tuple, np.hstack([table, read]).T.tolist()), strict=True))
    return Scan(
        sigma=here.error,
        held=here.active,
        stopped=(STOPPED.get(here.closed[0], ""), STOPPED.get(here.closed[1], "")),
        values=tuple(here.shift + here.scale * point.value for point in points),
        delta_chi2=tuple(max(0.0, point.delta) for point in points),
        path=path,
    )


def _status(here: _Interval, is_redundant: bool) -> tuple[Verdict, str]:
    """The status and why."""
    closed, active = here.closed, list(here.active)
    if not is_redundant:  # where a scan then ends is a matter of the bounds
        return Verdict.UNKNOWN, phrase("status", "no_redundancy")
    if here.others and here.is_closed:
        return Verdict.SEVERAL, _of_others(here)
    status = STATUS.get(closed, Verdict.UNCONSTRAINED)
    if status is Verdict.UNKNOWN or closed == ("prior", "prior"):
        return status, phrase("status", "sides", closed, active)
    if status is Verdict.UNCONSTRAINED:
        word = "any_of_period" if "periodic" in closed else "both_ends"
        return status, phrase("status", word, closed, active)
    # width of the interval over that of the Gaussian prior
    prior = None if here.parameter is None else here.parameter.prior_sigma
    low, high = here.ci95
    share = 0.0 if prior is None else (high - low) / (2.0 * ROOT_95 * prior)
    if share > PRIOR_ALONE:
        return Verdict.UNCONSTRAINED, phrase("status", "prior_alone")
    if here.exchange is not None or here.others:
        several = Verdict.SEVERAL if closed == ("data", "data") else Verdict.UNKNOWN
        return several, _of_others(here)
    # an output that may have anything that the model allows: an eigenfrequency of two coupled modes
    # lies between those of the lines, whatever was measured. What may have any size, over decades,
    # is measured by ratios: a width as the Q that goes with it
    if here.parameter is None:
        least, most = here.box
        begin, end = max(low, least), min(high, most)
        part = (end - begin) / (most - least)
        if spans_decades(least, most) and 0.0 < begin < end:
            part = math.log(end / begin) / math.log(most / least)
        if part > NEARLY_ALL:
            return Verdict.UNCONSTRAINED, phrase("status", "nearly_all")
    if status is not Verdict.DETERMINED:
        side = "above" if status is Verdict.BELOW else "below"
        return status, phrase("status", side, closed, active)
    if share > PRIOR_IDLE:
        return Verdict.BOUNDED, phrase("status", "prior_part")
    return _by_width(here)


def _by_width(here: _Interval) -> tuple[Verdict, str]:
    """Determined, or only bounded, where the data cut both ends."""
    low, high = here.ci95
    half, best = 0.5 * (high - low), abs(here.best)
    if here.period is not None:
        if high - low <= NARROW_ROUND * here.period:
            return Verdict.DETERMINED, phrase("status", "precise", half / here.period, True)
        return Verdict.BOUNDED, phrase("status", "wide_period")
    if low * high <= 0.0:
        return Verdict.BOUNDED, phrase("status", "zero_inside")
    if max(abs(low), abs(high)) <= NARROW * min(abs(low), abs(high)):
        share = half / best if best > 0.0 else math.inf
        return Verdict.DETERMINED, phrase("status", "precise", share, False)
    return Verdict.BOUNDED, phrase("status", "wide", max(low / high, high / low))


def _of_others(here: _Interval) -> str:
    """What other minima have that fit as well: a bound is none that one of them does not keep."""
    there, where = [*here.others], ANOTHER
    if here.exchange is not None:
        there, where = [here.exchange[0]], here.exchange[1]
    low, high = here.ci95
    # the error at one of several minima is no more than a tenth of the interval that holds them all
    error = math.nan
    if 0.0 < here.error < math.inf and high > low:
        error = min(here.error, 0.1 * (high - low))
    known = (there, error, here.unit)
    if here.closed != ("data", "data"):
        return phrase("status", "no_bound", *known, where)
    is_determined = _by_width(here)[0] is Verdict.DETERMINED
    if here.exchange is None and all(low <= value <= high for value in there):
        return phrase("status", "several_within", here.best, *known, low, high)
    if here.exchange is None and is_determined:
        return phrase("status", "several", here.best, *known)
    return phrase("status", "exchange", here.best, *known, low, high, where, is_determined)


def _without_value(scans: Scans, name: str, unit: str) -> Profile:
    """An output that has no value where the data lead, or that nothing moves."""
    best = float(scans.optimum.expansion.sample.outputs[scans.optimum.likelihood.names.index(name)])
    range_ = scans.ranges.get(name)
    box = NOWHERE if range_ is None else (range_.low, range_.high)
    is_exact = math.isfinite(best) and not box[1] > box[0]
    box = (best, best) if is_exact else box
    value = OutputEstimate(
        name=name,
        value=best,
        unit=unit,
        std=0.0 if is_exact else math.nan,
        ci68=box,
        ci95=box,
        lower=box[0],
        upper=box[1],
        closed_by=("data", "data") if is_exact else ("", ""),
        shrinkage=1.0 if is_exact else 0.0,
        status=Verdict.DETERMINED if is_exact else Verdict.UNKNOWN,
        reason=phrase("status", "exact" if is_exact else "no_value"),
        method="profile",
    )
    if is_exact:
        return value, Scan(sigma=0.0, values=(best,), delta_chi2=(0.0,), path={})
    failed = (STOPPED["failed"], STOPPED["failed"])
    return value, Scan(sigma=math.nan, values=(), delta_chi2=(), path={}, stopped=failed)


# --- fits that are as good ------------------------------------------------------------------------

#: Beyond an interval by less than this share of its width a value is still the same: two fits of
#: one minimum differ so, because the misfit that is minimised is not the likelihood.
SLACK = 0.5


def contradicts(
    value: float,
    interval: tuple[float, float],
    period: float | None = None,
    slack: float | None = None,
) -> bool:
    """Whether a value lies clearly outside an interval; one that is missing contradicts none.

    Args:
        value: in the unit of the interval.
        interval: its ends, the lower first.
        period: by which values may differ, times a whole number, and be the same.
        slack: how far beyond an end it may lie, in that unit; None: half the width.
    """
    low, high = interval
    if not all(map(math.isfinite, (value, low, high))):
        return False
    slack = max(SLACK * (high - low) if slack is None else slack, 1e-9 * max(abs(low), abs(high)))
    near = nearest_image(value, 0.5 * (low + high), period)
    return not low - slack <= near <= high + slack


def nearest_image(value: float, near: float, period: float | None) -> float:
    """A value, or the one whole periods off that is the nearest to another.

    Args:
        value: in any unit.
        near: what it is compared with.
        period: in the same unit; None: it has none.
    """
    return value if period is None else value - period * round((value - near) / period)


def equivalent_findings(values: Values) -> tuple[Finding, ...]:
    """Other fits that are as good, a finding each: its values in their units, and `delta_chi2`.

    The subject is the alternative that leads there, else the parameter that is the most of its
    standard errors away.

    Args:
        values: of the fit; without profiles nothing is known of other fits.
    """
    findings, scans = [], values.scans
    known = {name: value for name, value in values.parameters.items() if name in scans}
    for other in () if values.knowledge is None else values.knowledge.equivalents:
        there = {name: value for name, value in other.parameters.items() if name in known}
        far = {
            name: abs(value - known[name].likely) / scans[name].sigma
            for name, value in there.items()
            if scans[name].sigma > 0.0
        }
        farthest = max(there, key=lambda name: far.get(name, 0.0), default="")
        # values that the data constrain and that are others there are worth printing; where there
        # are none, as what differs is unconstrained anyway, there is nothing to act on
        differ = (name for name in there if far.get(name, math.inf) > 1.0)
        printed = tuple(name for name in differ if known[name].status.has_value)
        names = {
            "values": printed,
            "units": tuple(known[name].unit for name in printed),
            "alternative": (other.where,) if other.where else (),
        }
        findings.append(
            Finding(
                kind=Kind.equivalent_solution,
                severity="warning" if other.possible and printed else "note",
                subject=other.where or farthest,
                numbers={**other.parameters, "delta_chi2": other.delta},
                names=names,
            )
        )
    return tuple(findings)


def equal_fit(
    other: tuple[Objective, Sequence[FloatArray]],
    here: tuple[Objective, Sequence[FloatArray]],
    settings: Mapping[str, Scalar],
    noise: RowNoise,
) -> Equivalent | None:
    """Another alternative at its most likely point; None where the data exclude it.

    Args:
        other: objective of the other alternative, and search vectors to begin at.
        here: those of the reported one.
        settings: of the other alternative, by name.
        noise: of the rows.
    """
    own, there = (
        most_likely(LikelihoodEvaluator(likelihood_of(objective, noise)), begins)
        for objective, begins in (here, other)
    )
    # chi square over that of this model, both in the wider noise of the two
    wide = max(own.likelihood.inflation, there.likelihood.inflation)
    sizes = [each.likelihood.noise.log_determinant for each in (own, there)]
    if sizes[0] == sizes[1]:
        delta = own.calibrated((there.chi_square - own.chi_square) / wide**2)
    else:  # noise that residuals tell is another one there: -2 ln of the likelihoods' ratio
        delta = (sizes[1] + there.chi_square - sizes[0] - own.chi_square) / wide**2
    if delta > ROOT_95**2:
        return None
    objective, x = other[0], there.likelihood.folded(there.expansion.x)
    outputs = output_means(objective.response, objective.parameters, [x])
    named = zip(objective.parameters, to_model(objective.parameters, x), strict=True)
    return Equivalent(
        parameters={q.name: float(value) for q, value in named},
        derived={name: float(values[0]) for name, values in outputs.items()},
        delta=float(delta),
        origin="alternative",
        where=settings_words(settings),
    )


#: How far two frequencies may be from a whole number of rates apart, as a share of the rate.
WHOLE = 1e-3


def sampling_findings(
    rates_hz: Iterable[float],
    values: Mapping[str, FittedEstimate],
    equivalents: Sequence[Equivalent],
) -> Iterator[Finding]:
    """Which values in Hz are one of several because the record is sampled so rarely.

    Args:
        rates_hz: of the samples of all measurements that show frequencies up to multiples of them.
        values: of parameters and outputs, by name.
        equivalents: fits that are as good.
    """
    for rate in dict.fromkeys(rates_hz):
        for name, value in values.items():
            if value.unit != "Hz" or value.role != "parameter":
                continue
            there = [other.parameters[name] for other in equivalents if name in other.parameters]
            off = [(each - value.likely) / rate for each in there]
            turns = {round(each) for each in off if abs(each - round(each)) < WHOLE} - {0}
            if turns:
                shifted = (
                    f"{name} {'+' if turn > 0 else '−'} {number(abs(turn) * rate)} Hz"
                    for turn in sorted(turns)
                )
                yield Finding(
                    kind=Kind.sampling_ambiguity,
                    severity="warning",
                    subject=name,
                    numbers={"rate_hz": rate},
                    names={"frequencies": (name, *shifted)},
                )
