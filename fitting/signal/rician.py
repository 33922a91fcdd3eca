"""Rice's distribution: the length R of a phasor of length nu in Gaussian noise.

    R = |nu + s (g1 + i g2)|,    x = nu^2/(4 s^2)
    mean s sqrt(pi/2) e^-x ((1 + 2 x) I0(x) + 2 x I1(x)),    variance 2 s^2 + nu^2 - mean^2

s is the standard deviation of each quadrature. Without a phasor the mean is 1.25 s and the
deviation 0.66 s; far above the noise they are nu + s^2/(2 nu) and s. Source: S. O. Rice, Bell
System Technical Journal 24 (1945) 46.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.special import i0e, i1e

from fitting.text.arrays import FloatArray

#: Samples of a stretch over which noise and size are told apart, at least, and stretches at most.
STRETCH, STRETCHES = 16, 40
#: Sizes over noise between which a stretch tells its own, and how many are looked at.
FAINT, LOUD, KNOTS = 1e-2, 1e7, 400


def rician_mean(length: FloatArray, sigma: float) -> FloatArray:
    """Mean of R, (n,).

    Args:
        length: nu, (n,), zero or more.
        sigma: s, zero or more, in the same unit.
    """
    if sigma == 0.0:
        return np.array(length)
    x = 0.25 * (length / sigma) ** 2
    return np.asarray(sigma * np.sqrt(0.5 * np.pi) * ((1.0 + 2.0 * x) * i0e(x) + 2.0 * x * i1e(x)))


def rician_slope(length: FloatArray, sigma: float) -> FloatArray:
    """Derivative of the mean by the length, (n,): 0 in the noise, 1 far above it.

    Args:
        length: nu, (n,), zero or more.
        sigma: s, zero or more, in the same unit.
    """
    if sigma == 0.0:
        return np.ones(length.size)
    x = 0.25 * (length / sigma) ** 2
    return np.asarray(np.sqrt(0.5 * np.pi * x) * (i0e(x) + i1e(x)))


def rician_rise(length: FloatArray, sigma: float) -> FloatArray:
    """Derivative of the mean by s^2, (n,): 1/(2 nu) far above the noise.

    Args:
        length: nu, (n,), zero or more.
        sigma: s, zero or more, in the same unit.
    """
    if sigma == 0.0:
        return 0.5 / np.maximum(length, 1e-9 * float(np.max(length)))
    x = 0.25 * (length / sigma) ** 2
    return np.asarray(np.sqrt(np.pi / 8.0) / sigma * i0e(x))


def rician_deviation(ratio: FloatArray) -> FloatArray:
    """Standard deviation of R over s, (n,), of 0.66 to 1.

    Args:
        ratio: nu/s, (n,), zero or more.
    """
    near = np.minimum(ratio, 1e4)  # beyond, the difference would cancel
    mean = rician_mean(near, 1.0)
    return np.asarray(np.sqrt(2.0 + near**2 - mean**2))


def noise_weights(values: FloatArray) -> FloatArray:
    """Deviations of amplitudes over s, (n,), as their own scatter tells: less in the noise.

    In stretches the mean square, nu^2 + 2 s^2, and the scatter from sample to sample tell nu/s.

    Args:
        values: amplitudes, (n,), evenly sampled.
    """
    count = max(1, min(STRETCHES, values.size // STRETCH))
    edges = np.linspace(0, values.size, count + 1).astype(int)
    middles = 0.5 * (edges[:-1] + edges[1:])
    ratios = [_ratio(values[a:b]) for a, b in itertools.pairwise(edges)]
    logs = np.interp(np.arange(values.size), middles, np.log(ratios))
    return rician_deviation(np.exp(logs))


def _ratio(values: FloatArray) -> float:
    """Size over noise of a stretch: that whose mean square over its variance is as seen."""
    bent = np.diff(values, 2)
    variance = float(bent @ bent) / (6.0 * bent.size)
    if variance <= 0.0:
        return LOUD
    logs = np.linspace(np.log(FAINT), np.log(LOUD), KNOTS)
    squares = np.exp(2.0 * logs) + 2.0
    shares = np.log(squares / rician_deviation(np.exp(logs)) ** 2)  # rises with the size
    return float(np.exp(np.interp(np.log(np.mean(values**2) / variance), shares, logs)))
