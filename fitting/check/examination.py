"""All that is tried on a running FMU, as far as it goes, and what its runs cost here."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

from fitting.check.inputs import InputEffect, try_inputs
from fitting.check.resets import Resets, try_longer, try_resets
from fitting.check.runs import (
    STEPS,
    USUAL_STEP_S,
    pushed_run,
    response_step_s,
    trial_step_s,
    tried,
)
from fitting.check.steps import Repeatability, Trial, take_trial, try_freeing, try_repeats
from fitting.extension.fmu import FmuWorkers, Run
from fitting.text.arrays import Scalar
from fitting.text.errors import FmuFailure


@dataclass(frozen=True, kw_only=True)
class Examination:
    """What came of a trial step, resets, costs, smaller steps and inputs that move.

    Each is None, ``effects`` empty, where the FMU failed before: see ``failure``;
    ``repeats`` also where no output is a Real number.
    """

    trial: Trial | None = None
    resets: Resets | None = None
    costs: Costs | None = None
    repeats: Repeatability | None = None
    effects: tuple[InputEffect, ...] = ()
    failure: FmuFailure | None = None


def examine(workers: FmuWorkers, step_s: float | None, values: Mapping[str, Scalar]) -> Examination:
    """Try an FMU; a failure is reported, not raised.

    Args:
        workers: one process that runs the FMU.
        step_s: length of a trial step, s; None: one that resolves its response.
        values: start values by name, next to the FMU's own.

    Raises:
        BadInput: it has neither an output nor a local variable that is a number.
    """
    trial, resets, costs, repeats = None, None, None, None
    effects: tuple[InputEffect, ...] = ()
    failure = None
    try:
        step_s = step_s or trial_step_s(workers.description)
        trial = take_trial(workers, step_s or USUAL_STEP_S, values)
        try_freeing(workers, step_s or USUAL_STEP_S, values)
        step_s = step_s or response_step_s(workers, values)
        run = pushed_run(workers, step_s, values)
        resets = try_resets(workers, run)
        costs = measure_costs(workers, run)
        steps = repeated_steps(costs)
        repeats = try_repeats(workers, run, steps)
        resets = try_longer(workers, resets, run, steps)
        effects = try_inputs(workers, run, steps)
    except FmuFailure as error:
        failure = error
    return Examination(
        trial=trial,
        resets=resets,
        costs=costs,
        repeats=repeats,
        effects=effects,
        failure=failure,
    )


#: Processor time that a measured batch takes about, s, and its steps or runs at most.
BATCH_S = 0.05
MOST_STEPS, MOST_RUNS, MOST_NEW = 20_000, 400, 40
BATCHES = 3
#: Steps in which it is tried how well outputs repeat, at most and at least.
MOST_REPEATED, LEAST_REPEATED = 256, 16
#: Processor time that one of these runs may take, s.
REPEATED_S = 1.0


@dataclass(frozen=True, kw_only=True)
class Costs:
    """Processor time of a step and of the start of a run, s, and bytes that every run leaves.

    ``anew``: every run has a new instance, none is reset. ``bytes_per_run`` is NaN where the
    system reports none, or a new process has taken over meanwhile.
    """

    step_s: float
    start_s: float
    bytes_per_run: float
    anew: bool


def repeated_steps(costs: Costs) -> int:
    """Steps in which repeating is tried, a power of four, so that a busy machine is no other one.

    Args:
        costs: measured.
    """
    steps = MOST_REPEATED
    while steps > LEAST_REPEATED and steps * costs.step_s > REPEATED_S:
        steps //= 4
    return steps


def measure_costs(workers: FmuWorkers, run: Run) -> Costs:
    """Measure what steps and starts cost.

    Args:
        workers: one process that runs the FMU, whose resets have been tried.
        run: some steps that went well (`pushed_run`).

    Raises:
        FmuFailure: a run did not end in its time, or one that went well before now fails.
    """
    first = _spent(workers, [run])
    anew = workers.verdict.reused is not True
    most = MOST_NEW if anew else MOST_RUNS
    if anew and workers.description.one_instance_per_process:
        most = 1  # each is a process of its own
    count = min(most, max(1, int(BATCH_S / max(first, 1e-9))))
    runs = [replace(run, samples=1)] * count
    _spent(workers, runs)
    processes, memory = workers.counts.processes, [workers.memory_bytes]
    start_s = math.inf
    for _ in range(BATCHES):
        start_s = min(start_s, _spent(workers, runs) / count)
        memory.append(workers.memory_bytes)
    is_known = memory[0] > 0 and workers.counts.processes == processes
    left = min(b - a for a, b in pairwise(memory)) / count  # memory is taken in pages
    each = max((first - start_s) / (run.samples - 1), 1e-7)
    steps = min(MOST_STEPS, max(STEPS, int(BATCH_S / each)))
    before = workers.counts
    long = tried(workers, [replace(run, samples=steps + 1)])  # it may end before that
    spent = workers.counts.processor_s - before.processor_s
    return Costs(
        step_s=max(0.0, (spent - start_s) / steps if long else each),
        start_s=start_s,
        bytes_per_run=max(0.0, left) if is_known else math.nan,
        anew=anew,
    )


def _spent(workers: FmuWorkers, runs: list[Run]) -> float:
    """Processor time of runs, s."""
    before = workers.counts
    workers.run(runs)
    return workers.counts.processor_s - before.processor_s
