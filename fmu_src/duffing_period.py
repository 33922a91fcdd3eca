"""One period of a settled two-tone motion, of which all later ones are copies.

In the frame between two tones the slow motion of a time 1/|u1 - u2| comes back, but for a phase
that both tones share. So a run on its orbit takes the steps of one such time and no more.
"""

from __future__ import annotations

import bisect
import cmath
import math
from typing import TYPE_CHECKING

from .oscillator_equations import TWO_PI

if TYPE_CHECKING:
    from .duffing_exponential import Step
    from .duffing_slow import Pair, SlowModel

#: Steps that are kept: a motion that needs more in a period goes on by steps.
MOST_STEPS = 20_000


class Period:
    """The steps from ``begin`` s on, as far as they were taken."""

    def __init__(self, model: SlowModel, begin: float, length: float) -> None:
        self.model, self.begin, self.length = model, begin, length
        self.end = begin + length
        self.steps: list[Step] = []
        self._times: list[float] = []
        #: The last answer of ``within``, which is asked for both to get there and to read.
        self._within = math.nan, math.nan

    def add(self, step: Step) -> None:
        """Keep the next step."""
        self.steps.append(step)
        self._times.append(step.t)

    @property
    def full(self) -> bool:
        """Whether there are too many steps to be kept."""
        return len(self.steps) >= MOST_STEPS

    def within(self, t: float) -> float:
        """Return the time of the first period that ``t`` s is a copy of."""
        if t != self._within[0]:
            count = math.floor((t - self.begin) / self.length)
            first = min(max(t - count * self.length, self.begin), self.end) if count > 0 else t
            self._within = t, first
        return self._within[1]

    def slow(self, t: float) -> Pair:
        """Return w at ``t`` s; the steps up to that time's like have been taken."""
        first = self.within(t)
        step = self.steps[max(bisect.bisect_right(self._times, first) - 1, 0)]
        w1, w2 = step.between(self.model.rates, first)
        if first == t:
            return w1, w2
        tone = self.model.tones[0]
        turn = cmath.rect(1.0, TWO_PI * (tone.detuning.cycles(t) - tone.detuning.cycles(first)))
        return w1 * turn, w2 * turn


def period_of(model: SlowModel, begin: float) -> Period | None:
    """Return the empty period from ``begin`` s on, None where no number gives its length."""
    length = 1.0 / abs(model.detunings[0] - model.detunings[1])
    lasts = math.isfinite(length) and begin < begin + length
    return Period(model, begin, length) if lasts else None
