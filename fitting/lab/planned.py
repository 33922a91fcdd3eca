"""The virtual laboratory measures a planned campaign: given drives, outputs and numbers of spectra.

It comes after the bench's own series: the modes are where that series left them. The laboratory
follows the resonances, so that they drift no further, but for the departure from a straight line
that the bench has.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.lab.string import Bench, TwoModes, steady_state
from fitting.text.arrays import FloatArray


@dataclass(frozen=True)
class Planned:
    """One planned measurement: tones, drive amplitude of each, modal gains, observed mode (0, 1).

    ``averaged`` spectra are averaged with their phases kept, so that noise falls by their root.
    """

    label: str
    tones_hz: tuple[float, ...]
    amplitudes: tuple[float, ...]
    observed: int
    averaged: int = 1
    gains: tuple[float, float] = (1.0, 1.0)

    def __post_init__(self) -> None:
        if self.observed not in (0, 1):
            raise ValueError(f"observed mode {self.observed}, wanted 0 or 1")
        if len(self.amplitudes) != len(self.tones_hz) or self.averaged < 1:
            raise ValueError(f"{self.label}: an amplitude per tone and at least one spectrum")


@dataclass(frozen=True)
class Noise:
    """Of one spectrum's peak: ``floor_v`` per quadrature, ``relative`` to the peak for good."""

    floor_v: float
    relative: float

    def sigma_v(self, peaks_v: FloatArray, averaged: int) -> FloatArray:
        """Standard deviation of peaks after averaging, (n,)."""
        return np.asarray(np.hypot(self.floor_v / math.sqrt(averaged), self.relative * peaks_v))


@dataclass(frozen=True)
class PlannedSeries:
    """What the laboratory hands over, (m, tones) each, and beside it the truth of each row."""

    bench: Bench
    seed: int
    planned: tuple[Planned, ...]
    peaks_v: FloatArray
    sigmas_v: FloatArray
    eta_before_hz: tuple[float, float]
    eta_after_hz: tuple[float, float]
    true_modes: tuple[TwoModes, ...]
    true_peaks_v: FloatArray


def measure_planned(
    bench: Bench, planned: Sequence[Planned], noise: Noise, seed: int
) -> PlannedSeries:
    """Measure the rows of a plan one after the other; the same arguments give the same numbers.

    A peak is |gain A X + n| (1 + r) with complex Gaussian noise n of the floor after averaging, and
    r of the relative noise. ``bench.noise_scale`` multiplies all of it.
    """
    rng = np.random.default_rng(seed)
    first = bench.at(0.0)
    crest_hz = (first.eta_plus_hz, first.eta_minus_hz)[bench.observed]
    crest = np.abs(steady_state(first, np.array([crest_hz]))[0, bench.observed])
    volts = bench.crest_v / float(crest)
    own = Noise(bench.noise_scale * noise.floor_v, bench.noise_scale * noise.relative)
    states, lines, peaks = [], [], []
    for index, row in enumerate(planned):
        state = _state(bench, 0.5 if len(planned) == 1 else index / (len(planned) - 1))
        waves = steady_state(state, np.array(row.tones_hz), row.gains)[:, row.observed]
        line = volts * np.array(row.amplitudes) * waves
        quadratures = rng.standard_normal((2, line.size)) * own.floor_v / math.sqrt(row.averaged)
        factor = 1.0 + own.relative * rng.standard_normal(line.size)
        peaks.append(np.abs(line + quadratures[0] + 1j * quadratures[1]) * np.abs(factor))
        states.append(state)
        lines.append(np.abs(line))
    error = (bench.noise_scale * bench.eta_error_hz * rng.standard_normal(4)).tolist()
    before, after = _state(bench, 0.0), _state(bench, 1.0)
    return PlannedSeries(
        bench=bench,
        seed=seed,
        planned=tuple(planned),
        peaks_v=np.array(peaks),
        sigmas_v=np.array(
            [own.sigma_v(p, row.averaged) for p, row in zip(peaks, planned, strict=True)]
        ),
        eta_before_hz=(before.eta_plus_hz + error[0], before.eta_minus_hz + error[1]),
        eta_after_hz=(after.eta_plus_hz + error[2], after.eta_minus_hz + error[3]),
        true_modes=tuple(states),
        true_peaks_v=np.array(lines),
    )


def _state(bench: Bench, position: float) -> TwoModes:
    """The modes at ``position`` in [0, 1] of the planned series."""
    end = bench.at(1.0)
    bow = 4.0 * bench.curvature_hz * position * (1.0 - position)
    return replace(end, eta_plus_hz=end.eta_plus_hz + bow, eta_minus_hz=end.eta_minus_hz + bow)
