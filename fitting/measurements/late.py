"""Whether an FMU hands over its output one communication step late.

The commonest mistake of hand-written slaves: an output of the beginning of a step is returned at
its end, y_h(t) = q(t - h). With half the step it is y_(h/2)(t) = q(t - h/2), so that

    y_h(t) = y_(h/2)(t - h/2)

at every t, which no integration error does.
"""

from __future__ import annotations

import numpy as np

from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.traces import TraceRecord, Traces
from fitting.simulate.batch import Batch, Workers
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure, NoAnswer

#: Difference of the two runs at equal times, over the largest value, from which they are compared,
#: and the share of it that is left at shifted times, at most.
MOVED, LEFT = 1e-4, 0.05


def late_by_s(
    kind: Traces, trace: TraceRecord, model: DrivenModel, p: FloatArray, workers: Workers
) -> float:
    """The communication step by which the output of a driven trace is late, s; 0: it is not.

    Two runs, only of a trace for which the plan had to shorten its steps.

    Args:
        kind: the traces.
        trace: one of them.
        model: the FMU as their series drives it.
        p: parameters (n,), each in its own unit.
        workers: of the FMU.

    Raises:
        NoAnswer: the FMU does not answer any more.
    """
    steps = model.plan.step_plan(kind.key(trace))
    looks = [trace.look(fine) for fine in (1, 2)]
    if steps is None or steps.per_sample == 1 or looks[0] is None or looks[1] is None:
        return 0.0
    values = model.whole.values(p, trace.label or None, trace.settings)
    batch, output = Batch(), kind.output_of(trace)
    runs = [batch.ask(values, look.closer, look.hold_signal, output) for look in looks if look]
    try:
        batch.simulate(workers)
    except NoAnswer:
        raise
    except FmuFailure:  # it refuses such steps
        return 0.0
    late = is_late(*(batch.samples(run, output) for run in runs))
    return looks[0].closer.step_s if late else 0.0


def is_late(whole: FloatArray, halves: FloatArray) -> bool:
    """Whether an output over steps is what it is over half of them half a step earlier.

    Args:
        whole: of the start and after every step, shape (n,), in its unit.
        halves: of the start and after every half of a step, shape (m,), at least 2 n - 1.
    """
    count = min(whole.size - 1, (halves.size - 1) // 2)
    later, before, same = (
        whole[1 : count + 1],
        halves[1 : 2 * count : 2],
        halves[2 : 2 * count + 1 : 2],
    )
    largest = float(np.max(np.abs(same), initial=0.0))
    moved = float(np.max(np.abs(later - same), initial=0.0))
    left = float(np.max(np.abs(later - before), initial=0.0))
    return moved > MOVED * largest and left < LEFT * moved
