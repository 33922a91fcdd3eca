"""What an FMU's own steps leave in a trace, seen where it is sampled more finely than was recorded.

Communication steps of half the length change nothing where an FMU integrates in steps of its own
that fit into either. Between these it stands still, or it divides a shorter communication step
anew. With y_k at the ends of its steps of length h, Euler's method leaves at most

    (h/2) integral |y''| dt  =  1/2 sum |y_(k+1) - 2 y_k + y_(k-1)|

of a system whose errors do not grow. Where communication steps are no multiples of h, input and
output are late by a step, max |y_(k+1) - y_k|, besides. A better method leaves less, which nothing
tells from outside.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitting.fmu import HeldSignal
from fitting.signal.window import Window
from fitting.text.arrays import FloatArray

#: Communication steps of a closer look at most, and how many there are between two samples.
LOOKED, FEWEST, MOST = 8192, 4, 64
#: Moves that make a step of its own.
LEAST_MOVES = 6


@dataclass(frozen=True, eq=False)
class Look:
    """First samples of a trace, with ``fine`` communication steps between two of them.

    Args:
        window: of the samples.
        signal: what is held over the steps, and seen at the samples.
        fine: how many steps.
    """

    window: Window
    signal: HeldSignal
    fine: int

    @cached_property
    def closer(self) -> Window:
        """A sample after every communication step."""
        count = self.fine * (self.window.samples - 1) + 1
        step_s = self.window.step_s / self.fine
        return Window(tones_hz=(), settle_s=self.window.settle_s, step_s=step_s, samples=count)

    @cached_property
    def held_signal(self) -> HeldSignal:
        """The same, seen at the end of every step as it was held over it.

        An output that follows its input at once then moves when the next step is over, not at its
        start, where one that stands between steps of its own does.
        """
        held = self.signal.held
        seen = np.concatenate([held[:1], held])[-self.closer.samples :]
        return HeldSignal(self.signal.names, self.signal.step_s, held, seen)

    def standing_s(self, values: FloatArray) -> float:
        """The step between whose ends the output stands still, s; 0: it does not.

        An output that follows its input at once moves when that does: no step of its own.

        Args:
            values: of the output, after every step (n,).
        """
        moved = np.flatnonzero(np.diff(values))
        between = np.diff(moved)
        if moved.size < LEAST_MOVES or between.min() < 2 or np.ptp(between) > 1:
            return 0.0
        pushed = np.flatnonzero(np.any(np.diff(self.held_signal.seen, axis=0) != 0.0, axis=1))
        if np.array_equal(moved, pushed):
            return 0.0
        return self.closer.step_s * float(np.mean(between))


def looked_finely(samples: int) -> int:
    """Communication steps between two samples of a closer look.

    Args:
        samples: of the trace.
    """
    return max(FEWEST, min(MOST, LOOKED // samples))


def euler_leaves(values: FloatArray, *, late: bool) -> float:
    """What Euler's method over steps of the FMU's own leaves at most, over the largest value.

    Args:
        values: of an output that stands still between its steps (n,).
        late: whether communication steps end between its own.
    """
    moves = np.diff(values)
    ends = np.concatenate([values[:1], values[1:][moves != 0.0]])
    largest = float(np.max(np.abs(values)))
    left = 0.5 * float(np.sum(np.abs(np.diff(ends, 2))))
    if late:
        left += float(np.max(np.abs(moves)))
    return min(1.0, left / largest) if largest > 0.0 else 0.0
