"""Whether a reset brings an FMU back to where it began."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fitting.check.runs import VARIED, moved, moves, tried
from fitting.extension.fmu import FmuWorkers, Handling, Run
from fitting.text.arrays import Scalar


@dataclass(frozen=True, kw_only=True)
class Resets:
    """Whether a reset instance gives what a new one gives: ``reuse`` is a sentence.

    ``true``: whether every reset did, those that were called OK in the sense of FMI too: what
    is not set anew is back at its start. ``kept`` are values of which a trace is left where nothing
    is set anew, "" represents a run with nothing set at all. Also with every parameter and input
    varied, but for those of ``unvaried``, which the FMU refuses to take; those of ``idle`` changed
    no output in ``idle_steps`` steps of ``step_s`` seconds, ``steps`` of which were taken here, and
    have no effect where outputs were ``excited``: they moved in these steps.
    ``fails``: how a reset failed, or ended the process; empty: it did not.
    """

    reuse: str
    true: bool
    kept: tuple[str, ...]
    unvaried: tuple[str, ...]
    idle: tuple[str, ...]
    step_s: float
    steps: int
    idle_steps: int
    excited: bool
    fails: str


def try_resets(workers: FmuWorkers, run: Run) -> Resets:
    """Run some steps again after resets, every parameter and input varied in turn.

    Args:
        workers: processes that run the FMU.
        run: some steps (`pushed_run`).

    Raises:
        FmuFailure: a run did not end in its time.
    """
    others = _others(workers, run)
    refused, idle = [], []
    excited = (results := tried(workers, [run])) is not None and moves(results[0])
    for name, other in others.items():
        changed = replace(run, start_values={**run.start_values, name: other})
        if (results := tried(workers, [run, changed])) is None:
            refused.append(name)  # the trial run itself went well: it is this value
        elif np.array_equal(results[0], results[1], equal_nan=True):
            idle.append(name)
    acting = {name: other for name, other in others.items() if name not in refused}
    kept = () if workers.verdict.ended else _kept(workers, run, acting)
    verdict = workers.verdict
    return Resets(
        reuse=verdict.note,
        true=not (kept or verdict.lied),
        kept=kept,
        unvaried=tuple(refused),
        idle=tuple(idle),
        step_s=run.sample_step_s,
        steps=run.samples - 1,
        idle_steps=run.samples - 1,
        excited=excited,
        fails=verdict.failure,
    )


def try_longer(workers: FmuWorkers, resets: Resets, run: Run, steps: int) -> Resets:
    """Look at values that changed nothing over more steps: some act late.

    Args:
        workers: processes that run the FMU.
        resets: what some steps have shown.
        run: the steps.
        steps: their number here.

    Raises:
        FmuFailure: a run did not end in its time.
    """
    long = replace(run, samples=steps + 1)
    if not resets.idle or steps <= resets.steps:
        return resets
    if (whole := tried(workers, [long])) is None:
        return resets
    others = _others(workers, run)
    changed = [
        replace(long, start_values={**long.start_values, name: others[name]})
        for name in resets.idle
    ]
    answers = [tried(workers, [long, other]) for other in changed]
    idle = tuple(
        name
        for name, results in zip(resets.idle, answers, strict=True)
        if results is not None and np.array_equal(results[0], results[1], equal_nan=True)
    )
    return replace(resets, idle=idle, idle_steps=steps, excited=moves(whole[0]))


def _others(workers: FmuWorkers, run: Run) -> dict[str, Scalar]:
    """Another value of every variable that has one."""
    answers = {
        v.name: moved(v, run.start_values.get(v.name, v.start), VARIED)
        for v in workers.description.variables.values()
    }
    return {name: other for name, other in answers.items() if other is not None}


def _kept(workers: FmuWorkers, run: Run, others: Mapping[str, Scalar]) -> tuple[str, ...]:
    """Values of which a run after a reset shows a trace though it sets nothing."""
    # inputs stay moved, or a model at rest would show nothing
    inputs = {
        v.name: run.start_values[v.name]
        for v in workers.description.variables.values()
        if v.causality == "input" and v.name in run.start_values
    }

    def leaves(before: Mapping[str, Scalar]) -> bool:
        given = {name: value for name, value in inputs.items() if name not in before}
        new = replace(run, start_values=given, handling=Handling())
        after = replace(new, handling=Handling(before={**given, **before}))
        answers = tried(workers, [new, after])
        return answers is not None and not np.array_equal(answers[0], answers[1], equal_nan=True)

    if leaves({}):
        return ("",)  # the state itself stays, whatever was set
    if workers.description.one_instance_per_process:  # all at once: each takes two processes
        return (", ".join(others),) if leaves(others) else ()
    return tuple(name for name, other in others.items() if leaves({name: other}))
