"""The runs of a doctor: some steps with every value set, and every input moved from its start."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from fitting.extension.fmu import (
    USUAL_ACCURACY,
    FmuDescription,
    FmuVariable,
    FmuWorkers,
    Run,
    SampledSignal,
)
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure, NoAnswer

STEPS = 16  # in which a value shows what it does
VARIED = 1e-3  # of a value, to see what it does
#: Shares of an output below which rounding differs, on another machine in another way.
ROUNDING = 1e-12
#: The trial step of an FMU that declares no step and shows no response, s.
USUAL_STEP_S = 1e-3
#: Trial steps among which one is looked for, from and to, s, and their ratio; and the largest
#: second difference of a response over its range from which 16 steps cover a period of it or four
#: of its time constants: some 20 steps in a period, four in a time constant.
SHORTEST_S, LONGEST_S, LONGER, BENDS = 1e-12, 1e4, 4.0, 0.05
#: Processor time of a run after which no longer steps are tried, s.
MOST_S = 1.0
#: Own steps in a trial step: halves and quarters of it are whole ones, too.
OWN_STEPS = 4


def trial_step_s(description: FmuDescription) -> float | None:
    """Length of a trial step that suits what an FMU declares, s; None: it declares no step.

    Args:
        description: of the FMU.
    """
    if description.internal_step_s is not None:
        return OWN_STEPS * description.internal_step_s
    return description.usual_step_s


def response_step_s(workers: FmuWorkers, values: Mapping[str, Scalar]) -> float:
    """Length of a step that resolves the response to pushed inputs, s; `USUAL_STEP_S`: none shows.

    Longer and longer steps are tried. Over short ones a response is straight or a low power of the
    time; the first that bend it more show its time constant, or its period. What is rough already
    over the shortest ones is noise, what stands still between them moves in steps of its own.

    Args:
        workers: processes that run the FMU.
        values: start values by name.

    Raises:
        FmuFailure: a run did not end in its time.
    """
    run = _pushed(workers, trial_run(workers.description, SHORTEST_S, values, STEPS), values)
    smooth: npt.NDArray[np.bool_] | None = None
    while run.sample_step_s < LONGEST_S:
        before = workers.counts.processor_s
        if (results := tried(workers, [run])) is not None:
            # some FMUs have their outputs from the first step on, or one later
            y = results[0][2:]
            ranges, steps = np.ptp(y, axis=0), np.diff(y, axis=0)
            moving = ranges > USUAL_ACCURACY * np.max(np.abs(y), axis=0)
            moving &= np.all(steps != 0.0, axis=0)
            most = np.max(np.abs(np.diff(steps, axis=0)), axis=0)
            bends = np.divide(most, ranges, out=np.zeros_like(most), where=moving)
            smooth = bends < BENDS if smooth is None else smooth
            bend = float(np.max(bends[smooth], initial=0.0))
            if bend >= BENDS:  # it grows with the square of the step
                return run.sample_step_s * math.sqrt(BENDS / bend)
        if workers.counts.processor_s - before > MOST_S:
            break
        run = replace(run, sample_step_s=LONGER * run.sample_step_s)
    return USUAL_STEP_S


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
    other = _pushed(workers, run, values)
    return run if tried(workers, [other]) is None else other


def _pushed(workers: FmuWorkers, run: Run, values: Mapping[str, Scalar]) -> Run:
    """The run with every input moved from its start but for those of some values."""
    pushed = {
        v.name: other
        for v in workers.description.variables.values()
        if v.causality == "input" and v.name not in values
        if (other := moved(v, v.start, 1.0)) is not None
    }
    return replace(run, start_values={**run.start_values, **pushed})


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


def moves(values: FloatArray) -> bool:
    """Whether an output moves by more than rounding after the first step, and not as a clock does.

    Args:
        values: by sample and output.
    """
    bends = np.abs(np.diff(values[1:], 2, axis=0))
    sizes = np.max(np.abs(values), axis=0, initial=0.0)
    return bool(np.any(bends > ROUNDING * sizes))


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
