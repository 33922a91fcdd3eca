"""Fits that are as good: values there against an interval, other alternatives, sampled records."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from fitting.campaign.parameters import to_model
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective
from fitting.fit.optimum import Optimum, most_likely
from fitting.fit.outputs import output_means
from fitting.inference.likelihood.knowledge import Equivalent, Values
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.error_bars import ROOT_95
from fitting.text.estimate import FittedEstimate
from fitting.text.finding import Finding, Kind
from fitting.text.notation import number, settings_words

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
    if values.knowledge is None:
        return ()
    found = []
    for other in values.knowledge.equivalents:
        names = _printed(values, other)
        found.append(
            Finding(
                kind=Kind.equivalent_solution,
                # nothing to act on where it differs in values that are unconstrained anyway
                severity="warning" if other.possible and names["values"] else "note",
                subject=other.where or _farthest(values, other),
                numbers={**other.parameters, "delta_chi2": other.delta},
                names=names,
            )
        )
    return tuple(found)


def _printed(values: Values, other: Equivalent) -> dict[str, tuple[str, ...]]:
    """Names and units of the values that are worth printing: the data constrain them."""
    known = _profiled(values)
    names = tuple(n for n in other.parameters if n in known and known[n].status.has_value)
    return {
        "values": names,
        "units": tuple(known[n].unit for n in names),
        "alternative": (other.where,) if other.where else (),
    }


def _farthest(values: Values, other: Equivalent) -> str:
    """The parameter whose value at another fit is the most standard errors away."""
    known = _profiled(values)

    def off(name: str) -> float:
        sigma = values.scans[name].sigma
        far = abs(other.parameters[name] - known[name].likely)
        return far / sigma if sigma > 0.0 else 0.0

    return max((n for n in other.parameters if n in known), key=off, default="")


def _profiled(values: Values) -> dict[str, FittedEstimate]:
    return {name: value for name, value in values.parameters.items() if name in values.scans}


def equal_fit(
    other: tuple[Objective, Sequence[FloatArray]],
    here: tuple[Objective, Sequence[FloatArray]],
    settings: Mapping[str, Scalar],
    noise: RowNoise,
) -> Equivalent | None:
    """Another alternative at its most likely point; None where the data tell it from this one.

    Args:
        other: objective of the other alternative, and search vectors to begin at.
        here: those of the reported one.
        settings: of the other alternative, by name.
        noise: of the rows.
    """
    found = [
        most_likely(LikelihoodEvaluator(likelihood_of(objective, noise)), begins)
        for objective, begins in (here, other)
    ]
    own, there = found
    delta = _delta(own, there)
    if delta > ROOT_95**2:
        return None
    objective = other[0]
    x = there.likelihood.folded(there.expansion.x)
    outputs = output_means(objective.response, objective.parameters, [x])
    named = zip(objective.parameters, to_model(objective.parameters, x), strict=True)
    return Equivalent(
        parameters={q.name: float(value) for q, value in named},
        derived={name: float(values[0]) for name, values in outputs.items()},
        delta=float(delta),
        origin="alternative",
        where=settings_words(settings),
    )


def _delta(own: Optimum, there: Optimum) -> float:
    """Chi square of another model over that of this one, both in the wider noise of the two."""
    wide = max(own.likelihood.inflation, there.likelihood.inflation)
    mine = own.likelihood.noise.log_determinant
    other = there.likelihood.noise.log_determinant
    if mine == other:
        return own.calibrated((there.chi_square - own.chi_square) / wide**2)
    # noise that residuals tell is another one there: -2 ln of the likelihoods' ratio
    return float(other + there.chi_square - mine - own.chi_square) / wide**2


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
            found = sorted(_turns(name, value, rate, equivalents))
            if found:
                alike = (name, *(_shifted(name, turns, rate) for turns in found))
                yield Finding(
                    kind=Kind.sampling_ambiguity,
                    severity="warning",
                    subject=name,
                    numbers={"rate_hz": rate},
                    names={"frequencies": alike},
                )


def _turns(
    name: str, value: FittedEstimate, rate: float, equivalents: Sequence[Equivalent]
) -> set[int]:
    """By how many rates the values of equal fits are off."""
    if value.unit != "Hz" or value.role != "parameter":
        return set()
    there = [other.parameters[name] for other in equivalents if name in other.parameters]
    off = [(each - value.likely) / rate for each in there]
    return {round(each) for each in off if round(each) and abs(each - round(each)) < WHOLE}


def _shifted(name: str, turns: int, rate: float) -> str:
    return f"{name} {'+' if turns > 0 else '−'} {number(abs(turns) * rate)} Hz"
