"""What is written next to a value: ± where that is true, else the error on either side.

± is the 68 % interval of a profile likelihood, and is read as if the 95 % interval were
twice as long. A profile need be no parabola: its sides may differ, and beyond 68 % it may flatten
towards another valley. Then both are printed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from fitting.text.notation import joint_prefix, quantity, span, uneven_quantity

Interval = tuple[float, float]

#: Normal deviate within which 95 % lie.
ROOT_95 = 1.959964

#: Ratio of the sides from which each has a number of its own: either is 11 % off their mean.
UNEQUAL = 1.25
#: Ratio of a side at 95 % to 1.96 times that at 68 %, or its inverse, from which ± does not tell
#: the 95 % interval. Student's t reaches it at two degrees of freedom.
MISLEADING = 1.5


@dataclass(frozen=True, kw_only=True)
class ErrorBars:
    """How far the 68 % interval goes `below` and `above` the most likely value, and what ± means.

    `is_even`: half of the interval is taken for both sides; `covers95`: 1.96 times the sides is the
    95 % interval, near enough. Without a profile the sides are NaN, and both hold.
    """

    below: float = math.nan
    above: float = math.nan
    is_even: bool = True
    covers95: bool = True

    def words(self, value: float, std: float, unit: str, interval95: Interval) -> str:
        """A value with its error, "5.2 ± 0.3 Hz" or "235 +128 −89 Hz (146 to 363 Hz at 95 %)".

        Args:
            value: the most likely one.
            std: half of the 68 % interval, in the same unit.
            unit: of the values.
            interval95: the 95 % interval, which is printed where it does not follow from the error.
        """
        sides = (self.below, self.above)
        shown = quantity(value, std, unit) if self.is_even else uneven_quantity(value, sides, unit)
        if self.covers95:
            return shown
        factor, prefixed = joint_prefix(value, std if self.is_even else min(sides), unit)
        low, high = (end / factor for end in interval95)
        return f"{shown} ({span(low, high, prefixed)}\u00a0at\u00a095\u00a0%)"


#: Of a value without a profile: its error is linearised, and ± is all that it tells.
EVEN = ErrorBars()


def error_bars(value: float, ci68: Interval, ci95: Interval, simulation: float) -> ErrorBars:
    """The sides of a 68 % interval, and whether ± holds for them and the 95 % interval.

    How far the simulation's own error lengthens both intervals by as much is taken off before
    they are compared.

    Args:
        value: the most likely one.
        ci68: its 68 % interval; NaN where there is none.
        ci95: its 95 % interval.
        simulation: how far the simulation's own error moves it, at most.
    """
    below, above = _sides(value, ci68)
    if not (below > 0.0 and above > 0.0):
        return EVEN
    wide = _sides(value, ci95)
    moved = min(simulation, 0.99 * min(below, above))
    ratios = [
        (far - moved) / (ROOT_95 * (near - moved))
        for near, far in zip((below, above), wide, strict=True)
    ]
    return ErrorBars(
        below=below,
        above=above,
        is_even=max(below, above) < UNEQUAL * min(below, above),
        covers95=all(1.0 < MISLEADING * r < MISLEADING**2 for r in ratios),
    )


def _sides(best: float, interval: Interval) -> tuple[float, float]:
    return best - interval[0], interval[1] - best
