"""Values of which campaigns that are fitted together say what cannot be true of both.

A joint fit lies between them and is neither's. Such a value has no verdict: what each campaign says
of it by itself is told instead.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace

from fitting.inference.consistency import contradictions
from fitting.inference.joint_result import Estimate, JointResult
from fitting.inference.likelihood.knowledge import Knowledge, Profile
from fitting.inference.verdicts import withdrawn
from fitting.text.notation import listed, quantity

#: Standard deviations from which the values of two campaigns that contradict each other differ.
APART = 3.0


def contradicted(joint: JointResult | None, units: Mapping[str, str]) -> dict[str, str]:
    """What campaigns say of values by themselves, by name, where that differs; mostly empty.

    Args:
        joint: the tests of their agreement; None: nothing was tested.
        units: of the values, by name.
    """
    if joint is None or not contradictions(joint):
        return {}
    said = {}
    for name, unit in units.items():
        alone = {part.name: part.alone[name] for part in joint.series if name in part.alone}
        told = {series: each for series, each in alone.items() if math.isfinite(each.std)}
        if any(_apart(one, other) for one, other in itertools.combinations(told.values(), 2)):
            each = (f"{series} alone says {_words(e, unit)}" for series, e in told.items())
            said[name] = f"{listed(each)}: these contradict each other"
    return said


def without_verdicts(knowledge: Knowledge, reasons: Mapping[str, str]) -> Knowledge:
    """The same, values without a verdict where there is a reason.

    Args:
        knowledge: what the data say.
        reasons: why there is none, by name.
    """

    def judged(profiles: Mapping[str, Profile]) -> dict[str, Profile]:
        return {n: withdrawn(p, reasons[n]) if n in reasons else p for n, p in profiles.items()}

    return replace(
        knowledge, parameters=judged(knowledge.parameters), derived=judged(knowledge.derived)
    )


def _apart(one: Estimate, other: Estimate) -> bool:
    return abs(one.value - other.value) > APART * math.hypot(one.std, other.std)


def _words(estimate: Estimate, unit: str) -> str:
    return quantity(estimate.value, estimate.std, unit)
