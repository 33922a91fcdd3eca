"""A trial step, and how well outputs repeat: again, with smaller steps, later."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.check.runs import Probes, in_parts, shares
from fitting.extension.fmu import Handling, Run, is_late
from fitting.text.arrays import FloatArray

#: By which differences fall at least from halves to quarters where they come of the step.
FALLS = 1.5
#: Samples in each step where outputs are watched for a step of their own: the first look is as
#: much coarser as later ones become finer.
LOOKS = (0.125, 1.0, 8.0, 64.0, 512.0, 4096.0)
#: Part of the samples of a look at which outputs stand still where that shows a step.
STILL = 0.2
#: Moves at equal distances that tell a step.
MOVES = 4
#: Shift of the start, in steps: whole in no unit of an FMU; and a shift that is small beside it.
SHIFT, LITTLE = 0.3819660112501051, 1e-4
#: Share of the difference by a shift that a little shift leaves at least where it is noise.
NOISE = 0.1


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What came of a step of ``step_s`` seconds: outputs that were numbers, ``blank`` were none."""

    step_s: float
    numbers: tuple[str, ...]
    blank: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Repeatability:
    """How well Real outputs repeat in ``steps`` steps of ``step_s`` seconds.

    Every number is the largest difference of an output over its largest value, NaN where the FMU
    refused the run: ``again`` on a new instance; ``halves`` and ``quarters`` with steps of half the
    length, and with a quarter of it over half; ``later`` begun a part of a step later, ``little``
    a ten-thousandth of that. ``early`` and ``late`` are those with a quarter in the first and the
    last quarter of the time. ``output`` is whose ``halves`` are.

    ``own_step_s`` is the step in which outputs move where they are looked at more often, NaN where
    they move all the time. ``stops_s`` is the length of a step in which outputs that move in longer
    ones do not move at all, NaN where none was met. ``times_s`` and ``differences``
    (steps + 1, outputs) are those of ``halves``, for a figure. ``late_outputs`` come one
    communication step late.
    """

    step_s: float
    steps: int
    again: float
    halves: float
    quarters: float
    later: float
    little: float
    early: float
    late: float
    output: str
    own_step_s: float
    stops_s: float
    late_outputs: tuple[str, ...]
    outputs: tuple[str, ...]
    times_s: FloatArray
    differences: FloatArray

    @property
    def falls(self) -> bool:
        """Whether differences fall as steps become smaller: they come of the step, no noise."""
        return self.quarters * FALLS < self.halves

    @property
    def order(self) -> float:
        """Power of the step that differences fall with."""
        return math.log2(self.halves / self.quarters) if self.quarters > 0.0 else math.inf

    @property
    def by_time(self) -> bool:
        """Whether what a later start changes is noise: a drive inside changes little at once."""
        return self.little > NOISE * self.later

    @property
    def floor(self) -> float:
        """Share to which outputs repeat whatever the step: noise, or a step of its own."""
        noise = 0.0 if self.falls else float(np.nanmax([self.halves, self.quarters, 0.0]))
        return float(np.nanmax([self.again, noise, self.later if self.by_time else 0.0]))


def take_trial(probes: Probes, step_s: float) -> Trial:
    """Run one step with nothing set but given values, as a tool does that knows no others.

    Args:
        probes: of the FMU.
        step_s: length of the step, s.

    Raises:
        BadInput: neither an output nor a local variable is a number.
        FmuFailure: the FMU failed with these values.
    """
    run = replace(probes.trial_run(step_s), start_values=probes.values, handling=Handling())
    [result] = probes.workers.run([run])
    finite = {name: math.isfinite(v) for name, v in zip(run.outputs, result[-1], strict=True)}
    return Trial(
        step_s=step_s,
        numbers=tuple(name for name, is_finite in finite.items() if is_finite),
        blank=tuple(name for name, is_finite in finite.items() if not is_finite),
    )


def try_freeing(probes: Probes, step_s: float) -> None:
    """Run one step and free the instance: some FMUs crash or hang there.

    Args:
        probes: of the FMU, with values with which a trial step went well.
        step_s: length of the step, s.

    Raises:
        FmuFailure: it did.
    """
    run = replace(probes.trial_run(step_s), start_values=probes.values)
    probes.workers.run([replace(run, handling=Handling(freed=True))])


def try_repeats(probes: Probes, run: Run, steps: int) -> Repeatability | None:
    """How well outputs repeat; None where none of them is a Real number.

    Args:
        probes: of the FMU.
        run: some steps (`pushed_run`).
        steps: their number here.

    Raises:
        NotTried: a run did not end in its time, or ended the process.
    """
    variables = probes.description.variables
    real = tuple(name for name in run.outputs if variables[name].kind == "Real")
    if not real:
        return None
    run = replace(run, outputs=real, samples=steps + 1)
    whole, quarters = (_tried(probes, in_parts(run, parts)) for parts in (1, 4))
    # every half of a step is read: at half a step earlier late outputs are those of whole ones
    every = replace(run, sample_step_s=run.sample_step_s / 2.0, samples=2 * steps + 1)
    fine = _tried(probes, in_parts(every, 1))
    halves = fine[::2]
    alone = replace(in_parts(run, 1), handling=Handling())
    once, again = _tried(probes, alone), _tried(probes, alone)
    later, little = (
        _tried(probes, replace(in_parts(run, 1), start_time_s=shift * run.sample_step_s))
        for shift in (SHIFT, SHIFT * LITTLE)
    )
    columns = np.isfinite(whole).all(axis=0)
    if not columns.any():
        return None
    by_output = np.where(columns, shares(halves - whole, whole), np.nan)
    k = 0 if np.isnan(by_output).all() else int(np.nanargmax(by_output))
    quarter = max(1, steps // 4)
    finer = quarters - halves
    late = (name for name, y, z in zip(real, whole.T, fine.T, strict=True) if is_late(y, z))
    return Repeatability(
        step_s=run.sample_step_s,
        steps=steps,
        again=_share(again - once, whole),
        halves=_share(halves - whole, whole),
        quarters=_share(finer, whole),
        later=_share(later - whole, whole),
        little=_share(little - whole, whole),
        early=_share(finer[: quarter + 1], whole),
        late=_share(finer[-quarter:], whole),
        output=real[k],
        own_step_s=_own_step_s(probes, run),
        stops_s=_stops_s(run, whole, (halves, quarters)),
        late_outputs=tuple(late),
        outputs=real,
        times_s=np.arange(steps + 1, dtype=np.float64) * run.sample_step_s,
        differences=np.abs(halves - whole),
    )


def _tried(probes: Probes, run: Run) -> FloatArray:
    """The result of a run; NaN where the FMU refuses it."""
    answer = probes.tried(f"{run.samples - 1} steps of {run.sample_step_s:g} s", [run])
    return np.full((run.samples, len(run.outputs)), np.nan) if answer is None else answer[0]


def _share(difference: FloatArray, values: FloatArray) -> float:
    """The largest share of any output that is a number; NaN where there is none."""
    answer = shares(difference, values)
    return math.nan if np.isnan(answer).all() else float(np.nanmax(answer))


def _stops_s(run: Run, whole: FloatArray, parts: Sequence[FloatArray]) -> float:
    """The longest step in parts of which nothing moves, though it does in whole ones; NaN: none."""
    if not np.any(np.diff(whole, axis=0)):
        return math.nan
    for count, answer in zip((2, 4), parts, strict=True):
        if not np.any(np.diff(answer, axis=0)):
            return run.sample_step_s / count
    return math.nan


def _own_step_s(probes: Probes, run: Run) -> float:
    """The step in which outputs move when they are looked at often; NaN: they move all the time."""
    for finer in LOOKS:
        look = replace(run, sample_step_s=run.sample_step_s / finer)
        if finer < 1.0:  # what costs by its time, and not by its steps
            look = replace(look, samples=1 + (run.samples - 1) // 4)
        moves = np.diff(_tried(probes, look), axis=0)
        moving = moves[:, np.any(moves != 0.0, axis=0) & np.isfinite(moves).all(axis=0)]
        at = np.flatnonzero(np.any(moving != 0.0, axis=1))
        if not moving.size and finer < 1.0:
            continue  # steps that are too long for it
        if len(at) <= MOVES:
            return math.nan  # finer looks see less
        between = np.diff(at)
        if between.mean() * (1.0 - STILL) <= 1.0:
            continue
        # what comes at odd times is an event, no step
        one = between.min() >= 2 and np.ptp(between) <= (2 if between.mean() > MOVES else 1)
        if one or finer == LOOKS[-1]:
            return look.sample_step_s * float(between.mean()) if one else math.nan
    return math.nan
