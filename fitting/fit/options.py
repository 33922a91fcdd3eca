"""How a problem is solved, and what of it is reported."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from fitting.campaign import ContinuationSettings
from fitting.fit.solver.continuation import Schedule
from fitting.fit.solver.interior_point import SolveSettings, quick_settings
from fitting.text.choices import ALGORITHM2, ESTIMATORS, LIKELIHOOD

__all__ = ["ALGORITHM2", "ESTIMATORS", "LIKELIHOOD", "Options", "options_of"]


@dataclass(frozen=True)
class Options:
    """Schedule of nu, settings of each solve, and whose estimate is reported as the value."""

    schedule: Schedule = field(default_factory=Schedule)
    solve: SolveSettings = field(default_factory=SolveSettings)
    estimator: str = LIKELIHOOD


def options_of(chosen: ContinuationSettings, *, quick: bool = False) -> Options:
    """The campaign's own settings; `quick` takes its own start alone and looser tolerances.

    Args:
        chosen: the campaign's table [continuation].
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
    solve = SolveSettings(misfit=chosen.misfit)
    if quick:
        schedule = replace(schedule, starts=1)
        solve = quick_settings(solve)
    return Options(schedule, solve, chosen.estimator)
