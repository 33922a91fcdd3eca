"""A doctor's look at a running FMU: a trial step, what acts, whether resets and steps matter."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fitting.fmu.description import FmuDescription, FmuVariable
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import HeldSignal, Run
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer

VARIED = 1e-3  # of a value, to see whether a reset instance still gives what a new one gives
STEPS = 16  # in which a value shows what it does


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What came of a step of ``step_s`` seconds: outputs that were numbers, ``blank`` were none."""

    step_s: float
    numbers: tuple[str, ...]
    blank: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Resets:
    """Whether a reset instance gives what a new one gives: ``reuse`` is a sentence.

    Also with every parameter and input varied, but for those of ``unvaried``, which the FMU refuses
    to take; those of ``idle`` changed no output in ``steps`` steps of ``step_s`` seconds.
    """

    reuse: str
    unvaried: tuple[str, ...]
    idle: tuple[str, ...]
    step_s: float
    steps: int


@dataclass(frozen=True, kw_only=True)
class HalvedStep:
    """What half the communication step of ``step_s`` changes of ``steps`` samples.

    ``share`` is the largest difference of an output over its largest value, ``output`` whose.
    """

    step_s: float
    steps: int
    share: float
    output: str


def take_trial(workers: FmuWorkers, step_s: float, values: Mapping[str, Scalar]) -> Trial:
    """Run one step.

    Args:
        workers: processes that run the FMU.
        step_s: length of the step, s.
        values: start values by name, beside the FMU's own.

    Raises:
        BadInput: neither an output nor a local variable is a number.
        FmuFailure: the FMU failed with these values.
    """
    run = _trial_run(workers.description, step_s, values)
    [result] = workers.run([run])
    finite = {name: math.isfinite(v) for name, v in zip(run.outputs, result[-1], strict=True)}
    return Trial(
        step_s=step_s,
        numbers=tuple(name for name, is_finite in finite.items() if is_finite),
        blank=tuple(name for name, is_finite in finite.items() if not is_finite),
    )


def try_resets(workers: FmuWorkers, run: Run) -> Resets:
    """Run some steps again after resets, every parameter and input varied in turn.

    Args:
        workers: processes that run the FMU.
        run: some steps (`pushed_run`).

    Raises:
        FmuFailure: a run did not end in its time.
    """
    refused, idle = [], []
    for variable in workers.description.variables.values():
        other = _moved(variable, run.start_values.get(variable.name, variable.start), VARIED)
        if other is None:
            continue
        changed = replace(run, start_values={**run.start_values, variable.name: other})
        try:
            one, two = workers.run([run, changed])
        except NoAnswer:
            raise
        except FmuFailure:
            refused.append(variable.name)  # the trial run itself went well: it is this value
        else:
            if np.array_equal(one, two, equal_nan=True):
                idle.append(variable.name)
    return Resets(
        reuse=workers.reuse_note,
        unvaried=tuple(refused),
        idle=tuple(idle),
        step_s=run.sample_step_s,
        steps=STEPS,
    )


def halve_step(workers: FmuWorkers, run: Run) -> HalvedStep | None:
    """How far Real outputs rest on the communication step; None where none of them is a number.

    Args:
        workers: processes that run the FMU.
        run: some steps (`pushed_run`).

    Raises:
        FmuFailure: the FMU failed at half the step.
    """
    variables, step_s = workers.description.variables, run.sample_step_s
    real = tuple(name for name in run.outputs if variables[name].kind == "Real")
    if not real:
        return None
    run = replace(run, outputs=real)
    steps = HeldSignal((), 0.5 * step_s, np.empty((2 * STEPS, 0)), np.empty((STEPS + 1, 0)))
    whole, half = workers.run([run, replace(run, input_signal=steps)])
    shares = _shares(half - whole, whole)
    if not shares.size or np.all(np.isnan(shares)):
        return None
    k = int(np.nanargmax(shares))
    return HalvedStep(step_s=step_s, steps=STEPS, share=float(shares[k]), output=run.outputs[k])


def _shares(difference: FloatArray, values: FloatArray) -> FloatArray:
    """Largest differences over largest values, by column; zero where nothing differs."""
    most, size = np.max(np.abs(difference), axis=0), np.max(np.abs(values), axis=0)
    return np.asarray(
        np.divide(most, size, out=np.where(most > 0.0, np.inf, 0.0), where=size > 0.0)
    )


def pushed_run(workers: FmuWorkers, step_s: float, values: Mapping[str, Scalar]) -> Run:
    """Some steps with every input moved from its start, if the FMU bears that: what rests is blind.

    An input that `values` name stays as it is.

    Args:
        workers: processes that run the FMU.
        step_s: length of a step, s.
        values: start values by name, with which a trial step went well.

    Raises:
        FmuFailure: the run did not end in its time.
    """
    run = replace(_trial_run(workers.description, step_s, values), samples=STEPS + 1)
    pushed = {
        v.name: other
        for v in workers.description.variables.values()
        if v.causality == "input" and v.name not in values
        if (other := _moved(v, v.start, 1.0)) is not None
    }
    if not pushed:
        return run
    moved = replace(run, start_values={**run.start_values, **pushed})
    try:
        workers.run([moved])
    except NoAnswer:
        raise
    except FmuFailure:
        return run
    return moved


def _moved(variable: FmuVariable, value: Scalar | None, share: float) -> float | None:
    """A value moved by a share of itself, or of one, up or else down, inside its limits."""
    if variable.kind != "Real" or value is None or not variable.can_be_started:
        return None
    number = float(value)
    other = number * (1.0 + share) if number else share
    if variable.max is not None and other > variable.max:
        other = number * (1.0 - share) if number else -share
    return other if variable.min is None or other >= variable.min else None


def _trial_run(description: FmuDescription, step_s: float, values: Mapping[str, Scalar]) -> Run:
    outputs = tuple(v.name for v in description.seen)
    if not outputs:
        raise BadInput(
            f"{description.path}: has neither an output nor a local variable that is a number, "
            "wanted one at least"
        )
    starts = {
        v.name: v.start
        for v in description.variables.values()
        if v.can_be_started and v.kind == "Real" and v.start is not None
    }
    return Run(
        start_values={**starts, **values},
        settle_s=0.0,
        sample_step_s=step_s,
        samples=2,
        outputs=outputs,
        allow_nan=True,
    )
