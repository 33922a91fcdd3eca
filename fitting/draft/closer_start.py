"""Start values from which an FMU follows a record closer than from its own, decades apart.

    least over p of  |y - c s(p)|^2,   p_k times 10^(-3), ..., 10^3, one after the other

with the best factor c: a time constant shows whatever the gain. Values that c takes up, as a gain,
then follow with c = 1, where no detector stands between. An FMU comes with the values of its
author: a time constant of one second is no start for a step of milliseconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fitting.fmu import FmuVariable
from fitting.text.arrays import FloatArray

#: Factors on a value that are tried, and how often all values are gone through.
FACTORS = tuple(10.0 ** (0.5 * k) for k in range(-6, 7) if k)
ROUNDS = 2
#: Values that are moved at most: each costs a run for every factor and round.
MOST = 6
#: Share of the squares that are left, below which another start is closer.
CLOSER = 0.9
#: Change of the squares below which a value has no effect on the shape.
NO_EFFECT = 1e-6

#: The output (n,) at start values by name; None where the FMU refuses them.
Simulated = Callable[[Mapping[str, float]], FloatArray | None]


@dataclass(frozen=True)
class Record:
    """A record (n,) and whether its unit is another than the output's, so that a factor is free."""

    values: FloatArray
    is_scaled: bool

    def left(self, seen: FloatArray | None) -> float:
        """Squares that an output leaves of the record; infinite where there is none.

        Args:
            seen: of a run, shape (n,); None: the FMU refused the values.
        """
        if seen is None or not np.all(np.isfinite(seen)):
            return math.inf
        size = float(seen @ seen)
        factor = 1.0
        if self.is_scaled:
            factor = float(seen @ self.values) / size if size > 0.0 else 0.0
        return float(np.sum((self.values - factor * seen) ** 2))


def closer_starts(
    record: Record, simulated: Simulated, variables: Mapping[str, FmuVariable]
) -> dict[str, float]:
    """Start values that leave less of a record than the FMU's own; those that moved.

    Args:
        record: what was measured, in the unit of the output where they are of one kind.
        simulated: the output at start values.
        variables: those whose values may move, by name, with the FMU's own start values.
    """
    own = {name: float(v.start or 0.0) for name, v in variables.items() if v.start}
    names = list(own)[:MOST]
    shape = _Search(replace(record, is_scaled=True), simulated, variables)
    at = dict(own)
    blind = set(names)
    for _ in range(ROUNDS):
        for name in names:
            at, has_effect = shape.moved(at, name)
            blind -= {name} if has_effect else set()
    if not record.is_scaled:
        for name in (n for n in names if n in blind):
            at, _ = _Search(record, simulated, variables).moved(at, name)
    if not record.left(simulated(at)) < CLOSER * record.left(simulated(own)):
        return {}
    return {name: value for name, value in at.items() if value != own[name]}


@dataclass(frozen=True)
class _Search:
    record: Record
    simulated: Simulated
    variables: Mapping[str, FmuVariable]

    def moved(self, at: Mapping[str, float], name: str) -> tuple[dict[str, float], bool]:
        """Values with one moved to where least is left, and whether it has any effect on that."""
        values = [at[name], *(at[name] * factor for factor in FACTORS)]
        left = [self.left({**at, name: value}) for value in values]
        finite = [each for each in left if math.isfinite(each)]
        if not finite:
            return dict(at), False
        has_effect = max(finite) - min(finite) > NO_EFFECT * max(finite)
        best = int(np.argmin(left)) if min(left) < CLOSER * left[0] else 0
        return {**at, name: values[best]}, has_effect

    def left(self, values: Mapping[str, float]) -> float:
        """Squares that are left at values; infinite outside the ranges that the FMU declares."""
        inside = all(_is_inside(self.variables[n], value) for n, value in values.items())
        return self.record.left(self.simulated(values)) if inside else math.inf


def _is_inside(variable: FmuVariable, value: float) -> bool:
    low = -math.inf if variable.min is None else variable.min
    high = math.inf if variable.max is None else variable.max
    return low < value < high
