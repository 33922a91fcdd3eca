"""A doctor's look at a running FMU: a trial step, and whether a reset instance is as a new one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from fitting.fmu.description import FmuDescription, FmuVariable
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer

VARIED = 1e-3  # of a value, to see whether a reset instance still gives what a new one gives


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What came of a step of ``step_s`` seconds: outputs that were numbers, ``blank`` were none."""

    step_s: float
    numbers: tuple[str, ...]
    blank: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Resets:
    """Whether a reset instance gives what a new one gives: ``reuse`` is a sentence.

    Also with every parameter varied, but for those of ``unvaried``, which the FMU refuses to take.
    """

    reuse: str
    unvaried: tuple[str, ...]


def take_trial(workers: FmuWorkers, step_s: float, values: Mapping[str, Scalar]) -> Trial:
    """Run one step.

    Args:
        workers: processes that run the FMU.
        step_s: length of the step, s.
        values: start values by name, beside the FMU's own.

    Raises:
        BadInput: no output is a number.
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


def try_resets(workers: FmuWorkers, step_s: float, values: Mapping[str, Scalar]) -> Resets:
    """Run the trial step again after resets, every parameter varied in turn.

    Args:
        workers: processes that run the FMU.
        step_s: length of the step, s.
        values: start values by name, with which a trial step went well.

    Raises:
        FmuFailure: a run did not end in its time.
    """
    run = _trial_run(workers.description, step_s, values)
    refused = []
    for variable in workers.description.variables.values():
        other = _varied(variable, run.start_values.get(variable.name, variable.start))
        if other is None:
            continue
        changed = {**run.start_values, variable.name: other}
        try:
            workers.run([run, _trial_run(workers.description, step_s, changed)])
        except NoAnswer:
            raise
        except FmuFailure:
            refused.append(variable.name)  # the trial run itself went well: it is this value
    return Resets(reuse=workers.reuse_note, unvaried=tuple(refused))


def _varied(variable: FmuVariable, value: Scalar | None) -> float | None:
    """Another value of a Real parameter, inside its limits."""
    if variable.kind != "Real" or value is None or not variable.can_be_started:
        return None
    number = float(value)
    other = number * (1.0 + VARIED) if number else VARIED
    if variable.max is not None and other > variable.max:
        other = number * (1.0 - VARIED) if number else -VARIED
    return other if variable.min is None or other >= variable.min else None


def _trial_run(description: FmuDescription, step_s: float, values: Mapping[str, Scalar]) -> Run:
    outputs = tuple(
        v.name
        for v in description.variables.values()
        if v.causality == "output" and v.kind in ("Real", "Integer", "Boolean")
    )
    if not outputs:
        raise BadInput(f"{description.path}: has no output that is a number, wanted one at least")
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
