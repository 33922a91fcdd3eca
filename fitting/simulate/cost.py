"""What an evaluation costs: processor time of its runs on this FMU, compared in pairs.

A plan may not hang on how busy the machine is. So the time is that of processors, in the FMU's
process and in the thread that asks, while no other thread drives it; two settings are timed in
turn, always as often, so that a plan takes the same runs everywhere; and long runs are timed at
their beginning and reckoned up by their counted steps.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

from fitting.simulate.batch import Workers

#: A reduction is taken where an evaluation then takes less than this part of the processor time.
CHEAPER = 0.8
#: Pairs that are timed.
PAIRS = 7


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
    alone: Any = getattr(workers, "alone", nullcontext)
    with alone():
        reduced(), whole()  # the first run with other settings does more
        pairs = [(timed(reduced), timed(whole)) for _ in range(PAIRS)]
    return statistics.median(one / other if other > 0.0 else 1.0 for one, other in pairs)
