"""Two driven modes in 50-digit arithmetic: the truth that a simulation is measured against.

The only door of mpmath; belongs to the virtual laboratory and shares no code with the FMU. Every
double that goes in is taken as exact, every result is rounded to a double once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mpmath as mp
import numpy as np

from fitting.lab.string import TwoModes
from fitting.text.arrays import FloatArray

DIGITS = 50
#: Relative half width of the interval in which a maximum is looked for, in line widths.
SEARCH_WIDTHS = 2


def damping_hz(modes: TwoModes) -> Any:
    """T diag(d1, d2) T^T as an mpmath matrix (2, 2), Hz; its diagonal are the line widths.

    Args:
        modes: the two modes: η, damping and angle, as `TwoModes` explains.
    """
    c, s = mp.cos(mp.mpf(modes.theta_rad)), mp.sin(mp.mpf(modes.theta_rad))
    turn = mp.matrix([[-c, s], [s, c]] if modes.reflection else [[c, -s], [s, c]])
    return turn * mp.diag([mp.mpf(modes.d1_hz), mp.mpf(modes.d2_hz)]) * turn.T


def line_width_hz(modes: TwoModes, observed: int) -> float:
    """Full line width of a hybridised mode, (T D T^T)_ii / 2 pi, Hz.

    Args:
        modes: the two modes: η, damping and angle, as `TwoModes` explains.
        observed: which mode is read, 0 or 1.
    """
    with mp.workdps(DIGITS):
        return float(damping_hz(modes)[observed, observed])


def amplitudes(modes: TwoModes, observed: int, tones_hz: Sequence[float]) -> FloatArray:
    """Steady amplitudes (n,) of one hybridised mode per unit drive at each of the tones, s^2.

    |X(u)| with A(u) X = (1, 1)^T, A(u) = C - (2 pi u)^2 I + 2 pi i u T D T^T. The model is linear:
    several tones at once give each the amplitude that it has alone.

    Source: arXiv:2412.07301, the periodic solution of the coupled system.

    Args:
        modes: the two modes: η, damping and angle, as `TwoModes` explains.
        observed: which mode is read, 0 or 1.
        tones_hz: frequencies of the tones, Hz.
    """
    with mp.workdps(DIGITS):
        damping = damping_hz(modes)
        result = [abs(_phasors(modes, damping, mp.mpf(u))[observed]) for u in tones_hz]
        return np.array([float(a) for a in result])


def crest(modes: TwoModes, observed: int) -> float:
    """Maximum over the frequency of the amplitude of one hybridised mode near its own line, s^2.

    Args:
        modes: the two modes: η, damping and angle, as `TwoModes` explains.
        observed: which mode is read, 0 or 1.
    """
    with mp.workdps(DIGITS):
        damping = damping_hz(modes)
        eta = mp.mpf((modes.eta_plus_hz, modes.eta_minus_hz)[observed])
        reach = SEARCH_WIDTHS * damping[observed, observed]
        low, high = eta - reach, eta + reach
        golden = (mp.sqrt(5) - 1) / 2
        # near the top A falls with the square of the distance: 25 digits of u are 50 of A
        while high - low > eta * mp.mpf(10) ** -22:
            step = golden * (high - low)
            left, right = high - step, low + step
            heights = [abs(_phasors(modes, damping, u)[observed]) for u in (left, right)]
            low, high = (left, high) if heights[0] < heights[1] else (low, right)
        return float(abs(_phasors(modes, damping, (low + high) / 2)[observed]))


def _phasors(modes: TwoModes, damping: Any, u: Any) -> tuple[Any, Any]:
    """Both modes' response to exp(2 pi i u t) on each, by Cramer's rule."""
    eta1, eta2 = mp.mpf(modes.eta_plus_hz), mp.mpf(modes.eta_minus_hz)
    a11 = eta1 * eta1 - u * u + 1j * u * damping[0, 0]
    a22 = eta2 * eta2 - u * u + 1j * u * damping[1, 1]
    a12 = 1j * u * damping[0, 1]
    scale = (2 * mp.pi) ** 2 * (a11 * a22 - a12 * a12)
    return (a22 - a12) / scale, (a11 - a12) / scale
