"""Runs: what is asked of an FMU, with input signal and segments, and the count of what was done."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING

from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput

if TYPE_CHECKING:
    from fitting.fmu.run_requests import RunRequest

Tone = tuple[float, float, float]  # frequency in Hz, amplitude, phase in rad

WHOLE = 1e-9  # a number of steps counts as whole within this


def _require_time(name: str, time_s: float, *, zero: bool = False) -> None:
    """BadInput unless a time is finite and positive, or ``zero`` where that is allowed."""
    if not (math.isfinite(time_s) and (time_s > 0 or (zero and time_s == 0))):
        wanted = "a time of at least 0" if zero else "a positive time"
        raise BadInput(f"{name} is {time_s!r}, wanted {wanted}")


@dataclass(frozen=True)
class InputSignal:
    """A sum of tones b(t) = Σ a cos(2π f t + φ) for the FMU input ``name``, held over steps.

    ``tones`` rows (frequency in Hz, amplitude, phase in rad), ``step_s`` length of the
    communication steps. Over the step from t to t + h the input is held at
    Σ a cos(2π f (t + h/2) + φ) / sinc(f h), which makes the tone in the staircase exactly the tone
    that was asked for; what remains are its images at 1/h ± f.

    Raises BadInput for fewer than four steps in a period of the fastest tone.
    """

    name: str
    tones: tuple[Tone, ...]
    step_s: float

    def __post_init__(self) -> None:
        _require_time(f"input {self.name}: step_s", self.step_s)
        for frequency_hz, amplitude, phase in self.tones:
            if not all(map(math.isfinite, (frequency_hz, amplitude, phase))) or frequency_hz < 0:
                raise BadInput(
                    f"input {self.name}: tone ({frequency_hz!r}, {amplitude!r}, {phase!r}), wanted "
                    "finite numbers and a frequency of at least 0"
                )
            if frequency_hz * self.step_s > 0.25:
                raise BadInput(
                    f"input {self.name}: a tone of {frequency_hz!r} Hz in steps of "
                    f"{self.step_s!r} s has {1 / (frequency_hz * self.step_s):.3g} steps in a "
                    "period, wanted at least 4"
                )

    @property
    def names(self) -> tuple[str, ...]:
        """The input that it drives."""
        return (self.name,)


@dataclass(frozen=True, eq=False)
class SampledSignal:
    """Values of FMU inputs ``names`` over communication steps of ``step_s``.

    ``values`` (steps, inputs) are kept over each step; ``at_samples`` (samples, inputs) are set
    before a sample is read, for outputs that follow the input at once. Without names it is the
    steps alone. Two of equal values are equal.

    Raises BadInput for a step that is not positive and values that are not finite.
    """

    names: tuple[str, ...]
    step_s: float
    values: FloatArray
    at_samples: FloatArray

    def __post_init__(self) -> None:
        _require_time("inputs: step_s", self.step_s)
        for values in (self.values, self.at_samples):
            if values.shape[1:] != (len(self.names),):
                raise BadInput(f"inputs: values {values.shape}, wanted {len(self.names)} columns")
            if not all(map(math.isfinite, (float(values.sum()), float(abs(values).sum())))):
                raise BadInput("inputs: values that are not finite numbers")

    @cached_property
    def key(self) -> tuple[tuple[str, ...], float, bytes]:
        """What makes it equal to another one."""
        digest = hashlib.sha256(self.values.tobytes())
        digest.update(self.at_samples.tobytes())
        return self.names, self.step_s, digest.digest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, SampledSignal) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A segment of a piecewise run: a variable moved to ``value``, settling and samples again.

    Raises BadInput for numbers that are not finite or not positive.
    """

    value: float
    settle_s: float
    sample_step_s: float
    samples: int

    def __post_init__(self) -> None:
        numbers = (self.value, self.settle_s, self.sample_step_s)
        if not (all(map(math.isfinite, numbers)) and self.settle_s >= 0 and self.samples >= 1):
            raise BadInput(f"{self!r}: wanted finite numbers, a time and a sample at least")
        _require_time("sample_step_s", self.sample_step_s)


@dataclass(frozen=True, kw_only=True)
class Handling:
    """A new instance for one run alone, on which nothing is set that the run does not name.

    ``before``: start values of a run that goes before on that instance, which is reset then; None:
    there is none. ``freed``: the instance is freed behind the run, and that may fail.
    """

    before: Mapping[str, Scalar] | None = None
    freed: bool = False


@dataclass(frozen=True, kw_only=True, slots=True)
class Run:
    """One simulation of an FMU.

    Samples are at t_j = start_time + settle + j sample_step, j = 0 .. samples - 1, each computed
    from j and not from its neighbour. Without ``input_signal`` there is one communication step to
    t_0 (none if ``settle_s`` is 0) and one to every further sample; with it there are as many of
    ``input_signal.step_s`` as fit, which has to divide both times.

    ``start_values`` are set before initialisation; ``outputs`` are read at every sample.
    ``allow_nan``: an output that is not a finite number is handed back instead of being a failure.

    ``handling``: how an instance is handled, where that is what is asked; None: as suits.

    No communication step is longer than ``longest_step_s`` (0: as long as samples are apart), which
    is for FMUs that take one step of their solver in each; with a signal its steps are all.

    ``segments`` go on from the last sample without a new start, so that a tone that is ``moved``
    keeps its phase and the state its branch; their samples follow in the result.

    Raises BadInput for times that are not finite or not positive, for a step that does not divide
    them, and for segments together with a signal or without a start value of what they move.
    """

    start_values: Mapping[str, Scalar]
    settle_s: float
    sample_step_s: float
    samples: int
    outputs: tuple[str, ...]
    start_time_s: float = 0.0
    input_signal: InputSignal | SampledSignal | None = None
    allow_nan: bool = False
    moved: str = ""
    segments: tuple[Segment, ...] = ()
    handling: Handling | None = None
    longest_step_s: float = 0.0

    @property
    def rows(self) -> int:
        """Samples in all."""
        return self.samples + sum(segment.samples for segment in self.segments)

    def __post_init__(self) -> None:
        signal = self.input_signal
        if self.segments and (signal is not None or self.moved not in self.start_values):
            raise BadInput(
                f"segments move {self.moved!r}: wanted a start value of it, and no input signal"
            )
        _require_time("settle_s", self.settle_s, zero=True)
        if self.samples < 1:
            raise BadInput(f"samples is {self.samples!r}, wanted at least 1")
        times = {"settle_s": self.settle_s}
        if self.samples > 1:
            _require_time("sample_step_s", self.sample_step_s)
            times["sample_step_s"] = self.sample_step_s
        _require_time("longest_step_s", self.longest_step_s, zero=True)
        if not math.isfinite(self.start_time_s):
            raise BadInput(f"start_time_s is {self.start_time_s!r}, wanted a finite time")
        if not self.outputs or len(set(self.outputs)) != len(self.outputs):
            raise BadInput(f"outputs is {self.outputs!r}, wanted different names, one at least")
        if signal is None:
            return
        for name, time_s in times.items():
            count = time_s / signal.step_s
            if abs(count - round(count)) > WHOLE * max(1.0, count):
                raise BadInput(
                    f"{name} = {time_s!r} s is {count:.9g} steps of {signal.step_s!r} s, wanted a "
                    "whole number"
                )
        if isinstance(signal, SampledSignal):
            each = round(self.sample_step_s / signal.step_s) if self.samples > 1 else 0
            steps = round(self.settle_s / signal.step_s) + each * (self.samples - 1)
            if len(signal.values) != steps or len(signal.at_samples) != self.samples:
                raise BadInput(
                    f"inputs: {len(signal.values)} values for {steps} steps, "
                    f"{len(signal.at_samples)} for {self.samples} samples"
                )


def row_times(run: Run | RunRequest) -> list[float]:
    """Time of every row of a run's result, s.

    Args:
        run: with settling, step and number of samples.
    """
    first = run.start_time_s + run.settle_s
    times = [first + j * run.sample_step_s for j in range(run.samples)]
    for segment in run.segments:
        first = times[-1] + segment.settle_s
        times += [first + j * segment.sample_step_s for j in range(segment.samples)]
    return times


def parts(span_s: float, longest_s: float) -> int:
    """Into how many equal communication steps a time is divided.

    Args:
        span_s: the time, s.
        longest_s: of a step, s; 0: any.
    """
    return max(1, math.ceil(span_s / longest_s * (1.0 - WHOLE))) if longest_s else 1


def communication_steps(run: Run | RunRequest) -> int:
    """Communication steps of a run without a signal.

    Args:
        run: with settling, step and number of samples.
    """
    longest_s = run.longest_step_s
    return sum(
        (parts(part.settle_s, longest_s) if part.settle_s else 0)
        + (part.samples - 1) * parts(part.sample_step_s, longest_s)
        for part in (run, *run.segments)
    )


@dataclass(frozen=True, kw_only=True)
class Counts:
    """What the workers did: ``seconds`` were spent in the loops of FMI calls, summed over workers.

    ``processor_s`` is the processor time of it, which other programs do not lengthen. The runs and
    steps of the reset comparison are included.
    """

    runs: int = 0
    steps: int = 0
    seconds: float = 0.0
    processor_s: float = 0.0
    instances: int = 0
    processes: int = 0

    def __add__(self, other: Counts) -> Counts:
        names = (field.name for field in fields(self))
        return Counts(**{name: getattr(self, name) + getattr(other, name) for name in names})
