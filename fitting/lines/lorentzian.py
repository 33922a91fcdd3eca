"""The response of one driven damped mode: a Lorentzian at high Q.

    g(f) = w eta/((eta - f)(eta + f) + i f w)        eta eigenfrequency, w FWHM, |g(eta)| = 1

Near the line g = -i/(1 + i x) with x = 2 (f - eta)/w: phases fall over it, as of
Re[g exp(i 2 pi f t)]. The difference of squares is factored because at high Q it cancels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray


def mode_response(frequency_hz: FloatArray, eta_hz: float, width_hz: float) -> ComplexArray:
    """Response of one driven damped mode, 1 at eta in magnitude, shape of ``frequency_hz``.

    g(f) = w eta / ((eta - f)(eta + f) + i f w); the difference of squares is factored because at
    high Q it cancels. |g|^2 is a Lorentzian of full width w close to eta.

    Args:
        frequency_hz: frequencies (n,), Hz.
        eta_hz: resonance frequency, Hz.
        width_hz: full line width, Hz.
    """
    detuning = (eta_hz - frequency_hz) * (eta_hz + frequency_hz)
    return np.asarray(width_hz * eta_hz / (detuning + 1j * frequency_hz * width_hz))


class Response(NamedTuple):
    """A complex curve (n,) with its derivatives by its unknowns (q, n)."""

    values: ComplexArray
    slopes: ComplexArray


def lorentzian(frequency_hz: FloatArray, eta_hz: float, width_hz: float) -> Response:
    """g with its derivatives by eta (1/Hz) and by the logarithm of the width.

    Args:
        frequency_hz: frequencies (n,), Hz.
        eta_hz: eigenfrequency, Hz.
        width_hz: FWHM, Hz.
    """
    g = mode_response(frequency_hz, eta_hz, width_hz)
    by_eta = g * (1.0 / eta_hz - 2.0 / width_hz * g)
    by_log_width = g * (1.0 - 1j * frequency_hz / eta_hz * g)
    return Response(g, np.stack([by_eta, by_log_width]))
