"""What an evaluation costs: processor time of its runs on this FMU, compared in pairs.

A plan may not hang on how busy the machine is. So the time is that of processors, in the FMU's
process and in the thread that asks; two settings are timed in turn, several times; long runs are
timed at their beginning and reckoned up by their counted steps; and pairs are added where the
medians of the first leave a doubt.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

from fitting.simulate.batch import Workers

#: A reduction is taken where an evaluation then takes less than this part of the processor time.
CHEAPER = 0.8
#: Pairs that are timed, those in all where their median is a doubtful one, and what is doubtful.
PAIRS, MORE_PAIRS, DOUBTFUL = 3, 15, (0.65, 0.95)
#: Processor time of pairs from which no more are timed, s.
ENOUGH_S = 0.5


def processor_s(workers: Workers) -> float | None:
    """Processor time so far of the FMU's processes and this thread, s; None: it is not reported.

    Args:
        workers: processes that run the FMU.
    """
    counts: Any = getattr(workers, "counts", None)
    return None if counts is None else counts.processor_s + time.thread_time()


def cost_ratio(
    workers: Workers, reduced: Callable[[], object], whole: Callable[[], object]
) -> float | None:
    """Processor time of one evaluation over that of another, a median; None: it is not reported.

    Args:
        workers: processes that run the FMU, in which both spend their time.
        reduced: evaluates one setting.
        whole: evaluates the other.
    """

    def timed(evaluate: Callable[[], object]) -> float:
        before = processor_s(workers)
        evaluate()
        after = processor_s(workers)
        return 0.0 if before is None or after is None else after - before

    if processor_s(workers) is None:
        return None
    reduced(), whole()  # the first run with other settings does more
    ratios: list[float] = []
    spent_s, wanted = 0.0, PAIRS
    while len(ratios) < wanted and spent_s < ENOUGH_S:
        one, other = timed(reduced), timed(whole)
        spent_s += one + other
        ratios.append(one / other if other > 0.0 else 1.0)
        if len(ratios) == PAIRS and DOUBTFUL[0] < statistics.median(ratios) < DOUBTFUL[1]:
            wanted = MORE_PAIRS
    return statistics.median(ratios)
