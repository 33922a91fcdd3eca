"""One drive through an FMU: settle, look at the beating, read the spectrum."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from fitting.fmu import InputSignal, Run
from fitting.signal.spectrum import Band, amplitude_spectrum, plan_band
from fitting.signal.tones import exact, fit_tones, tones_in_words, unit_hint
from fitting.text.arrays import BoolArray, FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.notation import hertz

TRACE_BEATS = 2
TRACE_COLUMNS = 400
#: Samples of the trace in a column of the drawn envelope, spread evenly over one period of the
#: carrier: a prime, so that any number of periods from column to column does it.
COLUMN_SAMPLES = 41
CARRIER_PERIODS = 6
CARRIER_SAMPLES = 40  # per period
SETTLED = 1e-8  # change of an amplitude when the time to settle is doubled, relative to the largest
BESIDE = 1e-6  # of the largest peak: what is more than that beside the tones needs a reason
LONGEST_WINDOW_S = 100.0
#: The search for the time to settle ends at the longer one of these, in s and in windows.
LONGEST_SETTLE_S, LONGEST_SETTLE_WINDOWS = 100.0, 4096
MOST_HELD_STEPS = 10**7  # of a generated drive while it settles
EPS = float(np.finfo(float).eps)
ROUNDING = 10.0 * EPS  # of the largest value: lines of an FFT that are nothing else
CONSTANT = 100.0 * ROUNDING  # of the largest value: an output that oscillates less is constant


class Workers(Protocol):
    """What is needed of `fitting.fmu.FmuWorkers`."""

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        """Outputs of each run, shape (samples, outputs)."""
        ...


@dataclass(frozen=True)
class Drive:
    """What to simulate; None: to be derived.

    ``tones_hz`` are what the FMU is driven with: by its own parameters, or by us through ``input``,
    each tone with amplitude ``level`` and ``steps_per_period`` held steps in its period.
    """

    start_values: Mapping[str, Scalar]
    tones_hz: tuple[float, ...]
    outputs: tuple[str, ...]
    settle_s: float | None = None
    window_s: float | None = None
    samples: int | None = None
    input: str | None = None
    level: float = 1.0
    steps_per_period: int = 100

    def run(self, settle_s: float, step_s: float, samples: int) -> Run:
        """The run of this drive with these times; a generated drive rounds ``settle_s`` up."""
        signal = None
        if self.input is not None:
            held_s = step_s / math.ceil(step_s * max(self.tones_hz) * self.steps_per_period)
            settle_s = math.ceil(settle_s / held_s - 1e-9) * held_s
            signal = InputSignal(
                self.input, tuple((tone, self.level, 0.0) for tone in self.tones_hz), held_s
            )
        return Run(self.start_values, settle_s, step_s, samples, self.outputs, input_signal=signal)


@dataclass(frozen=True)
class Trace:
    """Values (samples, outputs) at times (samples,) in s."""

    times_s: FloatArray
    values: FloatArray


@dataclass(frozen=True)
class DriveResult:
    """What came of a drive.

    ``beating`` is sampled so that the samples fill the envelope (None for a single tone),
    ``carrier`` resolves some periods; ``frequencies_hz`` (bins,) ascending, ``amplitudes`` (bins,
    outputs), ``peaks`` (tones, outputs) in the outputs' units, V peak for volts; ``constants`` the
    values of outputs that do not oscillate, by name. ``coherent``: the bins hold the tones exactly;
    else peaks are fitted and the spectrum is tapered. ``rounding``: share of the largest peak below
    which a line may be the rounding of the time. ``settled``: False if amplitudes were still
    changing; ``explained``: False if there is more beside the tones than a steady response has;
    ``reasons`` sentences on what was chosen.
    """

    drive: Drive
    beating: Trace | None
    carrier: Trace
    frequencies_hz: FloatArray
    amplitudes: FloatArray
    peaks: FloatArray
    constants: Mapping[str, float]
    coherent: bool
    rounding: float
    settled: bool
    explained: bool
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class _Lines:
    """Amplitudes of a response: at the tones, at combinations of them, elsewhere; the mean apart.

    Each (any, outputs); the frequency of what is left by a fit is not known (nan). ``level``
    (outputs,) is the largest value.
    """

    peaks: FloatArray
    combined: FloatArray
    elsewhere: FloatArray
    combined_hz: FloatArray
    elsewhere_hz: FloatArray
    level: FloatArray

    def all(self) -> FloatArray:
        return np.vstack([self.peaks, self.combined, self.elsewhere])

    def constant(self) -> BoolArray:
        """Which outputs do not oscillate, (outputs,)."""
        return np.asarray(self.all().max(axis=0) <= CONSTANT * self.level)

    def share(self, lines: FloatArray) -> FloatArray:
        """Lines as parts of the largest peak of their output, less rounding; same shape."""
        peak = np.maximum(self.peaks.max(axis=0), np.finfo(float).tiny)
        parts = np.maximum(lines - ROUNDING * self.level, 0.0) / peak
        return np.where(self.constant(), 0.0, parts)


@dataclass(frozen=True)
class _Window:
    """Where peaks are read; if not coherent, ``band`` is for tones rounded to its bins."""

    band: Band
    coherent: bool
    tones_hz: tuple[float, ...]

    def lines(self, start_s: float, values: FloatArray) -> _Lines:
        """What the response holds."""
        level = np.max(np.abs(values), axis=0)
        if not self.coherent:
            times = _times(start_s, self.band.step_s, self.band.samples)
            found = fit_tones(self.tones_hz, times, values)
            rest = np.max(np.abs(found.rest), axis=0, keepdims=True)
            return _Lines(
                found.amplitudes, rest[:0], rest, np.empty(0), np.array([math.nan]), level
            )
        tones = list(self.band.bins())
        mixed = [k for k in self.band.combination_bins() if k]
        rest = np.setdiff1d(np.arange(1, self.band.samples // 2 + 1), [*tones, *mixed])
        a, f = amplitude_spectrum(values), self.band.frequencies_hz()
        return _Lines(a[tones], a[mixed], a[rest], f[mixed], f[rest], level)

    def spectrum(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Frequencies, ascending, and amplitudes."""
        if not self.coherent:
            taper = 1.0 - np.cos(2.0 * np.pi * np.arange(len(values)) / len(values))
            values = values * taper[:, np.newaxis]
        frequencies, amplitudes = self.band.frequencies_hz(), amplitude_spectrum(values)
        upwards = 1 if frequencies[0] <= frequencies[-1] else -1  # odd zones are seen mirrored
        return frequencies[::upwards], amplitudes[::upwards]

    def rounding(self, time_s: float) -> float:
        """Relative error of a response to the tones that comes of rounding such a time."""
        return 2.0 * math.pi * max(self.tones_hz) * time_s * EPS


def simulate_drive(
    drive: Drive, workers: Workers, tell: Callable[[str], None] = lambda text: None
) -> DriveResult:
    """Simulate a drive: find the time to settle, then trace, carrier and spectrum.

    ``tell`` hears what is under way. Raises BadInput where tones and window do not go together or
    no output oscillates, and FmuFailure if the FMU fails.
    """
    window, why_window = _window(drive)
    settle_s, settled, why_settle = _settle(drive, window, workers, tell)
    tell("spectrum and trace")
    band = window.band
    runs = [drive.run(settle_s, band.step_s, band.samples)]
    beating = _beating_run(drive, settle_s)
    results = workers.run(runs + ([beating] if beating else []))
    lines = window.lines(runs[0].settle_s, results[0])
    constants = _constants(drive, lines, results[0])
    trace = _trace(beating, results[1]) if beating else None
    shown = int(np.argmin(lines.constant()))
    carrier = _carrier_run(drive, settle_s, trace, shown)
    rounding = window.rounding(settle_s + float(band.window_s))
    explained, what_else = _what_else(lines, rounding)
    return DriveResult(
        drive,
        trace,
        _trace(carrier, workers.run([carrier])[0]),
        *window.spectrum(results[0]),
        lines.peaks,
        constants,
        window.coherent,
        rounding,
        settled,
        explained,
        (why_window, why_settle, what_else),
    )


def _constants(drive: Drive, lines: _Lines, values: FloatArray) -> dict[str, float]:
    constant = lines.constant()
    found = {
        name: float(np.mean(values[:, k])) for k, name in enumerate(drive.outputs) if constant[k]
    }
    if constant.all():
        raise BadInput(
            f"outputs: {', '.join(f'{name} is constant at {v:.9g}' for name, v in found.items())}; "
            "wanted one that oscillates under the drive"
        )
    return found


def _window(drive: Drive) -> tuple[_Window, str]:
    tones = drive.tones_hz
    band = plan_band(
        tones, longest_s=LONGEST_WINDOW_S, window_s=drive.window_s, samples=drive.samples
    )
    coherent = band is not None
    if band is None:
        band = _rounded_band(drive)
    shown = f"{float(band.window_s):.9g} s in {band.samples} samples"
    proof = (
        f"spectrum of {shown}: whole periods of every tone, each alone on bins {band.bins()}, none "
        "folded onto another one, onto 0 or onto half the sampling rate"
        if coherent
        else f"the tones have no common period up to {LONGEST_WINDOW_S:g} s: peaks by a fit of the "
        f"tones to {shown}, spectrum tapered"
    )
    return _Window(band, coherent, tones), proof


def _rounded_band(drive: Drive) -> Band:
    """A band for tones without a common period, rounded to what the window tells apart."""
    tones = drive.tones_hz
    gaps = [abs(a - b) for i, a in enumerate(tones) for b in tones[:i]]
    digits = math.ceil(math.log10(10.0 / min(*gaps, *tones)))
    rounded = tuple(float(round(exact(tone), digits)) for tone in tones)
    window_s = drive.window_s or 10.0**digits
    cause = None
    try:
        band = plan_band(rounded, longest_s=math.inf, window_s=window_s, samples=drive.samples)
        if band is not None:
            return band
    except BadInput as error:
        cause = error  # speaks of the rounded tones, which nobody has written
    raise BadInput(
        f"{tones_in_words(tones)}: no common period within {LONGEST_WINDOW_S:g} s, and no "
        f"sampling of {window_s:g} s keeps them within one band{unit_hint(tones)}"
    ) from cause


def _settle(
    drive: Drive, window: _Window, workers: Workers, tell: Callable[[str], None]
) -> tuple[float, bool, str]:
    """Time to wait, whether amplitudes are steady after it, and a sentence."""
    if drive.settle_s is not None:
        return drive.settle_s, True, f"sampling begins after {drive.settle_s:.9g} s, as asked for"
    band = window.band

    def lines_after(time_s: float) -> _Lines:
        tell(f"settling: trying {time_s:.3g} s")
        run = drive.run(time_s, band.step_s, band.samples)
        return window.lines(run.settle_s, workers.run([run])[0])

    time_s = float(band.window_s)
    longest_s = max(_longest_settle_s(drive, time_s), 4.0 * time_s)
    before = lines_after(time_s)
    change = math.inf
    while 2.0 * time_s <= longest_s:
        time_s *= 2.0
        after = lines_after(time_s)
        change = _change(before, after)
        if change <= max(SETTLED, window.rounding(time_s)):
            reason = (
                f"sampling begins after {time_s:.9g} s: amplitudes changed by {change:.1e} when "
                "the time to settle was doubled to that"
            )
            return time_s, True, reason
        before = after
    reason = (
        f"amplitudes still change by {change:.1e} after {time_s:.9g} s: what is shown is not steady"
    )
    return time_s, False, reason


def _longest_settle_s(drive: Drive, window_s: float) -> float:
    longest_s = max(LONGEST_SETTLE_S, LONGEST_SETTLE_WINDOWS * window_s)
    if drive.input is None:
        return longest_s
    return min(longest_s, MOST_HELD_STEPS / (max(drive.tones_hz) * drive.steps_per_period))


def _change(before: _Lines, after: _Lines) -> float:
    """Largest change of a line, relative to the largest of its output."""
    # all lines: a transient of little damping leaves the tones alone and has one of its own
    change = np.abs(after.all() - before.all()) - ROUNDING * after.level
    largest = np.maximum(after.all().max(axis=0), np.finfo(float).tiny)
    return float(np.max(np.where(after.constant(), 0.0, np.maximum(change, 0.0) / largest)))


def _what_else(lines: _Lines, rounding: float) -> tuple[bool, str]:
    """Whether a steady response explains what it holds beside the tones, and a sentence on that."""
    limit = max(BESIDE, rounding)
    combined, elsewhere = lines.share(lines.combined), lines.share(lines.elsewhere)
    share = float(np.max(elsewhere, initial=0.0))
    mixed = float(np.max(combined, initial=0.0))
    if share > limit:
        at_hz = float(lines.elsewhere_hz[int(np.argmax(elsewhere.max(axis=1)))])
        what = (
            "harmonics, mixtures of the tones, or free oscillations, which are not told apart "
            "without a common period of the tones"
            if math.isnan(at_hz)
            else f"most at {hertz(at_hz)}, which is no combination of the tones but a free "
            "oscillation that has not died away, or a drive that is not among the tones"
        )
    elif mixed > limit:
        at_hz = float(lines.combined_hz[int(np.argmax(combined.max(axis=1)))])
        what = (
            f"most at {hertz(at_hz)}, a combination of the tones, as in a response that is not "
            "linear"
        )
    else:
        small = max(share, mixed) <= max(SETTLED, rounding)
        what = "rounding" if small else "rounding, or the rest of a transient"
    most = share if share > limit else max(share, mixed)
    return share <= limit, f"beside the tones there is {most:.1e} of the largest peak: {what}"


def _beating_run(drive: Drive, settle_s: float) -> Run | None:
    tones = sorted(drive.tones_hz)
    if len(tones) == 1:
        return None
    length_s = TRACE_BEATS / min(b - a for a, b in pairwise(tones))
    middle_hz = sum(tones) / len(tones)
    periods = max(1, round(length_s * middle_hz / TRACE_COLUMNS))
    if periods % COLUMN_SAMPLES == 0:
        periods += 1
    step_s = periods / (COLUMN_SAMPLES * middle_hz)
    return drive.run(settle_s, step_s, math.ceil(length_s / step_s) + 1)


def _carrier_run(drive: Drive, settle_s: float, beating: Trace | None, output: int) -> Run:
    """Some periods, around the maximum of the output's envelope where there is one."""
    middle_hz = sum(drive.tones_hz) / len(drive.tones_hz)
    length_s = CARRIER_PERIODS / middle_hz
    if beating is not None:
        # not at the very first samples, which have nothing before them
        at = beating.times_s[int(np.argmax(np.abs(beating.values[:, output])))]
        settle_s = max(settle_s, float(at) - length_s / 2)
    samples = CARRIER_PERIODS * CARRIER_SAMPLES + 1
    return drive.run(settle_s, length_s / (samples - 1), samples)


def _trace(run: Run, values: FloatArray) -> Trace:
    return Trace(_times(run.settle_s, run.sample_step_s, run.samples), values)


def _times(start_s: float, step_s: float, samples: int) -> FloatArray:
    return np.asarray(start_s + np.arange(samples) * step_s, dtype=np.float64)
