"""How long a whole job will still take: what is expected of it, at the pace seen so far."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from fitting.api.cost import Expected, Range, added, times
from fitting.api.fitted import Progress, Spent
from fitting.api.progress import listed_words

#: Evaluations and seconds that a pace was seen for before it is printed: the first evaluations are
#: not like the rest.
ENOUGH, LEAST_S = 50, 2.0
#: What was printed runs down like a clock until a new estimate is off by this factor.
CALM = 1.5
#: What figures and report take, s, least and most.
REPORT_S = (5.0, 20.0)


class Remaining:
    """Follows a fit and its profiles: what is being done, and how long the whole job still takes.

    Args:
        expected: evaluations that the parts of the job are expected to take.
        drawn: whether figures and a report follow.
        clock: seconds.
    """

    def __init__(
        self, expected: Expected, *, drawn: bool = True, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._expected, self._clock = expected, clock
        self._report_s: Range = REPORT_S if drawn else (0.0, 0.0)
        self._seconds_each = math.nan
        # of profiles: when they began, what was requested since, and the total of the last time
        self._began_s, self._requested, self._total = math.nan, 0, 0
        self._printed_s: Range | None = None

    def searching(self, state: Progress) -> str:
        """Where a fit is, in words.

        Args:
            state: as `fitting.fit` hands it out.
        """
        e = self._expected
        self._measure(state.evaluations, state.elapsed_s)
        share = 1.0 - state.done / max(state.of, 1)
        if state.stage == "search":
            words = [f"search, alternative {state.done + 1}/{state.of}"]
            left = added(times(share, e.search), e.path)
        else:
            words = [f"{state.stage}, level {state.done + 1}/{state.of}", f"ν = {state.nu:.0e}"]
            left = times(share, e.path)
        j = state.j_fit + state.j_reg
        words += [f"J = {j:.5g}"] if math.isfinite(j) else []
        self._expect(added(left, e.profiles, e.bootstrap))
        return ", ".join(words)

    def profiling(self, spent: Spent) -> str:
        """Where the profiles are, in words.

        Args:
            spent: as `fitting.profile` hands it out.
        """
        # by now what was requested before has been made; its total begins anew where it falls
        if math.isnan(self._began_s):
            self._began_s = self._clock()
        self._measure(self._requested, self._clock() - self._began_s)
        self._requested += max(spent.total - self._total, 0)
        self._total = spent.total
        self._expect(self._expected.left(spent.stage, spent.evaluations))
        count = f"{spent.evaluations} evaluations"
        return f"profiles of {self._expected.profiled} values: {spent.stage}, {count}"

    def left(self) -> str:
        """How long all of it still takes, in words; nothing before a pace was seen."""
        if self._printed_s is None:
            return ""
        low_s, high_s = (max(at_s - self._clock(), 0.0) for at_s in self._printed_s)
        if high_s <= 0.0:
            return "longer than expected"
        if high_s < 1.0:
            return "a second left"
        unit, size = ("s", 1.0) if high_s < 120.0 else ("min", 60.0)
        low, high = _rounded(low_s / size), _rounded(high_s / size)
        if low == high:
            return f"about {high} {unit} left"
        return f"up to {high} {unit} left" if low == "0" else f"{low} to {high} {unit} left"

    def _measure(self, evaluations: int, seconds: float) -> None:
        """So many evaluations have taken so long."""
        if evaluations >= ENOUGH and seconds >= LEAST_S:
            self._seconds_each = seconds / evaluations

    def _expect(self, evaluations: Range) -> None:
        """So many evaluations are left before the report; what is printed stays if it is close."""
        if math.isnan(self._seconds_each):
            return
        now_s = self._clock()
        low_s, high_s = added(times(self._seconds_each, evaluations), self._report_s)
        if self._printed_s is not None:
            low_then_s, high_then_s = (max(at_s - now_s, 0.0) for at_s in self._printed_s)
            if max(high_s, high_then_s) <= CALM * min(high_s, high_then_s):
                low_s, high_s = min(max(low_s, low_then_s), high_then_s), high_then_s
        self._printed_s = (now_s + low_s, now_s + high_s)


def counted(remaining: Remaining, runs: int) -> str:
    """What stands behind the words of a progress: how long it still takes, and runs so far.

    Args:
        remaining: of the job.
        runs: of the FMU.
    """
    return listed_words(remaining.left(), f"{runs} runs")


def _rounded(value: float) -> str:
    """A whole number of at most two digits that count."""
    if value < 10.0:
        return f"{value:.0f}"
    place = 1 - math.floor(math.log10(value))
    return f"{round(value, place):.0f}"
