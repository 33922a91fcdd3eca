"""Outputs that are the same number as a parameter, or as another output."""

from __future__ import annotations

import math

from fitting.inference.likelihood.knowledge import Values
from fitting.text.estimate import FittedEstimate, OutputEstimate

#: Values, and ends of intervals over their width, that are as near are the same.
SAME, SAME_END = 1e-9, 0.02


def same_values(result: Values) -> dict[str, str]:
    """Outputs that are a parameter, or an earlier output, under another name, with that name.

    One mode's eigenfrequency is such an output, and the frequencies of two equal circuits are:
    value, error and interval are the same number.

    Args:
        result: of a reconstruction, or what was inferred of a fit.
    """
    names: dict[str, str] = {}
    first: dict[str, FittedEstimate] = dict(result.parameters)
    for name, d in result.derived.items():
        same = [other for other, p in first.items() if d.unit == p.unit and _same(d, p)]
        if same:
            names[name] = same[-1]
        else:
            first[name] = d
    return names


def _same(one: OutputEstimate, other: FittedEstimate) -> bool:
    """Whether two values are one number, in all that was found of them."""
    if one.status is not other.status or one.spread > SAME * abs(one.value):
        return False
    if (
        not math.isclose(one.value, other.value, rel_tol=SAME)
        or one.active_bounds != other.active_bounds
    ):
        return False
    width = other.ci95[1] - other.ci95[0]
    ends = zip(one.ci95, other.ci95, strict=True)
    return width > 0.0 and all(abs(here - there) < SAME_END * width for here, there in ends)
