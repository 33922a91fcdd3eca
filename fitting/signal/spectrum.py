"""Spectra that are shown: whole periods of every tone, and a band of frequencies unfolded.

For amplitudes at known tones alone `fitting.signal.window` needs far fewer samples.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

import numpy as np

from fitting.signal.combinations import mixed_lines
from fitting.signal.tones import common_period, exact, tones_in_words, unit_hint
from fitting.signal.window import folded, kept_apart
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import how_many

#: A window has at least this many beats of the closest tones.
BEATS = 5
#: Periods of a single tone in a window, at least and at most.
PERIODS = (4, 64)
#: The band shown is this many times as wide as the tones are apart.
BREADTH = 6
LEAST_SAMPLES = 256
MOST_SAMPLES = 2**20
#: Largest order of combinations of tones: within the band of the tones, and anywhere.
NEAR_ORDER, ANY_ORDER = 41, 5
#: Mixtures of more tones than these are not kept off them.
MOST_MIXED = 4


@dataclass(frozen=True, kw_only=True)
class Band:
    """A window of whole periods, sampled so that a band of frequencies is seen unfolded.

    N = ``samples`` at t_j = j T/N, j < N, over T = ``window_s`` (exact). Frequency f is seen in bin
    |f T - nearest multiple of N|; within the ``zone`` between z N/(2T) and (z + 1) N/(2T) that is
    one to one, and every tone is inside: on a bin, and on none of the two edges, which are what is
    seen as 0 and as half the sampling rate. So no tone folds onto another one.

    Raises BadInput where a tone is not on a bin or not inside the zone.
    """

    tones_hz: tuple[float, ...]
    window_s: Fraction
    samples: int
    zone: int

    def __post_init__(self) -> None:
        for tone, cycles in zip(self.tones_hz, self._cycles(), strict=True):
            if cycles.denominator != 1:
                raise BadInput(
                    f"{tone!r} Hz makes {float(cycles)!r} periods in {float(self.window_s)!r} s, "
                    "wanted a whole number"
                )
            if not self.zone * self.samples < 2 * cycles < (self.zone + 1) * self.samples:
                raise BadInput(
                    f"{tone!r} Hz, sampled {self.samples} times in {float(self.window_s)!r} s, is "
                    "on or beyond an edge of the band, wanted it inside"
                )

    @property
    def step_s(self) -> float:
        """Time from sample to sample."""
        return float(self.window_s / self.samples)

    def bins(self) -> tuple[int, ...]:
        """Bin of each tone in the discrete Fourier transform of the samples."""
        return tuple(folded(int(cycles), self.samples) for cycles in self._cycles())

    def frequencies_hz(self) -> FloatArray:
        """True frequency of every bin, shape (samples // 2 + 1,)."""
        k = np.arange(self.samples // 2 + 1)
        # odd zones are seen mirrored
        first, sign = (self.zone // 2, 1) if self.zone % 2 == 0 else ((self.zone + 1) // 2, -1)
        return np.asarray((first * self.samples + sign * k) / float(self.window_s))

    def combination_bins(self) -> tuple[int, ...]:
        """Bins of Σ k_i f_i with whole numbers k_i, where a nonlinear response has lines.

        The mean, harmonics and mixtures up to order Σ|k_i| = 5, and what lies between and next to
        the tones (Σ k_i = 1) up to order 41; each less where it would fill half of all bins. The
        tones themselves are left out.
        """
        n = self.samples
        cycles = {int(c) % n for c in self._cycles()}
        gaps = {(a - b) % n for a in cycles for b in cycles}
        near = _grown(cycles, gaps, NEAR_ORDER // 2, n)
        mixed = _grown({0}, {s * c % n for c in cycles for s in (1, -1)}, ANY_ORDER, n)
        lines = {folded(m, n) for m in mixed | near}
        return tuple(sorted(lines - set(self.bins())))

    def _cycles(self) -> list[Fraction]:
        return [exact(tone) * self.window_s for tone in self.tones_hz]


def plan_band(
    tones_hz: Sequence[float],
    *,
    longest_s: float,
    window_s: float | None = None,
    samples: int | None = None,
) -> Band | None:
    """A coherent window for the tones; None where several have no common period in ``longest_s``.

    The window is the least number of common periods with five beats (for a single tone 64 periods,
    or as many as ``longest_s`` holds, 4 at least) unless ``window_s`` is given, and the number of
    samples the least at which the band is six times as wide as the tones are apart, unless
    ``samples`` is given. Among numbers of samples those are passed over at which a harmonic or a
    mixture of the tones up to order 5 (3 f1, 2 f1 + f2), as a nonlinear response has them, folds
    onto a tone; where there is no other, the first is taken.

    Args:
        tones_hz: frequencies of the tones, Hz.
        longest_s: longest window, s.
        window_s: length of the window, s.
        samples: number of samples.

    Raises BadInput for tones that are not different and positive, for a window that is not whole
    periods, and where no sampling up to 2**20 samples keeps the tones within one band.
    """
    tones = tuple(float(tone) for tone in tones_hz)
    if len(set(tones)) != len(tones) or not all(0.0 < tone < math.inf for tone in tones):
        raise BadInput(f"{tones_in_words(tones)}: wanted different positive frequencies")
    if samples is not None and samples < 1:
        raise BadInput(f"samples is {samples!r}, wanted at least 1")
    period = common_period(tones)
    if window_s is not None:
        window = exact(window_s)
        # a decimal cannot hold every period: the nearest whole number of them is meant
        periods = round(window / period)
        if periods < 1 or abs(periods * period - window) > window / 10**9:
            raise BadInput(
                f"window of {window_s!r} s is {float(window / period):.9g} common periods of "
                f"{float(period)!r} s, wanted a whole number"
            )
        window = periods * period
    elif len(tones) == 1:
        window = period * max(PERIODS[0], math.floor(min(PERIODS[1], longest_s / period)))
    else:
        closest = min(b - a for a, b in pairwise(sorted(map(exact, tones))))
        window = period * math.ceil(BEATS / closest / period)
    if len(tones) > 1 and window > longest_s:
        return None
    halves = [int(2 * exact(tone) * window) for tone in tones]
    tried = _candidates(halves) if samples is None else [samples]
    possible = (n for n in tried if _common_zone(halves, n) is not None)
    first = next(possible, None)
    if first is not None:
        cycles = [half // 2 for half in halves]
        mixed = _mixtures(cycles)
        again = itertools.chain([first], possible)
        clean = (n for n in again if kept_apart(cycles, mixed, n))
        n = next(clean, first)
        return Band(tones_hz=tones, window_s=window, samples=n, zone=_common_zone(halves, n) or 0)
    count = f"with {how_many(samples, 'sample')}" if samples else f"up to {MOST_SAMPLES} samples"
    raise BadInput(
        f"{tones_in_words(tones)}: no sampling of {float(window)!r} s {count} keeps them "
        f"within one band, wanted more samples or tones closer to each other{unit_hint(tones)}"
    )


def amplitude_spectrum(values: FloatArray) -> FloatArray:
    """Peak amplitude in every bin of whole periods: (2/N) |rfft|; 1/N at 0 and at half the rate.

    ``values`` (samples,) or (samples, outputs); the result has (samples // 2 + 1) rows, in the unit
    of the values.
    """
    n = values.shape[0]
    amplitudes = np.abs(np.fft.rfft(values, axis=0)) * (2.0 / n)
    amplitudes[0] /= 2.0
    if n % 2 == 0:
        amplitudes[-1] /= 2.0
    return np.asarray(amplitudes, dtype=np.float64)


def _grown(seeds: set[int], steps: set[int], times: int, modulus: int) -> set[int]:
    """What is reached from the seeds in so many steps, as long as it is a quarter of all."""
    reached = edge = seeds
    for _ in range(times):
        edge = {(m + step) % modulus for m in edge for step in steps} - reached
        if len(reached) + len(edge) > modulus // 4:
            break
        reached = reached | edge
    return reached


def _mixtures(cycles: list[int]) -> set[int]:
    """Periods of Σ k_i f_i in the window for 1 < Σ|k_i| <= 5, those that are a tone's left out."""
    factors = mixed_lines(len(cycles), ANY_ORDER) if len(cycles) <= MOST_MIXED else ()
    mixed = (ks for ks in factors if sum(map(abs, ks)) > 1)
    return {abs(sum(k * c for k, c in zip(ks, cycles, strict=True))) for ks in mixed} - set(cycles)


def _candidates(halves: list[int]) -> list[int]:
    """Numbers of samples to try, the most wanted first; ``halves``: half periods of the tones."""
    least = max(LEAST_SAMPLES, BREADTH * (max(halves) - min(halves)))
    tried = range(least, min(8 * least, MOST_SAMPLES), max(1, least // 256))
    everything = max(halves) + 2  # zone 0 holds all of them
    centred = sorted(tried, key=lambda n: (_off_centre(halves, n), n))
    return centred + ([everything] if everything <= MOST_SAMPLES else [])


def _off_centre(halves: list[int], samples: int) -> float:
    """How far the middle of the tones is from the middle of the band, in bands; 1 beyond it."""
    zone = _common_zone(halves, samples)
    if zone is None:
        return 1.0
    return round(abs((max(halves) + min(halves)) / (2 * samples) - zone - 0.5), 1)


def _common_zone(halves: list[int], samples: int) -> int | None:
    """The zone that has all tones inside; None if there is none."""
    zones = {half // samples for half in halves}
    on_edge = any(half % samples == 0 for half in halves)
    return None if on_edge or len(zones) > 1 else zones.pop()
