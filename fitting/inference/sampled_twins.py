"""Frequencies that differ by the rate of the samples, whose fits are equal for it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from fitting.inference.likelihood.knowledge import Equivalent
from fitting.text.estimate import FittedEstimate
from fitting.text.finding import Finding, Kind
from fitting.text.notation import number

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
                alike = (name, *(_beside(name, turns, rate) for turns in found))
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


def _beside(name: str, turns: int, rate: float) -> str:
    return f"{name} {'+' if turns > 0 else '−'} {number(abs(turns) * rate)} Hz"
