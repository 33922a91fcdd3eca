"""Time record: values over time, whose runs begin with them, and the pulse for their decay.

The response to a pulse is a run of the FMU at all samples, or at few from which the others follow.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from fitting.fmu.runs import SampledSignal, Segment
from fitting.measurements.records import Record
from fitting.measurements.steps import REFINED_STEPS, Look, StepPlan
from fitting.signal.free_decay import FewSamples, rebuilt
from fitting.signal.time_grid import refuse_clipped, spacing_s
from fitting.signal.window import Window
from fitting.simulate.batch import Batch, Variation
from fitting.text.arrays import (
    ComplexArray,
    FloatArray,
    IntArray,
    Scalar,
    as_numbers,
    as_values,
    require_size,
)
from fitting.text.errors import BadInput

FIRST, DETECTED = BEGINS = ("first", "found")


@dataclass(frozen=True, eq=False)
class TimeRecord(Record):
    """Values over time; the kinds explain the fields.

    Raises:
        BadInput: shapes that differ, times that do not rise or are not even, values that are not
            finite or are clipped, a negative sigma.
    """

    time_s: npt.ArrayLike
    values: npt.ArrayLike
    _: KW_ONLY
    input: str = ""
    offset: bool = False
    sigma: float = 0.0
    begin: str = FIRST
    setting_sigma: Mapping[str, float] = field(default_factory=dict)
    source: str = "trace"
    t: FloatArray = field(init=False)
    y: FloatArray | ComplexArray = field(init=False)
    spacing_s: float = field(init=False)

    #: Whether values are those of a demodulator, amplitudes or phasors: then a step of a run may be
    #: many periods, and what it may not be is found by halving it.
    is_demodulated = False

    def __post_init__(self) -> None:
        t = as_numbers(self.time_s, f"{self.source}: times")
        read = as_values if self.is_demodulated else as_numbers
        y = read(self.values, f"{self.source}: values")
        if t.shape != y.shape:
            raise BadInput(f"{self.source}: {t.shape} times and {y.shape} values")
        if not (np.isfinite(t).all() and np.isfinite(y).all()):
            raise BadInput(f"{self.source}: wanted finite numbers")
        require_size(t, f"{self.source}: times")
        require_size(y, f"{self.source}: values")
        object.__setattr__(self, "spacing_s", spacing_s(t, self.source))
        self._set_samples(t, y)
        self._refuse_other_words("begin", BEGINS)
        if not self.sigma >= 0.0:
            raise BadInput(f"{self.source}: sigma is wanted as zero or more")
        self.check_statements()
        first = 0 if self.begin == FIRST else self.decay_begin()
        self._set_samples(t[first:], y[first:])
        for part in (self.y.real, self.y.imag) if np.iscomplexobj(self.y) else (self.y.real,):
            refuse_clipped(part, self.source)
        self.check_samples()

    def _set_samples(self, t: FloatArray, y: FloatArray | ComplexArray) -> None:
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "y", y)

    def _refuse_other_words(self, name: str, known: tuple[str, ...]) -> None:
        if getattr(self, name) not in known:
            raise BadInput(
                f"{self.source}: {name} is {getattr(self, name)!r}, wanted "
                f"{' or '.join(repr(word) for word in known)}"
            )

    def check_statements(self) -> None:
        """Complain of fields that do not go together."""

    def decay_begin(self) -> int:
        """Index of the first sample of the free decay.

        Raises:
            BadInput: there is none.
        """
        raise NotImplementedError

    def check_samples(self) -> None:
        """Complain of too few samples."""

    @property
    def first_words(self) -> str:
        """Where it begins, in words."""
        if self.begin == FIRST:
            return "the first sample"
        return f"{self.t[0]:.6g} s, where the free decay was found to begin"

    @property
    def has_unknown_start(self) -> bool:
        """Whether it rests on free responses, which a pulse gives."""
        return True

    @property
    def run_step_s(self) -> float:
        """Spacing of the samples of its runs, s."""
        return self.spacing_s

    @property
    def run_samples(self) -> int:
        """How many samples its longest run has."""
        return int(self.y.size)

    @property
    def value_share(self) -> float:
        """The largest value over the unit of its rows."""
        return 1.0

    def look(self, fine: int, most: int = REFINED_STEPS) -> Look | None:
        """A closer look at its run under the input; None: nothing but its start moves it.

        Args:
            fine: steps between two samples.
            most: steps in all.
        """
        return None

    @property
    def shifts(self) -> IntArray:
        """Samples by which the responses to a pulse are shifted against each other."""
        raise NotImplementedError

    @property
    def pulse_window(self) -> Window:
        """Samples of the response to a pulse, as long as the record and its shifts."""
        raise NotImplementedError

    def pulse(
        self, per_sample: int, level: float = 1.0, window: Window | None = None
    ) -> SampledSignal:
        """One spacing of the input at a level, then nothing.

        Args:
            per_sample: steps between two samples.
            level: of the pulse, in the FMU's unit.
            window: samples of the response; None: `pulse_window`.
        """
        window = window or self.pulse_window
        kept = np.zeros((per_sample * window.samples, 1))
        kept[:per_sample] = level
        step_s = window.step_s / per_sample
        return SampledSignal((self.input,), step_s, kept, np.zeros((window.samples, 1)))


#: Blocks, and samples of each, that are tried one after the other.
BLOCKS = ((12, 4), (16, 6), (24, 8), (32, 12))
#: Of this many samples one is simulated, at most: with more it is not worth it.
SPARED = 4


def few_samples(samples: int) -> list[FewSamples]:
    """Which samples of a decay may be worth a trial, the fewest first.

    Args:
        samples: of the whole run.
    """
    apart = [each for each in BLOCKS if SPARED * each[0] * each[1] <= samples]
    tried = [FewSamples(samples, blocks, length) for blocks, length in apart]
    return [few for few in tried if SPARED * few.indices.size <= samples]


def ask_decay(
    trace: TimeRecord,
    values: Mapping[str, Scalar],
    plan: StepPlan | None,
    batch: Batch,
    output: str,
    owner: int = 0,
) -> int:
    """Number of the run after a pulse: at few samples, where the plan has few.

    Args:
        trace: whose decay it is.
        values: start values of the FMU, by name.
        plan: of its steps; None: one between two samples, and all samples.
        batch: where runs are asked for.
        output: name of the output.
        owner: which evaluation pays for the run.
    """
    if plan is None or plan.few is None:
        signal = trace.pulse(1 if plan is None else plan.per_sample)
        return batch.ask(values, trace.pulse_window, signal, output, owner)
    step_s = trace.pulse_window.step_s
    own = Variation(
        {trace.input: 1.0},
        Window(tones_hz=(), settle_s=step_s, step_s=step_s, samples=1),
        moved=trace.input,
        segments=_segments(plan.few, step_s),
    )
    [run] = batch.ask_varied(values, [own], output, owner)
    return run


def read_decay(plan: StepPlan, batch: Batch, run: int, output: str) -> FloatArray | None:
    """All samples of a run after a pulse; None where they do not follow from the few of it.

    Args:
        plan: of the steps of its trace.
        batch: that has simulated it.
        run: its number.
        output: name of the output.
    """
    observed = batch.samples(run, output)
    if plan.few is None:
        return observed
    result = rebuilt(plan.few, observed[1:], plan.tolerance)  # the first is seen under the pulse
    return None if result is None else result.samples


@lru_cache(maxsize=64)
def _segments(few: FewSamples, step_s: float) -> tuple[Segment, ...]:
    """A sample each, at the very times of the whole run; the input is zero from the first on."""
    times = [float((k + 1) * step_s) for k in few.indices]
    before = [step_s, *times[:-1]]
    return tuple(
        Segment(value=0.0, settle_s=then - now, sample_step_s=step_s, samples=1)
        for now, then in zip(before, times, strict=True)
    )
