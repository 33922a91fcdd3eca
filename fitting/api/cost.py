"""What a job will cost, before it is begun: runs, seconds, memory."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from fitting.api.fitted import Tikhonov, search_options
from fitting.api.printed import HtmlText
from fitting.api.problem import Problem
from fitting.campaign.parameters import starts as starts_of
from fitting.campaign.parameters import to_search
from fitting.engine.threads import one_thread
from fitting.fit.objective import evaluate_many, stencil
from fitting.inference.cost import Expected as Expected
from fitting.inference.cost import Range as Range
from fitting.inference.cost import added as added
from fitting.inference.cost import expected
from fitting.inference.cost import times as times
from fitting.inference.determine import own_profiled
from fitting.text.errors import BadInput


@dataclass(frozen=True, kw_only=True)
class Cost(HtmlText):
    """What a fit with its profiles is expected to take, on this machine.

    ``expected`` holds the evaluations of its parts; ``evaluations``, ``runs`` and ``seconds`` are
    least and most of the whole. The plan took ``planning_runs`` and ``planning_s``; an evaluation
    takes ``runs_each`` runs and ``seconds_each`` with this many ``workers``, as measured over a
    Jacobian at the start. ``memory_bytes`` is the most that all processes held until then (NaN: not
    known here); a fit takes more.
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


@one_thread()
def cost(
    problem: Problem,
    method: Tikhonov | None = None,
    *,
    starts: int | None = None,
    profiles: bool = True,
    bootstrap: int = 0,
) -> Cost:
    """What a fit of a problem and its profiles will cost: planned, and one Jacobian measured.

    Args:
        problem: What is looked for, and from what.
        method: As `fit` takes it.
        starts: As `fit` takes it.
        profiles: Whether profiles are to be scanned.
        bootstrap: Synthetic data sets that are to be fitted anew.

    Raises:
        BadInput: the problem cannot be planned, or settings out of their range.
        FmuFailure: the FMU failed at the start.
    """
    if not isinstance(problem, Problem):
        raise BadInput(f"cost: found a {type(problem).__name__}, wanted a Problem")
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
    return Cost(
        expected=whole,
        workers=len(workers.pids),
        planning_runs=planning_runs,
        planning_s=planning_s,
        runs_each=runs_each,
        seconds_each=seconds_each,
        memory_bytes=_memory_bytes(workers.pids),
        evaluations=whole.evaluations,
        runs=runs,
        seconds=added(
            (planning_s, planning_s),
            times(seconds_each, whole.evaluations),
            times(share, whole.output_runs),
        ),
    )


def expected_of(
    problem: Problem, method: Tikhonov | None, starts: int | None, *, profiles: bool, refits: int
) -> Expected:
    """What `cost` expects, without a run of the FMU.

    Args:
        problem: What is looked for, and from what.
        method: As `fit` takes it.
        starts: As `fit` takes it.
        profiles: Whether profiles are to be scanned.
        refits: Synthetic data sets that are to be fitted anew.
    """
    options = search_options(problem, method, starts, None)
    return expected(problem.record, options, profiles=profiles, refits=refits)


def expected_of_identification(problem: Problem, refits: int) -> Expected:
    """What `identify` expects, without a run of the FMU: no search, but profiles of all values.

    Args:
        problem: What is looked for, and from what.
        refits: Synthetic data sets that are to be fitted anew.
    """
    options, record = search_options(problem, None, 1, None), problem.record
    return expected(record, options, profiles=True, refits=refits, own=own_profiled(record))


def _memory_bytes(pids: Iterable[int]) -> float:
    """The most that this process and some others have held; NaN where the system reports none."""
    if sys.platform != "linux":
        return math.nan
    total = 0
    try:
        for pid in ("self", *pids):
            text = Path(f"/proc/{pid}/status").read_text("ascii", "replace")
            [line] = [line for line in text.splitlines() if line.startswith("VmHWM:")]
            total += 1024 * int(line.split()[1])
    except (OSError, ValueError):
        return math.nan
    return float(total)
