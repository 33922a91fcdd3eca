"""Runs: what is asked of an FMU, with input signal and segments, and the count of what was done.

`RunRequests` turns runs, as people name things, into the value references that a worker needs. A
layout is what many runs share: which variables are set and read. A variable that any layout sets is
set by all of them (to its declared start value where the run does not name it), so that nothing
depends on what an FMU does to its parameters on reset.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, shown
from fitting.text.notation import listed

if TYPE_CHECKING:
    from fitting.fmu.description import FmuDescription, FmuVariable

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

    ``start_values`` are set before initialisation; ``outputs`` are read at every sample, `initial`
    ones once after initialisation, into columns behind those of the outputs; they need not be
    finite numbers. ``allow_nan``: an output that is none is handed back instead of being a failure.

    ``handling``: how an instance is handled, where that is what is asked; None: as suits.

    No communication step is longer than ``longest_step_s`` (0: as long as samples are apart), which
    is for FMUs that take one step of their solver in each; with a signal its steps are all. Samples
    are read ``delay_steps`` of them after their times, besides those that the FMU's user states:
    for outputs that come so late.

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
    initial: tuple[str, ...] = ()
    start_time_s: float = 0.0
    input_signal: InputSignal | SampledSignal | None = None
    allow_nan: bool = False
    moved: str = ""
    segments: tuple[Segment, ...] = ()
    handling: Handling | None = None
    longest_step_s: float = 0.0
    delay_steps: int = 0

    @property
    def rows(self) -> int:
        """Samples in all."""
        return self.samples + sum(segment.samples for segment in self.segments)

    def __post_init__(self) -> None:
        signal = self.input_signal
        is_set = self.moved in self.start_values or not self.moved
        if self.segments and (signal is not None or not is_set):
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


def end_time(run: RunRequest) -> float:
    """Time of the last row of a run, from its beginning at 0 s, and a step more for rounding.

    Args:
        run: with settling, step and number of samples.
    """
    end_s = run.start_time_s + run.settle_s + run.samples * run.sample_step_s
    return end_s + sum(s.settle_s + s.samples * s.sample_step_s for s in run.segments)


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


#: The causality of what FMI 3.0 sets in a mode of its own, before all other variables.
STRUCTURAL = "structuralParameter"
#: Least and largest number of every type of whole numbers; Integer is that of FMI 2.0.
_RANGES = {
    "Integer": (-(2**31), 2**31 - 1),
    **{f"Int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}
#: What fits a variable, by its kind.
_FITTING: Mapping[str, tuple[type, ...]] = {
    "Real": (int, float, np.integer),
    "Integer": (int, np.integer),
    "Boolean": (bool,),
    "String": (str,),
}


class Group(NamedTuple):
    """Variables of one FMI type; or elements of one array, which is set and read as a whole.

    ``size`` is that of the array, 0 for single variables; ``places`` those of the elements in it.
    ``structural``: they are set in configuration mode.
    """

    fmi_type: str
    names: tuple[str, ...]
    references: tuple[int, ...]
    size: int = 0
    places: tuple[int, ...] = ()
    structural: bool = False


class Gets(NamedTuple):
    """Variables ``groups`` that are read, each into some ``columns`` of the result."""

    groups: tuple[Group, ...]
    columns: tuple[tuple[int, ...], ...]


class Layout(NamedTuple):
    """``sets`` before initialisation; ``gets`` at each sample, ``initial`` after initialisation.

    ``names`` are those of all columns, of which ``width`` are read at each sample.
    """

    sets: tuple[Group, ...]
    gets: Gets
    initial: Gets
    names: tuple[str, ...]
    width: int
    input: Group | None
    moved: Group | None = None


class RunRequest(NamedTuple):
    """One run: ``values`` for each group of the layout's ``sets``.

    ``handled``: the run that goes before on the same instance, and whether that is freed at the
    end; see `Handling`. ``delay_steps``: communication steps by which outputs come late.
    """

    layout: int
    values: tuple[tuple[Scalar, ...], ...]
    settle_s: float
    sample_step_s: float
    samples: int
    start_time_s: float
    allow_nan: bool
    tones: tuple[Tone, ...] = ()
    step_s: float = 0.0
    segments: tuple[Segment, ...] = ()
    sampled: SampledSignal | None = None
    handled: tuple[RunRequest | None, bool] | None = None
    longest_step_s: float = 0.0
    delay_steps: int = 0

    @property
    def rows(self) -> int:
        """Samples in all."""
        return self.samples + sum(segment.samples for segment in self.segments)


_Key = tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...], tuple[str, ...], str, bool]


class RunRequests:
    """Turns runs into requests; keeps the layouts, numbered in the order of their making."""

    def __init__(self, description: FmuDescription) -> None:
        self.layouts: list[Layout] = []
        self._grown = False
        self._description = description
        self._known = description.settable
        self._numbers: dict[_Key, int] = {}
        self._defaults: dict[str, Scalar] = {}  # of every variable that any run has set
        self._elements: dict[str, Scalar] = {}  # of the others in an array with one of them
        self._fitting: set[tuple[str, tuple[Scalar, ...]]] = set()  # whole numbers, by type

    def take_all(self, runs: Sequence[Run]) -> list[RunRequest]:
        """The requests for a batch; raises BadInput as `take` does.

        Args:
            runs: to be simulated.
        """
        self._grown = False
        requests = [self.take(run) for run in runs]
        # a variable that a later run was the first to set is missing in the requests before it
        return [self.take(run) for run in runs] if self._grown else requests

    def take(self, run: Run) -> RunRequest:
        """The request for one run.

        Args:
            run: to be simulated.

        Raises BadInput for a name that the FMU does not have, a variable that cannot be set or
        read, and a value of the wrong type.
        """
        signal, handling = run.input_signal, run.handling
        inputs = signal.names if signal else ()
        names, moved = tuple(run.start_values), run.moved
        key = (names, run.outputs, run.initial, inputs, moved, handling is not None)
        number = self._numbers.get(key)
        if number is None:
            number = self._add(key, run.start_values)
        given = {**self._elements, **self._defaults, **run.start_values}
        groups = self.layouts[number].sets
        values = tuple([tuple(map(given.__getitem__, group.names)) for group in groups])
        for group, numbers in zip(groups, values, strict=True):
            # nearly all runs of a fit set whole numbers alike
            if group.fmi_type in _RANGES and (group.fmi_type, numbers) not in self._fitting:
                # what does not fit into the bytes of a type would be set to something else
                low, high = _RANGES[group.fmi_type]
                for name, value in zip(group.names, numbers, strict=True):
                    if not low <= int(value) <= high:
                        wanted = f"wanted {low} to {high}, as {group.fmi_type} has it"
                        raise self._bad(f"{name} = {shown(value)}, {wanted}")
                self._fitting.add((group.fmi_type, numbers))
        handled = None
        if handling is not None:
            before = None
            if handling.before is not None:
                first = replace(run, start_values=handling.before, handling=Handling())
                before = self.take(first)
            handled = before, handling.freed
        return RunRequest(
            layout=number,
            values=values,
            settle_s=run.settle_s,
            sample_step_s=run.sample_step_s,
            samples=run.samples,
            start_time_s=run.start_time_s,
            allow_nan=run.allow_nan,
            tones=() if signal is None or isinstance(signal, SampledSignal) else signal.tones,
            step_s=signal.step_s if signal else 0.0,
            segments=run.segments,
            sampled=signal if isinstance(signal, SampledSignal) else None,
            handled=handled,
            longest_step_s=run.longest_step_s,
            delay_steps=self._description.output_delay_steps + run.delay_steps,
        )

    def _add(self, key: _Key, start_values: Mapping[str, Scalar]) -> int:
        """A new layout; from now on all layouts set what it sets."""
        names, outputs, initial, inputs, moved, bare = key
        for name in (*names, *inputs):
            if bare or name not in self._defaults:
                start = self._settable(name).start
                if not bare and start is not None:  # else nothing is known that it could be set to
                    self._defaults[name] = start
                    self._numbers.clear()
                    self._grown = True
        for name, value in start_values.items():
            kind = self._known[name].kind
            fits = isinstance(value, _FITTING[kind])
            if not fits or (isinstance(value, bool) and kind != "Boolean"):
                raise self._bad(f"{name} = {value!r}, wanted a {kind}")

        self.layouts.append(
            Layout(
                sets=_grouped(self._whole_arrays(names if bare else (*names, *self._defaults))),
                gets=self._gets(outputs),
                initial=self._gets(initial, len(outputs)),
                names=(*outputs, *initial),
                width=len(outputs),
                input=self._inputs(inputs) if inputs else None,
                moved=self._moved(moved) if moved else None,
            )
        )
        self._numbers[key] = len(self.layouts) - 1
        return self._numbers[key]

    def _gets(self, names: tuple[str, ...], first: int = 0) -> Gets:
        """Numbers that are read into columns of the result, the first one with that number."""
        read = [self._description.variable(name) for name in names]
        for variable in read:
            if variable.kind not in ("Real", "Integer", "Boolean"):
                what = f"{variable.name!r} is of type {variable.fmi_type}"
                raise self._bad(f"{what}, wanted a number to read")
        groups = _grouped(read)
        columns = tuple(tuple(first + names.index(name) for name in g.names) for g in groups)
        return Gets(groups, columns)

    def _settable(self, name: str) -> FmuVariable:
        variable = self._description.variable(name)
        if variable.kind == "other":
            raise self._bad(
                f"{name!r} is of type {variable.fmi_type}, or a large array or one of texts; "
                "wanted a Real, Integer, Boolean or String"
            )
        if not variable.can_be_started:
            why = " as arrays have its size" if variable.is_size else ""
            raise self._bad(
                f"{name!r} is a {variable.variability} {variable.causality} that cannot be set"
                f"{why}, wanted a parameter or an input"
            )
        return variable

    def _whole_arrays(self, names: Iterable[str]) -> list[FmuVariable]:
        """Variables, each once, with all elements of an array that one of them is in."""
        given = [self._known[name] for name in dict.fromkeys(names)]
        arrays = {v.value_reference for v in given if v.size}
        elements = [v for v in self._known.values() if v.size and v.value_reference in arrays]
        for element in elements:
            if element.start is not None:
                self._elements[element.name] = element.start
            elif element not in given:
                what = f"{element.name!r} has no start value, wanted one"
                raise self._bad(f"{what}: an array is set as a whole")
        return [*(v for v in given if not v.size), *elements]

    def _inputs(self, names: Sequence[str]) -> Group:
        variables = [self._description.variable(name) for name in names]
        for variable in variables:
            if variable.causality != "input" or variable.kind != "Real":
                raise self._bad(
                    f"{variable.name!r} is a {variable.kind} {variable.causality}, wanted a Real "
                    "input for the drive"
                )
        groups = _grouped(variables)
        for group in groups:
            if group.places != tuple(range(group.size)):
                raise self._bad(
                    f"{listed(group.names)} are not all elements of the array in their order, "
                    "wanted all as inputs: an array is set as a whole"
                )
        if len(groups) > 1:
            raise self._bad(
                f"inputs {', '.join(names)} are of the types "
                f"{', '.join(g.fmi_type for g in groups)}; wanted one type"
            )
        return groups[0]

    def _moved(self, name: str) -> Group:
        variable = self._description.variable(name)
        free = variable.causality == "input" or variable.variability == "tunable"
        if variable.kind != "Real" or not free:
            raise self._bad(
                f"{name!r} is a {variable.variability} {variable.kind} {variable.causality}, "
                "wanted a tunable Real parameter to move during a run"
            )
        if variable.size > 1:
            raise self._bad(
                f"{name!r} is an element of an array, which is set as a whole; wanted a single "
                "variable to move during a run"
            )
        return _grouped([variable])[0]

    def _bad(self, what: str) -> BadInput:
        return BadInput(f"{self._description.path}: {what}")


def _grouped(variables: Sequence[FmuVariable]) -> tuple[Group, ...]:
    """Single variables by their types, structural ones first, then each array by itself."""
    alike: dict[tuple[bool, int, str], list[FmuVariable]] = {}
    for v in variables:
        if not v.size:
            key = v.causality != STRUCTURAL, -1, v.fmi_type
        else:
            key = True, v.value_reference, ""
        alike.setdefault(key, []).append(v)
    return tuple(
        Group(
            fmi_type=group[0].fmi_type,
            names=tuple(v.name for v in group),
            references=tuple(v.value_reference for v in group[:1] if v.size)
            or tuple(v.value_reference for v in group),
            size=group[0].size,
            places=tuple(v.place for v in group if v.size),
            structural=not later,
        )
        for (later, reference, _), group in sorted(
            alike.items(), key=lambda each: (each[0][0], each[0][1] >= 0)
        )
    )
