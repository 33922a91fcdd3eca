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
from fitting.text.rendering import phrase

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
    every = {part.name for part in joint.series}
    # a side of several campaigns is the rest of them all
    parts = [part for part in joint.series if part.name in sides or not sides <= every]
    reasons = {}
    for name, unit in units.items():
        known = {p.name: p.alone[name] for p in parts if name in p.alone}
        known = {series: each for series, each in known.items() if math.isfinite(each.std)}
        differ = any(_apart(one, other) for one, other in itertools.combinations(known.values(), 2))
        if not differ and len(known) == len(parts):
            continue
        names = [part.name for part in parts]
        reasons[name] = phrase("status", "contradicted", known, unit, names, differ)
    return reasons


def _apart(one: ValueAlone, other: ValueAlone) -> bool:
    return abs(one.value - other.value) > APART * math.hypot(one.std, other.std)
