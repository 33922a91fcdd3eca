"""Noise of a curve that is smooth but for it, and of magnitudes, whose noise is Rice's.

The length R of a phasor of length nu in Gaussian noise has Rice's distribution.

    R = |nu + s (g1 + i g2)|,    x = nu^2/(4 s^2)
    mean s sqrt(pi/2) e^-x ((1 + 2 x) I0(x) + 2 x I1(x)),    variance 2 s^2 + nu^2 - mean^2

s is the standard deviation of each quadrature. Without a phasor the mean is 1.25 s and the
deviation 0.66 s; far above the noise they are nu + s^2/(2 nu) and s. Source: S. O. Rice, Bell
System Technical Journal 24 (1945) 46.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import i0e, i1e

from fitting.text.arrays import ComplexArray, FloatArray

#: Differences of this order leave noise alone where a curve is resolved; its weight on white noise.
DIFFERENCES, WEIGHT = 4, float(np.sqrt(70.0))
#: Curves with fewer points do not show their noise by themselves.
LEAST_FOR_NOISE = 50
#: Degrees of freedom that an estimate has of each point beyond the differences: neighbouring ones
#: are correlated, and their median determines less than their squares would.
FREEDOM = 0.2
#: Median of |x| of a normal distribution of unit variance.
MEDIAN_OF_NORMAL = 0.6744897501960817
#: Samples of a stretch that distinguishes noise and size, at least, and stretches at most.
STRETCH, STRETCHES = 16, 20
#: How often sizes and noise are taken from each other: of stretches, of single points.
ROUNDS, SETTLING = 4, 12
#: Sizes over noise between which a stretch determines its own, and how many are looked at.
FAINT, LOUD, KNOTS = 0.3, 1e7, 400


def roughness(values: FloatArray | ComplexArray) -> float:
    """Standard deviation of values about a smooth curve; 0 where too few points determine it.

    Median of |fourth differences|, of complex values that of both quadratures.

    Args:
        values: one after the other along the curve, (n,).
    """
    if values.size < LEAST_FOR_NOISE:
        return 0.0
    left = np.diff(values, DIFFERENCES) / WEIGHT
    return float(np.median(np.abs([left.real, left.imag] if np.iscomplexobj(left) else left))) / (
        MEDIAN_OF_NORMAL
    )


def roughness_freedom(points: int) -> float:
    """Degrees of freedom of a `roughness`: its relative variance is 1/(2 nu), of a smooth curve.

    nu = 0.2 (n - 4), found by simulation for 60 to 400 points of white noise (0.195 to 0.205).

    Args:
        points: of the curve, n.
    """
    return FREEDOM * max(points - DIFFERENCES, 1)


class Rician(NamedTuple):
    """Mean of R, its derivative by the length, 0 in the noise to 1 far above, and by s^2; (n,)."""

    mean: FloatArray
    slope: FloatArray
    rise: FloatArray


def rician(length: FloatArray, sigma: float | FloatArray) -> Rician:
    """Mean magnitude of phasors in noise, with its derivatives; without noise the length itself.

    Args:
        length: nu, (n,), zero or more.
        sigma: s, zero or more, in the same unit; one number, or (n,).
    """
    known = np.asarray(sigma) > 0.0
    noise = np.where(known, sigma, 1.0)
    x = 0.25 * (length / noise) ** 2
    even, odd = i0e(x), i1e(x)
    mean = noise * np.sqrt(0.5 * np.pi) * ((1.0 + 2.0 * x) * even + 2.0 * x * odd)
    far = 0.5 / np.maximum(length, 1e-9 * max(float(np.max(length, initial=0.0)), 1e-290))
    return Rician(
        np.where(known, mean, length),
        np.where(known, np.sqrt(0.5 * np.pi * x) * (even + odd), 1.0),
        np.where(known, np.sqrt(np.pi / 8.0) / noise * even, far),
    )


def rician_deviation(ratio: FloatArray) -> FloatArray:
    """Standard deviation of R over s, (n,), of 0.66 to 1.

    Args:
        ratio: nu/s, (n,), zero or more.
    """
    near = np.minimum(ratio, 1e4)  # beyond, the difference would cancel
    mean = rician(near, 1.0).mean
    return np.asarray(np.sqrt(2.0 + near**2 - mean**2))


def quadrature_noise(values: FloatArray) -> float:
    """Noise s of each quadrature of magnitudes along a curve; 0 where too few determine it.

    Fourth differences leave the deviations of R, which are less than s where nu is small: most
    points of a sweep may lie there, while its lines lie far above.

    Args:
        values: magnitudes, one after the other along the curve, (n,).
    """
    noise = roughness(values)
    if not noise > 0.0:
        return noise
    power = np.convolve(values**2, np.full(DIFFERENCES + 1, 1.0 / (DIFFERENCES + 1)), "valid")
    bends = np.abs(np.diff(values, DIFFERENCES)) / WEIGHT
    for _ in range(SETTLING):
        lengths = np.sqrt(np.maximum(power / noise**2 - 2.0, 0.0))
        noise = float(np.median(bends / rician_deviation(lengths))) / MEDIAN_OF_NORMAL
    return noise


@dataclass(frozen=True)
class Scatter:
    """Noise s of each quadrature, deviations of amplitudes over it, (n,), less in the noise.

    ``drowns``: somewhere the phasor is smaller than its noise, which is seen there by itself.
    """

    noise: float
    weights: FloatArray
    drowns: bool


def scatter_of(values: FloatArray) -> Scatter:
    """What the scatter of amplitudes shows of their noise.

    In every stretch the mean square, nu^2 + 2 s^2, and the variance from sample to sample give s;
    with the median of these the mean squares give nu/s. The variances over what they then should
    be give s anew, from all samples alike.

    Args:
        values: amplitudes, (n,), evenly sampled.
    """
    count = max(1, min(STRETCHES, values.size // STRETCH))
    edges = np.linspace(0, values.size, count + 1).astype(int)
    parts = [values[a:b] for a, b in itertools.pairwise(edges)]
    power = np.array([float(np.mean(part**2)) for part in parts])
    bends = [np.diff(part, 2) for part in parts]
    variance = np.array([float(bend @ bend) / (6.0 * bend.size) for bend in bends])
    logs = np.linspace(np.log(FAINT), np.log(LOUD), KNOTS)
    shares = rician_deviation(np.exp(logs)) ** 2
    rising = np.log((np.exp(2.0 * logs) + 2.0) / shares)
    smallest = np.finfo(float).tiny
    observed = np.log(np.maximum(power, smallest) / np.maximum(variance, smallest))
    noise = float(np.median(variance / np.exp(np.interp(observed, rising, np.log(shares)))))
    middles = 0.5 * (edges[:-1] + edges[1:])
    for _ in range(ROUNDS):
        squares = np.maximum(power / max(noise, smallest) - 2.0, FAINT**2)
        expected = rician_deviation(np.minimum(np.sqrt(squares), LOUD)) ** 2
        noise = float(np.mean(variance / expected))
    ratios = np.exp(0.5 * np.interp(np.arange(values.size), middles, np.log(squares)))
    return Scatter(
        noise=float(np.sqrt(noise)),
        weights=rician_deviation(np.minimum(ratios, LOUD)),
        drowns=bool(np.min(squares) < 1.0),
    )
