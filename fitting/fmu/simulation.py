"""One run of an FMU instance: initialise, step, read. The hot loop of the whole program."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from fitting.fmu.input_signal import held_values
from fitting.fmu.interface import Access, Interface
from fitting.fmu.log import CallFailed
from fitting.fmu.orders import Layout, Order
from fitting.fmu.records import row_times
from fitting.text.arrays import FloatArray

Reader = Callable[[int], None]

DOUBLE = 8  # bytes


class Binding(NamedTuple):
    """A layout with its functions and buffers; ``input`` is set where the run has a signal."""

    layout: Layout
    sets: tuple[Access, ...]
    gets: tuple[Access, ...]
    input: Access | None
    moved: Access | None = None


def bind(fmu: Interface, layout: Layout) -> Binding:
    """Functions and buffers for a layout, made once for many runs."""
    return Binding(
        layout,
        tuple(fmu.access("Set", group) for group in layout.sets),
        tuple(fmu.access("Get", group) for group in layout.gets),
        fmu.access("Set", layout.input) if layout.input else None,
        fmu.access("Set", layout.moved) if layout.moved else None,
    )


def simulate(fmu: Interface, binding: Binding, order: Order) -> FloatArray:
    """One run of a new or reset instance, shape (samples, outputs).

    Raises CallFailed for a status that is not OK or a warning, for a step that ends early and,
    unless ``order.allow_nan``, for an output that is not a finite number.
    """
    result = np.empty((order.rows, len(binding.layout.outputs)))
    for access, values in zip(binding.sets, order.values, strict=True):
        fmu.set(access, values)
    read = _reader(fmu, binding, result)
    fmu.enter_initialisation(order.start_time_s)
    if binding.input is None:
        fmu.leave_initialisation()
        now = _stride(fmu, order, read)
        if binding.moved is not None:
            _follow(fmu, binding.moved, order, read, now)
    else:
        _stride_with_input(fmu, binding.input, order, read)
    fmu.terminate()
    if not (order.allow_nan or np.isfinite(result).all()):
        raise CallFailed(fmu.with_log(_not_finite(binding.layout.outputs, order, result)))
    return result


def steps_of(order: Order) -> int:
    """Communication steps of a run."""
    if order.step_s:
        lead, each = _whole_steps(order)
        return lead + each * (order.samples - 1)
    legs = sum(leg.samples - 1 + bool(leg.settle_s) for leg in order.legs)
    return order.samples - 1 + bool(order.settle_s) + legs


def _follow(fmu: Interface, moved: Access, order: Order, read: Reader, now: float) -> None:
    """Legs after the first stretch: move the variable, one step to each of their samples."""
    row = order.samples
    for leg in order.legs:
        fmu.set(moved, (leg.value,))
        first = now + leg.settle_s
        for j in range(leg.samples):
            then = first + j * leg.sample_step_s
            if then > now:
                fmu.step(now, then - now)
            read(row)
            row, now = row + 1, then


def _stride(fmu: Interface, order: Order, read: Reader) -> float:
    """One step to each sample; the time of the last."""
    step = order.sample_step_s
    first = now = order.start_time_s + order.settle_s
    if order.settle_s:
        fmu.step(order.start_time_s, first - order.start_time_s)
    read(0)
    for j in range(1, order.samples):
        then = first + j * step
        fmu.step(now, then - now)
        read(j)
        now = then
    return now


def _stride_with_input(fmu: Interface, drive: Access, order: Order, read: Reader) -> None:
    """Many steps to each sample, with the input held over each."""
    start, step = order.start_time_s, order.step_s
    lead, each = _whole_steps(order)
    values = held_values(order.tones, start, step, steps_of(order) + 1).tolist()
    fmu.set(drive, (values[0],))
    fmu.leave_initialisation()
    if lead == 0:
        read(0)
    now = start
    for k in range(1, steps_of(order) + 1):
        fmu.set(drive, (values[k - 1],))
        then = start + k * step
        fmu.step(now, then - now)
        now = then
        if k >= lead and (k - lead) % each == 0:
            read((k - lead) // each)


def _whole_steps(order: Order) -> tuple[int, int]:
    """Steps before the first sample, and from one sample to the next."""
    each = round(order.sample_step_s / order.step_s) if order.samples > 1 else 1
    return round(order.settle_s / order.step_s), each


def _reader(fmu: Interface, binding: Binding, result: FloatArray) -> Reader:
    """Function that reads all outputs into row j of the result."""
    instance, check = fmu.instance, fmu.check
    first = binding.gets[0]
    if len(binding.gets) == 1 and first.buffer._type_ is ctypes.c_double:
        function, name, references, n, _, tail = first
        rows: Any = result  # numpy's arrays do offer the buffer that ctypes wants
        target = ctypes.c_double.from_buffer(rows)

        def read_doubles(j: int) -> None:
            # straight into the row, without a buffer in between
            at = ctypes.byref(target, DOUBLE * n * j)
            check(function(instance, references, n, at, *tail), name)

        return read_doubles

    def read_mixed(j: int) -> None:
        for access, columns in zip(binding.gets, binding.layout.columns, strict=True):
            function, name, references, n, buffer, tail = access
            check(function(instance, references, n, buffer, *tail), name)
            result[j, list(columns)] = buffer

    return read_mixed


def _not_finite(outputs: tuple[str, ...], order: Order, result: FloatArray) -> str:
    j, column = np.argwhere(~np.isfinite(result))[0]
    at = row_times(order)[int(j)]
    return f"output {outputs[column]} is {result[j, column]} at t = {at!r} s"
