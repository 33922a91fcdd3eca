"""All that is tried on a running FMU, as far as it goes, and what its runs cost here."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise

from fitting.check.inputs import InputEffect, try_inputs
from fitting.check.resets import Resets, try_longer, try_resets
from fitting.check.runs import (
    PROBE_SHARE,
    STEPS,
    USUAL_STEP_S,
    FailedProbe,
    NotTried,
    Probes,
    pushed_run,
    response_step_s,
    trial_step_s,
)
from fitting.check.steps import Repeatability, Trial, take_trial, try_freeing, try_repeats
from fitting.extension.fmu import FmuWorkers, Run
from fitting.text.arrays import Scalar
from fitting.text.errors import FmuFailure


@dataclass(frozen=True, kw_only=True)
class Examination:
    """What came of a trial step, resets, costs, smaller steps and inputs that move.

    Each is None, ``effects`` empty, where the FMU does not run: see ``failure``; or where that
    probe failed or had no time: see ``failed`` and ``skipped``; ``repeats`` also where no output is
    a Real number. ``refused`` are variables whose own start value the FMU does not take.
    """

    trial: Trial | None = None
    resets: Resets | None = None
    costs: Costs | None = None
    repeats: Repeatability | None = None
    effects: tuple[InputEffect, ...] = ()
    failure: FmuFailure | None = None
    refused: tuple[str, ...] = ()
    failed: tuple[FailedProbe, ...] = ()
    skipped: tuple[str, ...] = ()


def examine(
    workers: FmuWorkers,
    step_s: float | None,
    values: Mapping[str, Scalar],
    *,
    budget_s: float = math.inf,
    show: Callable[[str], None] = lambda _what: None,
) -> Examination:
    """Try an FMU; a failure is reported, not raised.

    Args:
        workers: one process that runs the FMU.
        step_s: length of a trial step, s; None: one that resolves its response.
        values: start values by name, next to the FMU's own.
        budget_s: time for all that is tried when it runs, s.
        show: is called with what is tried.

    Raises:
        BadInput: it has neither an output nor a local variable that is a number.
    """
    probes = Probes(workers, values, budget_s, show)
    step_s = step_s or trial_step_s(workers.description)
    first_s = step_s or USUAL_STEP_S
    show("trial run")
    trial = None
    try:
        trial = take_trial(probes, first_s)
        try_freeing(probes, first_s)
    except FmuFailure as error:
        return Examination(trial=trial, failure=error)
    if budget_s < math.inf:
        workers.limit(PROBE_SHARE * budget_s, "a sixth of --budget")
    resets, costs, repeats = None, None, None
    effects: tuple[InputEffect, ...] = ()
    probes.drop_refused(first_s)
    if step_s is None:
        step_s = first_s
        with suppress(NotTried):
            step_s = response_step_s(probes)
    with suppress(NotTried):
        run = pushed_run(probes, step_s)
        steps = STEPS
        with suppress(NotTried):
            resets = try_resets(probes, run)
        with suppress(NotTried):
            costs = measure_costs(probes, run)
            steps = repeated_steps(costs)
        with suppress(NotTried):
            repeats = try_repeats(probes, run, steps)
        with suppress(NotTried):
            resets = resets and try_longer(probes, resets, run, steps)
        effects = try_inputs(probes, run, steps)
    return Examination(
        trial=trial,
        resets=resets,
        costs=costs,
        repeats=repeats,
        effects=effects,
        refused=probes.refused,
        failed=tuple(probes.failed),
        skipped=tuple(probes.skipped),
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


def measure_costs(probes: Probes, run: Run) -> Costs:
    """Measure what steps and starts cost.

    Args:
        probes: of the FMU, whose resets have been tried.
        run: some steps that went well (`pushed_run`).

    Raises:
        NotTried: a run did not end in its time, or one that went well before now fails.
    """
    workers = probes.workers
    first = _spent(probes, [run])
    anew = workers.verdict.reused is not True
    most = MOST_NEW if anew else MOST_RUNS
    if anew and workers.description.one_instance_per_process:
        most = 1  # each is a process of its own
    count = min(most, max(1, int(BATCH_S / max(first, 1e-9))))
    runs = [replace(run, samples=1)] * count
    _spent(probes, runs)
    processes, memory = workers.counts.processes, [workers.memory_bytes]
    start_s = math.inf
    for _ in range(BATCHES):
        start_s = min(start_s, _spent(probes, runs) / count)
        memory.append(workers.memory_bytes)
    is_known = memory[0] > 0 and workers.counts.processes == processes
    left = min(b - a for a, b in pairwise(memory)) / count  # memory is taken in pages
    each = max((first - start_s) / (run.samples - 1), 1e-7)
    steps = min(MOST_STEPS, max(STEPS, int(BATCH_S / each)))
    before = workers.counts
    long = probes.tried(
        f"{steps} steps", [replace(run, samples=steps + 1)]
    )  # it may end before that
    spent = workers.counts.processor_s - before.processor_s
    return Costs(
        step_s=max(0.0, (spent - start_s) / steps if long else each),
        start_s=start_s,
        bytes_per_run=max(0.0, left) if is_known else math.nan,
        anew=anew,
    )


def _spent(probes: Probes, runs: list[Run]) -> float:
    """Processor time of runs, s."""
    before = probes.workers.counts
    probes.run(f"{len(runs)} runs", runs)
    return probes.workers.counts.processor_s - before.processor_s
