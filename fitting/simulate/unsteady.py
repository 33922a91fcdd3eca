"""What keeps amplitudes from standing still: the strongest line beside the tones, in a long look.

Windows of whole periods of the tones alone see a line close to a tone as an amplitude that changes:
a sideband of a pump for ever, a free oscillation until it has died away.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from fitting.fmu import FmuVariable, row_times
from fitting.signal.tones import ToneFit
from fitting.simulate.batch import Workers
from fitting.simulate.budget import Kind
from fitting.simulate.drive_plan import DrivePlan
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import FmuFailure, NoAnswer
from fitting.text.units import convert, same_kind

#: Samples of the look, and those in a period of the fastest tone: no ratio of small numbers.
SAMPLES, PER_PERIOD = 8192, 4.618034
#: Bins on both sides of a tone that its own taper fills.
TAPERED = 3
#: A line that is less than this part of what amplitudes may be off by does not explain it.
EXPLAINS = 0.02
#: Parameters that are tried for a missing damping, their values, for rates as parts of the line's
#: frequency, and what is left of a line that decays.
MOST_TRIED, TRIED, TRIED_HZ, DECAYED = 12, 1e-3, 1e-4, 0.5
#: A distance is that of a parameter where the two are the same within this part of a bin.
SAME = 0.5


class RemainderKind(StrEnum):
    """What there is beside the tones."""

    UNEXPLAINED = "unexplained"  # a line at no combination of the tones
    UNKNOWN = "unknown"  # what a fit leaves, of which no frequency is known
    COMBINATION = "combination"
    SMALL = "small"  # within the plan's promise: rounding, or the rest of a transient
    ROUNDING = "rounding"


@dataclass(frozen=True)
class Remainder:
    """The most that a response holds beside the tones, as a share of the largest peak.

    `at_hz`: where that is, `bin_hz`: to how much that is known, Hz (NaN: not known).
    """

    kind: RemainderKind
    share: float
    at_hz: float = math.nan
    bin_hz: float = math.nan

    @property
    def explained(self) -> bool:
        """Whether a steady response to the tones has that."""
        return self.kind not in (RemainderKind.UNEXPLAINED, RemainderKind.UNKNOWN)


@dataclass(frozen=True)
class Sideband:
    """A line at a tone plus or minus (`sign`) a parameter of the FMU, both by name."""

    tone: str
    sign: str
    parameter: str


def strongest_other_line(workers: Workers, plan: DrivePlan) -> Remainder | None:
    """The strongest line beside the tones, None where none explains what does not stand still.

    Args:
        workers: processes that run the FMU.
        plan: of one drive, whose amplitudes did not stand still.
    """
    [settling] = plan.budget.of(Kind.SETTLING)
    share, rate_hz = _shares(workers, plan, plan.settings)
    k, output = divmod(int(np.argmax(share)), share.shape[1])
    top = float(share[k, output])
    moved = float(settling.numbers.get("change", plan.promised))
    if not (TAPERED <= k < len(share) - 1 and top > EXPLAINS * moved):
        return None
    at_hz = (k + _beyond(share[k - 1 : k + 2, output])) / rate_hz
    return Remainder(RemainderKind.UNEXPLAINED, top, at_hz, 1.0 / rate_hz)


def missing_damping(
    workers: Workers, plan: DrivePlan, line: Remainder, variables: Mapping[str, FmuVariable]
) -> tuple[str, ...]:
    """Parameters that are 0 and, where they are not, let a line beside the tones decay.

    Each is tried: a rate at a ten-thousandth of the line's frequency, others at a thousandth.

    Args:
        workers: processes that run the FMU.
        plan: of one drive, whose amplitudes did not stand still.
        line: that does not decay.
        variables: of the FMU, by name.
    """
    drive, result = plan.drives[0], []
    values = {**drive.start_values, **plan.settings}
    zeros = [
        name
        for name, variable in variables.items()
        if (variable.causality, variable.kind) == ("parameter", "Real")
        and name not in drive.names
        and values.get(name, variable.start) == 0.0
    ]
    for name in zeros[:MOST_TRIED]:
        unit = variables[name].unit or "1"
        rate = same_kind(unit, "Hz")
        tried = convert(TRIED_HZ * line.at_hz, "Hz", unit, where=name) if rate else TRIED
        try:
            share, rate_hz = _shares(workers, plan, {**plan.settings, name: tried})
        except NoAnswer:
            raise
        except FmuFailure:  # no such value
            continue
        k = round(line.at_hz * rate_hz)
        if float(np.max(share[max(0, k - TAPERED) : k + TAPERED + 1])) < DECAYED * line.share:
            result.append(name)
    return tuple(result)


def _shares(
    workers: Workers, plan: DrivePlan, settings: Mapping[str, Scalar]
) -> tuple[FloatArray, float]:
    """Lines (bins, outputs) beside the tones over the largest peak of each output; 1/bin in s."""
    drive = plan.drives[0]
    step_s = 1.0 / (PER_PERIOD * drive.fastest_hz)
    run = drive.run_at(settings, plan.settle_s, step_s, SAMPLES)
    values = workers.run([run])[0][-SAMPLES:]
    result = ToneFit(drive.tones_hz, np.array(row_times(run))[-SAMPLES:])(values)
    share = _tapered(result.rest) / np.maximum(result.amplitudes.max(axis=0), np.finfo(float).tiny)
    rate_hz = SAMPLES * run.sample_step_s
    for tone in drive.tones_hz:
        k = round(tone * rate_hz)
        share[max(0, k - TAPERED) : k + TAPERED + 1] = 0.0
    share[:TAPERED] = 0.0
    return share, rate_hz


def _tapered(values: FloatArray) -> FloatArray:
    """Amplitudes (bins, outputs) under a Hann window, right at the middle of a bin."""
    taper = 1.0 - np.cos(2.0 * np.pi * np.arange(len(values)) / len(values))
    return np.asarray(
        2.0 * np.abs(np.fft.rfft(values * taper[:, np.newaxis], axis=0)) / len(values)
    )


def _beyond(three: FloatArray) -> float:
    """Bins from the middle one to the line, by the logarithms of three amplitudes."""
    left, middle, right = np.log(np.maximum(three, np.finfo(float).tiny))
    bend = left - 2.0 * middle + right
    return float(0.5 * (left - right) / bend) if bend < 0.0 else 0.0


def sideband_of(
    line: Remainder,
    tones: Mapping[str, float],
    values: Mapping[str, Scalar],
    variables: Mapping[str, FmuVariable],
) -> Sideband | None:
    """The parameter of the FMU, a frequency, whose value is the distance of a line from a tone.

    Args:
        line: beside the tones.
        tones: their frequencies by name, Hz.
        values: start values, by name.
        variables: of the FMU, by name.

    Returns:
        None where no parameter has that value, or more than one.
    """
    result = []
    for name, variable in variables.items():
        value = values.get(name, variable.start)
        frequency = variable.unit is not None and same_kind(variable.unit, "Hz")
        if name in tones or variable.causality != "parameter" or not frequency:
            continue
        hz = convert(float(value or 0.0), str(variable.unit), "Hz", where=name)
        for tone, tone_hz in tones.items():
            distance = line.at_hz - tone_hz
            if hz > TAPERED * line.bin_hz and abs(abs(distance) - hz) < SAME * line.bin_hz:
                result.append(Sideband(tone, "+" if distance > 0.0 else "−", name))
    return result[0] if len(result) == 1 else None
