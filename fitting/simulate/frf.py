"""The FRF of an FMU, point by point in one simulation each way, so that a branch is followed.

The tone is moved while the FMU runs: its phase carries on and the state stays on its branch, as in
a laboratory. Upward and downward sweeps then differ where a response has two branches, and each
jumps where its own one ends.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run, Segment, row_times
from fitting.signal.combinations import USUAL_ORDER
from fitting.signal.tones import ToneFit
from fitting.signal.window import Window
from fitting.simulate.batch import Workers
from fitting.simulate.budget import Basis, Kind
from fitting.simulate.drive import Approach, Drive
from fitting.simulate.planner import MOST_WORK, DrivePlan, PlanOptions, plan_drives
from fitting.simulate.probe import knowledge_of
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.units import convert

#: Wanted accuracy where none is given, relative to the largest amplitude.
USUAL_SWEEP_ACCURACY = 1e-4
DIRECTIONS = ("up", "down")
#: Points at which the plan looks.
TRIED = 5
#: Directions differ where amplitudes are apart by more than this part of the larger one.
APART = 0.02


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """What to simulate: ``tone`` is the tunable parameter that is moved, in ``tone_unit``.

    ``frequencies_hz`` (n,) ascending; ``directions`` of "up" and "down".

    Raises:
        BadInput: fewer than two points, or points that do not rise.
    """

    start_values: Mapping[str, Scalar]
    tone: str
    tone_unit: str
    frequencies_hz: tuple[float, ...]
    output: str
    directions: tuple[str, ...] = ("up",)

    def __post_init__(self) -> None:
        f = self.frequencies_hz
        if len(f) < 2 or f[0] <= 0.0 or any(b <= a for a, b in itertools.pairwise(f)):
            raise BadInput(f"sweep from {f[0]!r} Hz to {f[-1]!r} Hz: wanted two rising points")

    def drive(self, frequency_hz: float, first_hz: float) -> Drive:
        """The drive at one point, come to from another one.

        Args:
            frequency_hz: frequency, Hz.
            first_hz: first frequency of a run, Hz.
        """
        first, value = (
            convert(f, "Hz", self.tone_unit, where=self.tone) for f in (first_hz, frequency_hz)
        )
        return Drive(
            start_values=self.start_values,
            tones_hz=(frequency_hz,),
            outputs=(self.output,),
            highest_order=USUAL_ORDER,
            approach=Approach(self.tone, first, value),
        )


@dataclass(frozen=True)
class Curve:
    """Amplitudes (n,) at the sweep's frequencies, ascending whichever way they were taken."""

    direction: str
    amplitudes: FloatArray


@dataclass(frozen=True)
class Jump:
    """Between which frequencies a branch ended on the way ``direction``."""

    direction: str
    low_hz: float
    high_hz: float


@dataclass(frozen=True, kw_only=True)
class SweepResponse:
    """Curves of a sweep, in the output's unit, the jumps between them, and the plan of it.

    ``difference`` is the largest of the directions, as a share of the largest amplitude (None: one
    direction only).
    """

    sweep: Sweep
    plan: DrivePlan
    curves: tuple[Curve, ...]
    jumps: tuple[Jump, ...]
    difference: float | None

    @property
    def accuracy(self) -> float:
        """The promise at the points that the plan looked at, relative to the largest amplitude.

        What both ways differ by is added where they stay on one branch: one of them is as far off.
        """
        return self.plan.promised + (0.0 if self.jumps else self.difference or 0.0)

    @property
    def steady(self) -> bool:
        """Whether the promise is what was wanted."""
        return self.accuracy <= self.plan.budget.wanted


def sweep(
    workers: FmuWorkers,
    what: Sweep,
    accuracy: float | None = None,
    *,
    settle_s: float | None = None,
    annotation: AccuracyAnnotation | None = None,
    work: float | None = None,
) -> SweepResponse:
    """Plan a sweep of an FMU and take it each way that is asked for.

    Args:
        workers: the running FMU.
        what: start values in the FMU's units, the parameter that is moved, frequencies in Hz.
        accuracy: wanted largest error of an amplitude, as a part of the largest amplitude; None:
            1e-4, or what the FMU can give.
        settle_s: time at each point in s; None: found by watching the amplitudes at some points,
            come to from the far end of the sweep.
        annotation: which parameters set the solver's accuracy, where the FMU does not declare it.
        work: communication steps and substeps of a run at most; None: some twenty seconds.

    Returns:
        A curve per direction, the jumps between them, the plan. The model is the FMU's as its
        start values set it: no reduction is tried.

    Raises:
        BadInput: the tone cannot be moved during a run, or does not drive the output.
        FmuFailure: the FMU failed.
    """
    f = what.frequencies_hz
    tried = [f[round(k * (len(f) - 1) / (TRIED - 1))] for k in range(TRIED)]
    # from the far end of the sweep: further than any step of it
    drives = [what.drive(u, f[0] if u > 0.5 * (f[0] + f[-1]) else f[-1]) for u in tried]
    known = knowledge_of(workers.description, annotation)
    # what a reduction leaves out is known at the points that are tried, and a sweep visits others
    whole = replace(known.annotation, full={}, reductions=(), force=(), forbid=())
    options = PlanOptions(
        examples=True,
        of_largest=True,
        settle_s=settle_s,
        fixed=frozenset(what.start_values),
        usual=accuracy is None,
        work=MOST_WORK if work is None else work,
    )
    wanted = USUAL_SWEEP_ACCURACY if accuracy is None else accuracy
    plan = plan_drives(drives, wanted, workers, replace(known, annotation=whole), options)
    [settling] = plan.budget.of(Kind.SETTLING)
    if settling.basis is Basis.WATCHED:
        # next to a maximum transients are larger than at points that are tried: in twice the time
        # what is left of them is the square
        longer = replace(settling, numbers={**settling.numbers, "settle_s": 2.0 * plan.settle_s})
        decisions = tuple(longer if d is settling else d for d in plan.decisions)
        budget = replace(plan.budget, decisions=decisions)
        plan = replace(plan, settle_s=2.0 * plan.settle_s, budget=budget)
    return take_sweep(workers, what, plan)


def take_sweep(workers: Workers, what: Sweep, plan: DrivePlan) -> SweepResponse:
    """Take a sweep as planned, each way that is asked for.

    Args:
        workers: processes that run the FMU.
        what: the sweep.
        plan: settings, settling and windows, with what they promise.
    """
    paths = {
        direction: what.frequencies_hz[:: 1 if direction == "up" else -1]
        for direction in what.directions
    }
    planned = [_path_run(what, path, plan) for path in paths.values()]
    answers = workers.run([run for run, _ in planned])
    curves = []
    for (direction, path), (run, windows), rows in zip(
        paths.items(), planned, answers, strict=True
    ):
        # the samples of a run are those of its points, one window after the other
        times, ends = np.array(row_times(run)), np.cumsum([w.samples for w in windows])
        amplitudes = np.array(
            [
                float(ToneFit((f,), t)(samples).amplitudes[0])
                for f, t, samples in zip(
                    path, np.split(times, ends[:-1]), np.split(rows[:, 0], ends[:-1]), strict=True
                )
            ]
        )
        curves.append(Curve(direction, amplitudes if direction == "up" else amplitudes[::-1]))
    difference: float | None = None
    jumps: tuple[Jump, ...] = ()
    if len(curves) > 1:
        up, down = (next(c.amplitudes for c in curves if c.direction == d) for d in DIRECTIONS)
        difference = float(np.max(np.abs(up - down)) / max(np.max(up), np.max(down)))
        jumps = _jumps(what, up, down)
    return SweepResponse(
        sweep=what, plan=plan, curves=tuple(curves), jumps=jumps, difference=difference
    )


def _path_run(what: Sweep, path: Sequence[float], plan: DrivePlan) -> tuple[Run, list[Window]]:
    """One simulation that visits frequencies in that order, and the window at each."""
    grid = plan.drives[0].grid
    drives = [replace(what.drive(f, path[0]), grid=grid) for f in path]
    windows = [drive.window(plan.settle_s, plan.order, plan.longest_s) for drive in drives]
    segments = tuple(
        Segment(
            value=d.approach.value,
            settle_s=d.grid.at_step(plan.settle_s),
            sample_step_s=w.step_s,
            samples=w.samples,
        )
        for d, w in zip(drives[1:], windows[1:], strict=True)
        if d.approach
    )
    return replace(drives[0].run(windows[0], plan.settings), segments=segments), windows


def _jumps(what: Sweep, up: FloatArray, down: FloatArray) -> tuple[Jump, ...]:
    """Where each way leaves its branch: upwards at the upper end of what differs, else the lower.

    Of several stretches that differ the widest counts.
    """
    apart = np.abs(up - down) > APART * np.maximum(up, down)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], apart, [False]]).astype(int)))
    if edges.size == 0:
        return ()
    stretches = edges.reshape(-1, 2)  # from the first that differs to the first that does not
    first, last = stretches[int(np.argmax(stretches[:, 1] - stretches[:, 0]))]
    f, jumps = what.frequencies_hz, []
    if last < len(f):
        jumps.append(Jump("up", f[last - 1], f[last]))
    if first > 0:
        jumps.append(Jump("down", f[first - 1], f[first]))
    return tuple(jumps)
