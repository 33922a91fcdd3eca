"""What an FMU's own steps leave in a trace, seen where it is sampled more finely than was recorded.

Communication steps of half the length change nothing where an FMU integrates in steps of its own
that fit into either. Between these it stands still, or it divides a shorter communication step
anew. With y_k at the ends of its steps of length h, Euler's method leaves at most

    (h/2) integral |y''| dt  =  1/2 sum |y_(k+1) - 2 y_k + y_(k-1)|

of a system whose errors do not grow. Those of an oscillation may: what is off along its motion
shifts it in time, and stays. With z = (y', y''/w), w^2 = <y''^2>/<y'^2>, over all stretches in
which the input does not change, the shift after a time t and what it makes of the output are

    s(t) = (h/2) integral |z'|/|z| dt,     max |y'(t)| s(t)

which is added twice where y'' changes its sign again and again: a motion that rushes and rests, or
whose period depends on its size, is shifted by more than its mean. Where communication steps are no
multiples of h, input and output are late by a step, max |y_(k+1) - y_k|, besides. A better method
leaves less, which nothing tells from outside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fitting.fmu.runs import SampledSignal
from fitting.signal.window import Window
from fitting.text.arrays import BoolArray, FloatArray

#: Communication steps of a closer look at most, and how many there are between two samples.
LOOKED, FEWEST, MOST = 8192, 4, 64
#: Moves that make a step of its own.
LEAST_MOVES = 6
#: Changes of the sign of y'' that make an oscillation: few modes that only decay have fewer.
LEAST_TURNS = 3
#: How often the shift of an oscillation is counted.
SHIFTED = 2.0
#: Of the largest value, what a difference is rounded to.
ROUNDED = 64.0 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Look:
    """Samples of a trace, the first or all, with ``fine`` communication steps between two of them.

    Args:
        window: of the samples.
        signal: what is held over the steps, and seen at the samples.
        fine: how many steps.
    """

    window: Window
    signal: SampledSignal
    fine: int

    @cached_property
    def closer(self) -> Window:
        """A sample after every communication step."""
        count = self.fine * (self.window.samples - 1) + 1
        step_s = self.window.step_s / self.fine
        return Window(tones_hz=(), settle_s=self.window.settle_s, step_s=step_s, samples=count)

    @cached_property
    def held_signal(self) -> SampledSignal:
        """The same, seen at the end of every step as it was held over it.

        An output that follows its input at once then moves when the next step is over, not at its
        start, where one that stands between steps of its own does.
        """
        kept = self.signal.values
        observed = np.concatenate([kept[:1], kept])[-self.closer.samples :]
        return SampledSignal(self.signal.names, self.signal.step_s, kept, observed)

    @cached_property
    def pushed(self) -> BoolArray:
        """Whether the input changes between two steps (n - 1,)."""
        return np.asarray(np.any(np.diff(self.held_signal.at_samples, axis=0) != 0.0, axis=1))

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
        if np.array_equal(moved, np.flatnonzero(self.pushed)):
            return 0.0
        return self.closer.step_s * float(np.mean(between))


def looked_finely(per_sample: int, samples: int) -> tuple[int, ...]:
    """Communication steps between two samples of closer looks, even multiples of those of a run.

    Args:
        per_sample: steps of a run between two samples.
        samples: of the trace.
    """
    whole = per_sample * 2 * (max(FEWEST, min(MOST, LOOKED // (per_sample * samples))) // 2)
    finer = per_sample * 2 * math.ceil(MOST / (2 * per_sample))
    return (whole, finer) if whole < finer else (whole,)


def euler_leaves(values: FloatArray, pushed: BoolArray, *, late: bool) -> tuple[float, bool]:
    """What Euler's method over steps of the FMU's own leaves, and whether it shifts an oscillation.

    It is relative to the largest value, and may be more than that: so are then the
    derivatives by a frequency that meet it.

    Args:
        values: of an output that stands still between its steps (n,).
        pushed: whether the input changes between two of them (n - 1,).
        late: whether communication steps end between its own.
    """
    largest = float(np.max(np.abs(values)))
    if largest == 0.0:
        return 0.0, False
    moves = np.diff(values)
    at = np.append(0, np.flatnonzero(moves) + 1)
    left = 0.5 * float(np.sum(np.abs(np.diff(values[at], 2))))
    if late:
        left += float(np.max(np.abs(moves)))
    times = np.append(0, np.cumsum(pushed))[at]
    shifted = _shifted(values[at] / largest, times[3:] == times[:-3])
    return left / largest + SHIFTED * shifted, shifted > 0.0


def _shifted(ends: FloatArray, still: BoolArray) -> float:
    """What the shift of an oscillation makes of values at the ends of steps; 0: it is none.

    Args:
        ends: over the largest of them (n,).
        still: whether the input does not change over three steps (n - 3,).
    """
    speed, turn, further = (np.diff(ends, k)[: still.size] for k in (1, 2, 3))
    plain = still & (np.abs(turn) > ROUNDED)
    turns = np.count_nonzero(np.diff(np.sign(turn))[plain[1:] & plain[:-1]])
    if turns < LEAST_TURNS:
        return 0.0
    w = float(np.linalg.norm(turn[still]) / np.linalg.norm(speed[still]))
    ratio = np.hypot(turn, further / w)[plain] / np.hypot(speed, turn / w)[plain]
    each = np.full(speed.size, float(np.mean(ratio)))
    each[plain] = ratio
    return float(np.max(0.5 * np.cumsum(each) * np.abs(speed)))
