"""How a problem is solved, and what of it is reported."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields

from fitting.campaign import ContinuationSettings
from fitting.campaign.file import Schedule
from fitting.measurements.measurement import Measurement
from fitting.text.choices import ALGORITHM2, ESTIMATORS, LIKELIHOOD, MISFITS

__all__ = [
    "ALGORITHM2",
    "ESTIMATORS",
    "LIKELIHOOD",
    "Options",
    "Schedule",
    "options_of",
    "usual_misfit",
]


@dataclass(frozen=True, kw_only=True)
class Options:
    """Schedule of nu, misfit of Algorithm 2, and whose estimate is reported as the value.

    `path`: whether Algorithm 2 is carried out, `global_path` whether its levels are minimised over
    the whole box, too. The likelihood's estimate needs neither.
    """

    schedule: Schedule = field(default_factory=Schedule)
    misfit: str = MISFITS[0]
    estimator: str = LIKELIHOOD
    path: bool = False
    global_path: bool = False

    @property
    def needs_path(self) -> bool:
        """Whether Algorithm 2 is asked for, by itself or by what rests on it."""
        return self.path or self.global_path or self.estimator == ALGORITHM2


def usual_misfit(measurements: Iterable[Measurement]) -> str:
    """The misfit where none is named: "squares" where there is a trace, else "slack".

    Sums of absolute values are the paper's, for a few peaks of which some may be wrong. A trace has
    thousands of samples with like noise: a slack for each buys nothing, and a sum over traces and
    peaks is one sum, of squares then.

    Args:
        measurements: that are fitted together.
    """
    return "squares" if any(m.is_trace for m in measurements) else MISFITS[0]


def options_of(
    chosen: ContinuationSettings | None, measurements: Iterable[Measurement] = ()
) -> Options:
    """The campaign's own settings; Algorithm 2 is carried out where the campaign gives any.

    Args:
        chosen: the campaign's table [continuation], None without one.
        measurements: that are fitted, on which the usual misfit depends.
    """
    settings = chosen or ContinuationSettings()
    return Options(
        schedule=Schedule(**{f.name: getattr(settings, f.name) for f in fields(Schedule)}),
        misfit=settings.misfit or usual_misfit(measurements),
        estimator=settings.estimator,
        path=chosen is not None,
    )
