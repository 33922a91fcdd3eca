"""How long a whole job will still take: what is expected of it, at the pace seen so far."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from fitting.api.cost import Expected, Range, added, times
from fitting.api.fitted import Progress, Spent
from fitting.cli.running.progress import listed_words

#: Evaluations and seconds that a pace was seen for before it is told: the first evaluations are not
#: like the rest.
ENOUGH, LEAST_S = 50, 2.0
#: What was said runs down like a clock until a new estimate is off by this factor.
CALM = 1.5
#: A batch of evaluations this many times slower than those before it was held up, and tells
#: nothing of those that follow.
DELAYED = 10.0
#: Figures that a report is expected to have, its page counted as one, and seconds of each before
#: any was drawn.
FIGURES, FIGURE_S = 10, (0.5, 2.0)


class Remaining:
    """Follows a fit, its profiles and its report: what is being done, and how long all of it takes.

    Args:
        expected: evaluations that the parts of the job are expected to take.
        drawn: whether figures and a report follow.
        clock: seconds.
    """

    def __init__(
        self, expected: Expected, *, drawn: bool = True, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._expected, self._clock = expected, clock
        self._seconds_each = math.nan
        # of profiles: evaluations and their seconds; total, size and time of the last batch
        self._evaluations, self._seconds = 0, 0.0
        self._last: tuple[int, int, float] | None = None
        self._drawing_s: Range = times(FIGURES if drawn else 0.0, FIGURE_S)
        self._drawing_began_s = math.nan
        self._printed_s: Range | None = None

    def searching(self, state: Progress) -> str:
        """Where a fit is, in words.

        Args:
            state: as `fitting.fit` hands it out.
        """
        e = self._expected
        if state.elapsed_s >= LEAST_S and state.evaluations >= ENOUGH:
            self._seconds_each = state.elapsed_s / state.evaluations
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

    def walking(self, spent: Spent) -> str:
        """Where the profiles are, in words.

        Args:
            spent: as `fitting.profile` hands it out.
        """
        # by now those asked for before have been made; their total begins anew where it falls
        now_s = self._clock()
        before, requested, then_s = self._last or (0, 0, now_s)
        self._last = (spent.total, max(spent.total - before, 0), now_s)
        seconds = now_s - then_s
        if self._evaluations >= ENOUGH:  # but for what held this batch up
            usual_s = self._seconds / self._evaluations * max(requested, 1)
            seconds = min(seconds, DELAYED * usual_s)
        self._evaluations += requested
        self._seconds += seconds
        if self._evaluations >= ENOUGH and self._seconds >= LEAST_S:
            self._seconds_each = self._seconds / self._evaluations
        self._expect(self._expected.left(spent.stage, spent.evaluations))
        count = f"{spent.evaluations} evaluations"
        return f"profiles of {self._expected.profiled} values: {spent.stage}, {count}"

    def report(self) -> str:
        """What is printed before the first figure, whose number is not known yet."""
        self._printed_s = None
        self._expect((0.0, 0.0))
        return "figures and report"

    def drawing(self, done: int, of: int) -> str:
        """Where the figures are, in words.

        Args:
            done: figures that are drawn.
            of: figures in all.
        """
        now_s = self._clock()
        if not done:
            self._drawing_began_s = now_s
        each = FIGURE_S
        if done:
            each = times((now_s - self._drawing_began_s) / done, (1.0, 1.0))
        self._drawing_s = times(of - done + 1, each)
        self._expect((0.0, 0.0))
        return f"figure {done + 1} of {of}" if done < of else "report"

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

    def _expect(self, evaluations: Range) -> None:
        """So many evaluations are left before the figures; what is printed stays if it is close."""
        if max(evaluations) > 0.0 and not self._seconds_each > 0.0:
            return
        now_s = self._clock()
        seconds_each = self._seconds_each if max(evaluations) > 0.0 else 0.0
        low_s, high_s = added(times(seconds_each, evaluations), self._drawing_s)
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
