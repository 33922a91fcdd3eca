"""Values that a fit accepts and that no draw is near: what a chain that agrees with itself misses.

A value v of a parameter is accepted where the fit's own profile has

    Dchi^2(v) k^2 <= 3.84        k the factor by which the fit widened the noise; draws do not

and at every other minimum that fits as well. Walkers agree as well where all of them miss the same
part of a posterior: only what is known apart from them can show it. A chain is near a value where a
draw is closer than a tenth of the width of the profile's interval.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitting.campaign.parameters import Parameter
from fitting.inference.likelihood.knowledge import Knowledge, Profile
from fitting.inference.posterior.minima import Target
from fitting.inference.posterior.turns import told_value
from fitting.signal.student import ROOT_95
from fitting.text.arrays import FloatArray
from fitting.text.notation import number, unit_text

#: Share of the profile's interval within which a draw has to be.
NEAR = 0.1
#: Ends of a branch at which the end of the interval was seen to fit, not assumed.
SEEN = ("crossed", "held", "bound", "round")


@dataclass(frozen=True)
class Accepted:
    """Values of one parameter that a fit accepts, in its unit, and the width of its interval."""

    values: tuple[float, ...]
    width: float


@dataclass(frozen=True)
class Missed:
    """A value that a fit accepts, and the draw that comes nearest to it, in `unit`."""

    name: str
    value: float
    nearest: float
    unit: str

    @property
    def words(self) -> str:
        """A clause."""
        unit = f" {unit_text(self.unit)}" if unit_text(self.unit) else ""
        return (
            f"no draw is near {self.name} = {number(self.value, 4)}{unit}, which the fit accepts "
            f"(the nearest: {number(self.nearest, 4)}{unit})"
        )


def accepted_by(knowledge: Knowledge) -> dict[str, Accepted]:
    """Values that a fit accepts, by name of the parameter.

    Args:
        knowledge: of the fit, with its profiles.
    """
    found = {}
    for name, profile in knowledge.parameters.items():
        low, high = profile.interval95
        others = [e.parameters[name] for e in knowledge.equivalents if not e.where]
        values = (*_accepted(profile, knowledge.inflation), *others)
        if high > low and math.isfinite(high - low):
            found[name] = Accepted(tuple(filter(math.isfinite, values)), high - low)
    return found


def _accepted(profile: Profile, inflation: float) -> list[float]:
    """Values along a profile, and the ends of its interval where these were seen to fit."""
    points = zip(profile.values, profile.delta, strict=True)
    values = [v for v, delta in points if delta * inflation**2 <= ROOT_95**2]
    if inflation == 1.0:
        ends = zip(profile.interval95, profile.ends, strict=True)
        values += [value for value, end in ends if end in SEEN]
    return values


def missed_by(
    target: Target, begins: FloatArray, draws: FloatArray, accepted: Mapping[str, Accepted]
) -> Missed | None:
    """The accepted value that is the farthest from all draws; None where each has one near it.

    Values beyond the bounds are none that draws could come near.

    Args:
        target: the posterior.
        begins: where the period of each parameter that has one begins, (n,), NaN of others.
        draws: (steps, walkers, n) in the parameters' units.
        accepted: by name of the parameter.
    """
    worst, missed = NEAR, None
    for i, (p, begin) in enumerate(zip(target.parameters, begins.tolist(), strict=True)):
        known = accepted.get(p.name)
        if known is None:
            continue
        ordered = np.sort(draws[..., i], axis=None)
        width = known.width if p.period is None else min(known.width, p.period)
        for value in _inside(p, begin, known.values):
            nearest = _nearest(ordered, value, p.period)
            off = abs(_apart(nearest - value, p.period)) / width
            if off > worst:
                worst, missed = off, Missed(p.name, value, nearest, p.unit)
    return missed


def _inside(parameter: Parameter, begin: float, values: tuple[float, ...]) -> list[float]:
    """Values in the bounds, as draws have them: a period may lead there."""
    if parameter.period is None:
        return [v for v in values if parameter.lower <= v <= parameter.upper]
    period, low = parameter.period, parameter.lower
    inside = [v for v in values if low + np.mod(v - low, period) <= parameter.upper]
    return [told_value(parameter, begin, v) for v in inside]


def _nearest(ordered: FloatArray, value: float, period: float | None) -> float:
    """The draw next to a value, of those in rising order."""
    k = int(np.searchsorted(ordered, value))
    beside = ordered[[k - 1, k % ordered.size]]  # the last one stands before the first, on a circle
    return float(min(beside, key=lambda draw: abs(_apart(draw - value, period))))


def _apart(difference: float, period: float | None) -> float:
    if period is None:
        return difference
    return difference - period * round(difference / period)
