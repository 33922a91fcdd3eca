"""Laboratory traces to numbers: noise floor, amplitude at known tones.

Works on plain arrays in Hz and volts (or whatever unit the detector was declared in).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.text.arrays import BoolArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, how_many

FLOOR_KINDS = ("robust", "mean", "none")

# |n| of complex Gaussian noise with sigma per quadrature is Rayleigh distributed.
RAYLEIGH_MEAN = math.sqrt(math.pi / 2.0)
RAYLEIGH_MEDIAN = math.sqrt(2.0 * math.log(2.0))

GUARD_POINTS = 6  # a resolution filter sampled at its own bandwidth is below 1e-20 there
MIN_FLOOR_POINTS = 10
DETECTION_SIGMA = 4.0  # noise alone exceeds it in one trace point of 3000
CHANCE = 1e-6  # of an unknown line of noise alone, in a whole spectrum


@dataclass(frozen=True)
class NoiseFloor:
    """Noise of a magnitude trace: mean magnitude ``level_v`` and ``sigma_v`` per quadrature."""

    level_v: float
    sigma_v: float


@dataclass(frozen=True, kw_only=True)
class PeakReading:
    """Amplitudes at the known tones of one spectrum.

    ``peaks_v`` (n,) with the floor removed, ``sigmas_v`` (n,) standard deviations, ``raw_v`` (n,)
    as read, ``floor`` of the trace. All in the trace's amplitude unit.
    """

    peaks_v: FloatArray
    sigmas_v: FloatArray
    raw_v: FloatArray
    floor: NoiseFloor


def noise_floor(
    frequency_hz: FloatArray,
    amplitude_v: FloatArray,
    tones_hz: Sequence[float],
    kind: str,
    *,
    source: str = "spectrum",
) -> NoiseFloor:
    """Noise level of a magnitude spectrum from the points away from every tone.

    "mean": level = average (the paper's xi), sigma = level / sqrt(pi/2). "robust" and "none":
    sigma = median / sqrt(2 ln 2), level = sigma sqrt(pi/2); spurious lines and skirts on up to
    half of the points shift it little. Rayleigh statistics of the magnitude in both.

    Args:
        frequency_hz: frequencies (n,), Hz.
        amplitude_v: amplitudes (n,), V peak.
        tones_hz: frequencies of the tones, Hz.
        kind: how the floor is taken: "mean", "robust" or "none".
        source: of the data, for complaints.

    Raises:
        BadInput: too few points away from the tones.
    """
    quiet = amplitude_v[_away(frequency_hz, tones_hz)]
    if quiet.size < MIN_FLOOR_POINTS:
        raise BadInput(
            f"{source}: {how_many(quiet.size, 'point')} more than {GUARD_POINTS} points away from "
            f"the tones; the noise floor wants at least {MIN_FLOOR_POINTS} (a wider span, or ready "
            "peaks)"
        )
    if kind == "mean":
        level = float(np.mean(quiet))
        return NoiseFloor(level, level / RAYLEIGH_MEAN)
    sigma = float(np.median(quiet)) / RAYLEIGH_MEDIAN
    return NoiseFloor(sigma * RAYLEIGH_MEAN, sigma)


def read_peaks(
    frequency_hz: FloatArray,
    amplitude_v: FloatArray,
    tones_hz: Sequence[float],
    kind: str = "robust",
    *,
    source: str = "spectrum",
) -> PeakReading:
    """Amplitudes at ``tones_hz`` of a magnitude spectrum, noise floor removed.

    "mean" subtracts the average floor, z* = z - xi, as the paper does. "robust" takes the noise off
    in quadrature, z* = sqrt(z^2 - sigma^2), which leaves a bias of order sigma^4 / z^3; the plain
    difference takes 1 percent off a peak 100 times the floor. "none" leaves z.

    Args:
        frequency_hz: frequencies (n,), Hz.
        amplitude_v: amplitudes (n,), V peak.
        tones_hz: frequencies of the tones, Hz.
        kind: how the floor is taken: "mean", "robust" or "none".
        source: of the data, for complaints.

    Raises:
        BadInput: a tone outside the trace, or one that does not stand out of the floor.

    Source: the paper, section on the laboratory data; Gudbjartsson and Patz, The Rician
    distribution of noisy MRI data, Magn. Reson. Med. 34 (1995) 910, for the quadrature.
    """
    if kind not in FLOOR_KINDS:
        raise ValueError(f"noise floor kind {kind!r}, wanted one of {FLOOR_KINDS}")
    for tone in tones_hz:
        _check_inside(frequency_hz, tone, source)
    raw = np.array([_amplitude_at(frequency_hz, amplitude_v, tone) for tone in tones_hz])
    if kind == "none" and frequency_hz.size < MIN_FLOOR_POINTS + (2 * GUARD_POINTS + 1) * len(raw):
        floor = NoiseFloor(0.0, 0.0)  # a bare list of lines has no floor to read
    else:
        floor = noise_floor(frequency_hz, amplitude_v, tones_hz, kind, source=source)
    for tone, height in zip(tones_hz, raw, strict=True):
        if not height > DETECTION_SIGMA * floor.sigma_v:
            raise BadInput(
                f"{source}: no peak at the tone {hertz(tone, digits=8)}: {height:.3g} read on "
                f"a noise floor of {floor.level_v:.3g}; wanted at least "
                f"{DETECTION_SIGMA * floor.sigma_v:.3g} (wrong file, or wrong drive frequency?)"
            )
    if kind == "mean":
        peaks = raw - floor.level_v
    elif kind == "robust":
        peaks = raw * np.sqrt(1.0 - (floor.sigma_v / raw) ** 2)  # no square of a volt: any scale
    else:
        peaks = raw
    return PeakReading(
        peaks_v=peaks, sigmas_v=np.full(raw.shape, floor.sigma_v), raw_v=raw, floor=floor
    )


def unknown_line(
    frequency_hz: FloatArray, amplitude_v: FloatArray, known_hz: Sequence[float]
) -> tuple[float, float] | None:
    """The largest line of a spectrum at none of the known frequencies: (Hz, amplitude), or None.

    Returned where noise alone reaches that height at any of the points less often than `CHANCE`:
    a > sigma sqrt(2 ln(n/CHANCE)) for n Rayleigh-distributed magnitudes.

    Args:
        frequency_hz: frequencies (n,), Hz.
        amplitude_v: amplitudes (n,), any unit.
        known_hz: lines that are expected, Hz.
    """
    rest = np.flatnonzero(_away(frequency_hz, known_hz))
    if rest.size < MIN_FLOOR_POINTS:
        return None
    sigma = float(np.median(amplitude_v[rest])) / RAYLEIGH_MEDIAN
    top = int(rest[np.argmax(amplitude_v[rest])])
    if not amplitude_v[top] > sigma * math.sqrt(2.0 * math.log(rest.size / CHANCE)):
        return None
    return float(frequency_hz[top]), float(amplitude_v[top])


def _away(frequency_hz: FloatArray, tones_hz: Sequence[float]) -> BoolArray:
    """Which points are away from every tone, (n,)."""
    away = np.ones(frequency_hz.size, dtype=np.bool_)
    for tone in tones_hz:
        nearest = int(np.argmin(np.abs(frequency_hz - tone)))
        away[max(0, nearest - GUARD_POINTS) : nearest + GUARD_POINTS + 1] = False
    return away


def _check_inside(frequency_hz: FloatArray, tone_hz: float, source: str) -> None:
    first, last = float(frequency_hz[0]), float(frequency_hz[-1])
    slack = 0.5 * (last - first) / max(1, frequency_hz.size - 1)
    if not first - slack <= tone_hz <= last + slack:
        raise BadInput(
            f"{source}: does not contain the tone {hertz(tone_hz, digits=8)}; its points run "
            f"from {hertz(first, last, digits=8, joined=' to ')}"
        )


def _amplitude_at(frequency_hz: FloatArray, amplitude_v: FloatArray, tone_hz: float) -> float:
    """Amplitude of a line at a known frequency: the point itself, or the crest between points.

    Where the tone lies on a point, that point is the amplitude and nothing is fitted to noise.
    Between points the crest of the parabola through the logarithms of three points is taken: exact
    for the Gaussian resolution filter of a spectrum analyser.
    """
    nearest = int(np.argmin(np.abs(frequency_hz - tone_hz)))
    neighbours = frequency_hz[max(0, nearest - 1) : nearest + 2]
    step = float(np.min(np.diff(neighbours))) if neighbours.size > 1 else 0.0
    if abs(float(frequency_hz[nearest]) - tone_hz) <= 1e-3 * step or not 0 < nearest < (
        frequency_hz.size - 1
    ):
        return float(amplitude_v[nearest])
    f, a = neighbours - tone_hz, amplitude_v[nearest - 1 : nearest + 2]
    if np.any(a <= 0.0):
        return float(np.max(a))
    curvature, slope, height = np.polyfit(f / step, np.log(a), 2)
    crest = -slope / (2.0 * curvature) if curvature < 0.0 else math.inf
    if abs(crest) > 1.0:  # no line within a point of the tone: leave it to the detection limit
        return float(np.max(a))
    return float(math.exp(height - slope**2 / (4.0 * curvature)))
