"""When to ask an FMU that has a step of its own: at whole steps, else its last one is seen.

Such an FMU stands still between its steps, so that a sample elsewhere is as late as its last step
is old: amplitudes then repeat to the part of a period that a step is, however long it settles.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from fitting.signal.spectrum import Band, plan_band
from fitting.signal.tones import common_period, exact, tone_design, tones_in_words
from fitting.signal.window import (
    LARGEST_CONDITION,
    SPARE_SAMPLES,
    TRIED_SAMPLES,
    Window,
    folded,
    kept_apart,
    longest_window_s,
    span_s,
    whole_steps,
)
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import hertz

#: Common periods of tones and steps that are tried for a number of samples that divides them.
MOST_PERIODS = 8
#: Steps of the FMU in a window, at most.
MOST_STEPS = 1e5
#: Sampling steps that are tried for tones without a common period.
TRIED_STEPS = 400
#: Samples of a spectrum, at least.
SHOWN = 64
#: A time is at a step where it is no further from one than this part of it.
AT_STEP = 1e-9


@dataclass(frozen=True, kw_only=True)
class Grid:
    """At which times an FMU is asked, where not all are alike to it.

    Samples at whole steps of `step_s` and `offset` of one (`step_s` 0: at any times), communication
    steps no longer than `longest_s` (0: as long as samples are apart).

    Raises:
        ValueError: a time below zero.
    """

    step_s: float = 0.0
    offset: float = 0.0
    longest_s: float = 0.0

    def __post_init__(self) -> None:
        if not min(self.step_s, self.offset, self.longest_s) >= 0.0:
            raise ValueError(f"{self!r}: wanted times of at least 0")

    def whole_s(self, tones_hz: Sequence[float]) -> Fraction:
        """The shortest time with whole periods of every tone and whole steps, s.

        Args:
            tones_hz: frequencies of the tones, Hz.
        """
        period = common_period(tones_hz)
        if not self.step_s:
            return period
        # the least common multiple of two fractions
        h = exact(self.step_s)
        a, b = period.numerator * h.denominator, h.numerator * period.denominator
        return Fraction(math.lcm(a, b), period.denominator * h.denominator)

    def at_step(self, time_s: float) -> float:
        """A time rounded up to the grid, s.

        Args:
            time_s: to be rounded up, s.
        """
        if not self.step_s:
            return time_s
        count = math.ceil(time_s / self.step_s - self.offset - AT_STEP)
        return (max(count, 0) + self.offset) * self.step_s


ANY_TIME = Grid()


def longest_common_s(grid: Grid, tones_hz: Sequence[float]) -> float:
    """Longest time with whole periods of tones that is waited for, s.

    Args:
        grid: at which times the FMU is asked.
        tones_hz: frequencies of the tones, Hz.
    """
    longest_s = longest_window_s(tones_hz)
    return min(longest_s, MOST_STEPS * grid.step_s) if grid.step_s else longest_s


def window_on(
    grid: Grid,
    tones_hz: Sequence[float],
    settle_s: float,
    *,
    samples_per_period: int = 0,
    mixtures_hz: Sequence[float] = (),
    longest_s: float = math.inf,
) -> Window:
    """Window for known tones as `plan_window` plans it, with every sample on a grid.

    A drive that is held over steps is so over whole steps of the grid.

    Args:
        grid: at which times the FMU is asked.
        tones_hz: frequencies of the tones, Hz.
        settle_s: time before the first sample, s.
        samples_per_period: steps in a period of the fastest tone for which an input is held; 0:
            none is.
        mixtures_hz: combinations of the tones that may not be seen as a tone, Hz.
        longest_s: longest window of whole periods, s.

    Raises:
        BadInput: no samples on the grid keep the tones apart, or clear of the lines next to them.
    """
    tones = tuple(map(float, tones_hz))
    if max(tones) * grid.step_s >= 0.5:
        raise BadInput(
            f"drive frequencies {hertz(*tones)}: the FMU has steps of its own of {grid.step_s:g} "
            f"s, {1.0 / (max(tones) * grid.step_s):.3g} in a period; wanted more than 2"
        )
    least = 2 * len(tones) + 1 + SPARE_SAMPLES
    common = grid.whole_s(tones)
    if common <= min(longest_s, longest_common_s(grid, tones)):
        for steps, samples in _divided(common, exact(grid.step_s), least):
            cycles = [int(exact(tone) * steps * exact(grid.step_s)) for tone in tones]
            others = {int(exact(f) * steps * exact(grid.step_s)) for f in mixtures_hz}
            if kept_apart(cycles, others - set(cycles), samples):
                folds = {folded(k, samples) for k in others}
                return _window(
                    grid,
                    Window(
                        tones_hz=tones,
                        settle_s=settle_s,
                        step_s=steps // samples * grid.step_s,
                        samples=samples,
                        mixture_bins=tuple(sorted({k for b in folds for k in (b, -b % samples)})),
                        mixtures=len(mixtures_hz),
                    ),
                    samples_per_period,
                )
    if mixtures_hz:
        raise BadInput(
            f"drive frequencies {hertz(*tones)}: their mixtures in a nonlinear response cannot be "
            f"distinguished by samples at whole steps of {grid.step_s:g} s"
        )
    return _window(grid, _fitted(grid, tones, settle_s, least + 4), samples_per_period)


def band_on(
    grid: Grid, tones_hz: Sequence[float], longest_s: float, wanted: Band, chosen: bool
) -> Band:
    """A spectrum of known tones with every sample on a grid, about as long and fine as another one.

    Args:
        grid: at which times the FMU is asked.
        tones_hz: frequencies of the tones, Hz.
        longest_s: longest window, s.
        wanted: the spectrum where samples may be at any times.
        chosen: whether the user has chosen its window or its samples, which are then kept to.

    Raises:
        BadInput: no samples on the grid show the tones so.
    """
    common, h = grid.whole_s(tones_hz), exact(grid.step_s)
    window = common * math.ceil(wanted.window_s / common)
    if chosen:
        window = wanted.window_s
    steps = window / h
    least = wanted.samples if chosen else min(wanted.samples, SHOWN)
    if float(window) <= max(longest_s, float(wanted.window_s)) and steps.denominator == 1:
        most = least if chosen else int(steps)
        for samples in range(least, most + 1):
            if steps.numerator % samples:
                continue
            with contextlib.suppress(BadInput):
                band = plan_band(
                    tones_hz, longest_s=math.inf, window_s=float(window), samples=samples
                )
                if band is not None:
                    return band
    raise BadInput(
        f"{tones_in_words(tones_hz)}: no spectrum up to {longest_s:g} s holds whole periods of "
        f"them in samples at whole steps of {grid.step_s:g} s, the FMU's own; wanted tones that "
        "have one"
    )


def _divided(common: Fraction, step_s: Fraction, least: int) -> Iterator[tuple[int, int]]:
    """Lengths in steps of the grid, and the numbers of samples that divide them."""
    steps = int(common / step_s)
    for periods in range(1, MOST_PERIODS + 1):
        whole = periods * steps
        for samples in range(least, min(whole, least + TRIED_SAMPLES) + 1):
            if whole % samples == 0:
                yield whole, samples


def _fitted(grid: Grid, tones: tuple[float, ...], settle_s: float, samples: int) -> Window:
    """Samples of a tone fit: the whole steps between them at which it amplifies rounding least."""
    counts = np.linspace(0.8, 2.5, TRIED_STEPS) * span_s(tones) / samples / grid.step_s
    tried = np.unique(np.maximum(np.round(counts), 1.0))
    conditions = [_condition(tones, samples, float(n) * grid.step_s) for n in tried]
    k = int(np.argmin(conditions))
    if conditions[k] > LARGEST_CONDITION:
        raise BadInput(
            f"drive frequencies {tones} Hz: no sampling at whole steps of {grid.step_s:g} s "
            f"distinguishes them (condition {conditions[k]:.3g})"
        )
    return Window(
        tones_hz=tones,
        settle_s=settle_s,
        step_s=float(tried[k]) * grid.step_s,
        samples=samples,
        coherent=False,
        condition=conditions[k],
    )


def _condition(tones: tuple[float, ...], samples: int, step_s: float) -> float:
    times: FloatArray = np.arange(samples, dtype=float) * step_s
    return float(np.linalg.cond(tone_design(tones, times)))


def _window(grid: Grid, window: Window, samples_per_period: int) -> Window:
    """The window with its settling on the grid, and with held steps where the drive is held."""
    steps, hold = round(window.step_s / grid.step_s), 0
    if samples_per_period:
        wanted = window.step_s * max(window.tones_hz) * samples_per_period
        hold = next((n for n in range(1, steps) if steps % n == 0 and n >= wanted), steps)
        # held steps begin with the run, so that no sample lies off the grid
        settle_s = whole_steps(window.settle_s, window.step_s / hold)
    else:
        settle_s = grid.at_step(window.settle_s)
    return replace(window, settle_s=settle_s, hold_steps=hold)
