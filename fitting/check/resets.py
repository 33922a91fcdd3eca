"""Whether a reset brings an FMU back to where it began."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from fitting.check.runs import NotTried, Probes, moves
from fitting.extension.fmu import Handling, Run
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


def try_resets(probes: Probes, run: Run) -> Resets:
    """Run some steps again after resets, every parameter and input varied in turn.

    Args:
        probes: of the FMU.
        run: some steps (`pushed_run`).

    Raises:
        NotTried: the run itself failed when it was repeated, or there was no time.
    """
    [whole] = probes.run("the same run again", [run])
    refused, idle, acting = [], [], {}
    for name, other in probes.others(run).items():
        changed = replace(run, start_values={**run.start_values, name: other})
        with suppress(NotTried):
            results = probes.tried(_valued(name, other), [run, changed])
            if results is None:
                refused.append(name)  # the run itself went well: it is this value
                continue
            acting[name] = other
            if np.array_equal(results[0], results[1], equal_nan=True):
                idle.append(name)
    kept = () if probes.workers.verdict.ended else _kept(probes, run, acting)
    verdict = probes.workers.verdict
    return Resets(
        reuse=verdict.note,
        true=not (kept or verdict.lied),
        kept=kept,
        unvaried=tuple(refused),
        idle=tuple(idle),
        step_s=run.sample_step_s,
        steps=run.samples - 1,
        idle_steps=run.samples - 1,
        excited=moves(whole),
        fails=verdict.failure,
    )


def try_longer(probes: Probes, resets: Resets, run: Run, steps: int) -> Resets:
    """Look at values that changed nothing over more steps: some act late.

    Args:
        probes: of the FMU.
        resets: what some steps have shown.
        run: the steps.
        steps: their number here.

    Raises:
        NotTried: the longer run ended the process or gave no answer, or there was no time.
    """
    long = replace(run, samples=steps + 1)
    if not resets.idle or steps <= resets.steps:
        return resets
    if (whole := probes.tried(f"{steps} steps", [long])) is None:
        return resets
    others, idle = probes.others(run), []
    for name in resets.idle:
        changed = replace(long, start_values={**long.start_values, name: others[name]})
        with suppress(NotTried):  # of what was not tried in these steps nothing is stated
            results = probes.tried(_valued(name, others[name]), [long, changed])
            if results is not None and np.array_equal(results[0], results[1], equal_nan=True):
                idle.append(name)
    return replace(resets, idle=tuple(idle), idle_steps=steps, excited=moves(whole[0]))


def _valued(name: str, value: Scalar) -> str:
    return f"{name} = {value:g}" if isinstance(value, float) else f"{name} = {value}"


def _kept(probes: Probes, run: Run, others: Mapping[str, Scalar]) -> tuple[str, ...]:
    """Values of which a run after a reset shows a trace though it sets nothing."""
    # inputs stay moved, or a model at rest would show nothing
    variables = probes.description.variables
    inputs = {n: v for n, v in run.start_values.items() if variables[n].causality == "input"}

    def leaves(before: Mapping[str, Scalar], what: str) -> bool:
        given = {name: value for name, value in inputs.items() if name not in before}
        new = replace(run, start_values=given, handling=Handling())
        after = replace(new, handling=Handling(before={**given, **before}))
        with suppress(NotTried):
            answers = probes.tried(f"reset after {what}", [new, after])
            return answers is not None and not np.array_equal(
                answers[0], answers[1], equal_nan=True
            )
        return False

    if leaves({}, "a run with nothing set"):
        return ("",)  # the state itself stays, whatever was set
    if probes.description.one_instance_per_process:  # all at once: each takes two processes
        return (", ".join(others),) if leaves(others, "a run with other values") else ()
    return tuple(n for n, other in others.items() if leaves({n: other}, _valued(n, other)))
