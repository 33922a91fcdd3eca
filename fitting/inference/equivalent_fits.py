"""Fits that are as good: values there against an interval, other alternatives, sampled records."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from fitting.campaign.parameters import to_model
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import RowNoise
from fitting.fit.objective import Objective
from fitting.fit.optimum import most_likely
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
        # values that the data constrain are worth printing; where none differs, as they are
        # unconstrained anyway, there is nothing to act on
        printed = tuple(name for name in there if known[name].status.has_value)
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
    """Another alternative at its most likely point; None where the data tell it from this one.

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
