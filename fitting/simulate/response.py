"""One drive through an FMU, from a wanted accuracy to amplitudes, spectrum, lines and traces."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from itertools import pairwise

import numpy as np

from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.fmu.description import FmuVariable
from fitting.fmu.pool import FmuWorkers
from fitting.fmu.runs import Run, row_times
from fitting.signal.combinations import USUAL_ORDER, expected_hz, mixed_lines
from fitting.signal.grid import band_on
from fitting.signal.spectrum import Band, amplitude_spectrum, plan_band
from fitting.signal.tones import ToneFit, exact, fit_tones, tones_in_words, unit_hint
from fitting.signal.window import longest_window_s
from fitting.simulate.batch import Workers
from fitting.simulate.budget import Kind
from fitting.simulate.drive import Drive
from fitting.simulate.planner import MOST_WORK, DrivePlan, PlanOptions, plan_drives
from fitting.simulate.probe import ORDERS, attempt, knowledge_of
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.units import convert, same_kind

#: Wanted accuracy where none is given.
USUAL_ACCURACY = 1e-6
TRACE_BEATS = 2
TRACE_COLUMNS = 400
#: Samples of the trace in a column of the drawn envelope, spread evenly over one period of the
#: carrier: a prime, so that any number of periods from column to column does it.
COLUMN_SAMPLES = 41
CARRIER_PERIODS = 6
CARRIER_SAMPLES = 40  # per period
SPURIOUS = 1e-6  # of the largest peak: more than that besides the tones needs a reason
SMALL = 1e-8  # of the largest peak: what is less than that is rounding
EPS = float(np.finfo(float).eps)
ROUNDING = 10.0 * EPS  # of the largest value: lines of an FFT that are nothing else
#: Samples of the look, and those in a period of the fastest tone: no ratio of small numbers.
LONG_SAMPLES, PER_PERIOD = 8192, 4.618034
#: Bins on both sides of a tone that its own taper fills.
TAPERED = 3
#: A line that is less than this part of what amplitudes may be off by does not explain it.
EXPLAINS = 0.02
#: Parameters that are tried for a missing damping, their values, for rates as parts of the line's
#: frequency, and what is left of a line that decays.
MOST_TRIED, TRIED, TRIED_HZ, DECAYED = 12, 1e-3, 1e-4, 0.5
#: A distance is that of a parameter where the two are the same within this part of a bin.
SAME = 0.5


@dataclass(frozen=True)
class Shown:
    """What is to be shown of a drive; None: some common periods, samples by the band."""

    window_s: float | None = None
    samples: int | None = None


@dataclass(frozen=True)
class Trace:
    """Values (samples, outputs) at times (samples,) in s."""

    times_s: FloatArray
    values: FloatArray


@dataclass(frozen=True, kw_only=True)
class Spectrum:
    """Amplitudes (bins, outputs), V peak for volts, at frequencies (bins,) in Hz, ascending.

    `window_s` in `samples` samples. `coherent`: bins hold the tones exactly, those of `bins`; else
    the spectrum is tapered. `rounding`: share of the largest peak below which a line may be the
    rounding of the time.
    """

    frequencies_hz: FloatArray
    amplitudes: FloatArray
    window_s: float
    samples: int
    coherent: bool
    bins: tuple[int, ...]
    rounding: float


@dataclass(frozen=True)
class MixedLine:
    """A line at sum_i factors[i] f_i of the tones, with its amplitudes (outputs,)."""

    factors: tuple[int, ...]
    frequency_hz: float
    amplitudes: FloatArray


class RemainderKind(StrEnum):
    """What there is apart from the tones."""

    UNEXPLAINED = "unexplained"  # a line at no combination of the tones
    UNKNOWN = "unknown"  # what a fit leaves, of which no frequency is known
    COMBINATION = "combination"
    SMALL = "small"  # within the plan's promise: rounding, or the rest of a transient
    ROUNDING = "rounding"


@dataclass(frozen=True)
class Remainder:
    """The most that a response holds apart from the tones, as a share of the largest peak.

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


@dataclass(frozen=True, kw_only=True)
class DriveResponse:
    """What came of a drive.

    `peaks` (tones, outputs) are the amplitudes that the plan promises, in the outputs' units, V
    peak for volts; `plan` has how, and how accurate they are. `beating` is sampled so that the
    samples fill the envelope (None for a single tone), `carrier` resolves some periods. `lines`
    are those at combinations of the tones that stand out of rounding, by order and frequency.
    `constants`: values of outputs that do not oscillate, by name. `other_line`: that keeps
    amplitudes from standing still, where they do not and there is one.
    """

    drive: Drive
    plan: DrivePlan
    peaks: FloatArray
    spectrum: Spectrum
    lines: tuple[MixedLine, ...]
    remainder: Remainder
    other_line: Remainder | None
    beating: Trace | None
    carrier: Trace
    constants: Mapping[str, float]

    @property
    def accuracy(self) -> float:
        """The promise: largest relative error of a peak."""
        return self.plan.promised

    @property
    def steady(self) -> bool:
        """Whether the promise is what was wanted, and nothing is there that it does not explain."""
        return self.plan.budget.kept and self.remainder.explained


def plan_drive(  # noqa: PLR0913 - keywords that all have defaults
    workers: FmuWorkers,
    drive: Drive,
    accuracy: float | None = None,
    *,
    settle_s: float | None = None,
    annotation: AccuracyAnnotation | None = None,
    shown: Shown | None = None,
    work: float | None = None,
) -> DrivePlan:
    """Plan one drive of an FMU.

    Args:
        workers: the running FMU.
        drive: start values in the FMU's units, tones in Hz, outputs; what it sets is left as it is.
        accuracy: wanted largest relative error of an amplitude, between 0 and 1; None: 1e-6, or
            what the FMU can give.
        settle_s: time before sampling in s; None: found by watching the amplitudes. What a given
            time leaves of the transient is a part of the promise.
        annotation: how the FMU is made accurate, and reductions to force or forbid, where it is not
            to be taken from the FMU's own annotation.
        shown: window in s and number of samples of the spectrum.
        work: communication steps and substeps of a run at most; None: some twenty seconds.

    Raises:
        BadInput: tones and window do not go together, no output oscillates, names that the FMU
            does not have.
        FmuFailure: the FMU failed.
    """
    _band(drive, shown or Shown())  # what cannot be shown is refused before it is planned
    options = PlanOptions(
        settle_s=settle_s,
        fixed=frozenset(drive.start_values),
        usual=accuracy is None,
        work=MOST_WORK if work is None else work,
    )
    known = knowledge_of(workers.description, annotation)
    wanted = USUAL_ACCURACY if accuracy is None else accuracy
    return plan_drives((drive,), wanted, workers, known, options)


def respond(workers: Workers, plan: DrivePlan, shown: Shown | None = None) -> DriveResponse:
    """Run and read what was planned for one drive, and what is shown with it.

    Args:
        workers: processes that run the FMU.
        plan: settings, settling and windows, with what they promise.
        shown: window in s and number of samples of the spectrum.

    Returns:
        Amplitudes at the tones with the plan that promises them, spectrum, lines at combinations
        of the tones, traces. Where the accuracy cannot be promised, the plan states what can.
    """
    drive, reading, shown = plan.drives[0], plan.readings[0], shown or Shown()
    band, coherent = _band(drive, shown)
    run = drive.run_at(plan.settings, plan.settle_s, band.step_s, band.samples)
    planned, values = workers.run([*plan.runs, run])
    peaks = plan.read(planned)
    beating, carrier = _traces(workers, plan)
    # the phase of a tone is known to the rounding of the time
    end_s = plan.settle_s + float(band.window_s)
    rounding = 2.0 * math.pi * max(drive.tones_hz) * end_s * EPS
    remainder = _remainder(plan, band if coherent else None, run, values, rounding)
    other = None if plan.settles else strongest_other_line(workers, plan)
    if other is not None and (remainder.explained or other.share > remainder.share):
        remainder = other
    frequencies_hz = band.frequencies_hz()
    amplitudes = amplitude_spectrum(values if coherent else values * hann(len(values)))
    upwards = 1 if frequencies_hz[0] <= frequencies_hz[-1] else -1  # odd zones are seen mirrored
    spectrum = Spectrum(
        frequencies_hz=frequencies_hz[::upwards],
        amplitudes=amplitudes[::upwards],
        window_s=float(band.window_s),
        samples=band.samples,
        coherent=coherent,
        bins=band.bins(),
        rounding=rounding,
    )
    # where an output does not oscillate no line is large
    oscillating = np.where(reading.constant, np.inf, peaks)
    means = zip(drive.outputs, reading.constant, reading.mean.tolist(), strict=True)
    return DriveResponse(
        drive=replace(drive, start_values={**drive.start_values, **plan.settings}),
        plan=plan,
        peaks=peaks,
        spectrum=spectrum,
        lines=_mixed_lines(drive, spectrum, oscillating, plan.promised),
        remainder=remainder,
        other_line=other,
        beating=beating,
        carrier=carrier,
        constants={name: mean for name, constant, mean in means if constant},
    )


# -- the spectrum ---------------------------------------------------------------------------------


def _band(drive: Drive, shown: Shown) -> tuple[Band, bool]:
    """Where the spectrum is seen, and whether it holds whole periods of every tone."""
    band = plan_band(
        drive.tones_hz,
        longest_s=longest_window_s(drive.tones_hz),
        window_s=shown.window_s,
        samples=shown.samples,
    )
    coherent, result = band is not None, band or _rounded_band(drive.tones_hz, shown)
    if not drive.grid.step_s:
        return result, coherent
    longest_s = longest_window_s(drive.tones_hz)
    return band_on(drive.grid, drive.tones_hz, longest_s, result, shown != Shown()), True


def _rounded_band(tones: tuple[float, ...], shown: Shown) -> Band:
    """A band for tones without a common period, rounded to what the window resolves."""
    gaps = [abs(a - b) for i, a in enumerate(tones) for b in tones[:i]]
    digits = math.ceil(math.log10(10.0 / min(*gaps, *tones)))
    rounded = tuple(float(round(exact(tone), digits)) for tone in tones)
    window_s = shown.window_s or 10.0**digits
    with suppress(BadInput):  # it names rounded tones, which were not written
        band = plan_band(rounded, longest_s=math.inf, window_s=window_s, samples=shown.samples)
        if band is not None:
            return band
    raise BadInput(
        f"{tones_in_words(tones)}: no common period within {longest_window_s(tones):g} s, and no "
        f"sampling of {window_s:g} s keeps them within one band{unit_hint(tones)}"
    )


def _remainder(
    plan: DrivePlan, band: Band | None, run: Run, values: FloatArray, rounding: float
) -> Remainder:
    """What there is besides the tones, against what a steady response of that accuracy has.

    By the bins of a band with whole periods of every tone; else (None) by a fit of tones and
    combinations, of which the rest has no known frequency.
    """
    drive, largest = plan.drives[0], np.max(np.abs(values), axis=0)
    if band is None:
        times_s = np.array(row_times(run))
        result, lines_hz = fit_tones(drive.tones_hz, times_s, values), drive.tones_hz
        with suppress(BadInput):  # as many combinations as the samples distinguish
            for order in ORDERS[1:]:
                more_hz = (*drive.tones_hz, *expected_hz(drive.tones_hz, order))
                result, lines_hz = fit_tones(more_hz, times_s, values), more_hz
        peaks, combined = np.split(result.amplitudes, [len(drive.tones_hz)])
        unexplained = np.max(np.abs(result.rest), axis=0, keepdims=True)
        combined_hz, unexplained_hz = np.array(lines_hz[len(peaks) :]), np.array([math.nan])
    else:
        tones, mixed = list(band.bins()), [k for k in band.combination_bins() if k]
        rest = np.setdiff1d(np.arange(1, band.samples // 2 + 1), [*tones, *mixed])
        a, f = amplitude_spectrum(values), band.frequencies_hz()
        peaks, unexplained, combined = a[tones], a[rest], a[mixed]
        unexplained_hz, combined_hz = f[rest], f[mixed]
    peak = np.maximum(peaks.max(axis=0), np.finfo(float).tiny)
    limit, most = max(SPURIOUS, rounding, plan.promised), 0.0
    unknown = RemainderKind.UNKNOWN if band is None else RemainderKind.UNEXPLAINED
    for kind, lines, at_hz in (
        (unknown, unexplained, unexplained_hz),
        (RemainderKind.COMBINATION, combined, combined_hz),
    ):
        # as parts of the largest peak of their output, less the rounding of its samples
        parts = np.maximum(lines - ROUNDING * largest, 0.0) / peak
        parts = np.where(plan.readings[0].constant, 0.0, parts)
        share = float(np.max(parts, initial=0.0))
        if share > limit:
            return Remainder(kind, share, float(at_hz[int(np.argmax(parts.max(axis=1)))]))
        most = max(most, share)
    is_rounding = most <= max(SMALL, rounding)
    return Remainder(RemainderKind.ROUNDING if is_rounding else RemainderKind.SMALL, most)


def _mixed_lines(
    drive: Drive, spectrum: Spectrum, peaks: FloatArray, promised: float
) -> tuple[MixedLine, ...]:
    """Lines at combinations of the tones that stand out of rounding.

    Those within the band that the spectrum shows, up to sum |k_i| = 9, larger than 1e-6 of the
    output's largest peak and than what is promised of it; none where the bins do not hold the tones
    exactly.
    """
    if not spectrum.coherent:
        return ()
    tones = [exact(f) for f in drive.tones_hz]
    limit = max(SPURIOUS, spectrum.rounding, promised) * peaks.max(axis=0)
    first, count = float(spectrum.frequencies_hz[0]), spectrum.frequencies_hz.size
    step = (float(spectrum.frequencies_hz[-1]) - first) / (count - 1)
    taken = set(drive.tones_hz)
    result = []
    for factors in sorted(mixed_lines(len(tones), USUAL_ORDER), key=lambda k: sum(map(abs, k))):
        f = float(sum(k * tone for k, tone in zip(factors, tones, strict=True)))
        if f < 0.0:
            f, factors = -f, tuple(-k for k in factors)
        at = round((f - first) / step)
        if f in taken or not 0 <= at < count or abs(first + at * step - f) > 1e-3 * step:
            continue
        taken.add(f)
        if np.any(spectrum.amplitudes[at] > limit):
            result.append(MixedLine(factors, f, spectrum.amplitudes[at]))
    return tuple(sorted(result, key=lambda line: (sum(map(abs, line.factors)), line.frequency_hz)))


# -- traces ---------------------------------------------------------------------------------------


def _traces(workers: Workers, plan: DrivePlan) -> tuple[Trace | None, Trace]:
    """The envelope of the beating of several tones, and some periods of the carrier."""
    drive, tones = plan.drives[0], sorted(plan.drives[0].tones_hz)
    middle_hz, settle_s = sum(tones) / len(tones), plan.settle_s

    def trace(settle_s: float, step_s: float, samples: int) -> Trace:
        run = drive.run_at(plan.settings, settle_s, step_s, samples)
        return Trace(np.array(row_times(run)), workers.run([run])[0])

    beating, length_s = None, CARRIER_PERIODS / middle_hz
    if len(tones) > 1:
        beats_s = TRACE_BEATS / min(b - a for a, b in pairwise(tones))
        periods = max(1, round(beats_s * middle_hz / TRACE_COLUMNS))
        if periods % COLUMN_SAMPLES == 0:
            periods += 1
        step_s = periods / (COLUMN_SAMPLES * middle_hz)
        beating = trace(settle_s, step_s, math.ceil(beats_s / step_s) + 1)
        # periods around the maximum of the envelope of the first output that oscillates, but not
        # at the very first samples, which have nothing before them
        output = plan.readings[0].constant.index(False)
        at_s = float(beating.times_s[int(np.argmax(np.abs(beating.values[:, output])))])
        settle_s = max(settle_s, at_s - length_s / 2)
    samples = CARRIER_PERIODS * CARRIER_SAMPLES + 1
    return beating, trace(settle_s, length_s / (samples - 1), samples)


# -- what keeps amplitudes from standing still -----------------------------------------------------
#
# Windows of whole periods of the tones alone see a line close to a tone as an amplitude that
# changes: a sideband of a pump for ever, a free oscillation until it has died away.


@dataclass(frozen=True)
class Sideband:
    """A line at a tone plus or minus (`sign`) a parameter of the FMU, both by name."""

    tone: str
    sign: str
    parameter: str


def strongest_other_line(workers: Workers, plan: DrivePlan) -> Remainder | None:
    """The strongest line apart from the tones, None where none explains what does not stand still.

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
    # between bins by a parabola through three logarithms
    left, middle, right = np.log(np.maximum(share[k - 1 : k + 2, output], np.finfo(float).tiny))
    bend = left - 2.0 * middle + right
    at_hz = (k + (float(0.5 * (left - right) / bend) if bend < 0.0 else 0.0)) / rate_hz
    return Remainder(RemainderKind.UNEXPLAINED, top, at_hz, 1.0 / rate_hz)


def missing_damping(
    workers: Workers, plan: DrivePlan, line: Remainder, variables: Mapping[str, FmuVariable]
) -> tuple[str, ...]:
    """Parameters that are 0 and, where they are not, let a line apart from the tones decay.

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
        shares = attempt(partial(_shares, workers, plan, {**plan.settings, name: tried}))
        if shares is None:  # no such value
            continue
        share, rate_hz = shares
        k = round(line.at_hz * rate_hz)
        if float(np.max(share[max(0, k - TAPERED) : k + TAPERED + 1])) < DECAYED * line.share:
            result.append(name)
    return tuple(result)


def _shares(
    workers: Workers, plan: DrivePlan, settings: Mapping[str, Scalar]
) -> tuple[FloatArray, float]:
    """Lines (bins, outputs) besides the tones over the largest peak of each output; 1/bin in s."""
    drive = plan.drives[0]
    step_s = 1.0 / (PER_PERIOD * drive.fastest_hz)
    run = drive.run_at(settings, plan.settle_s, step_s, LONG_SAMPLES)
    values = workers.run([run])[0][-LONG_SAMPLES:]
    result = ToneFit(drive.tones_hz, np.array(row_times(run))[-LONG_SAMPLES:])(values)
    tapered = 2.0 * np.abs(np.fft.rfft(result.rest * hann(LONG_SAMPLES), axis=0)) / LONG_SAMPLES
    share = tapered / np.maximum(result.amplitudes.max(axis=0), np.finfo(float).tiny)
    rate_hz = LONG_SAMPLES * run.sample_step_s
    for tone in drive.tones_hz:
        k = round(tone * rate_hz)
        share[max(0, k - TAPERED) : k + TAPERED + 1] = 0.0
    share[:TAPERED] = 0.0
    return share, rate_hz


def hann(samples: int) -> FloatArray:
    """A taper (samples, 1) of mean one, under which a line is right at the middle of a bin.

    Args:
        samples: number of samples.
    """
    return np.asarray(1.0 - np.cos(2.0 * np.pi * np.arange(samples) / samples))[:, np.newaxis]


def sideband_of(
    line: Remainder,
    tones: Mapping[str, float],
    values: Mapping[str, Scalar],
    variables: Mapping[str, FmuVariable],
) -> Sideband | None:
    """The parameter of the FMU, a frequency, whose value is the distance of a line from a tone.

    Args:
        line: apart from the tones.
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
