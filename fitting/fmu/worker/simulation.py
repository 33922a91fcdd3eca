"""One run of an FMU instance: initialise, step, read. The hot loop of the whole program."""

from __future__ import annotations

import ctypes
import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, repeat
from typing import Any, NamedTuple

import numpy as np

from fitting.fmu.runs import (
    Gets,
    Layout,
    RunRequest,
    SampledSignal,
    Segment,
    Tone,
    communication_steps,
    end_time,
    parts,
    row_times,
)
from fitting.fmu.worker.instance import WARNING, FmuInstance, VariableAccess
from fitting.fmu.worker.log import CallFailed
from fitting.signal.tones import cycle_fraction
from fitting.text.arrays import FloatArray

Reader = Callable[[int], None]
Advance = Callable[[float, float], None]

DOUBLE = 8  # bytes
BLOCK = 4096  # rows of inputs at a time


class Binding(NamedTuple):
    """A layout with its functions and buffers; ``input`` is set where the run has a signal."""

    layout: Layout
    sets: tuple[VariableAccess, ...]
    gets: tuple[VariableAccess, ...]
    initial: tuple[VariableAccess, ...]
    input: VariableAccess | None
    moved: VariableAccess | None = None


def bind(fmu: FmuInstance, layout: Layout) -> Binding:
    """Functions and buffers for a layout, made once for many runs.

    Args:
        fmu: an instance that is set up.
        layout: of the run: which variables it sets and reads.
    """
    return Binding(
        layout=layout,
        sets=tuple(fmu.access("Set", group) for group in layout.sets),
        gets=tuple(fmu.access("Get", group) for group in layout.gets.groups),
        initial=tuple(fmu.access("Get", group) for group in layout.initial.groups),
        input=fmu.access("Set", layout.input) if layout.input else None,
        moved=fmu.access("Set", layout.moved) if layout.moved else None,
    )


def simulate(fmu: FmuInstance, binding: Binding, request: RunRequest) -> FloatArray:
    """One run of a new or reset instance, shape (samples, outputs).

    Args:
        fmu: an instance that is set up.
        binding: access to the variables of a run.
        request: a run, in value references.

    Raises CallFailed for a status that is not OK or a warning, for a step that ends early and,
    unless ``request.allow_nan``, for an output that is not a finite number.
    """
    layout = binding.layout
    result = np.empty((request.rows, len(layout.names)))
    # structural parameters come first, in configuration mode
    configuring = False
    for group, access, values in zip(layout.sets, binding.sets, request.values, strict=True):
        if group.structural != configuring:
            configuring = group.structural
            fmu.call("EnterConfigurationMode" if configuring else "ExitConfigurationMode")
        fmu.set(access, values)
    if configuring:
        fmu.call("ExitConfigurationMode")
    read = _reader(fmu, layout.gets, binding.gets, result)
    initial = _reader(fmu, layout.initial, binding.initial, result)
    fmu.enter_initialisation(request.start_time_s, end_time(request))
    advance, late = fmu.step, None
    if request.delay_steps and steps_of(request):
        late = _LateOutputs(fmu.step, read, request.delay_steps)
        advance, read = late.advance, late.read
    if request.sampled is not None:
        _stride_in_steps(fmu, binding.input, request, advance, read, initial)
    elif binding.input is None or fmu.follow(binding.input, request.tones):
        fmu.leave_initialisation()
        initial(0)
        _stride(fmu, binding.moved, request, advance, read)
    else:
        _stride_in_steps(fmu, binding.input, _with_sampled_tones(request), advance, read, initial)
    if late is not None:
        late.finish()
    fmu.terminate()
    result[1:, layout.width :] = result[0, layout.width :]
    sampled = result[:, : layout.width]
    if not (request.allow_nan or np.count_nonzero(np.isfinite(sampled)) == sampled.size):
        j, column = np.argwhere(~np.isfinite(sampled))[0]
        at = row_times(request)[int(j)]
        text = f"output {layout.names[column]} is {result[j, column]} at t = {at!r} s"
        raise CallFailed(fmu.with_log(text))
    return result


class _LateOutputs:
    """Reads every sample some communication steps after its time, for outputs that come so late."""

    def __init__(self, step: Advance, read: Reader, delay_steps: int) -> None:
        self._step, self._read, self._delay = step, read, delay_steps
        self._taken, self._due = 0, deque[tuple[int, int]]()  # row, and steps after which it is due
        self._last = 0.0, 0.0

    def advance(self, at: float, step: float) -> None:
        """One communication step, and the samples that are due after it."""
        self._step(at, step)
        self._last = at + step, step
        self._taken += 1
        while self._due and self._due[0][1] <= self._taken:
            self._read(self._due.popleft()[0])

    def read(self, row: int) -> None:
        """Keep a sample until it is due."""
        self._due.append((row, self._taken + self._delay))

    def finish(self) -> None:
        """Further steps of the last one's length, until every sample is read."""
        while self._due:
            self.advance(*self._last)


def steps_of(request: RunRequest) -> int:
    """Communication steps of a run, without those after the last sample.

    Args:
        request: a run, in value references.
    """
    if request.step_s:
        lead, each = _whole_steps(request)
        return lead + each * (request.samples - 1)
    return communication_steps(request)


def _whole_steps(request: RunRequest) -> tuple[int, int]:
    """Steps before the first sample, and from one sample to the next."""
    each = round(request.sample_step_s / request.step_s) if request.samples > 1 else 1
    return round(request.settle_s / request.step_s), each


def _stride(
    fmu: FmuInstance,
    moved: VariableAccess | None,
    request: RunRequest,
    advance: Advance,
    read: Reader,
) -> None:
    """One step to each sample, or equal ones that are short enough; then segments likewise."""
    longest_s = request.longest_step_s
    row, now = 0, request.start_time_s
    stretches: list[RunRequest | Segment] = [request, *request.segments]
    for stretch in stretches:
        if isinstance(stretch, Segment) and moved is not None:
            fmu.set(moved, (stretch.value,))
        first = now + stretch.settle_s
        for j in range(stretch.samples):
            then = first + j * stretch.sample_step_s if j else first
            if then > now:
                if longest_s:
                    start, span = now, then - now
                    count = parts(span, longest_s)
                    for k in range(1, count):
                        at = start + k * (span / count)
                        advance(now, at - now)
                        now = at
                advance(now, then - now)
            read(row)
            row, now = row + 1, then


def values_over_steps(
    tones: Iterable[Tone], start_s: float, step_s: float, steps: int
) -> FloatArray:
    """Values to hold over each of ``steps`` communication steps, shape (steps,).

    Σ a cos(2π f (t + h/2) + φ) / sinc(f h), t = start + k h, as `InputSignal` explains.

    Args:
        tones: frequency in Hz, amplitude and phase of each.
        start_s: time of the first step, s.
        step_s: time between samples, s.
        steps: number of steps.
    """
    middle = np.asarray(start_s + (np.arange(steps) + 0.5) * step_s, dtype=np.float64)
    values = np.zeros(steps)
    for frequency_hz, amplitude, phase in tones:
        if amplitude != 0.0:
            kept = amplitude / float(np.sinc(frequency_hz * step_s))
            values += kept * np.cos(2.0 * math.pi * cycle_fraction(frequency_hz, middle) + phase)
    return values


def _with_sampled_tones(request: RunRequest) -> RunRequest:
    """The run with its tones as values over each step, and as they are at each sample."""
    start, step = request.start_time_s, request.step_s
    lead, each = _whole_steps(request)
    kept = values_over_steps(request.tones, start, step, steps_of(request))
    # an output that sees the input at once would show what was held over the step before
    times = start + step * (lead + each * np.arange(request.samples, dtype=np.float64))
    observed = np.zeros(request.samples)
    for frequency_hz, amplitude, phase in request.tones:
        turns = cycle_fraction(frequency_hz, times)
        observed += amplitude * np.cos(2.0 * math.pi * turns + phase)
    signal = SampledSignal(("",), step, kept[:, np.newaxis], observed[:, np.newaxis])
    return request._replace(sampled=signal)


def _stride_in_steps(
    fmu: FmuInstance,
    inputs: VariableAccess | None,
    request: RunRequest,
    advance: Advance,
    read: Reader,
    initial: Reader,
) -> None:
    """Steps of one length, with values of the inputs over each and at each sample.

    An input keeps its value: it is set where that changes, which after a pulse it never does.
    """
    assert request.sampled is not None  # noqa: S101  # the caller asked
    start, step = request.start_time_s, request.step_s
    lead, each = _whole_steps(request)
    kept, observed = request.sampled.values, _rows(request.sampled.at_samples)
    assign = fmu.set
    last: tuple[float, ...] = ()  # without inputs, all rows are that
    if inputs is not None:
        last = next(observed) if lead == 0 else tuple(kept[0].tolist())
        assign(inputs, last)
    fmu.leave_initialisation()
    initial(0)
    if lead == 0:
        read(0)
    else:
        last = ()  # the first step sets it again, in step mode
    row, due = (1, each) if lead == 0 else (0, lead)
    now = start
    for k, values in enumerate(_rows(kept), 1):
        if values != last and inputs is not None:
            assign(inputs, values)
            last = values
        then = start + k * step
        advance(now, then - now)
        now = then
        if k == due:
            values = next(observed)
            if values != last and inputs is not None:
                assign(inputs, values)
                last = values
            read(row)
            row, due = row + 1, due + each


def _rows(table: FloatArray) -> Iterator[tuple[float, ...]]:
    """Rows of numbers of Python, a block at a time: all of them would take ten times the memory."""
    if not table.size:
        return repeat((), len(table))
    starts = range(0, len(table), BLOCK)
    return chain.from_iterable(zip(*table[k : k + BLOCK].T.tolist(), strict=True) for k in starts)


def _reader(
    fmu: FmuInstance, gets: Gets, accesses: Sequence[VariableAccess], result: FloatArray
) -> Reader:
    """Function that reads some outputs into row j of the result."""
    instance, check = fmu.instance, fmu.check
    groups = gets.groups
    single = len(groups) == 1 and not groups[0].size
    if single and accesses[0].buffer._type_ is ctypes.c_double:
        function, name, references, n, _, tail = accesses[0]
        first, size = DOUBLE * gets.columns[0][0], result.strides[0]
        rows: Any = result  # numpy's arrays do offer the buffer that ctypes wants
        target = ctypes.c_double.from_buffer(rows)

        def read_doubles(j: int) -> None:
            # straight into the row, without a buffer in between
            place = ctypes.byref(target, first + size * j)
            status = function(instance, references, n, place, *tail)
            if status > WARNING:
                check(status, name)

        return read_doubles

    def read_mixed(j: int) -> None:
        for access, group, columns in zip(accesses, groups, gets.columns, strict=True):
            function, name, references, n, buffer, tail = access
            check(function(instance, references, n, buffer, *tail), name)
            values = [buffer[place] for place in group.places] if group.size else buffer
            result[j, list(columns)] = values

    return read_mixed
