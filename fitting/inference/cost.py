"""How many evaluations of the model a job is expected to take, before it is begun.

Counted in Jacobians by central differences, 2n + 1 evaluations for n parameters. The ranges hold
those of the shipped campaigns that the model describes, with a quarter more (the published series,
which it does not describe, takes 1.7 times the most): where noise does not explain what is left,
searches go on, and profiles that come by a better point begin anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from fitting.fit.options import Options
from fitting.fit.problem import Problem

#: Least and most: a count of evaluations, runs, seconds.
Range = tuple[float, float]

#: Jacobians of the descent from the campaign's start and of the end of a fit; of a search of the
#: box (none where an alternative mirrors another one).
DESCENT: Range = (4.0, 30.0)
SEARCH: Range = (1.0, 120.0)
#: Evaluations of a level of Algorithm 2, in those of a Jacobian by forward differences; and of a
#: level that is minimised over the box.
LEVEL: Range = (4.0, 50.0)
GLOBAL: Range = (200.0, 1500.0)
#: Jacobians of the most likely point and other minima that fit; of the interval of each value,
#: verified at least and scanned at most; and of what has no effect, for each parameter.
MINIMA: Range = (0.5, 20.0)
SCANS: Range = (0.1, 20.0)
DIRECTIONS: Range = (0.0, 5.0)
#: What a stage is at most expected to take yet, as a share of what it has taken beyond its most.
OVERDUE = 0.25
#: Jacobians of a refit of the bootstrap.
REFIT: Range = (0.4, 4.0)
#: Runs in which the range of a derived output over the box is looked for.
OUTPUT_RANGE: Range = (200.0, 4500.0)


class Stage(StrEnum):
    """What an inference is looking for."""

    MINIMA = "other minima"
    SCANS = "scans"
    DIRECTIONS = "what has no effect"
    REFITS = "refits of the bootstrap"


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What a job consists of, and the evaluations that each part is expected to take.

    ``parameters`` are searched for from ``starts`` for each of the ``alternatives``; ``levels`` of
    nu are those of Algorithm 2 (0: it is left out); ``profiled`` values have a profile, ``outputs``
    of them are derived; ``refits`` are those of the bootstrap. ``search``, ``path``, ``profiles``
    and ``bootstrap`` are least and most evaluations, ``stages`` those of the profiles in their
    order; ``output_runs`` further runs.
    """

    parameters: int
    alternatives: int
    levels: int
    starts: int
    profiled: int
    outputs: int
    refits: int
    search: Range
    path: Range
    profiles: Range
    stages: Mapping[Stage, Range]
    bootstrap: Range
    output_runs: Range

    @property
    def jacobian(self) -> int:
        """Evaluations of a Jacobian by central differences."""
        return 2 * self.parameters + 1

    def left(self, stage: str, evaluations: int) -> Range:
        """Evaluations that are left from within one of the stages of profiles and refits.

        Args:
            stage: one of `Stage`, in words.
            evaluations: that this stage has taken.
        """
        stages = {**self.stages, Stage.REFITS: self.bootstrap}
        names = list(stages)
        (low, high), *later = (stages[name] for name in names[names.index(Stage(stage)) :])
        here = max(low - evaluations, 0.0), max(high - evaluations, OVERDUE * evaluations)
        return added(here, *later)

    @property
    def evaluations(self) -> Range:
        """Evaluations of the whole job."""
        return added(self.search, self.path, self.profiles, self.bootstrap)


def expected(
    problem: Problem, options: Options, *, profiles: bool, refits: int, own: int = 0
) -> Expected:
    """What a fit and its profiles are expected to take.

    Args:
        problem: parameters, measurements and alternatives.
        options: of the search.
        profiles: whether profiles are scanned.
        refits: synthetic data sets that are fitted anew.
        own: values of single experiments that have a profile, too.
    """
    schedule = options.schedule
    unknowns, alternatives = len(problem.parameters), len(problem.alternatives)
    shared = sum(not p.experiments for p in problem.parameters)
    outputs = len(problem.outputs) if profiles else 0
    profiled = shared + own + outputs if profiles else 0
    jacobian = 2.0 * unknowns + 1.0
    stages = {
        Stage.MINIMA: times(jacobian if profiles else 0.0, MINIMA),
        Stage.SCANS: times(profiled * jacobian, SCANS),
        Stage.DIRECTIONS: times(unknowns * jacobian if profiles else 0.0, DIRECTIONS),
    }
    search = added(DESCENT, SEARCH) if schedule.starts > 1 else DESCENT
    levels = schedule.iterations if options.needs_path else 0
    level = added(LEVEL, GLOBAL) if options.global_path else LEVEL
    return Expected(
        parameters=unknowns,
        alternatives=alternatives,
        levels=levels,
        starts=schedule.starts,
        profiled=profiled,
        outputs=outputs,
        refits=refits,
        search=times(alternatives * jacobian, search),
        path=times(levels * (unknowns + 1.0), level),
        profiles=added(*stages.values()),
        stages=stages,
        bootstrap=times(refits * jacobian, REFIT),
        output_runs=times(outputs, OUTPUT_RANGE),
    )


def added(*ranges: Range) -> Range:
    """The sum of ranges.

    Args:
        *ranges: least and most each.
    """
    return sum(low for low, _ in ranges), sum(high for _, high in ranges)


def times(factor: float, range_: Range) -> Range:
    """A range, so many times.

    Args:
        factor: at least 0.
        range_: least and most.
    """
    return factor * range_[0], factor * range_[1]
