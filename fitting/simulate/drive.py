"""A drive of an FMU: start values, tones, outputs; the windows and runs that it is asked by."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from fitting.fmu.runs import InputSignal, Run, Segment, row_times
from fitting.signal.combinations import expected_hz, mixed_hz
from fitting.signal.grid import ANY_TIME, Grid, longest_common_s, window_on
from fitting.signal.tones import ToneFit
from fitting.signal.window import Window, plan_window, whole_steps
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput

#: Combinations of the tones that are fitted with them where there are no whole periods: of the
#: order of a cubic term's shift of its own lines.
NEAR_ORDER = 5


@dataclass(frozen=True)
class Approach:
    """A tunable parameter that is moved to `value` after settling at `first`, in its own unit."""

    name: str
    first: float
    value: float


@dataclass(frozen=True, kw_only=True)
class Drive:
    """What an FMU is driven with, and what is read of it.

    `tones_hz` are the tones of the drive: made by the FMU from its own parameters, or by us
    through `input`, each with that `amplitude` and `steps_per_period` held steps in the period of
    the fastest; `tone_names` are what they are called (empty: f1, f2, ...). `read_hz` are the lines
    that are read (empty: the tones), `highest_order` that of the combinations of the tones which
    the response is known to hold. `approach`: the tone is moved while the FMU runs, and read where
    it has come to. `phases`: amplitude and phase are read, not the amplitude alone.
    `grid`: at which times the FMU is asked, where not all are alike to it.
    """

    start_values: Mapping[str, Scalar]
    tones_hz: tuple[float, ...]
    outputs: tuple[str, ...]
    input: str | None = None
    amplitude: float = 1.0
    steps_per_period: int = 100
    read_hz: tuple[float, ...] = ()
    highest_order: int = 1
    approach: Approach | None = None
    tone_names: tuple[str, ...] = ()
    phases: bool = False
    grid: Grid = ANY_TIME

    @property
    def names(self) -> tuple[str, ...]:
        """What the tones are called, in combinations of them."""
        return self.tone_names or tuple(f"f{k + 1}" for k in range(len(self.tones_hz)))

    @property
    def lines_hz(self) -> tuple[float, ...]:
        """The lines that are read, Hz."""
        return self.read_hz or self.tones_hz

    @property
    def fastest_hz(self) -> float:
        """The fastest of them, Hz."""
        return max(self.lines_hz)

    def window(self, settle_s: float, order: int = 1, longest_s: float = math.inf) -> Window:
        """When to sample it, after that time of settling.

        No combination of the tones up to `order` folds onto a line that is read; common periods
        beyond `longest_s` are given up for a tone fit.

        Args:
            settle_s: time before the first sample, s.
            order: highest sum of the absolute factors.
            longest_s: longest window, s.
        """
        kept = self.steps_per_period if self.input is not None else 0
        highest = max(order, self.highest_order)
        lines = self.lines_hz, self.tones_hz
        return _window(lines, settle_s, kept, highest, longest_s, self.grid)

    def run(
        self,
        window: Window,
        settings: Mapping[str, Scalar],
        more: tuple[str, ...] = (),
        hold_s: float | None = None,
    ) -> Run:
        """The run of such a window with these further start values.

        Args:
            window: settling and samples of a run.
            settings: values of FMU variables, by name.
            more: outputs to be read besides its own.
            hold_s: time over which an input is held, s; None: that of the window.
        """
        signal, moved = None, ""
        segments: tuple[Segment, ...] = ()
        values = {**self.start_values, **settings}
        if self.input is not None:
            rows = tuple((tone, self.amplitude, 0.0) for tone in self.tones_hz)
            signal = InputSignal(self.input, rows, hold_s or window.input_step_s)
        if self.approach is not None:
            moved, values[self.approach.name] = self.approach.name, self.approach.first
            segments = (
                Segment(
                    value=self.approach.value,
                    settle_s=window.settle_s,
                    sample_step_s=window.step_s,
                    samples=window.samples,
                ),
            )
        return Run(
            start_values=values,
            settle_s=window.settle_s,
            sample_step_s=window.step_s,
            samples=window.samples,
            outputs=(*self.outputs, *(name for name in more if name not in self.outputs)),
            input_signal=signal,
            moved=moved,
            segments=segments,
            longest_step_s=window.longest_s,
        )

    def run_at(
        self, settings: Mapping[str, Scalar], settle_s: float, step_s: float, samples: int
    ) -> Run:
        """The run with samples at any times; a generated drive rounds ``settle_s`` up.

        An FMU with a step of its own is asked at the next whole steps, and no closer than these.

        Args:
            settings: values of FMU variables, by name.
            settle_s: time before the first sample, s.
            step_s: time between samples, s.
            samples: number of samples.
        """
        own_s = self.grid.step_s
        if own_s:
            step_s = max(round(step_s / own_s), 1) * own_s
        per_sample = math.ceil(step_s * max(self.tones_hz) * self.steps_per_period)
        hold_s = own_s or step_s / per_sample
        driven = self.input is not None
        settle_s = whole_steps(settle_s, hold_s) if driven else self.grid.at_step(settle_s)
        # the tones are not read of it
        times = Window(
            tones_hz=(),
            settle_s=settle_s,
            step_s=step_s,
            samples=samples,
            longest_s=self.grid.longest_s,
        )
        return self.run(times, settings, hold_s=hold_s)

    def fit(self, window: Window) -> ToneFit:
        """The fit of the lines in the last samples of a run with that window.

        Args:
            window: settling and samples of a run.
        """
        if self.approach is None:
            return window.fit
        times = row_times(self.run(window, {}))[-window.samples :]
        return ToneFit(self.lines_hz, np.array(times))


@lru_cache(maxsize=4096)
def _window(
    lines_and_tones_hz: tuple[tuple[float, ...], tuple[float, ...]],
    settle_s: float,
    kept: int,
    order: int,
    longest_s: float,
    grid: Grid,
) -> Window:
    lines_hz, tones_hz = lines_and_tones_hz
    whole_s = grid.whole_s(lines_hz)
    longest_s = min(longest_s, longest_common_s(grid, lines_hz))
    coherent = whole_s <= longest_s or (len(lines_hz) == 1 and not grid.step_s)
    mixtures_hz = mixed_hz(tones_hz, order) if coherent else ()
    plan = partial(window_on, grid) if grid.step_s else plan_window
    plan = partial(plan, lines_hz, settle_s, longest_s=longest_s)
    plan = partial(plan, samples_per_period=kept, mixtures_hz=mixtures_hz)
    if coherent or grid.step_s:
        return replace(plan(), longest_s=grid.longest_s)
    # without whole periods every line of the response leaks into the tones, at each time otherwise
    expected = expected_hz(tones_hz, max(order, NEAR_ORDER))
    try:
        result = plan(expected_hz=tuple(f for f in expected if f not in lines_hz))
    except BadInput:
        if order > NEAR_ORDER:
            raise
        result = plan()  # of tones far apart combinations come close to each other
    return replace(result, longest_s=grid.longest_s)
