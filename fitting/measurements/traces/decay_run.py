"""Response to a pulse: a run of the FMU at all samples, or at few from which the others follow."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from fitting.fmu.runs import Segment
from fitting.measurements.traces.step_plan import StepPlan
from fitting.measurements.traces.time_record import TimeRecord
from fitting.signal.free_decay import FewSamples, rebuilt
from fitting.signal.window import Window
from fitting.simulate.batch import Batch, Variation
from fitting.text.arrays import FloatArray, Scalar

#: Blocks, and samples of each, that are tried one after the other.
BLOCKS = ((12, 4), (16, 6), (24, 8), (32, 12))
#: Of this many samples one is simulated, at most: with more it is not worth it.
SPARED = 4


def few_samples(samples: int) -> list[FewSamples]:
    """Which samples of a decay may be worth a trial, the fewest first.

    Args:
        samples: of the whole run.
    """
    apart = [each for each in BLOCKS if SPARED * each[0] * each[1] <= samples]
    tried = [FewSamples(samples, blocks, length) for blocks, length in apart]
    return [few for few in tried if SPARED * few.indices.size <= samples]


def ask_decay(
    trace: TimeRecord,
    values: Mapping[str, Scalar],
    plan: StepPlan | None,
    batch: Batch,
    output: str,
    owner: int = 0,
) -> int:
    """Number of the run after a pulse: at few samples, where the plan says so.

    Args:
        trace: whose decay it is.
        values: start values of the FMU, by name.
        plan: of its steps; None: one between two samples, and all samples.
        batch: where runs are asked for.
        output: name of the output.
        owner: which evaluation pays for the run.
    """
    if plan is None or plan.few is None:
        signal = trace.pulse(1 if plan is None else plan.per_sample)
        return batch.ask(values, trace.pulse_window, signal, output, owner)
    step_s = trace.pulse_window.step_s
    own = Variation(
        {trace.input: 1.0},
        Window(tones_hz=(), settle_s=step_s, step_s=step_s, samples=1),
        moved=trace.input,
        segments=_segments(plan.few, step_s),
    )
    [run] = batch.ask_varied(values, [own], output, owner)
    return run


def read_decay(plan: StepPlan, batch: Batch, run: int, output: str) -> FloatArray | None:
    """All samples of a run after a pulse; None where they do not follow from the few of it.

    Args:
        plan: of the steps of its trace.
        batch: that has simulated it.
        run: its number.
        output: name of the output.
    """
    observed = batch.samples(run, output)
    if plan.few is None:
        return observed
    result = rebuilt(plan.few, observed[1:], plan.tolerance)  # the first is seen under the pulse
    return None if result is None else result.samples


@lru_cache(maxsize=64)
def _segments(few: FewSamples, step_s: float) -> tuple[Segment, ...]:
    """A sample each, at the very times of the whole run; the input is zero from the first on."""
    times = [float((k + 1) * step_s) for k in few.indices]
    before = [step_s, *times[:-1]]
    return tuple(
        Segment(value=0.0, settle_s=then - now, sample_step_s=step_s, samples=1)
        for now, then in zip(before, times, strict=True)
    )
