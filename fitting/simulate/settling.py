"""How long a response takes to settle: its tones watched while the time doubles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from fitting.simulate.budget import Decision
from fitting.simulate.probe import Probe, Reading, apart
from fitting.text.arrays import Scalar
from fitting.text.notation import number, prefixed

#: Doublings of the time to settle, at most, and how far beyond the end one more look is taken.
DOUBLINGS, FAR = 48, 16.0
#: Changes that fall by less than this are not yet those of a transient that dies away.
DYING = 0.6
#: Factor on a measured change, for what it does not tell.
SAFETY = 2.0


def settling_s(line_width_hz: float, accuracy: float) -> float:
    """Time after which a transient exp(-pi w t) is below the accuracy, s.

    Planned for half the width that was stated: a fit may try less damping than there is.

    Raises:
        ValueError: a width or an accuracy that is not positive.
    """
    if not (line_width_hz > 0.0 and 0.0 < accuracy < 1.0):
        raise ValueError(f"line width {line_width_hz!r} Hz, accuracy {accuracy!r}")
    return math.log(1.0 / accuracy) / (math.pi * 0.5 * line_width_hz)


@dataclass(frozen=True)
class Settled:
    """Time to settle, the error that is left, and what was seen at the end."""

    settle_s: float
    bound: float
    last: tuple[Reading, ...]
    seconds: float
    steady: bool


def watch(probe: Probe, settings: Mapping[str, Scalar], wanted: float, limit_s: float) -> Settled:
    """Double the time until amplitudes stand still: twice in a row, and dying away."""
    tones = [shot.tones_hz for shot in probe.shots]
    step = min(10.0 / max(t) for t in tones)
    step = max(step, *(probe.length_s(shot) / 16.0 for shot in probe.shots))
    times, seen, changes = [0.0], [], []
    here, seconds = probe.read(settings, 0.0)
    seen.append(here)
    for k in range(DOUBLINGS):
        time_s = step * 2.0**k
        if seconds > limit_s / 2.0:
            break
        here, seconds = probe.read(settings, time_s)
        changes.append(apart(here, seen[-1]))
        times.append(time_s)
        seen.append(here)
        far_s = FAR * time_s if FAR * seconds <= 0.2 * limit_s else 0.0
        if _stands(changes, wanted) and _far(probe, settings, far_s, here, wanted):
            return _earliest(probe, settings, times, seen, changes[-1], wanted)
    bound = min(1.0, SAFETY * changes[-1]) if changes else 1.0
    return Settled(times[-1], bound, tuple(seen[-1]), seconds, False)


def _stands(changes: list[float], wanted: float) -> bool:
    if len(changes) < 2 or max(changes[-2:]) > 0.25 * wanted:
        return False
    return changes[-1] <= max(DYING * changes[-2], 0.05 * wanted)


def _far(
    probe: Probe, settings: Mapping[str, Scalar], far_s: float, here: list[Reading], wanted: float
) -> bool:
    """Whether a look much later (0: not taken, it would cost too much) shows no slow transient."""
    return far_s == 0.0 or apart(probe.read(settings, far_s)[0], here) <= 0.5 * wanted


def _earliest(
    probe: Probe,
    settings: Mapping[str, Scalar],
    times: list[float],
    seen: list[list[Reading]],
    change: float,
    wanted: float,
) -> Settled:
    """The shortest of the times tried that does, and one between it and the one before."""
    last, left = seen[-1], SAFETY * change
    errors = [apart(last, reading) for reading in seen]
    k = next(i for i, e in enumerate(errors) if max(errors[i:]) <= 0.5 * wanted)
    if k > 0 and times[k] > 0.0 and 0.0 < errors[k] < errors[k - 1]:
        aim = 0.3 * wanted
        part = math.log(max(errors[k - 1] / aim, 1.0)) / math.log(errors[k - 1] / errors[k])
        time_s = times[k - 1] + min(part, 1.0) * (times[k] - times[k - 1])
        if time_s < 0.95 * times[k]:
            between, seconds = probe.read(settings, time_s)
            error = apart(last, between)
            if error <= 0.5 * wanted:
                return Settled(time_s, SAFETY * error + left, tuple(last), seconds, True)
    seconds = probe.read(settings, times[k])[1]
    return Settled(times[k], SAFETY * errors[k] + left, tuple(last), seconds, True)


def settling(settled: Settled) -> Decision:
    """The decision on what was seen."""
    factor, unit = prefixed(settled.settle_s, "s")
    if settled.settle_s == 0.0:
        return Decision(
            "settling",
            "none",
            settled.bound,
            "the response is steady from the start: amplitudes do not change with time",
        )
    shown = f"{number(settled.settle_s / factor, 3)} {unit}"
    if not settled.steady:
        why = "amplitudes still change by half as much when the time is doubled"
        return Decision("settling", shown, settled.bound, why)
    return Decision(
        "settling",
        shown,
        settled.bound,
        f"transient below {settled.bound:.1e}, by watching the amplitudes while the time doubled",
    )
