"""Values at equal fits elsewhere: what they say against an interval around one of them."""

from __future__ import annotations

import math

from fitting.inference.likelihood.knowledge import Equivalent, Values
from fitting.text.estimate import FittedEstimate
from fitting.text.finding import Finding, Kind

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
    near = turned_to(value, 0.5 * (low + high), period)
    return not low - slack <= near <= high + slack


def turned_to(value: float, near: float, period: float | None) -> float:
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
