"""One run of an FMU instance: initialise, step, read. The hot loop of the whole program."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from fitting.fmu.run_requests import Layout, RunRequest
from fitting.fmu.runs import communication_steps, parts, row_times
from fitting.fmu.worker.input_signal import held_values, seen_values
from fitting.fmu.worker.instance import WARNING, FmuInstance, VariableAccess
from fitting.fmu.worker.log import CallFailed
from fitting.text.arrays import FloatArray

Reader = Callable[[int], None]

DOUBLE = 8  # bytes
BLOCK = 4096  # rows of inputs at a time


class Binding(NamedTuple):
    """A layout with its functions and buffers; ``input`` is set where the run has a signal."""

    layout: Layout
    sets: tuple[VariableAccess, ...]
    gets: tuple[VariableAccess, ...]
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
        gets=tuple(fmu.access("Get", group) for group in layout.gets),
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
    result = np.empty((request.rows, len(binding.layout.outputs)))
    _set_start_values(fmu, binding, request)
    read = _reader(fmu, binding, result)
    fmu.enter_initialisation(request.start_time_s)
    if request.held is not None:
        _stride_in_steps(fmu, binding.input, request, read)
    elif binding.input is None or fmu.follow(binding.input, request.tones):
        fmu.leave_initialisation()
        now = _stride(fmu, request, read)
        if binding.moved is not None:
            _follow(fmu, binding.moved, request, read, now)
    else:
        _stride_with_input(fmu, binding.input, request, read)
    fmu.terminate()
    if not (request.allow_nan or np.count_nonzero(np.isfinite(result)) == result.size):
        raise CallFailed(fmu.with_log(_not_finite(binding.layout.outputs, request, result)))
    return result


def _set_start_values(fmu: FmuInstance, binding: Binding, request: RunRequest) -> None:
    """Structural parameters in configuration mode, which come first, then all others."""
    groups = zip(binding.layout.sets, binding.sets, request.values, strict=True)
    configuring = False
    for group, access, values in groups:
        if group.structural != configuring:
            configuring = group.structural
            fmu.configure(begin=configuring)
        fmu.set(access, values)
    if configuring:
        fmu.configure(begin=False)


def steps_of(request: RunRequest) -> int:
    """Communication steps of a run.

    Args:
        request: a run, in value references.
    """
    if request.step_s:
        lead, each = _whole_steps(request)
        return lead + each * (request.samples - 1)
    return communication_steps(request)


def _follow(
    fmu: FmuInstance, moved: VariableAccess, request: RunRequest, read: Reader, now: float
) -> None:
    """Segments after the first stretch: move the variable, one step to each of their samples."""
    row = request.samples
    for segment in request.segments:
        fmu.set(moved, (segment.value,))
        first = now + segment.settle_s
        for j in range(segment.samples):
            then = first + j * segment.sample_step_s
            if then > now:
                _advance(fmu, request, now, then)
            read(row)
            row, now = row + 1, then


def _stride(fmu: FmuInstance, request: RunRequest, read: Reader) -> float:
    """One step to each sample; the time of the last."""
    step = request.sample_step_s
    first = now = request.start_time_s + request.settle_s
    if request.settle_s:
        _advance(fmu, request, request.start_time_s, first)
    read(0)
    for j in range(1, request.samples):
        then = first + j * step
        _advance(fmu, request, now, then)
        read(j)
        now = then
    return now


def _advance(fmu: FmuInstance, request: RunRequest, now: float, then: float) -> None:
    """From one time to another, in one step or in equal ones that are short enough."""
    if not request.longest_step_s:
        fmu.step(now, then - now)
        return
    count = parts(then - now, request.longest_step_s)
    begin, span = now, then - now
    for k in range(1, count):
        at = begin + k * (span / count)
        fmu.step(now, at - now)
        now = at
    fmu.step(now, then - now)


def _stride_with_input(
    fmu: FmuInstance, drive: VariableAccess, request: RunRequest, read: Reader
) -> None:
    """Many steps to each sample, with the input held over each, and seen as it is at the sample."""
    start, step = request.start_time_s, request.step_s
    lead, each = _whole_steps(request)
    values = held_values(request.tones, start, step, steps_of(request) + 1).tolist()
    # an output that sees the input at once would show what was held over the step before
    at = np.arange(request.samples, dtype=np.float64)
    seen = seen_values(request.tones, np.asarray(start + step * (lead + each * at)))
    fmu.set(drive, (seen[0] if lead == 0 else values[0],))
    fmu.leave_initialisation()
    if lead == 0:
        read(0)
    now = start
    for k in range(1, steps_of(request) + 1):
        fmu.set(drive, (values[k - 1],))
        then = start + k * step
        fmu.step(now, then - now)
        now = then
        if k >= lead and (k - lead) % each == 0:
            j = (k - lead) // each
            fmu.set(drive, (seen[j],))
            read(j)


def _stride_in_steps(
    fmu: FmuInstance, inputs: VariableAccess | None, request: RunRequest, read: Reader
) -> None:
    """Steps of one length, with values of the inputs over each and at each sample.

    An input keeps its value: it is set where that changes, which after a pulse it never does.
    """
    assert request.held is not None  # noqa: S101  # the caller asked
    start, step = request.start_time_s, request.step_s
    lead, each = _whole_steps(request)
    held, seen = _rows(request.held.held), _rows(request.held.seen)

    last: tuple[float, ...] | None = None

    def put(rows: Iterator[tuple[float, ...]]) -> None:
        nonlocal last
        values = next(rows)
        if inputs is not None and values != last:
            fmu.set(inputs, values)
            last = values

    if lead == 0:
        put(seen)
        fmu.leave_initialisation()
        read(0)
    else:
        if inputs is not None:
            fmu.set(inputs, tuple(request.held.held[0].tolist()))
        fmu.leave_initialisation()
    now = start
    for k in range(1, steps_of(request) + 1):
        put(held)
        then = start + k * step
        fmu.step(now, then - now)
        now = then
        if k >= lead and (k - lead) % each == 0:
            put(seen)
            read((k - lead) // each)


def _rows(table: FloatArray) -> Iterator[tuple[float, ...]]:
    """Rows of numbers of Python, a block at a time: all of them would take ten times the memory."""
    for begin in range(0, len(table), BLOCK):
        yield from map(tuple, table[begin : begin + BLOCK].tolist())


def _whole_steps(request: RunRequest) -> tuple[int, int]:
    """Steps before the first sample, and from one sample to the next."""
    each = round(request.sample_step_s / request.step_s) if request.samples > 1 else 1
    return round(request.settle_s / request.step_s), each


def _reader(fmu: FmuInstance, binding: Binding, result: FloatArray) -> Reader:
    """Function that reads all outputs into row j of the result."""
    instance, check = fmu.instance, fmu.check
    first, size = binding.gets[0], DOUBLE * len(binding.layout.gets[0].references)
    groups = binding.layout.gets
    single = len(groups) == 1 and not groups[0].size
    if single and first.buffer._type_ is ctypes.c_double:
        function, name, references, n, _, tail = first
        rows: Any = result  # numpy's arrays do offer the buffer that ctypes wants
        target = ctypes.c_double.from_buffer(rows)

        def read_doubles(j: int) -> None:
            # straight into the row, without a buffer in between
            status = function(instance, references, n, ctypes.byref(target, size * j), *tail)
            if status > WARNING:
                check(status, name)

        return read_doubles

    def read_mixed(j: int) -> None:
        for access, group, columns in zip(
            binding.gets, groups, binding.layout.columns, strict=True
        ):
            function, name, references, n, buffer, tail = access
            check(function(instance, references, n, buffer, *tail), name)
            values = [buffer[place] for place in group.places] if group.size else buffer
            result[j, list(columns)] = values

    return read_mixed


def _not_finite(outputs: tuple[str, ...], request: RunRequest, result: FloatArray) -> str:
    j, column = np.argwhere(~np.isfinite(result))[0]
    at = row_times(request)[int(j)]
    return f"output {outputs[column]} is {result[j, column]} at t = {at!r} s"
