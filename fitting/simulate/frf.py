"""The FRF of an FMU, point by point in one simulation each way, so that a branch is followed.

The tone is moved while the FMU runs: its phase carries on and the state stays on its branch, as in
a laboratory. Upward and downward sweeps then differ where a response has two branches, and each
jumps where its own one ends.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fitting.fmu import Leg, Run, row_times
from fitting.signal.combinations import USUAL_ORDER, mixed_hz
from fitting.signal.tones import ToneFit
from fitting.signal.window import Window, plan_window
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.units import convert

DIRECTIONS = ("up", "down")
#: Points at which the time to settle is tried, and their largest number of doublings.
TRIED, DOUBLINGS = 5, 30
#: Beats of the whole span in the first time tried: enough for a transient to show.
FIRST_BEATS = 0.25
LONGEST_SETTLE_S = 100.0
#: Directions differ where amplitudes are apart by more than this part of the larger one.
APART = 0.02


class Workers(Protocol):
    """What is needed of `fitting.fmu.FmuWorkers`."""

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Outputs of each run, shape (samples, outputs)."""
        ...


@dataclass(frozen=True)
class Sweep:
    """What to simulate: ``tone`` is the tunable parameter that is moved, in ``tone_unit``.

    ``frequencies_hz`` (n,) ascending; ``settle_s`` None: found by trying.
    """

    start_values: Mapping[str, Scalar]
    tone: str
    tone_unit: str
    frequencies_hz: tuple[float, ...]
    output: str
    directions: tuple[str, ...] = ("up",)
    settle_s: float | None = None
    accuracy: float = 1e-4

    def __post_init__(self) -> None:
        f = self.frequencies_hz
        if len(f) < 2 or f[0] <= 0.0 or any(b <= a for a, b in itertools.pairwise(f)):
            raise BadInput(f"sweep from {f[0]!r} Hz to {f[-1]!r} Hz: wanted two rising points")

    def run(self, path: Sequence[float], settle_s: float) -> tuple[Run, list[Window]]:
        """One simulation that visits frequencies in that order, and the window at each."""
        windows = [_window(f) for f in path]
        values = [convert(f, "Hz", self.tone_unit, where=self.tone) for f in path]
        legs = tuple(
            Leg(v, settle_s, w.step_s, w.samples)
            for v, w in zip(values[1:], windows[1:], strict=True)
        )
        first = windows[0]
        run = Run(
            {**self.start_values, self.tone: values[0]},
            settle_s,
            first.step_s,
            first.samples,
            (self.output,),
            moved=self.tone,
            legs=legs,
        )
        return run, windows


def _window(frequency_hz: float) -> Window:
    return plan_window((frequency_hz,), 0.0, mixtures_hz=mixed_hz((frequency_hz,), USUAL_ORDER))


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


@dataclass(frozen=True)
class FrfResult:
    """Curves of a sweep, the jumps between them, and sentences on what was chosen.

    ``settled``: False if amplitudes were still changing after the longest time tried.
    """

    sweep: Sweep
    curves: tuple[Curve, ...]
    jumps: tuple[Jump, ...]
    settle_s: float
    settled: bool
    reasons: tuple[str, ...]


def sweep_fmu(
    sweep: Sweep, workers: Workers, tell: Callable[[str], None] = lambda text: None
) -> FrfResult:
    """Take the FRF each way that is asked for; ``tell`` hears what is under way.

    Raises:
        BadInput: the tone cannot be moved during a run.
        FmuFailure: the FMU failed.
    """
    settle_s, settled, why = _settling(sweep, workers, tell)
    paths = {
        direction: sweep.frequencies_hz[:: 1 if direction == "up" else -1]
        for direction in sweep.directions
    }
    tell(f"{len(sweep.frequencies_hz)} points, {' and '.join(paths)}")
    asked = [sweep.run(path, settle_s) for path in paths.values()]
    answers = workers.run([run for run, _ in asked])
    curves = []
    for (direction, path), (run, windows), rows in zip(paths.items(), asked, answers, strict=True):
        found = _amplitudes(run, path, windows, rows[:, 0])
        curves.append(Curve(direction, found if direction == "up" else found[::-1]))
    jumps = _jumps(sweep, curves)
    return FrfResult(sweep, tuple(curves), jumps, settle_s, settled, (why, _differ(curves, jumps)))


def _amplitudes(
    run: Run, path: Sequence[float], windows: Sequence[Window], samples: FloatArray
) -> FloatArray:
    """Amplitude at every point of a path, by the tone in its samples."""
    times, begin, found = np.array(row_times(run)), 0, []
    for f, window in zip(path, windows, strict=True):
        end = begin + window.samples
        fit = ToneFit((f,), times[begin:end])
        found.append(float(fit(samples[begin:end]).amplitudes[0]))
        begin = end
    return np.array(found)


def _settling(
    sweep: Sweep, workers: Workers, tell: Callable[[str], None]
) -> tuple[float, bool, str]:
    """Time to wait at each point, whether amplitudes are steady after it, and a sentence."""
    if sweep.settle_s is not None:
        return sweep.settle_s, True, f"{sweep.settle_s:.6g} s at each point, as asked for"
    f = sweep.frequencies_hz
    tried = [f[round(k * (len(f) - 1) / (TRIED - 1))] for k in range(TRIED)]
    # from the far end of the sweep: further than any step of it
    paths = [(f[0] if u > 0.5 * (f[0] + f[-1]) else f[-1], u) for u in tried]
    time_s, before, steady, change = FIRST_BEATS / (f[-1] - f[0]), None, 0, math.inf
    for _ in range(DOUBLINGS):
        tell(f"settling: trying {time_s:.3g} s")
        asked = [sweep.run(path, time_s) for path in paths]
        rows = workers.run([run for run, _ in asked])
        found = np.array(
            [
                _amplitudes(run, path, windows, r[:, 0])[-1]
                for path, (run, windows), r in zip(paths, asked, rows, strict=True)
            ]
        )
        if not found.any():
            raise BadInput(f"{sweep.output} does not move under {sweep.tone}: wanted a drive")
        if before is not None:
            change = float(np.max(np.abs(found - before)) / np.max(found))
            steady = steady + 1 if change <= sweep.accuracy else 0
        if steady == 2:
            why = f"amplitudes changed by {change:.1e} of the largest when it was doubled to that"
            return time_s, True, f"{time_s:.4g} s at each point: {why}"
        before = found
        if 2.0 * time_s > LONGEST_SETTLE_S:
            break
        time_s *= 2.0
    return time_s, False, f"amplitudes still change by {change:.1e} after {time_s:.4g} s at a point"


def _jumps(sweep: Sweep, curves: Sequence[Curve]) -> tuple[Jump, ...]:
    """Where each way leaves its branch: upwards at the upper end of what differs, else the lower.

    Of several stretches that differ the widest counts.
    """
    if len(curves) < 2:
        return ()
    up, down = (next(c.amplitudes for c in curves if c.direction == d) for d in DIRECTIONS)
    apart = np.abs(up - down) > APART * np.maximum(up, down)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], apart, [False]]).astype(int)))
    if edges.size == 0:
        return ()
    stretches = edges.reshape(-1, 2)  # from the first that differs to the first that does not
    first, last = stretches[int(np.argmax(stretches[:, 1] - stretches[:, 0]))]
    f = sweep.frequencies_hz
    jumps = []
    if last < len(f):
        jumps.append(Jump("up", f[last - 1], f[last]))
    if first > 0:
        jumps.append(Jump("down", f[first - 1], f[first]))
    return tuple(jumps)


def _differ(curves: Sequence[Curve], jumps: Sequence[Jump]) -> str:
    if len(curves) < 2:
        return "one way only: whether there is another branch would show in --direction both"
    a, b = (c.amplitudes for c in curves)
    most = float(np.max(np.abs(a - b)) / max(np.max(a), np.max(b)))
    told = f"upward and downward sweep differ by at most {most:.1e} of the largest amplitude"
    return told + (": hysteresis" if jumps else "")
