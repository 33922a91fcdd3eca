"""How long a response takes to settle: its tones watched while the time doubles."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

from fitting.simulate.budget import Basis, Decision, Kind
from fitting.simulate.probe import Probe, Reading
from fitting.text.arrays import Scalar

#: Periods of the fastest line before the first sample, at most: time is a number of 53 bits, and
#: phases after so many are known to 1e-5. About how far beyond the end one more look is.
MOST_PERIODS, FAR = 1e10, 16.3
#: Two times count as the same where they differ by no more than this part: by rounding.
ROUNDED = 1e-9
#: A change stands still that is at most this part of what is wanted.
QUIET = 0.25
#: Changes that fall by less than this are not yet those of a transient that dies away.
DYING = 0.6
#: Factor on a measured change, for what it does not tell.
SAFETY = 2.0
#: Amplitudes that differ by no more than so many times what they repeat to do not move, and how
#: much longer the time is when that is looked at again.
NOISY, LOOK_AGAIN = 4.0, 4.0
#: Digits of a time to settle: no plan hangs on the last bit of what was seen.
DIGITS = 3
#: Beats between where a moved tone comes from and where it goes, in the first time tried.
FIRST_BEATS = 0.25


def settling_s(line_width_hz: float, accuracy: float) -> float:
    """Time after which a transient exp(-pi w t) is below the accuracy, s.

    Planned for half the width that was stated: a fit may try less damping than there is.

    Args:
        line_width_hz: full width of the narrowest line, Hz.
        accuracy: relative error that is wanted.

    Raises:
        ValueError: a width or an accuracy that is not positive.
    """
    if not (line_width_hz > 0.0 and 0.0 < accuracy < 1.0):
        raise ValueError(f"line width {line_width_hz!r} Hz, accuracy {accuracy!r}")
    return math.log(1.0 / accuracy) / (math.pi * 0.5 * line_width_hz)


@dataclass(frozen=True, kw_only=True)
class Settled:
    """Time to settle, the error that is left, and what was seen at the end.

    `steady`: the amplitudes stood still at last; `prescribed`: the time is the user's own.
    `repeats`: how far amplitudes repeat, where they do not do so as far as was wanted, else 0.
    `ended_by`: what ended the search where it is not steady, "work" in steps of the FMU or
    "periods", at that `limit`; `change`: how far they moved at last.
    """

    settle_s: float
    bound: float
    last: tuple[Reading, ...]
    steady: bool
    prescribed: bool = False
    repeats: float = 0.0
    ended_by: str = ""
    limit: float = 0.0
    change: float = 0.0


def settle(
    probe: Probe,
    settings: Mapping[str, Scalar],
    wanted: float,
    work: float,
    longest_s: float = math.inf,
) -> Settled:
    """Double the time until amplitudes stand still: twice in a row, and dying away.

    That ends where they repeat no better, however long the FMU runs. Errors are relative as the
    probe tells; `wanted` is the largest that may be left.

    Args:
        probe: trial runs of the FMU, remembered.
        settings: values of FMU variables, by name.
        wanted: error that is wanted, and the one that is left.
        work: of the longest run, in steps.
        longest_s: longest time to settle, s. Looks that only confirm that a time within it does
            may lie beyond it.
    """
    times, observed, changes = [0.0], [probe.read(settings, 0.0)], [1.0]
    first_s, looked_s = _first_s(probe), 0.0
    most_s = min(longest_s, max(MOST_PERIODS / probe.fastest_hz, first_s))
    for k in itertools.count():
        time_s = first_s * 2.0**k
        # once a change is small enough, one doubling more shows whether the next one is so too
        last_s = most_s * (2.0 if changes[-1] <= QUIET * wanted else 1.0)
        if time_s > last_s * (1.0 + ROUNDED) or probe.work(settings, time_s) > work:
            break
        observed.append(probe.read(settings, time_s))
        changes.append(probe.changes(observed[-1], observed[-2]))
        times.append(time_s)
        if _stands(changes[1:], wanted) and _stands_far(probe, settings, time_s, wanted, work):
            return _earliest(probe, settings, times, observed, wanted)
        if probe.foreign and _lingers(changes[1:], wanted) and time_s >= LOOK_AGAIN * looked_s:
            looked_s, repeats = time_s, probe.repetition(settings, time_s)
            # also where noise is small enough: it would be so twice in a row by chance alone
            if changes[-1] <= NOISY * repeats:
                result = _as_it_repeats(probe, times, observed, repeats)
                return result if repeats > QUIET * wanted else replace(result, repeats=0.0)
    ended_by_work = probe.work(settings, time_s) > work
    return replace(
        _unsteady(times, observed, changes),
        ended_by="work" if ended_by_work else "periods",
        limit=work if ended_by_work else most_s * probe.fastest_hz,
        change=changes[-1],
    )


def _unsteady(times: list[float], observed: list[list[Reading]], changes: list[float]) -> Settled:
    """What there is where amplitudes do not stand still.

    Changes that die away bound what is left. Others bound nothing: a response that grows with time
    changes by half at every doubling, however far it is from its end.
    """
    dies = len(changes) > 3 and all(b <= DYING * a for a, b in pairwise(changes[-3:]))
    bound = SAFETY * changes[-1] if dies and changes[-1] < DYING else math.inf
    return Settled(settle_s=times[-1], bound=bound, last=tuple(observed[-1]), steady=False)


def _lingers(changes: list[float], wanted: float) -> bool:
    """Whether the last change is neither small enough nor on its way there."""
    if len(changes) < 3 or changes[-1] <= QUIET * wanted:
        return False
    return changes[-1] > DYING * min(changes[-3:-1])


def _as_it_repeats(
    probe: Probe, times: list[float], observed: list[list[Reading]], repeats: float
) -> Settled:
    """The shortest time tried from which on all amplitudes are as far apart as they repeat."""
    changes = [probe.changes(observed[-1], reading) for reading in observed]
    k = next(i for i in range(len(changes)) if max(changes[i:]) <= NOISY * repeats)
    errors = [probe.errors(reading, observed[-1]) for reading in observed[k:]]
    return Settled(
        settle_s=times[k],
        bound=SAFETY * max(repeats, *errors),
        last=tuple(observed[k]),
        steady=True,
        repeats=repeats,
    )


def settle_as_prescribed(
    probe: Probe, settings: Mapping[str, Scalar], settle_s: float, reference: Settled
) -> Settled:
    """What a user's own time to settle leaves, by what was seen once amplitudes stood still.

    Args:
        probe: trial runs of the FMU, remembered.
        settings: values of FMU variables, by name.
        settle_s: time before the first sample, s.
        reference: settling that is known to do.
    """
    here = probe.read(settings, settle_s)
    bound = SAFETY * probe.changes(reference.last, here) + reference.bound
    return replace(
        reference,
        settle_s=settle_s,
        bound=bound,
        last=tuple(here),
        prescribed=True,
    )


def _first_s(probe: Probe) -> float:
    """The first time tried: ten periods, a part of the windows; enough for a change to show."""
    least = min(10.0 / drive.fastest_hz for drive in probe.drives)
    lengths = [probe.length_s(drive) / 16.0 for drive in probe.drives]
    lines = [drive.fastest_hz for drive in probe.drives]
    moved = any(drive.approach is not None for drive in probe.drives)
    span_hz = max(lines) - min(lines)
    return max(least, *lengths, FIRST_BEATS / span_hz if moved and span_hz else 0.0)


def _stands(changes: list[float], wanted: float) -> bool:
    if len(changes) < 2 or max(changes[-2:]) > QUIET * wanted:
        return False
    return changes[-1] <= max(DYING * changes[-2], 0.05 * wanted)


def _stands_far(
    probe: Probe, settings: Mapping[str, Scalar], time_s: float, wanted: float, work: float
) -> bool:
    """Whether a look much later (not taken where it costs too much) shows no slow transient."""
    if FAR * probe.work(settings, time_s) > 0.4 * work:
        return True
    here, later = probe.read(settings, time_s), probe.read(settings, _far_s(probe, time_s))
    return probe.changes(later, here) <= 0.5 * wanted


def _far_s(probe: Probe, time_s: float) -> float:
    """A time about `FAR` times as long: whole windows later, where all drives have the same.

    Combinations of the tones that fold onto a tone then do so with the same phase, and what does
    not change is not taken for a transient. An odd number of windows, and no multiple of five: one
    in step with the doublings of ten periods would not show an oscillation that is so as well.
    """
    length_s = probe.common_length_s()
    if length_s is None:
        return FAR * time_s
    count = max(1, round((FAR - 1.0) * time_s / length_s))
    while count % 2 == 0 or count % 5 == 0:
        count += 1
    return time_s + count * length_s


def _earliest(
    probe: Probe,
    settings: Mapping[str, Scalar],
    times: list[float],
    observed: list[list[Reading]],
    wanted: float,
) -> Settled:
    """The shortest of the times tried that does, or one between it and the one before."""
    last = observed[-1]
    left = SAFETY * probe.changes(last, observed[-2])
    errors = [probe.changes(last, reading) for reading in observed]
    k = next(i for i, e in enumerate(errors) if max(errors[i:]) <= 0.5 * wanted)
    time_s, error = times[k], errors[k]
    if k > 0 and 0.0 < errors[k] < errors[k - 1]:
        part = math.log(max(errors[k - 1] / (0.3 * wanted), 1.0))
        part = min(part / math.log(errors[k - 1] / errors[k]), 1.0)
        between_s = _rounded_up(times[k - 1] + part * (times[k] - times[k - 1]))
        if between_s < 0.95 * times[k]:
            there = probe.changes(last, probe.read(settings, between_s))
            if there <= 0.5 * wanted:
                time_s, error = between_s, there
    return Settled(settle_s=time_s, bound=SAFETY * error + left, last=tuple(last), steady=True)


def _rounded_up(time_s: float) -> float:
    """A time with few digits, no shorter than that."""
    grain = 10.0 ** (math.floor(math.log10(time_s)) + 1 - DIGITS)
    return float(f"{math.ceil(time_s / grain * (1.0 - 1e-9)) * grain:.{DIGITS + 3}g}")


def settling_decision(settled: Settled) -> Decision:
    """The decision on what was seen.

    Args:
        settled: settling time with what it rests on.
    """
    basis = Basis.WATCHED if settled.steady else Basis.UNSTEADY
    if settled.steady and settled.prescribed:
        basis = Basis.PRESCRIBED
    elif settled.steady and settled.settle_s == 0.0:
        basis = Basis.STEADY
    numbers: dict[str, Scalar] = {"settle_s": settled.settle_s}
    if not settled.steady:
        numbers |= {
            "ended_by": settled.ended_by,
            "limit": settled.limit,
            "change": settled.change,
        }
    if settled.repeats:
        basis, numbers["repeats"] = Basis.REPEATED, settled.repeats
    return Decision(
        kind=Kind.SETTLING,
        basis=basis,
        bound=settled.bound,
        numbers=numbers,
        forced=settled.prescribed,
    )
