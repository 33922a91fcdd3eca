"""What to simulate for a wanted accuracy: settling, window and sampling, each with its reason.

A window is coherent where it holds whole periods of every tone: a tone fit then equals the Fourier
bin and no tone leaks into another. Few samples suffice, because the tones are known: sampling far
below them is no loss as long as no tone folds onto another, onto 0 or onto half the sampling rate,
and that is proved here, not hoped for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache

import numpy as np

from fitting.signal.spectrum import common_period, cycle_fraction, exact
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import hertz

#: A common period longer than this is given up for a tone fit, s.
LONGEST_WINDOW_S = 100.0
#: Samples beyond the unknowns (two per tone and the mean), by which a misfit shows.
SPARE_SAMPLES = 2
#: Largest condition number of a tone fit without a coherent window.
LARGEST_CONDITION = 3.0
#: Bits of a binary grain within the length of a run: times on it, and their differences, are
#: doubles without rounding, so that an FMU is asked for the very times that the fit assumes.
GRAIN_BITS = 50
#: Largest grain, as a share of a step, to which the step is rounded.
LARGEST_GRAIN = 1e-3


@dataclass(frozen=True)
class Window:
    """When to sample one run: t_j = settle + j step, j < samples; how many held steps a step has.

    `held_steps` is the number of input steps in one sampling step, 0 for tones that the model
    makes itself. `reason` is a sentence for the report; `beside` are Fourier bins of lines that the
    response may hold beside the tones.

    Raises:
        ValueError: too few samples for the tones, or times that are not positive.
    """

    tones_hz: tuple[float, ...]
    settle_s: float
    step_s: float
    samples: int
    coherent: bool
    held_steps: int
    reason: str
    beside: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if self.samples < 2 * len(self.tones_hz) + 1:
            raise ValueError(f"{self.samples} samples cannot hold {len(self.tones_hz)} tones")
        if not (self.step_s > 0.0 and self.settle_s >= 0.0):
            raise ValueError(f"step {self.step_s!r} s, settling {self.settle_s!r} s")

    @property
    def input_step_s(self) -> float:
        """Length of a held input step, s."""
        return self.step_s / self.held_steps if self.held_steps else self.step_s

    @cached_property
    def projector(self) -> FloatArray:
        """Least-squares fit of the tones as a matrix on the samples, (1 + 2 tones, samples)."""
        return np.asarray(np.linalg.pinv(self.design))

    def times_s(self) -> FloatArray:
        """Sampling times, shape (samples,), each by one multiplication."""
        return np.asarray(self.settle_s + np.arange(self.samples) * self.step_s)

    @cached_property
    def design(self) -> FloatArray:
        """Columns 1, cos 2 pi f t, sin 2 pi f t, ...: shape (samples, 1 + 2 tones)."""
        return _design(self.tones_hz, self.times_s())


def _design(tones_hz: Sequence[float], times_s: FloatArray) -> FloatArray:
    columns = [np.ones(times_s.size)]
    for tone in tones_hz:
        phase = 2.0 * np.pi * cycle_fraction(tone, times_s)
        columns += [np.cos(phase), np.sin(phase)]
    return np.stack(columns, axis=1)


def settling_s(line_width_hz: float, accuracy: float) -> float:
    """Time after which a transient exp(-pi w t) is below the accuracy, s.

    Planned for half the width that was stated: a fit may try less damping than there is.

    Raises:
        ValueError: a width or an accuracy that is not positive.
    """
    if not (line_width_hz > 0.0 and 0.0 < accuracy < 1.0):
        raise ValueError(f"line width {line_width_hz!r} Hz, accuracy {accuracy!r}")
    return math.log(1.0 / accuracy) / (math.pi * 0.5 * line_width_hz)


def coherent_samples(
    tones_hz: Sequence[float], period_s: Fraction, least: int, beside_hz: Sequence[float] = ()
) -> int | None:
    """Least number of samples over a common period at which no tone folds onto another.

    With k = f T whole, tone k is seen at k mod N: these must differ from each other, from each
    other's negatives, from 0 and from N/2; nor may a line ``beside_hz`` be seen there, which a
    nonlinear response has at mixtures of the tones. All in whole numbers.
    """
    bins = [int(exact(tone) * period_s) for tone in tones_hz]
    others = {int(exact(line) * period_s) for line in beside_hz} - set(bins)
    for samples in range(least, least + 1000):
        seen = [b % samples for b in bins]
        taken = {*seen, *(samples - s for s in seen)}
        apart = len(taken) == 2 * len(bins) and 0 not in seen
        if apart and not any(line % samples in taken for line in others):
            return samples
    return None


def plan_window(
    tones_hz: Sequence[float],
    settle_s: float,
    *,
    samples_per_period: int = 0,
    beside_hz: Sequence[float] = (),
    spare: int = SPARE_SAMPLES,
    longest_s: float = LONGEST_WINDOW_S,
) -> Window:
    """Window for known tones: coherent where they have a common period, else for a tone fit.

    `samples_per_period` > 0 is for a drive that is held over steps: the steps divide the window.
    No line of `beside_hz`, of which the response may hold any amount, is seen as one of the tones.
    `spare` samples are taken beyond the unknowns; a common period beyond `longest_s` is given up.

    Raises:
        BadInput: no window keeps the tones apart (two equal tones, for one), or clear of the lines
            beside them.
    """
    tones = tuple(float(tone) for tone in tones_hz)
    least = 2 * len(tones) + 1 + spare
    common = common_period(tones)
    samples = None
    if common <= longest_s or len(tones) == 1:
        samples = coherent_samples(tones, common, least, beside_hz)
    if samples is None and beside_hz:
        raise BadInput(
            f"drive frequencies {hertz(*tones)}: their mixtures in a nonlinear response cannot be "
            f"told apart; wanted frequencies with a common period up to {longest_s:g} s"
        )
    if samples is None:
        return _incoherent(tones, settle_s, least + 4, samples_per_period)
    period = float(common)
    reason = (
        f"{hertz(*tones)}: {period:.6g} s hold whole periods; {samples} samples keep the tones "
        "apart and off 0 and half the rate, so that a fit of the tones is the Fourier bin"
    )
    if beside_hz:
        reason += f", clear of the {len(beside_hz)} mixtures that a nonlinear response may have"
    held = 0
    if samples_per_period:
        held = math.ceil(period * max(tones) * samples_per_period / samples)
    window = _aligned(tones, settle_s, period / samples, samples, True, held, reason)
    mixed = [int(exact(line) * common) % samples for line in beside_hz]
    return replace(window, beside=tuple(sorted({k for m in mixed for k in (m, -m % samples)})))


def _incoherent(
    tones: tuple[float, ...], settle_s: float, samples: int, samples_per_period: int
) -> Window:
    gaps = [abs(a - b) for i, a in enumerate(tones) for b in tones[:i]]
    if gaps and min(gaps) <= 0.0:
        raise BadInput(f"drive frequencies {tones} Hz: two are the same; wanted different ones")
    span = 1.0 / min([*gaps, *tones])  # the mean is a tone of 0 Hz: keep off it as well
    best, best_step = _best_step(tones, samples, span)
    if best > LARGEST_CONDITION:
        raise BadInput(
            f"drive frequencies {tones} Hz: no sampling tells them apart (condition {best:.3g}); "
            "wanted frequencies with a common period"
        )
    reason = (
        f"{' and '.join(f'{tone!r} Hz' for tone in tones)}: no common period of reasonable length; "
        f"amplitudes by a tone fit of {samples} samples (condition number {best:.2f})"
    )
    held = math.ceil(best_step * max(tones) * samples_per_period) if samples_per_period else 0
    return _aligned(tones, settle_s, best_step, samples, False, held, reason)


@lru_cache(maxsize=1024)
def _best_step(tones: tuple[float, ...], samples: int, span_s: float) -> tuple[float, float]:
    """Least condition number of a tone fit over windows of about a span, and its sampling step."""
    steps = np.linspace(0.8, 2.5, 400) * span_s / samples
    times = np.arange(samples, dtype=float) * steps[:, np.newaxis]
    # all at once: step by step a thousand experiments would be planned for minutes
    conditions = np.linalg.cond(_design(tones, times.ravel()).reshape(steps.size, samples, -1))
    k = int(np.argmin(conditions))
    return float(conditions[k]), float(steps[k])


def _aligned(
    tones: tuple[float, ...],
    settle_s: float,
    step_s: float,
    samples: int,
    coherent: bool,
    held: int,
    reason: str,
) -> Window:
    """Settling in whole held steps, where the drive is held; else times on a binary grain."""
    if held:
        grain = step_s / held
        settle_s = math.ceil(settle_s / grain - 1e-9) * grain
        reason += f"; the drive is held over steps of {grain:.6g} s"
        return Window(tones, settle_s, step_s, samples, coherent, held, reason)
    grain = 2.0 ** (math.frexp(settle_s + samples * step_s)[1] - GRAIN_BITS)
    if grain > LARGEST_GRAIN * step_s:  # so late that no grain of a double divides the step
        return Window(tones, settle_s, step_s, samples, coherent, held, reason)
    step_s, settle_s = round(step_s / grain) * grain, math.ceil(settle_s / grain) * grain
    return Window(tones, settle_s, step_s, samples, coherent, held, reason)


def tone_amplitudes(window: Window, samples: FloatArray) -> FloatArray:
    """Amplitudes (n_tones,) of the known tones in sampled values (samples,).

    Raises:
        ValueError: another number of samples than planned.
    """
    if samples.shape != (window.samples,):
        raise ValueError(f"{samples.size} samples, planned were {window.samples}")
    coefficients = window.projector @ samples
    return np.hypot(coefficients[1::2], coefficients[2::2])


def tone_misfit(window: Window, samples: FloatArray) -> float:
    """Largest deviation of samples from mean plus tones, relative to the largest amplitude.

    Lines that are expected beside the tones are no part of it; harmonics otherwise, a transient
    that is left, or noise of the solver: what a plan should keep small.
    """
    coefficients = window.projector @ samples
    largest = max(float(np.max(tone_amplitudes(window, samples))), np.finfo(float).tiny)
    rest = samples - window.design @ coefficients
    if window.beside:
        lines = np.fft.fft(rest)
        lines[list(window.beside)] = 0.0
        rest = np.fft.ifft(lines).real
    return float(np.max(np.abs(rest))) / largest
