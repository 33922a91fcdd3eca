"""One drive through an FMU, from a wanted accuracy to amplitudes, spectrum, lines and traces."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fitting.fmu import Run, row_times
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.signal.combinations import USUAL_ORDER, mixed_lines
from fitting.signal.grid import band_on
from fitting.signal.spectrum import Band, amplitude_spectrum, plan_band
from fitting.signal.tones import exact, fit_tones, tones_in_words, unit_hint
from fitting.signal.window import LONGEST_WINDOW_S
from fitting.simulate.batch import Workers
from fitting.simulate.drive import Drive
from fitting.simulate.drive_plan import DrivePlan, constants_of
from fitting.simulate.knowledge import FmuLike, knowledge_of
from fitting.simulate.planner import MOST_WORK, PlanOptions, plan_drives
from fitting.simulate.unsteady import Remainder, RemainderKind, strongest_other_line
from fitting.text.arrays import BoolArray, FloatArray
from fitting.text.errors import BadInput

#: Wanted accuracy where none is given.
USUAL_ACCURACY = 1e-6
TRACE_BEATS = 2
TRACE_COLUMNS = 400
#: Samples of the trace in a column of the drawn envelope, spread evenly over one period of the
#: carrier: a prime, so that any number of periods from column to column does it.
COLUMN_SAMPLES = 41
CARRIER_PERIODS = 6
CARRIER_SAMPLES = 40  # per period
BESIDE = 1e-6  # of the largest peak: what is more than that beside the tones needs a reason
SMALL = 1e-8  # of the largest peak: what is less than that is rounding
EPS = float(np.finfo(float).eps)
ROUNDING = 10.0 * EPS  # of the largest value: lines of an FFT that are nothing else


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


@dataclass(frozen=True, kw_only=True)
class DriveResponse:
    """What came of a drive.

    `peaks` (tones, outputs) are the amplitudes that the plan promises, in the outputs' units, V
    peak for volts; `plan` says how, and how accurate they are. `beating` is sampled so that the
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
    workers: FmuLike,
    drive: Drive,
    accuracy: float | None = None,
    *,
    settle_s: float | None = None,
    annotation: AccuracyAnnotation | None = None,
    shown: Shown | None = None,
    work: float | None = None,
) -> DrivePlan:
    """The plan on which `simulate` stands; its arguments and errors.

    Args:
        workers: processes that run the FMU.
        drive: tones and amplitudes that drive.
        accuracy: relative error that is wanted; None: the usual one, or what the FMU can give.
        settle_s: time before the first sample, s.
        annotation: what the FMU says of its own accuracy.
        shown: the window that is kept as samples, None for none.
        work: communication steps and substeps of a run at most; None: some twenty seconds.
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


def simulate(
    workers: FmuLike,
    drive: Drive,
    accuracy: float | None = None,
    *,
    settle_s: float | None = None,
    annotation: AccuracyAnnotation | None = None,
    shown: Shown | None = None,
) -> DriveResponse:
    """Plan, run and read one drive of an FMU.

    Args:
        workers: the running FMU, `fitting.fmu.FmuWorkers`.
        drive: start values in the FMU's units, tones in Hz, outputs; what it sets is left as it is.
        accuracy: wanted largest relative error of an amplitude, between 0 and 1; None: 1e-6, or
            what the FMU can give.
        settle_s: time before sampling in s; None: found by watching the amplitudes. What a given
            time leaves of the transient is a part of the promise.
        annotation: how the FMU is told to be accurate, and reductions to force or forbid, where it
            is not to be taken from the FMU's own annotation.
        shown: window in s and number of samples of the spectrum.

    Returns:
        Amplitudes at the tones with the plan that promises them, spectrum, lines at combinations
        of the tones, traces. Where the accuracy cannot be promised, the plan says what can.

    Raises:
        BadInput: tones and window do not go together, no output oscillates, names that the FMU
            does not have.
        FmuFailure: the FMU failed.
    """
    plan = plan_drive(
        workers, drive, accuracy, settle_s=settle_s, annotation=annotation, shown=shown
    )
    return respond(workers, plan, shown)


def respond(workers: Workers, plan: DrivePlan, shown: Shown | None = None) -> DriveResponse:
    """Run and read what was planned for one drive, and what is shown beside it.

    Args:
        workers: processes that run the FMU.
        plan: settings, settling and windows, with what they promise.
        shown: the window that is kept as samples, None for none.
    """
    drive, shown = plan.drives[0], shown or Shown()
    band, coherent = _band(drive, shown)
    settle_s = plan.settle_s
    runs = [*plan.runs, drive.run_at(plan.settings, settle_s, band.step_s, band.samples)]
    beating = _beating_run(plan)
    answers = workers.run([*runs, *([beating] if beating else [])])
    lines = _lines(drive, band, coherent, runs[1], answers[1])
    trace = _trace(beating, answers[2]) if beating else None
    constant = plan.readings[0].constant
    carrier = _carrier_run(plan, trace, constant.index(False))
    rounding = 2.0 * math.pi * max(drive.tones_hz) * (settle_s + float(band.window_s)) * EPS
    frequencies_hz, amplitudes = _spectrum(band, coherent, answers[1])
    spectrum = Spectrum(
        frequencies_hz=frequencies_hz,
        amplitudes=amplitudes,
        window_s=float(band.window_s),
        samples=band.samples,
        coherent=coherent,
        bins=band.bins(),
        rounding=rounding,
    )
    peaks = plan.read(answers[0])
    other = None if plan.settles else strongest_other_line(workers, plan)
    remainder = _remainder(lines, np.array(constant), rounding, plan.promised)
    if other is not None and (remainder.explained or other.share > remainder.share):
        remainder = other
    return DriveResponse(
        drive=replace(drive, start_values={**drive.start_values, **plan.settings}),
        plan=plan,
        peaks=peaks,
        spectrum=spectrum,
        lines=_mixed_lines(drive, spectrum, _oscillating(peaks, constant), plan.promised),
        remainder=remainder,
        other_line=other,
        beating=trace,
        carrier=_trace(carrier, workers.run([carrier])[0]),
        constants=constants_of(drive, plan.readings[0]),
    )


# -- the spectrum ---------------------------------------------------------------------------------


def _band(drive: Drive, shown: Shown) -> tuple[Band, bool]:
    """Where the spectrum is seen, and whether it holds whole periods of every tone."""
    band = plan_band(
        drive.tones_hz,
        longest_s=LONGEST_WINDOW_S,
        window_s=shown.window_s,
        samples=shown.samples,
    )
    coherent, result = band is not None, band or _rounded_band(drive.tones_hz, shown)
    if not drive.grid.step_s:
        return result, coherent
    chosen = shown != Shown()
    return band_on(drive.grid, drive.tones_hz, LONGEST_WINDOW_S, result, chosen), True


def _rounded_band(tones: tuple[float, ...], shown: Shown) -> Band:
    """A band for tones without a common period, rounded to what the window tells apart."""
    gaps = [abs(a - b) for i, a in enumerate(tones) for b in tones[:i]]
    digits = math.ceil(math.log10(10.0 / min(*gaps, *tones)))
    rounded = tuple(float(round(exact(tone), digits)) for tone in tones)
    window_s = shown.window_s or 10.0**digits
    cause = None
    try:
        band = plan_band(rounded, longest_s=math.inf, window_s=window_s, samples=shown.samples)
        if band is not None:
            return band
    except BadInput as error:
        cause = error  # speaks of the rounded tones, which nobody has written
    raise BadInput(
        f"{tones_in_words(tones)}: no common period within {LONGEST_WINDOW_S:g} s, and no "
        f"sampling of {window_s:g} s keeps them within one band{unit_hint(tones)}"
    ) from cause


def _spectrum(band: Band, coherent: bool, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Frequencies, ascending, and amplitudes."""
    if not coherent:
        taper = 1.0 - np.cos(2.0 * np.pi * np.arange(len(values)) / len(values))
        values = values * taper[:, np.newaxis]
    frequencies, amplitudes = band.frequencies_hz(), amplitude_spectrum(values)
    upwards = 1 if frequencies[0] <= frequencies[-1] else -1  # odd zones are seen mirrored
    return frequencies[::upwards], amplitudes[::upwards]


@dataclass(frozen=True, kw_only=True)
class _Lines:
    """Amplitudes of a response at the tones, at combinations, elsewhere: (any, outputs).

    The frequency of what is left by a fit is not known (nan). ``largest`` (outputs,) is the largest
    value.
    """

    peaks: FloatArray
    combined: FloatArray
    unexplained: FloatArray
    combined_hz: FloatArray
    unexplained_hz: FloatArray
    largest: FloatArray

    def share(self, lines: FloatArray, constant: BoolArray) -> FloatArray:
        """Lines as parts of the largest peak of their output, less rounding; same shape."""
        peak = np.maximum(self.peaks.max(axis=0), np.finfo(float).tiny)
        parts = np.maximum(lines - ROUNDING * self.largest, 0.0) / peak
        return np.where(constant, 0.0, parts)


def _lines(drive: Drive, band: Band, coherent: bool, run: Run, values: FloatArray) -> _Lines:
    largest = np.max(np.abs(values), axis=0)
    if not coherent:
        result = fit_tones(drive.tones_hz, np.array(row_times(run)), values)
        left = np.max(np.abs(result.rest), axis=0, keepdims=True)
        return _Lines(
            peaks=result.amplitudes,
            combined=left[:0],
            unexplained=left,
            combined_hz=np.empty(0),
            unexplained_hz=np.array([math.nan]),
            largest=largest,
        )
    tones = list(band.bins())
    mixed = [k for k in band.combination_bins() if k]
    rest = np.setdiff1d(np.arange(1, band.samples // 2 + 1), [*tones, *mixed])
    a, f = amplitude_spectrum(values), band.frequencies_hz()
    return _Lines(
        peaks=a[tones],
        combined=a[mixed],
        unexplained=a[rest],
        combined_hz=f[mixed],
        unexplained_hz=f[rest],
        largest=largest,
    )


def _remainder(lines: _Lines, constant: BoolArray, rounding: float, promised: float) -> Remainder:
    """What there is beside the tones, against what a steady response of that accuracy has."""
    limit = max(BESIDE, rounding, promised)
    combined, unexplained = (lines.share(a, constant) for a in (lines.combined, lines.unexplained))
    share, mixed = (float(np.max(a, initial=0.0)) for a in (unexplained, combined))
    if share > limit:
        at_hz = float(lines.unexplained_hz[int(np.argmax(unexplained.max(axis=1)))])
        return Remainder(
            RemainderKind.UNKNOWN if math.isnan(at_hz) else RemainderKind.UNEXPLAINED, share, at_hz
        )
    if mixed > limit:
        at_hz = float(lines.combined_hz[int(np.argmax(combined.max(axis=1)))])
        return Remainder(RemainderKind.COMBINATION, mixed, at_hz)
    most = max(share, mixed)
    kind = RemainderKind.ROUNDING if most <= max(SMALL, rounding) else RemainderKind.SMALL
    return Remainder(kind, most)


def _oscillating(peaks: FloatArray, constant: tuple[bool, ...]) -> FloatArray:
    """Peaks (tones, outputs), infinite where an output does not oscillate: no line is larger."""
    return np.where(constant, np.inf, peaks)


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
    limit = max(BESIDE, spectrum.rounding, promised) * peaks.max(axis=0)
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


def _beating_run(plan: DrivePlan) -> Run | None:
    drive = plan.drives[0]
    tones = sorted(drive.tones_hz)
    if len(tones) == 1:
        return None
    length_s = TRACE_BEATS / min(b - a for a, b in pairwise(tones))
    middle_hz = sum(tones) / len(tones)
    periods = max(1, round(length_s * middle_hz / TRACE_COLUMNS))
    if periods % COLUMN_SAMPLES == 0:
        periods += 1
    step_s = periods / (COLUMN_SAMPLES * middle_hz)
    samples = math.ceil(length_s / step_s) + 1
    return drive.run_at(plan.settings, plan.settle_s, step_s, samples)


def _carrier_run(plan: DrivePlan, beating: Trace | None, output: int) -> Run:
    """Some periods, around the maximum of the output's envelope where there is one."""
    drive, settle_s = plan.drives[0], plan.settle_s
    middle_hz = sum(drive.tones_hz) / len(drive.tones_hz)
    length_s = CARRIER_PERIODS / middle_hz
    if beating is not None:
        # not at the very first samples, which have nothing before them
        at = beating.times_s[int(np.argmax(np.abs(beating.values[:, output])))]
        settle_s = max(settle_s, float(at) - length_s / 2)
    samples = CARRIER_PERIODS * CARRIER_SAMPLES + 1
    return drive.run_at(plan.settings, settle_s, length_s / (samples - 1), samples)


def _trace(run: Run, values: FloatArray) -> Trace:
    return Trace(np.array(row_times(run)), values)
