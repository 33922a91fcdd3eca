"""How long a whole job will still take: what is expected of it, at the pace seen so far."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from fitting.api.cost import Expected, Range, added, times
from fitting.api.fitted import Progress

#: Evaluations of the profiles from which their own pace is taken, not that of the search, and
#: seconds that a pace was seen for before it is told: the first evaluations are not like the rest.
ENOUGH, SEEN_S = 50, 5.0
#: What was said runs down like a clock until a new estimate is off by this factor.
CALM = 1.5


class Remaining:
    """Follows a fit and its profiles, and says at each moment how far it is.

    Args:
        expected: evaluations that the parts of the job are expected to take.
        clock: seconds.
    """

    def __init__(self, expected: Expected, clock: Callable[[], float] = time.monotonic) -> None:
        self._expected, self._clock = expected, clock
        self._seconds_each = math.nan
        self._begun_s = math.nan
        self._told_s: Range | None = None

    def searching(self, state: Progress) -> str:
        """Where a search is, in words.

        Args:
            state: as `fitting.fit` hands it out.
        """
        e = self._expected
        if state.seconds_each * state.evaluations >= SEEN_S:
            self._seconds_each = state.seconds_each
        words = [
            f"alternative {state.alternative + 1}/{state.alternatives}",
            f"start {state.start + 1}/{max(state.start + 1, state.starts)}",
            f"ν = {state.nu:.0e}",
        ]
        j = state.j_fit + state.j_reg
        words += [f"J = {j:.5g}"] if math.isfinite(j) else []
        share = 1.0 - state.done / max(state.of, 1)
        left = added(times(share, e.search), e.profiles, e.bootstrap)
        return ", ".join([*words, *self._left(left, self._clock())])

    def walking(self, evaluations: int) -> str:
        """Where the profiles are, in words.

        Args:
            evaluations: that they have taken so far.
        """
        e, now_s = self._expected, self._clock()
        if math.isnan(self._begun_s):
            self._begun_s = now_s
        if evaluations >= ENOUGH and now_s - self._begun_s >= SEEN_S:
            self._seconds_each = (now_s - self._begun_s) / evaluations
        low, high = e.profiles[0] - evaluations, e.profiles[1] - evaluations
        bounds = (max(low, 0.0) + e.bootstrap[0], high + e.bootstrap[1])
        words = f"profiles of {e.profiled} values, {evaluations} evaluations"
        late = ["longer than expected"]
        return ", ".join([words, *(self._left(bounds, now_s) if high > 0.0 else late)])

    def _left(self, evaluations: Range, now_s: float) -> list[str]:
        """How long so many evaluations take; nothing before a pace was seen."""
        if not self._seconds_each > 0.0:
            return []
        low_s, high_s = (count * self._seconds_each for count in evaluations)
        if self._told_s is not None:
            low_then_s, high_then_s = (max(at_s - now_s, 0.0) for at_s in self._told_s)
            if max(high_s, high_then_s) <= CALM * min(high_s, high_then_s):
                low_s, high_s = min(low_s, low_then_s), high_then_s
        self._told_s = (now_s + low_s, now_s + high_s)
        if high_s < 1.0:
            return ["a second left"]
        unit, size = ("s", 1.0) if high_s < 120.0 else ("min", 60.0)
        low, high = _rounded(low_s / size), _rounded(high_s / size)
        return [f"up to {high} {unit} left" if low == "0" else f"{low} to {high} {unit} left"]


def _rounded(value: float) -> str:
    """A whole number of at most two digits that count."""
    if value < 10.0:
        return f"{value:.0f}"
    place = 1 - math.floor(math.log10(value))
    return f"{round(value, place):.0f}"
