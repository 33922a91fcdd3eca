"""Amplitudes as detectors have them: magnitudes of two quadratures, each with noise.

|a + sigma (x + i y)| is larger than a on average, the more the smaller a: its mean (Rice) is

    M(a) = sigma sqrt(pi/2) e^(-q) [(1 + 2 q) I0(q) + 2 q I1(q)]        q = a^2/(4 sigma^2)

from 1.25 sigma for no response at all to a + sigma^2/(2 a) for a large one.

Source: S. O. Rice, Mathematical analysis of random noise, Bell System Technical Journal 24 (1945).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import i0e, i1e

from fitting.text.arrays import FloatArray
from fitting.text.once import made_once

#: Beyond so many standard deviations the series in 1/a holds to 1e-9 sigma; below, a table of this
#: spacing does, for a fourth of the time of the Bessel functions.
FAR, SPACING = 16.0, 1.0 / 64.0


class Magnitude(NamedTuple):
    """Mean magnitudes (n,) and their slopes d mean/d amplitude (n,), from 0 to 1."""

    mean: FloatArray
    slope: FloatArray


@made_once
def _table() -> FloatArray:
    """Cubics (intervals, 4) in place of M(a) - a for sigma = 1, rising powers, from 0 to `FAR`."""
    a = np.linspace(0.0, FAR, 1 + round(FAR / SPACING))
    q = 0.25 * a**2
    even, odd = i0e(q), i1e(q)
    y = np.sqrt(0.5 * np.pi) * ((1.0 + 2.0 * q) * even + 2.0 * q * odd) - a
    slope = SPACING * (np.sqrt(np.pi / 8.0) * a * (even + odd) - 1.0)
    step, first, last = np.diff(y), slope[:-1], slope[1:]
    cubics = [y[:-1], first, 3.0 * step - 2.0 * first - last, first + last - 2.0 * step]
    return np.stack(cubics, axis=1)


def mean_magnitude(amplitude: FloatArray, sigma: FloatArray) -> Magnitude:
    """What magnitudes are on average, and how they follow the amplitude; to 1e-9 sigma.

    Args:
        amplitude: without noise, shape (n,), any unit, not negative.
        sigma: standard deviation of each quadrature, shape (n,), in that unit; zero: no noise.
    """
    known = sigma > 0.0
    noise = np.where(known, sigma, 1.0)
    ratio = np.where(known, amplitude / noise, FAR)
    small = ratio < FAR
    place = np.where(small, ratio / SPACING, 0.0)
    interval = place.astype(np.intp)
    t = place - interval
    c0, c1, c2, c3 = np.take(_table(), interval, axis=0).T
    far = np.maximum(ratio, FAR) ** -2.0
    series = ratio * far * (1 / 2 + far * (1 / 8 + far * (3 / 16 + far * 75 / 128)))
    more = noise * np.where(small, c0 + t * (c1 + t * (c2 + t * c3)), series)
    tangent = (c1 + t * (2.0 * c2 + t * 3.0 * c3)) / SPACING
    slope = np.where(small, tangent, -far * (1 / 2 + far * (3 / 8 + far * 15 / 16)))
    return Magnitude(
        np.where(known, amplitude + more, amplitude), np.where(known, 1.0 + slope, 1.0)
    )
