"""How a problem is solved, and what of it is reported."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from fitting.campaign import ContinuationSettings
from fitting.fit.solver.continuation import Schedule
from fitting.fit.solver.interior_point import SolveSettings, quick_settings
from fitting.measurements.measurement import Measurement
from fitting.text.choices import ALGORITHM2, ESTIMATORS, LIKELIHOOD, MISFITS

__all__ = ["ALGORITHM2", "ESTIMATORS", "LIKELIHOOD", "Options", "options_of", "usual_misfit"]


@dataclass(frozen=True)
class Options:
    """Schedule of nu, settings of each solve, and whose estimate is reported as the value."""

    schedule: Schedule = field(default_factory=Schedule)
    solve: SolveSettings = field(default_factory=SolveSettings)
    estimator: str = LIKELIHOOD


def usual_misfit(measurements: Iterable[Measurement]) -> str:
    """The misfit where nobody names one: "squares" where there is a trace, else "slack".

    Sums of absolute values are the paper's, for a few peaks of which some may be wrong. A trace has
    thousands of samples with like noise: a slack for each buys nothing, and a sum over traces and
    peaks is one sum, of squares then.

    Args:
        measurements: that are fitted together.
    """
    return "squares" if any(m.is_trace for m in measurements) else MISFITS[0]


def options_of(
    chosen: ContinuationSettings, measurements: Iterable[Measurement] = (), *, quick: bool = False
) -> Options:
    """The campaign's own settings; `quick` takes its own start alone and looser tolerances.

    Args:
        chosen: the campaign's table [continuation].
        measurements: that are fitted, on which the usual misfit depends.
        quick: whether one start and looser tolerances will do.
    """
    schedule = Schedule(
        nu_start=chosen.nu_start,
        beta=chosen.beta,
        levels=chosen.iterations,
        tolerance=chosen.tolerance,
        starts=chosen.starts,
        seed=chosen.seed,
    )
    solve = SolveSettings(misfit=chosen.misfit or usual_misfit(measurements))
    if quick:
        schedule = replace(schedule, starts=1)
        solve = quick_settings(solve)
    return Options(schedule, solve, chosen.estimator)
