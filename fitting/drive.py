"""One drive through an FMU: settle, look at the beating, read the spectrum."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fitting.errors import BadInput, StartValue
from fitting.fmu import InputSignal, Run
from fitting.spectrum import Band, amplitude_spectrum, exact, fit_tones, plan_band

FloatArray = NDArray[np.float64]

TRACE_SAMPLES = 8000
TRACE_BEATS = 2
CARRIER_PERIODS = 6
CARRIER_SAMPLES = 40  # per period
GOLDEN = (3.0 - math.sqrt(5.0)) / 2.0  # of a period from sample to sample: fills the envelope
SETTLED = 1e-8  # change of an amplitude when the time to settle is doubled, relative to the largest
MOST_DOUBLINGS = 12
LONGEST_WINDOW_S = 100.0


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

    start_values: Mapping[str, StartValue]
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
    ``carrier`` resolves some periods; ``frequencies_hz`` (bins,), ``amplitudes`` (bins, outputs),
    ``peaks`` (tones, outputs) in the outputs' units, V peak for volts. ``coherent``: the bins hold
    the tones exactly; else peaks are fitted and the spectrum is tapered. ``settled``: False if
    amplitudes were still changing; ``reasons`` sentences on what was chosen.
    """

    drive: Drive
    beating: Trace | None
    carrier: Trace
    frequencies_hz: FloatArray
    amplitudes: FloatArray
    peaks: FloatArray
    coherent: bool
    settled: bool
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class _Window:
    """Where peaks are read; if not coherent, ``band`` is for tones rounded to its bins."""

    band: Band
    coherent: bool
    tones_hz: tuple[float, ...]

    def lines(self, start_s: float, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Peaks (tones, outputs), and what else there is (any, outputs), the mean left out."""
        if self.coherent:
            bins = list(self.band.bins())
            spectrum = amplitude_spectrum(values)
            return spectrum[bins], np.delete(spectrum, [0, *bins], axis=0)
        times = _times(start_s, self.band.step_s, self.band.samples)
        peaks, rest = fit_tones(self.tones_hz, times, values)
        return peaks, np.max(np.abs(rest), axis=0, keepdims=True)

    def spectrum(self, values: FloatArray) -> FloatArray:
        if self.coherent:
            return amplitude_spectrum(values)
        taper = 1.0 - np.cos(2.0 * np.pi * np.arange(len(values)) / len(values))
        return amplitude_spectrum(values * taper[:, np.newaxis])


def simulate_drive(
    drive: Drive, workers: Workers, tell: Callable[[str], None] = lambda text: None
) -> DriveResult:
    """Simulate a drive: find the time to settle, then trace, carrier and spectrum.

    ``tell`` hears what is under way. Raises BadInput where tones and window do not go together and
    FmuFailure if the FMU fails.
    """
    window, why_window = _window(drive)
    settle_s, settled, why_settle = _settle(drive, window, workers, tell)
    tell("spectrum and trace")
    band = window.band
    runs = [drive.run(settle_s, band.step_s, band.samples)]
    beating = _beating_run(drive, settle_s)
    results = workers.run(runs + ([beating] if beating else []))
    peaks, rest = window.lines(runs[0].settle_s, results[0])
    trace = _trace(beating, results[1]) if beating else None
    carrier = _carrier_run(drive, settle_s, trace)
    return DriveResult(
        drive,
        trace,
        _trace(carrier, workers.run([carrier])[0]),
        band.frequencies_hz(),
        window.spectrum(results[0]),
        peaks,
        window.coherent,
        settled,
        (why_window, why_settle, _what_else(peaks, rest)),
    )


def _window(drive: Drive) -> tuple[_Window, str]:
    tones = drive.tones_hz
    band = plan_band(
        tones, longest_s=LONGEST_WINDOW_S, window_s=drive.window_s, samples=drive.samples
    )
    coherent = band is not None
    if band is None:
        gaps = [abs(a - b) for i, a in enumerate(tones) for b in tones[:i]]
        digits = math.ceil(math.log10(10.0 / min(gaps, default=tones[0])))
        rounded = tuple(float(round(exact(tone), digits)) for tone in tones)
        window_s = drive.window_s or 10.0**digits
        band = plan_band(rounded, longest_s=math.inf, window_s=window_s, samples=drive.samples)
    if band is None:
        raise BadInput(f"tones {tones} Hz: no window holds them")
    shown = f"{float(band.window_s):.9g} s in {band.samples} samples"
    proof = (
        f"spectrum of {shown}: whole periods of every tone, each alone on bins {band.bins()}, none "
        "folded onto another one, onto 0 or onto half the sampling rate"
        if coherent
        else f"the tones have no common period up to {LONGEST_WINDOW_S:g} s: peaks by a fit of the "
        f"tones to {shown}, spectrum tapered"
    )
    return _Window(band, coherent, tones), proof


def _settle(
    drive: Drive, window: _Window, workers: Workers, tell: Callable[[str], None]
) -> tuple[float, bool, str]:
    """Time to wait, whether amplitudes are steady after it, and a sentence."""
    if drive.settle_s is not None:
        return drive.settle_s, True, f"sampling begins after {drive.settle_s:.9g} s, as asked for"
    band = window.band

    def lines_after(time_s: float) -> FloatArray:
        tell(f"settling: trying {time_s:.3g} s")
        run = drive.run(time_s, band.step_s, band.samples)
        values = workers.run([run])[0]
        # all lines: a transient of little damping leaves the tones alone and has one of its own
        return np.vstack(window.lines(run.settle_s, values))

    time_s = float(band.window_s)
    before = lines_after(time_s)
    change = math.inf
    for _ in range(MOST_DOUBLINGS):
        time_s *= 2.0
        after = lines_after(time_s)
        largest = np.maximum(np.max(after, axis=0), np.finfo(float).tiny)
        change = float(np.max(np.abs(after - before) / largest))
        if change <= SETTLED:
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


def _what_else(peaks: FloatArray, rest: FloatArray) -> str:
    """A sentence on what the response holds beside the tones."""
    share = float(np.max(rest / np.maximum(peaks.max(axis=0), np.finfo(float).tiny)))
    where = (
        "harmonics, or free oscillations that do not die away" if share > SETTLED else "rounding"
    )
    return f"beside the tones there is {share:.1e} of the largest peak: {where}"


def _beating_run(drive: Drive, settle_s: float) -> Run | None:
    tones = sorted(drive.tones_hz)
    if len(tones) == 1:
        return None
    beat_s = 1.0 / min(b - a for a, b in pairwise(tones))
    step_s = TRACE_BEATS * beat_s / TRACE_SAMPLES
    middle_hz = sum(tones) / len(tones)
    periods = math.floor(step_s * middle_hz)
    if periods >= 1:
        step_s = (periods + GOLDEN) / middle_hz
    return drive.run(settle_s, step_s, math.ceil(TRACE_BEATS * beat_s / step_s) + 1)


def _carrier_run(drive: Drive, settle_s: float, beating: Trace | None) -> Run:
    """Some periods, around the maximum of the envelope where there is one."""
    middle_hz = sum(drive.tones_hz) / len(drive.tones_hz)
    length_s = CARRIER_PERIODS / middle_hz
    if beating is not None:
        # of the first output; not at the very first samples, which have nothing before them
        at = beating.times_s[int(np.argmax(np.abs(beating.values[:, 0])))]
        settle_s = max(settle_s, float(at) - length_s / 2)
    samples = CARRIER_PERIODS * CARRIER_SAMPLES + 1
    return drive.run(settle_s, length_s / (samples - 1), samples)


def _trace(run: Run, values: FloatArray) -> Trace:
    return Trace(_times(run.settle_s, run.sample_step_s, run.samples), values)


def _times(start_s: float, step_s: float, samples: int) -> FloatArray:
    return np.asarray(start_s + np.arange(samples) * step_s, dtype=np.float64)
