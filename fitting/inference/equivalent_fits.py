"""Values at equal fits elsewhere: what they say against an interval around one of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from fitting.campaign.parameters import Parameter
from fitting.fit.linearisation import IDENTIFIABLE
from fitting.fit.path import AlternativeResult
from fitting.inference.values import DerivedResult, ParameterResult
from fitting.text.arrays import Scalar
from fitting.text.notation import number

#: How reasons begin, by which they are found again.
EXCHANGE = "determined up to an exchange"
MISSED = "the reported fit is not in its interval"
#: Beyond an interval by less than this share of its width a value is still the same: two fits of
#: one minimum differ so, because the misfit that is minimised is not the likelihood.
SLACK = 0.5


def contradicts(value: float, interval: tuple[float, float], period: float | None = None) -> bool:
    """Whether a value lies clearly outside an interval; one that is missing contradicts none.

    Args:
        value: in the unit of the interval.
        interval: its ends, the lower first.
        period: by which values may differ and be the same.
    """
    low, high = interval
    if not all(map(math.isfinite, (value, low, high))):
        return False
    slack = max(SLACK * (high - low), 1e-9 * max(abs(low), abs(high)))
    turns = (0.0,) if period is None else (-period, 0.0, period)
    return not any(low - slack <= value + turn <= high + slack for turn in turns)


def exchange_words(here: float, there: float, where: str, unit: str) -> str:
    """Why a value is determined no further than to two of them.

    Args:
        here: the value that is reported, in its unit.
        there: the other value, in the same unit.
        where: what leads there.
        unit: of both.
    """
    size = f"{number(here, 5)} here, {number(there, 5)} {unit}".rstrip()
    return f"{EXCHANGE}: {size} at {where}, which fits as well"


def settings_words(settings: Mapping[str, Scalar]) -> str:
    """Settings of an alternative, as in a campaign file.

    Args:
        settings: by name, in the FMU's units.
    """
    return ", ".join(f"{name} = {value}" for name, value in settings.items())


Values = Mapping[str, ParameterResult | DerivedResult]


def exchange_reasons(
    values: Values, parameters: Sequence[Parameter], alternatives: Iterable[AlternativeResult]
) -> dict[str, str]:
    """Why values called determined are not, by name.

    Another alternative that fits as well has the value outside its interval; or the value itself
    lies outside, because its interval belongs to an equal fit elsewhere.

    Args:
        values: by name, with their intervals.
        parameters: that were fitted, for their periods.
        alternatives: all that were tried.
    """
    periods = {p.name: p.period for p in parameters}
    others = [a for a in alternatives if a.equal_to_best and not a.reported]
    said = {}
    for name, value in values.items():
        if value.identifiable == IDENTIFIABLE[2]:
            continue
        period = periods.get(name)
        if contradicts(value.value, value.ci95, period) or (
            math.isnan(value.value) and all(map(math.isfinite, value.ci95))
        ):
            said[name] = f"{MISSED}, which an equal fit elsewhere has inside"
            continue
        for other in others if value.identifiable == IDENTIFIABLE[0] else ():
            there = {**other.parameters, **other.derived}.get(name, math.nan)
            if contradicts(there, value.ci95, period):
                where = settings_words(other.settings)
                said[name] = exchange_words(value.value, there, where, value.unit)
                break
    return said


def with_lower_verdicts(
    parameters: Mapping[str, ParameterResult],
    derived: Mapping[str, DerivedResult],
    reasons: Mapping[str, str],
) -> tuple[dict[str, ParameterResult], dict[str, DerivedResult]]:
    """The same values, those with a reason against them partly determined.

    Args:
        parameters: by name.
        derived: by name.
        reasons: by the names of the values that they speak against.
    """
    word = IDENTIFIABLE[1]
    return (
        {k: replace(v, identifiable=word) if k in reasons else v for k, v in parameters.items()},
        {k: replace(v, identifiable=word) if k in reasons else v for k, v in derived.items()},
    )


def is_reason(sentence: str) -> bool:
    """Whether a sentence is one of `reason_sentences`.

    Args:
        sentence: of the warnings of a result.
    """
    return EXCHANGE in sentence or MISSED in sentence


def reason_sentences(reasons: Mapping[str, str]) -> list[str]:
    """The reasons, for the warnings of a result.

    Args:
        reasons: by name of the value.
    """
    return [f"{name}: {reason}." for name, reason in reasons.items()]
