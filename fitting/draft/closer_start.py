"""Start values from which an FMU follows a record closer than from its own, decades apart.

    least over p of  |y - c s(p)|^2,   p_k times 10^(-3), ..., 10^3, in turn

with the best factor c: a time constant shows whatever the gain. Values that c takes up, as a gain,
then follow with c = 1, where no detector is between. An FMU comes with the values of its author: a
time constant of one second is no start for a step of milliseconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from fitting.extension.fmu import FmuVariable
from fitting.text.arrays import FloatArray

#: Factors on a value that are tried, and how often all values are gone through.
FACTORS = tuple(10.0 ** (0.5 * k) for k in range(-6, 7) if k)
ROUNDS = 2
#: Values that are moved at most: each costs a run for every factor and round.
MOST = 6
#: Share of the squares below which another start is closer.
CLOSER = 0.9
#: Change of the squares below which a value has no effect on the shape.
NO_EFFECT = 1e-6

#: The output (n,) at start values by name; None where the FMU refuses them.
Simulated = Callable[[Mapping[str, float]], FloatArray | None]


def closer_starts(
    record: FloatArray,
    simulated: Simulated,
    variables: Mapping[str, FmuVariable],
    *,
    is_scaled: bool,
) -> dict[str, float]:
    """Start values with smaller residuals of a record than the FMU's own; those that moved.

    Args:
        record: what was measured (n,), in the unit of the output where they are of one kind.
        simulated: the output at start values.
        variables: those whose values may move, by name, with the FMU's own start values.
        is_scaled: whether its unit is another than the output's, so that a factor is free.
    """
    own = {name: float(v.start or 0.0) for name, v in variables.items() if v.start}
    at, blind = dict(own), list(own)[:MOST]

    def squares(values: Mapping[str, float], *, scaled: bool) -> float:
        """Sum of squared residuals; infinite outside the ranges that the FMU declares."""
        for name, value in values.items():
            low, high = variables[name].min, variables[name].max
            if (
                not (-math.inf if low is None else low)
                < value
                < (math.inf if high is None else high)
            ):
                return math.inf
        y = simulated(values)
        if y is None or not np.all(np.isfinite(y)):
            return math.inf
        size, factor = float(y @ y), 1.0
        if scaled:
            factor = float(y @ record) / size if size > 0.0 else 0.0
        return float(np.sum((record - factor * y) ** 2))

    def move(name: str, *, scaled: bool) -> bool:
        """Move one value to where the squares are least; whether it has any effect on them."""
        values = [at[name], *(at[name] * factor for factor in FACTORS)]
        sizes = [squares({**at, name: value}, scaled=scaled) for value in values]
        finite = [size for size in sizes if math.isfinite(size)]
        if finite and min(sizes) < CLOSER * sizes[0]:
            at[name] = values[int(np.argmin(sizes))]
        return bool(finite) and max(finite) - min(finite) > NO_EFFECT * max(finite)

    for _ in range(ROUNDS):
        for name in list(own)[:MOST]:
            if move(name, scaled=True) and name in blind:
                blind.remove(name)
    if not is_scaled:
        for name in blind:
            move(name, scaled=False)
    if not squares(at, scaled=is_scaled) < CLOSER * squares(own, scaled=is_scaled):
        return {}
    return {name: value for name, value in at.items() if value != own[name]}
