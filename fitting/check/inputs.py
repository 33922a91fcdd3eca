"""What inputs, and parameters that may be moved during a run, do."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from fitting.check.runs import VARIED, NotTried, Probes, moved, moves
from fitting.extension.fmu import FmuVariable, Run, SampledSignal, Segment
from fitting.text.arrays import Scalar


@dataclass(frozen=True, kw_only=True)
class InputEffect:
    """What an input or a tunable parameter does when it is moved between steps.

    ``acts``: an output changes in ``steps`` steps; ``at_once``: without a step, which is direct
    feed-through; both are None where the FMU refuses the run, ``at_once`` of parameters as well.
    ``excited``: something was there to be changed: an input, or an output that moved.
    """

    name: str
    causality: str
    acts: bool | None
    at_once: bool | None
    steps: int
    excited: bool = True


def try_inputs(probes: Probes, run: Run, most: int = 0) -> tuple[InputEffect, ...]:
    """What every Real input and every tunable Real parameter does when it is moved in a run.

    Args:
        probes: of the FMU.
        run: some steps (`pushed_run`).
        most: steps in which those are looked at again that change nothing in these; 0: in none.
    """
    effects: list[InputEffect] = []
    for v in probes.description.variables.values():
        if v.name not in run.start_values:
            continue
        start = run.start_values[v.name]
        share = 1.0 if v.causality == "input" else VARIED
        other = moved(v, start, share) if v.kind == "Real" and start is not None else None
        if other is None:
            continue
        with suppress(NotTried):
            effect = _effect(probes, run, v, (start, other))
            if effect is not None and effect.acts is False and most >= run.samples:
                longer = _effect(probes, replace(run, samples=most + 1), v, (start, other))
                effect = effect if longer is None or longer.acts is None else longer
            effects += [] if effect is None else [effect]
    return tuple(effects)


def _effect(
    probes: Probes, run: Run, variable: FmuVariable, values: tuple[Scalar, Scalar]
) -> InputEffect | None:
    """What one of them does; None: it is neither."""
    if variable.causality == "input":
        return _input(probes, run, variable, (float(values[0]), float(values[1])))
    if variable.causality == "parameter" and variable.variability == "tunable":
        return _tunable(probes, run, variable, values)
    return None


def _input(
    probes: Probes, run: Run, variable: FmuVariable, values: tuple[float, float]
) -> InputEffect:
    """Half of the steps at another value; and the last sample alone."""
    constant = np.full((run.samples - 1, 1), values[0])
    received = np.full((run.samples, 1), values[0])
    pushed, last = constant.copy(), received.copy()
    pushed[len(constant) // 2 :] = last[-1] = values[1]

    def signal(over: np.ndarray, at: np.ndarray) -> Run:
        made = SampledSignal((variable.name,), run.sample_step_s, over, at)
        return replace(run, input_signal=made)

    results = probes.tried(
        f"{variable.name} moved to {values[1]:g}",
        [signal(constant, received), signal(pushed, received), signal(constant, last)],
    )
    acts = at_once = None
    if results is not None:
        still, late, direct = results
        at_once = not np.array_equal(still, direct, equal_nan=True)
        acts = at_once or not np.array_equal(still, late, equal_nan=True)
    return InputEffect(
        name=variable.name,
        causality=variable.causality,
        acts=acts,
        at_once=at_once,
        steps=run.samples - 1,
    )


def _tunable(
    probes: Probes, run: Run, variable: FmuVariable, values: tuple[Scalar, Scalar]
) -> InputEffect:
    """The second half of the steps at another value."""
    half = max(1, (run.samples - 1) // 2)

    def moved_to(value: Scalar) -> Run:
        then = Segment(
            value=float(value),
            settle_s=run.sample_step_s,
            sample_step_s=run.sample_step_s,
            samples=half,
        )
        start_values = {**run.start_values, variable.name: float(values[0])}
        return replace(
            run, start_values=start_values, samples=half, moved=variable.name, segments=(then,)
        )

    what = f"{variable.name} moved to {values[1]:g}"
    results = probes.tried(what, [moved_to(value) for value in values])
    acts = None if results is None else not np.array_equal(results[0], results[1], equal_nan=True)
    return InputEffect(
        name=variable.name,
        causality=variable.causality,
        acts=acts,
        at_once=None,
        steps=run.samples - 1,
        excited=results is None or moves(results[0][half:]),
    )
