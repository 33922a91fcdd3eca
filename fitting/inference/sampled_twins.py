"""Frequencies that differ by the rate of the samples, whose fits are equal for it: in words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from fitting.inference.likelihood.knowledge import Equivalent, Profile
from fitting.text.notation import listed, number

#: How such a sentence begins.
SAMPLED = "Sampled "
#: How far two frequencies may be from a whole number of rates apart, as a share of the rate.
WHOLE = 1e-3


def sampling_sentences(
    rates_hz: Iterable[float], profiles: Mapping[str, Profile], equivalents: Sequence[Equivalent]
) -> tuple[str, ...]:
    """Which values in Hz are one of several because the record is sampled so rarely.

    Args:
        rates_hz: of the samples of all measurements that show frequencies up to multiples of them.
        profiles: of parameters and outputs, by name.
        equivalents: fits that are as good.
    """
    said = []
    for rate in dict.fromkeys(rates_hz):
        for name, profile in profiles.items():
            found = sorted(_turns(name, profile, rate, equivalents))
            if found:
                there = [_beside(name, turns, rate) for turns in found]
                said.append(
                    f"{SAMPLED}{number(rate)} times a second, {listed([name, *there])} give the "
                    f"same record: a box narrower than {number(rate)} Hz decides."
                )
    return tuple(said)


def _turns(name: str, profile: Profile, rate: float, equivalents: Sequence[Equivalent]) -> set[int]:
    """By how many rates the values of equal fits are off."""
    if profile.unit != "Hz" or profile.kind != "parameter":
        return set()
    values = [other.parameters[name] for other in equivalents if name in other.parameters]
    off = [(value - profile.best) / rate for value in values]
    return {round(each) for each in off if round(each) and abs(each - round(each)) < WHOLE}


def _beside(name: str, turns: int, rate: float) -> str:
    return f"{name} {'+' if turns > 0 else '−'} {number(abs(turns) * rate)} Hz"
