"""Values of campaigns that are fitted together and contradict each other.

What the joint fit finds then is true of none of them. A value keeps its verdict only where each of
them determines it by itself and they say the same; of the others it is told what each says alone.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

from fitting.inference.consistency import contradictions
from fitting.inference.joint_result import JointResult, ValueAlone
from fitting.text.notation import listed, quantity

#: Standard deviations from which the values of two campaigns that contradict each other differ.
APART = 3.0


def contradicted(joint: JointResult | None, units: Mapping[str, str]) -> dict[str, str]:
    """Why values have no verdict, by name, where campaigns contradict each other; mostly empty.

    Args:
        joint: the tests of their agreement; None: nothing was tested.
        units: of the values, by name.
    """
    found = contradictions(joint)
    if joint is None or not found:
        return {}
    sides = {side for test in found for side in (test.one, test.other)}
    names = {part.name for part in joint.series}
    # a side of several campaigns is the rest of them all
    parts = [part for part in joint.series if part.name in sides or not sides <= names]
    said = {}
    for name, unit in units.items():
        told = {p.name: p.alone[name] for p in parts if name in p.alone}
        told = {series: each for series, each in told.items() if math.isfinite(each.std)}
        differ = any(_apart(one, other) for one, other in itertools.combinations(told.values(), 2))
        if not differ and len(told) == len(parts):
            continue
        each = (f"{series} alone determines {_words(e, unit)}" for series, e in told.items())
        told_words = f"{listed(each)}: " if told else ""
        said[name] = told_words + (
            "these contradict each other"
            if differ
            else f"{listed(p.name for p in parts)} contradict each other, and not each of them "
            "determines this value by itself"
        )
    return said


def _apart(one: ValueAlone, other: ValueAlone) -> bool:
    return abs(one.value - other.value) > APART * math.hypot(one.std, other.std)


def _words(estimate: ValueAlone, unit: str) -> str:
    return quantity(estimate.value, estimate.std, unit)
