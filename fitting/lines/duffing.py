"""The line of a mode whose frequency follows its own amplitude: a Duffing oscillator at one drive.

    h = -i/(1 + i y)        s = |h|^2 = 1/(1 + y^2)        y + b s = x = 2 (f - eta)/w

eta and w are those of small amplitudes; b, in half widths, is how far the top is shifted, so that
the amplitude is largest at eta + b w/2. Beyond |b| = 8/(3 sqrt 3) = 1.54 three amplitudes are
possible between two frequencies, and a sweep jumps: one that rises follows the branch that starts
below the line, the least y.

Source: L. Landau and E. Lifshitz, Mechanics, section 29; R. Lifshitz and M. Cross, Reviews of
Nonlinear Dynamics and Complexity 1 (2008) 1, for the slow amplitude.
"""

from __future__ import annotations

import math

import numpy as np

from fitting.lines.lorentzian import Response
from fitting.text.arrays import FloatArray

#: Bend, in half widths, from which three amplitudes are possible.
CRITICAL = 8.0 / (3.0 * math.sqrt(3.0))
#: Slope dx/dy at a fold, below which derivatives are those of a curve that is this steep.
STEEPEST = 1e-3


def duffing(frequency_hz: FloatArray, eta_hz: float, width_hz: float, bend: float) -> Response:
    """h of a rising sweep, with its derivatives by eta (1/Hz), by log width and by the bend.

    Args:
        frequency_hz: frequencies (n,), Hz.
        eta_hz: eigenfrequency of small amplitudes, Hz.
        width_hz: FWHM of small amplitudes, Hz.
        bend: b, shift of the top in half widths.
    """
    x = 2.0 * (frequency_hz - eta_hz) / width_hz
    y = _least_root(x, bend)
    size = 1.0 / (1.0 + y * y)
    h = np.asarray(-1j / (1.0 + 1j * y), dtype=complex)
    # dx/dy of x = y + b s; beyond a fold nothing is on this branch
    steep = 1.0 - 2.0 * bend * y * size**2
    steep = np.where(np.abs(steep) < STEEPEST, STEEPEST, steep)
    by_x = h * h / steep  # dh/dy = h^2
    return Response(h, np.stack([by_x * (-2.0 / width_hz), -by_x * x, -by_x * size]))


def _least_root(x: FloatArray, bend: float) -> FloatArray:
    """The least y (n,) with y^3 - x y^2 + y + b - x = 0, in closed form, with a step of Newton's.

    With y = t + x/3 that is t^3 + p t + q = 0: Viete's angles for three real roots, else Cardano's.
    """
    p = 1.0 - x * x / 3.0
    q = bend - 2.0 * x / 3.0 - 2.0 * x**3 / 27.0
    square = 0.25 * q * q + p**3 / 27.0
    u = -np.copysign(np.cbrt(0.5 * np.abs(q) + np.sqrt(np.maximum(square, 0.0))), q)
    single = u - p / np.where(u == 0.0, 1.0, 3.0 * u)
    radius = np.sqrt(np.maximum(-p, 0.0) / 3.0)
    cosine = np.clip(-0.5 * q / np.maximum(radius, 1e-100) ** 3, -1.0, 1.0)
    least = 2.0 * radius * np.cos((np.arccos(cosine) + 2.0 * np.pi) / 3.0)
    y = np.where(square < 0.0, least, single) + x / 3.0
    slope = 1.0 + y * (3.0 * y - 2.0 * x)
    step = ((y - x) * (1.0 + y * y) + bend) / np.where(np.abs(slope) > STEEPEST, slope, np.inf)
    return np.asarray(y - step)
