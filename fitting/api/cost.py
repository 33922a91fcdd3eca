"""What a job will cost, before it is begun: runs, seconds, memory."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

from fitting.api.fitted import Tikhonov, search_options
from fitting.api.printed import HtmlText
from fitting.api.problem import Problem
from fitting.campaign.parameters import starts as starts_of
from fitting.campaign.parameters import to_search
from fitting.engine.threads import one_thread
from fitting.fit.objective import evaluate_many, stencil
from fitting.fmu.worker.confinement import most_memory
from fitting.inference.cost import Expected as Expected
from fitting.inference.cost import Range as Range
from fitting.inference.cost import added as added
from fitting.inference.cost import expected as expected
from fitting.inference.cost import times as times
from fitting.inference.determine import own_profiled as own_profiled
from fitting.text.arguments import checked


@dataclass(frozen=True, kw_only=True)
class Cost(HtmlText):
    """Expected cost of a fit with its profiles on this machine.

    ``expected`` has evaluations by part; ``evaluations``, ``runs`` and ``seconds`` are least and
    most. The plan took ``planning_runs`` and ``planning_s``, an evaluation of a Jacobian
    ``runs_each`` and ``seconds_each`` with ``workers`` processes, which held ``memory_bytes`` (NaN:
    unknown); a fit takes more.
    """

    expected: Expected
    workers: int
    planning_runs: int
    planning_s: float
    runs_each: float
    seconds_each: float
    memory_bytes: float
    evaluations: Range
    runs: Range
    seconds: Range


@checked
@one_thread()
def cost(
    problem: Problem,
    method: Tikhonov | None = None,
    *,
    starts: int | None = None,
    profiles: bool = True,
    bootstrap: int = 0,
) -> Cost:
    """Plan a fit with its profiles and measure one Jacobian: what it will cost.

    Args:
        problem: The problem.
        method: Algorithm 2; None: as the campaign states, none without its table [continuation].
        starts: 1: the problem's start, and a search within the bounds only if noise does not
            explain that fit; more: always a search; None: the campaign's, else 3.
        profiles: Whether profiles are scanned.
        bootstrap: Synthetic data sets to refit; 0: none.

    Raises:
        BadInput: the problem cannot be planned, or settings out of their range.
        FmuFailure: the FMU failed at the start.
    """
    options = search_options(problem, method, starts, None)
    record, workers = problem.record, problem.fmu.workers
    whole = expected(record, options, profiles=profiles, refits=bootstrap)
    runs_before, started = workers.counts.runs, time.perf_counter()
    objective = problem.objective
    planning_runs, planning_s = workers.counts.runs - runs_before, time.perf_counter() - started
    x = to_search(record.parameters, starts_of(record.parameters))
    points = [x, *stencil(objective, x).nodes]
    runs_before, started = workers.counts.runs, time.perf_counter()
    evaluate_many(objective, points)
    seconds_each = (time.perf_counter() - started) / len(points)
    runs_each = (workers.counts.runs - runs_before) / len(points)
    # what an output needs is part of a run at least, and a run of its own at most
    evaluated = added(
        times(runs_each, whole.evaluations), (0.0, whole.profiles[1] if whole.outputs else 0.0)
    )
    runs = added(evaluated, whole.output_runs, (planning_runs, planning_runs))
    share = seconds_each / max(runs_each, 1.0)
    resident = len(workers.pids) * workers.memory_bytes
    return Cost(
        expected=whole,
        workers=len(workers.pids),
        planning_runs=planning_runs,
        planning_s=planning_s,
        runs_each=runs_each,
        seconds_each=seconds_each,
        memory_bytes=float(most_memory() + resident) if resident else math.nan,
        evaluations=whole.evaluations,
        runs=runs,
        seconds=added(
            (planning_s, planning_s),
            times(seconds_each, whole.evaluations),
            times(share, whole.output_runs),
        ),
    )
