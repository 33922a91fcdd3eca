"""How long a response takes to settle: its tones watched while the time doubles."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

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
#: Doublings after which changes that do not die away may be combinations seen as tones.
MIXING = 5
#: Digits of a time to settle: no plan depends on the last bit of a reading.
DIGITS = 3
#: Beats between where a moved tone comes from and where it goes, in the first time tried.
FIRST_BEATS = 0.25


@dataclass(frozen=True)
class Settled:
    """The decision on a time to settle, what was read at the end, and with which settings."""

    decision: Decision
    last: tuple[Reading, ...]
    settings: Mapping[str, Scalar]

    @property
    def settle_s(self) -> float:
        """Time before the first sample, s."""
        return float(self.decision.numbers["settle_s"])

    @property
    def bound(self) -> float:
        """Relative error that is left."""
        return self.decision.bound

    @property
    def steady(self) -> bool:
        """Whether the amplitudes stood still at last."""
        return self.decision.basis is not Basis.UNSTEADY

    @property
    def repeats(self) -> float:
        """How far amplitudes repeat, where they do not do so as far as was wanted, else 0."""
        return float(self.decision.numbers.get("repeats", 0.0))


def _settled(basis: Basis, settle_s: float, bound: float, **numbers: Scalar) -> Decision:
    if basis is Basis.WATCHED and settle_s == 0.0:
        basis = Basis.STEADY
    return Decision(Kind.SETTLING, basis, bound, numbers={"settle_s": settle_s, **numbers})


def settle(
    probe: Probe,
    settings: Mapping[str, Scalar],
    wanted: float,
    work: float,
    longest_s: float = math.inf,
    *,
    mixes: bool = True,
) -> Settled:
    """Double the time until amplitudes stand still: twice in a row, and dying away.

    That ends where they repeat no better, however long the FMU runs. Errors are relative as the
    probe defines; `wanted` is the largest that may be left.

    Args:
        probe: trial runs of the FMU, remembered.
        settings: values of FMU variables, by name.
        wanted: error that is wanted.
        work: of the longest run, in steps.
        longest_s: longest time to settle, s. Looks that only confirm that a time within it does
            may lie beyond it.
        mixes: whether combinations of several tones may be seen as tones.
    """
    # ten periods, a part of the windows, and where a tone is moved enough of its beat with where
    # it came from: less shows no change of what has not settled
    lines = [drive.fastest_hz for drive in probe.drives]
    span_hz = max(lines) - min(lines)
    moved = any(drive.approach is not None for drive in probe.drives)
    first_s = max(
        min(10.0 / line for line in lines),
        *(window.length_s / 16.0 for window in probe.windows(0.0)),
        FIRST_BEATS / span_hz if moved and span_hz else 0.0,
    )
    most_s = min(longest_s, max(MOST_PERIODS / probe.fastest_hz, first_s))
    times, observed, changes = [0.0], [probe.read(settings, 0.0)], [1.0]
    probed_s, moves_later = 0.0, False
    mixes = mixes and any(len(drive.tones_hz) > 1 for drive in probe.drives)
    for k in itertools.count():
        time_s = first_s * 2.0**k
        # once a change is small enough, one doubling more shows whether the next one is so too
        last_s = most_s * (2.0 if changes[-1] <= QUIET * wanted else 1.0)
        if time_s > last_s * (1.0 + ROUNDED) or probe.work(settings, time_s) > work:
            break
        observed.append(probe.read(settings, time_s))
        changes.append(probe.changes(observed[-1], observed[-2]))
        times.append(time_s)
        here, before = changes[-1], changes[-3:-1]
        is_quiet = k >= 1 and max(changes[-2:]) <= QUIET * wanted
        if is_quiet and here <= max(DYING * changes[-2], 0.05 * wanted):
            # a look much later, where it is affordable, shows no slow transient either
            if FAR * probe.work(settings, time_s) <= 0.4 * work:
                later = probe.read(settings, _later_s(probe, time_s))
                moves_later = probe.changes(later, observed[-1]) > 0.5 * wanted
            if not moves_later:
                decision = _earliest(probe, settings, times, observed, wanted)
                return Settled(decision, tuple(observed[-1]), settings)
        # a change that is neither small enough nor on its way there may be noise of the FMU's own
        lingers = k >= 2 and here > max(QUIET * wanted, DYING * min(before))
        if lingers and mixes and k >= MIXING:
            # combinations that are seen as tones add to these with a phase of their own every time
            separate = probe.separating(settings, time_s, QUIET * wanted)
            if separate is not None:
                return settle(separate, settings, wanted, work, longest_s, mixes=False)
            mixes = False
        if not (probe.known.is_foreign and lingers) or time_s < LOOK_AGAIN * probed_s:
            continue
        probed_s = time_s
        repeats = probe.repetition(settings, time_s)
        # also where noise is small enough: it would be so twice in a row by chance alone
        if here <= NOISY * repeats:
            k, decision = _as_it_repeats(probe, times, observed, repeats, wanted)
            return Settled(decision, tuple(observed[k]), settings)
    # Changes that die away bound what is left. Others bound nothing: a response that grows with
    # time changes by half at every doubling, however far it is from its end.
    dies = len(changes) > 3 and all(b <= DYING * a for a, b in itertools.pairwise(changes[-3:]))
    bound = SAFETY * changes[-1] if dies and changes[-1] < DYING else math.inf
    ended_by, limit = "periods", most_s * probe.fastest_hz
    if probe.work(settings, time_s) > work:
        ended_by, limit = "work", work
    decision = _settled(
        Basis.UNSTEADY, times[-1], bound, ended_by=ended_by, limit=limit, change=changes[-1]
    )
    return Settled(decision, tuple(observed[-1]), settings)


def settle_as_prescribed(
    probe: Probe, settings: Mapping[str, Scalar], settle_s: float, reference: Settled
) -> Settled:
    """What a user's own time to settle leaves, compared with amplitudes that stood still.

    Args:
        probe: trial runs of the FMU, remembered.
        settings: values of FMU variables, by name.
        settle_s: time before the first sample, s.
        reference: settling that is known to do.
    """
    here, known = probe.read(settings, settle_s), reference.decision
    limited = known.basis in (Basis.UNSTEADY, Basis.REPEATED)
    decision = replace(
        known,
        basis=known.basis if limited else Basis.PRESCRIBED,
        bound=SAFETY * probe.changes(reference.last, here) + known.bound,
        numbers={**known.numbers, "settle_s": settle_s},
        forced=True,
    )
    return Settled(decision, tuple(here), settings)


def _as_it_repeats(
    probe: Probe, times: list[float], observed: list[list[Reading]], repeats: float, wanted: float
) -> tuple[int, Decision]:
    """The shortest time tried from which on all amplitudes are as far apart as they repeat."""
    changes = [probe.changes(observed[-1], reading) for reading in observed]
    k = next(i for i in range(len(changes)) if max(changes[i:]) <= NOISY * repeats)
    bound = SAFETY * max(repeats, *(probe.errors(each, observed[-1]) for each in observed[k:]))
    if repeats > QUIET * wanted:
        return k, _settled(Basis.REPEATED, times[k], bound, repeats=repeats)
    return k, _settled(Basis.WATCHED, times[k], bound)


def _later_s(probe: Probe, time_s: float) -> float:
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
) -> Decision:
    """The shortest of the times tried that does, or one between it and the one before."""
    last = observed[-1]
    left = SAFETY * probe.changes(last, observed[-2])
    errors = [probe.changes(last, reading) for reading in observed]
    k = next(i for i in range(len(errors)) if max(errors[i:]) <= 0.5 * wanted)
    time_s, error = times[k], errors[k]
    if k > 0 and 0.0 < errors[k] < errors[k - 1]:
        # a transient that decays exponentially; the time in few digits, upwards
        part = math.log(max(errors[k - 1] / (0.3 * wanted), 1.0))
        part = min(part / math.log(errors[k - 1] / errors[k]), 1.0)
        between_s = times[k - 1] + part * (times[k] - times[k - 1])
        grain = 10.0 ** (math.floor(math.log10(between_s)) + 1 - DIGITS)
        between_s = float(f"{math.ceil(between_s / grain * (1.0 - 1e-9)) * grain:.{DIGITS + 3}g}")
        if between_s < 0.95 * times[k]:
            there = probe.changes(last, probe.read(settings, between_s))
            if there <= 0.5 * wanted:
                time_s, error = between_s, there
    return _settled(Basis.WATCHED, time_s, SAFETY * error + left)
