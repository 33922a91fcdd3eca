"""How many evaluations of the model a job is expected to take, before it is begun.

Counted in Jacobians by central differences, 2n + 1 evaluations for n parameters. The ranges hold
those of the shipped campaigns that the model describes, with a quarter more (the published series,
which it does not describe, takes 1.7 times the most): where noise does not explain what is left,
searches go on, and profiles that come by a better point begin anew.
"""

from __future__ import annotations

from dataclasses import dataclass

from fitting.fit.options import Options
from fitting.fit.problem import Problem

#: Least and most: a count of evaluations, runs, seconds.
Range = tuple[float, float]

#: Jacobians of Algorithm 2 beyond one for each level.
LEVELS: Range = (3.0, 90.0)
#: Jacobians of a search of the box (none where an alternative mirrors another one), and of every
#: further start (none where the search finds no other minimum; two minima may be lowered for it).
SEARCH: Range = (1.0, 60.0)
FURTHER: Range = (0.0, 90.0)
#: Jacobians of a profile, both ways, with its share of the search for other minima.
PROFILE: Range = (8.0, 120.0)
#: Jacobians of a refit of the bootstrap.
REFIT: Range = (0.4, 4.0)
#: Runs in which the range of a derived output over the box is looked for.
OUTPUT_RANGE: Range = (400.0, 9000.0)


@dataclass(frozen=True, kw_only=True)
class Expected:
    """What a job consists of, and the evaluations that each part is expected to take.

    ``parameters`` are searched for, ``levels`` of nu from the campaign's start and ``starts`` in
    all for each of the ``alternatives``; ``profiled`` values have a profile, ``outputs`` of them
    are derived; ``refits`` are those of the bootstrap. ``search``, ``profiles`` and ``bootstrap``
    are least and most evaluations, ``output_runs`` runs beside them.
    """

    parameters: int
    alternatives: int
    levels: int
    starts: int
    profiled: int
    outputs: int
    refits: int
    search: Range
    profiles: Range
    bootstrap: Range
    output_runs: Range

    @property
    def jacobian(self) -> int:
        """Evaluations of a Jacobian by central differences."""
        return 2 * self.parameters + 1

    @property
    def evaluations(self) -> Range:
        """Evaluations of the whole job."""
        return added(self.search, self.profiles, self.bootstrap)


def expected(problem: Problem, options: Options, *, profiles: bool, refits: int) -> Expected:
    """What a fit and its profiles are expected to take.

    Args:
        problem: parameters, measurements and alternatives.
        options: of the search.
        profiles: whether profiles are walked.
        refits: synthetic data sets that are fitted anew.
    """
    schedule = options.schedule
    unknowns, alternatives = len(problem.parameters), len(problem.alternatives)
    shared = sum(not p.experiments for p in problem.parameters)
    outputs = len(problem.outputs) if profiles else 0
    profiled = shared + outputs if profiles else 0
    jacobian = 2.0 * unknowns + 1.0
    path = added((schedule.levels, schedule.levels), LEVELS)
    if schedule.starts > 1:
        path = added(path, SEARCH, times(schedule.starts - 1, FURTHER))
    return Expected(
        parameters=unknowns,
        alternatives=alternatives,
        levels=schedule.levels,
        starts=schedule.starts,
        profiled=profiled,
        outputs=outputs,
        refits=refits,
        search=times(alternatives * jacobian, path),
        profiles=times(profiled * jacobian, PROFILE),
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
