"""When to sample a response to known tones: few samples, and the proof that they suffice.

A window is coherent where it holds whole periods of every tone: a tone fit then equals the Fourier
bin and no tone leaks into another. Few samples suffice, because the tones are known: sampling far
below them is no loss as long as no tone folds onto another, onto 0 or onto half the sampling rate,
and that is proved here, not hoped for.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache

import numpy as np

from fitting.signal.tones import FittedTones, ToneFit, common_period, exact, tone_design
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import hertz

#: Periods of the fastest tone in a common period, at most: times are doubles.
LONGEST_PERIODS = 1e9
#: Samples beyond the unknowns (two per tone and the mean), by which a misfit shows.
SPARE_SAMPLES = 2
#: Numbers of samples tried from the least on, until one keeps the tones apart.
TRIED_SAMPLES = 1000
#: Sampling steps that are tried for tones without a common period.
TRIED_STEPS = 400
#: Lines that are fitted with tones without a common period, at most: more take minutes to plan.
MOST_FITTED = 100
#: Largest condition number of a tone fit without a coherent window.
LARGEST_CONDITION = 3.0
#: Bits of a binary grain within the length of a run: times on it, and their differences, are
#: doubles without rounding, so that an FMU is asked for the very times that the fit assumes.
GRAIN_BITS = 50
#: Largest grain, as a share of a step, to which the step is rounded.
LARGEST_GRAIN = 1e-3


@dataclass(frozen=True, kw_only=True)
class Window:
    """When to sample one run: t_j = settle + j step, j < samples; how many held steps a step has.

    `hold_steps` is the number of input steps in one sampling step, 0 for tones that the model
    makes itself. `condition` is that of the tone fit where the window is not coherent, else 1.
    `mixture_bins` are Fourier bins of lines that the response may hold besides the tones, and
    `mixtures` the number of these lines; without whole periods they are fitted with the tones,
    `expected_hz`. `longest_s` is the longest communication step (0: any), s; outputs are read
    `delay_steps` communication steps after their time, by which they come late.

    Raises:
        ValueError: too few samples for the tones, or times that are not positive.
    """

    tones_hz: tuple[float, ...]
    settle_s: float
    step_s: float
    samples: int
    coherent: bool = True
    hold_steps: int = 0
    condition: float = 1.0
    mixture_bins: tuple[int, ...] = ()
    mixtures: int = 0
    expected_hz: tuple[float, ...] = ()
    longest_s: float = 0.0
    delay_steps: int = 0

    def __post_init__(self) -> None:
        if self.samples < 2 * len(self.tones_hz) + 1:
            raise ValueError(f"{self.samples} samples cannot hold {len(self.tones_hz)} tones")
        if not (self.step_s > 0.0 and self.settle_s >= 0.0):
            raise ValueError(f"step {self.step_s!r} s, settling {self.settle_s!r} s")

    @property
    def length_s(self) -> float:
        """Time that is sampled, s: whole periods of every tone where the window is coherent."""
        return self.step_s * self.samples

    @property
    def input_step_s(self) -> float:
        """Length of a held input step, s."""
        return self.step_s / self.hold_steps if self.hold_steps else self.step_s

    def times_s(self) -> FloatArray:
        """Sampling times, shape (samples,), each by one multiplication."""
        return np.asarray(self.settle_s + np.arange(self.samples) * self.step_s)

    @cached_property
    def fit(self) -> ToneFit:
        """The fit of the tones at these times."""
        return ToneFit(self.tones_hz, self.times_s(), self.expected_hz)

    def read(self, values: FloatArray) -> FittedTones:
        """Mean and tones in samples, shape (samples,) or (samples, outputs).

        Args:
            values: samples (samples, outputs).

        Raises:
            ValueError: another number of samples than planned.
        """
        self._require_planned(values)
        return self.fit(values)

    def phasors(self, values: FloatArray) -> ComplexArray:
        """Phasors (tones,) alone of samples (samples,), for a fraction of the time of `read`.

        Args:
            values: samples (samples,).

        Raises:
            ValueError: another number of samples than planned.
        """
        self._require_planned(values)
        return np.asarray(self.fit.reader @ values)

    def _require_planned(self, values: FloatArray) -> None:
        if values.shape[:1] != (self.samples,):
            raise ValueError(f"{values.shape[0]} samples, planned were {self.samples}")


def longest_window_s(tones_hz: Sequence[float]) -> float:
    """Longest common period of tones (Hz) that is waited for, s.

    Args:
        tones_hz: frequencies of the tones, Hz.
    """
    return LONGEST_PERIODS / max(tones_hz)


def folded(cycles: int, samples: int) -> int:
    """Bin at which a line of so many whole periods in a window is seen by so many samples.

    Args:
        cycles: in the window.
        samples: number of samples.
    """
    return min(cycles % samples, -cycles % samples)


def kept_apart(cycles: Sequence[int], others: Iterable[int], samples: int) -> bool:
    """Whether samples over whole periods see each tone by itself: the proof against folding.

    `cycles` are whole periods of the tones in the window, `others` those of lines that the
    response may hold besides them. With k = f T whole, tone k is seen at the bin k mod N, and -k
    mod N: these must differ from tone to tone, and from 0 and N/2, and no other line may be seen
    there. All in whole numbers.

    Args:
        cycles: of the tones in the window.
        others: bins that are taken.
        samples: number of samples.
    """
    bins = {folded(k, samples) for k in cycles}
    alone = len(bins) == len(cycles) and 0 not in bins and (samples % 2 or samples // 2 not in bins)
    return bool(alone) and not any(folded(k, samples) in bins for k in others)


def coherent_samples(
    tones_hz: Sequence[float], period_s: Fraction, least: int, mixtures_hz: Sequence[float] = ()
) -> int | None:
    """Least number of samples over a common period at which no tone folds onto another.

    Nor does a line of `mixtures_hz` fold onto a tone, as a nonlinear response has them. None where
    none of the first thousand numbers does.

    Args:
        tones_hz: frequencies of the tones, Hz.
        period_s: common period of the tones, s.
        least: samples at least.
        mixtures_hz: combinations of the tones that the window must hold, Hz.
    """
    cycles = [int(exact(tone) * period_s) for tone in tones_hz]
    others = {int(exact(line) * period_s) for line in mixtures_hz} - set(cycles)
    tried = range(least, least + TRIED_SAMPLES)
    return next((n for n in tried if kept_apart(cycles, others, n)), None)


def plan_window(
    tones_hz: Sequence[float],
    settle_s: float,
    *,
    samples_per_period: int = 0,
    mixtures_hz: Sequence[float] = (),
    expected_hz: tuple[float, ...] = (),
    longest_s: float = math.inf,
) -> Window:
    """Window for known tones: coherent where they have a common period, else for a tone fit.

    `samples_per_period` > 0 is for a drive that is held over steps: the steps divide the window.
    No line of `mixtures_hz`, of which the response may hold any amount, is seen as one of the
    tones. A common period beyond `longest_s` is given up.

    Args:
        tones_hz: frequencies of the tones, Hz.
        settle_s: time before the first sample, s.
        samples_per_period: steps in a period of the fastest tone for which an input is held; 0:
            none is.
        mixtures_hz: combinations of the tones that the window must hold, Hz.
        expected_hz: lines that are fitted with tones without a common period, Hz.
        longest_s: longest window, s.

    Raises:
        BadInput: no window keeps the tones apart (two equal tones, for one), or clear of the lines
            next to them.
    """
    tones = tuple(float(tone) for tone in tones_hz)
    least = 2 * len(tones) + 1 + SPARE_SAMPLES
    common, longest_s = common_period(tones), min(longest_s, longest_window_s(tones))
    samples = None
    if common <= longest_s or len(tones) == 1:
        samples = coherent_samples(tones, common, least, mixtures_hz)
    if samples is None and mixtures_hz:
        raise BadInput(
            f"drive frequencies {hertz(*tones)}: their mixtures in a nonlinear response cannot be "
            f"distinguished; wanted frequencies with a common period up to {longest_s:g} s"
        )
    if samples is None:
        return _incoherent(tones, expected_hz, settle_s, least + 4, samples_per_period)
    period = float(common)
    hold = 0
    if samples_per_period:
        hold = math.ceil(period * max(tones) * samples_per_period / samples)
    folds = {folded(int(exact(line) * common), samples) for line in mixtures_hz}
    return _aligned(
        Window(
            tones_hz=tones,
            settle_s=settle_s,
            step_s=period / samples,
            samples=samples,
            hold_steps=hold,
            mixture_bins=tuple(sorted({k for b in folds for k in (b, -b % samples)})),
            mixtures=len(mixtures_hz),
        )
    )


def span_s(tones_hz: tuple[float, ...]) -> float:
    """Time in which a fit distinguishes tones, also from the mean, which is one of 0 Hz, s.

    Args:
        tones_hz: frequencies of the tones, Hz.

    Raises:
        BadInput: two equal tones.
    """
    gaps = [abs(a - b) for i, a in enumerate(tones_hz) for b in tones_hz[:i]]
    if gaps and min(gaps) <= 0.0:
        raise BadInput(f"drive frequencies {tones_hz} Hz: two are the same; wanted different ones")
    return 1.0 / min([*gaps, *tones_hz])


def _incoherent(
    tones: tuple[float, ...],
    near_hz: tuple[float, ...],
    settle_s: float,
    samples: int,
    samples_per_period: int,
) -> Window:
    span = span_s(tones)
    # more than unknowns: lines far from the tones fold to anywhere, and not onto another one
    samples += 3 * len(near_hz)
    best, best_step = math.inf, 0.0
    if len(near_hz) <= MOST_FITTED:
        best, best_step = _best_step((*tones, *near_hz), samples, span)
    if best > LARGEST_CONDITION:
        raise BadInput(
            f"drive frequencies {tones} Hz: no sampling distinguishes them (condition {best:.3g}); "
            "wanted frequencies with a common period"
        )
    hold = math.ceil(best_step * max(tones) * samples_per_period) if samples_per_period else 0
    return _aligned(
        Window(
            tones_hz=tones,
            settle_s=settle_s,
            step_s=best_step,
            samples=samples,
            coherent=False,
            hold_steps=hold,
            condition=best,
            mixtures=len(near_hz),
            expected_hz=near_hz,
        )
    )


@lru_cache(maxsize=1024)
def _best_step(tones: tuple[float, ...], samples: int, span_s: float) -> tuple[float, float]:
    """Least condition number of a tone fit over windows of about a span, and its sampling step.

    Steps at equal distances see a tone all alike, where it makes whole periods in that distance:
    then they are tried at growing ones.
    """
    shortest, longest = 0.8 * span_s / samples, 2.5 * span_s / samples
    even = _best_of(tones, samples, np.linspace(shortest, longest, TRIED_STEPS))
    if even[0] <= LARGEST_CONDITION:
        return even
    return min(even, _best_of(tones, samples, np.geomspace(shortest, longest, TRIED_STEPS)))


def _best_of(tones: tuple[float, ...], samples: int, steps: FloatArray) -> tuple[float, float]:
    times = np.arange(samples, dtype=float) * steps[:, np.newaxis]
    # all at once: step by step a thousand experiments would be planned for minutes
    conditions = np.linalg.cond(tone_design(tones, times.ravel()).reshape(steps.size, samples, -1))
    k = int(np.argmin(conditions))
    return float(conditions[k]), float(steps[k])


def _aligned(window: Window) -> Window:
    """Settling in whole held steps, where the drive is held; else times on a binary grain."""
    step_s, settle_s = window.step_s, window.settle_s
    if window.hold_steps:
        return replace(window, settle_s=whole_steps(settle_s, window.input_step_s))
    grain = 2.0 ** (math.frexp(settle_s + window.samples * step_s)[1] - GRAIN_BITS)
    if grain > LARGEST_GRAIN * step_s:  # so late that no grain of a double divides the step
        return window
    step_s, settle_s = round(step_s / grain) * grain, math.ceil(settle_s / grain) * grain
    return replace(window, step_s=step_s, settle_s=settle_s)


def whole_steps(time_s: float, step_s: float) -> float:
    """A time rounded up to whole steps, s.

    Args:
        time_s: to be rounded up, s.
        step_s: time between samples, s.
    """
    return math.ceil(time_s / step_s - 1e-9) * step_s


def tone_misfit(window: Window, samples: FloatArray) -> float:
    """Largest deviation of samples from mean plus tones, relative to the largest amplitude.

    Lines that are expected besides the tones are no part of it; harmonics otherwise, a transient
    that is left, or noise of the solver: what a plan should keep small.

    Args:
        window: settling and samples of a run.
        samples: values (samples, outputs).
    """
    fitted = window.read(samples)
    largest = max(float(np.max(fitted.amplitudes)), np.finfo(float).tiny)
    rest = fitted.rest
    if window.mixture_bins:
        lines = np.fft.fft(rest)
        lines[list(window.mixture_bins)] = 0.0
        rest = np.fft.ifft(lines).real
    return float(np.max(np.abs(rest))) / largest
