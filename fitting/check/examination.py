"""All that a doctor tries on a running FMU, as far as it goes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fitting.check.costs import Costs, measure_costs, repeated_steps
from fitting.check.inputs import InputEffect, try_inputs
from fitting.check.resets import Resets, try_longer, try_resets
from fitting.check.runs import pushed_run
from fitting.check.steps import Repeatability, Trial, take_trial, try_freeing, try_repeats
from fitting.extension.fmu import FmuWorkers
from fitting.text.arrays import Scalar
from fitting.text.errors import FmuFailure


@dataclass(frozen=True, kw_only=True)
class Examination:
    """What came of a trial step, resets, costs, smaller steps and inputs that move.

    Each is None, ``effects`` empty, where the FMU failed before, of which ``failure`` tells;
    ``repeats`` also where no output is a Real number.
    """

    trial: Trial | None = None
    resets: Resets | None = None
    costs: Costs | None = None
    repeats: Repeatability | None = None
    effects: tuple[InputEffect, ...] = ()
    failure: FmuFailure | None = None


def examine(workers: FmuWorkers, step_s: float, values: Mapping[str, Scalar]) -> Examination:
    """Try an FMU; that it fails is told, not raised.

    Args:
        workers: one process that runs the FMU.
        step_s: length of a trial step, s.
        values: start values by name, beside the FMU's own.

    Raises:
        BadInput: it has neither an output nor a local variable that is a number.
    """
    trial, resets, costs, repeats = None, None, None, None
    effects: tuple[InputEffect, ...] = ()
    failure = None
    try:
        trial = take_trial(workers, step_s, values)
        try_freeing(workers, step_s, values)
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
