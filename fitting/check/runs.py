"""The runs of a doctor: some steps with every value set, and every input moved from its start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitting.extension.fmu import FmuDescription, FmuVariable, FmuWorkers, Run, SampledSignal
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer

STEPS = 16  # in which a value shows what it does
VARIED = 1e-3  # of a value, to see what it does
#: The trial step of an FMU that tells no step of its own, s.
USUAL_STEP_S = 1e-3
#: Own steps in a trial step: halves and quarters of it are whole ones, too.
OWN_STEPS = 4


def trial_step_s(description: FmuDescription) -> float:
    """Length of a trial step that suits an FMU, s.

    Args:
        description: of the FMU.
    """
    if description.internal_step_s is not None:
        return OWN_STEPS * description.internal_step_s
    return USUAL_STEP_S if description.usual_step_s is None else description.usual_step_s


def trial_run(
    description: FmuDescription, step_s: float, values: Mapping[str, Scalar], steps: int = 1
) -> Run:
    """Some steps from rest, with every value that the FMU can be given.

    Args:
        description: of the FMU.
        step_s: length of a step, s.
        values: start values by name, next to the FMU's own.
        steps: their number.

    Raises:
        BadInput: neither an output nor a local variable is a number.
    """
    outputs = tuple(v.name for v in description.observable)
    if not outputs:
        raise BadInput(
            f"{description.path}: has neither an output nor a local variable that is a number, "
            "wanted one at least"
        )
    # what is varied later on, too, so that every run sets the same
    starts = {
        v.name: v.start
        for v in description.variables.values()
        if v.can_be_started and v.start is not None
        if v.kind == "Real" or moved(v, v.start, VARIED) is not None
    }
    return Run(
        start_values={**starts, **values},
        settle_s=0.0,
        sample_step_s=step_s,
        samples=steps + 1,
        outputs=outputs,
        allow_nan=True,
    )


def pushed_run(workers: FmuWorkers, step_s: float, values: Mapping[str, Scalar]) -> Run:
    """Some steps with every input moved from its start, if the FMU bears that: what rests is blind.

    An input that `values` name stays as it is. There are fewer steps where the FMU ends earlier.

    Args:
        workers: processes that run the FMU.
        step_s: length of a step, s.
        values: start values by name, with which a trial step went well.

    Raises:
        FmuFailure: the run did not end in its time.
    """
    run = trial_run(workers.description, step_s, values, STEPS)
    while run.samples > 2 and tried(workers, [run]) is None:
        run = replace(run, samples=1 + (run.samples - 1) // 4)
    pushed = {
        v.name: other
        for v in workers.description.variables.values()
        if v.causality == "input" and v.name not in values
        if (other := moved(v, v.start, 1.0)) is not None
    }
    if not pushed:
        return run
    other_run = replace(run, start_values={**run.start_values, **pushed})
    return run if tried(workers, [other_run]) is None else other_run


def tried(workers: FmuWorkers, runs: Sequence[Run]) -> list[FloatArray] | None:
    """Results of runs; None where the FMU refuses or fails one of them.

    Args:
        workers: processes that run the FMU.
        runs: to be simulated.

    Raises:
        NoAnswer: a run did not end in its time: another one would cost as much.
    """
    try:
        return workers.run(runs)
    except NoAnswer:
        raise
    except FmuFailure:
        return None


def in_parts(run: Run, parts: int) -> Run:
    """The same samples, with every step taken in some equal ones.

    Args:
        run: some steps without a signal.
        parts: of each step.
    """
    n = run.samples - 1
    steps = SampledSignal(
        (), run.sample_step_s / parts, np.empty((parts * n, 0)), np.empty((n + 1, 0))
    )
    return replace(run, input_signal=steps)


def moved(variable: FmuVariable, value: Scalar | None, share: float) -> Scalar | None:
    """Another value: moved by a share of itself, or of one, up or else down, inside its limits.

    A Boolean is the other one, a whole number with both limits the next one; None: there is none.

    Args:
        variable: of the FMU.
        value: that it has.
        share: of the value.
    """
    if value is None or not variable.can_be_started:
        return None
    if variable.kind == "Boolean":
        return not value
    limited = variable.min is not None and variable.max is not None
    if variable.kind == "Integer" and limited and variable.min != variable.max:
        return int(value) + (1 if int(value) < float(variable.max or 0.0) else -1)
    if variable.kind != "Real":
        return None
    number = float(value)
    other = number * (1.0 + share) if number else share
    if variable.max is not None and other > variable.max:
        other = number * (1.0 - share) if number else -share
    return other if variable.min is None or other >= variable.min else None


def shares(difference: FloatArray, values: FloatArray) -> FloatArray:
    """Largest differences over largest values, by column; zero where nothing differs.

    Args:
        difference: by sample and output.
        values: by sample and output.
    """
    most, size = np.max(np.abs(difference), axis=0), np.max(np.abs(values), axis=0)
    return np.asarray(
        np.divide(most, size, out=np.where(most > 0.0, np.inf, 0.0), where=size > 0.0)
    )
