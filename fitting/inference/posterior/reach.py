"""Values that a fit accepts and that no draw is near: what a chain that agrees with itself misses.

A value v of a parameter is accepted where the fit's own profile has

    Dchi^2(v) k^2 <= 3.84        k the factor by which the fit widened the noise; draws do not

and at every other minimum that fits as well. Walkers agree as well where all of them miss the same
part of a posterior: only what is known apart from them can show it. A chain is near a value where a
draw is closer than a tenth of the width of the profile's interval.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitting.campaign.parameters import Parameter
from fitting.inference.likelihood.knowledge import Scan, Values
from fitting.inference.posterior.minima import Target
from fitting.inference.posterior.turns import told_value
from fitting.text.arrays import FloatArray
from fitting.text.error_bars import ROOT_95
from fitting.text.estimate import SLACK
from fitting.text.notation import number, unit_text

#: Share of the profile's interval within which a draw has to be.
NEAR = 0.1


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


def accepted_by(fit: Values, parameters: Sequence[Parameter]) -> dict[str, Accepted]:
    """Values inside the bounds that a fit accepts, by name of the parameter.

    Profiles are scanned beyond the bounds, where no draw comes: what fits only with another value
    beyond its own is left out, and a value beyond its own counts at that bound.

    Args:
        fit: with its profiles; without them nothing is known.
        parameters: that are drawn, with their bounds.
    """
    knowledge = fit.knowledge
    if knowledge is None:
        return {}
    bounds = {p.name: _bounds(p) for p in parameters}
    others = [e.parameters for e in knowledge.equivalents if not e.where]
    others = [place for place in others if _is_inside(place, bounds)]
    found = {}
    for name, scan in knowledge.scans.items():
        if name not in fit.parameters:
            continue
        low, high = fit.parameters[name].ci95
        values = [place[name] for place in others if name in place]
        if name in bounds:
            values += _along(name, scan, knowledge.inflation, bounds)
        if high > low and math.isfinite(high - low):
            found[name] = Accepted(tuple(values), high - low)
    return found


def _along(
    name: str, scan: Scan, inflation: float, bounds: Mapping[str, tuple[float, float]]
) -> list[float]:
    """Accepted values along a profile."""
    values = []
    for k, (value, delta) in enumerate(zip(scan.values, scan.delta_chi2, strict=True)):
        place = {other: path[k] for other, path in scan.path.items() if other != name}
        if delta * inflation**2 <= ROOT_95**2 and _is_inside(place, bounds):
            values.append(float(np.clip(value, *bounds[name])))
    return values


def _bounds(parameter: Parameter) -> tuple[float, float]:
    """Of a value with a period none: a turn leads back inside."""
    if parameter.period is not None:
        return -math.inf, math.inf
    return parameter.lower, parameter.upper


def _is_inside(place: Mapping[str, float], bounds: Mapping[str, tuple[float, float]]) -> bool:
    """Whether no value of a place lies beyond its bounds, but for rounding."""
    for name, value in place.items():
        low, high = bounds.get(name, (-math.inf, math.inf))
        slack = SLACK * (high - low) if math.isfinite(high - low) else 0.0
        if not low - slack <= value <= high + slack and not math.isnan(value):
            return False
    return True


def missed_by(
    target: Target, begins: FloatArray, draws: FloatArray, accepted: Mapping[str, Accepted]
) -> Missed | None:
    """The accepted value that is the farthest from all draws; None where each has one near it.

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
    """Values as draws have them; of a box that holds no whole period those that a turn leads to."""
    if parameter.period is None:
        return list(values)
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
