"""The response of the oscillator of tests/support/cfmus/own_step.h, from matrices of scipy."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm


def phasor(
    tone_hz: float, step_s: float, eigenfrequency_hz: float = 31.0, line_width_hz: float = 2.0
) -> complex:
    """Phasor of x'' + g x' + w0^2 x = w0^2 cos 2 pi f t, the force held over steps at its middle.

    With X the state after n steps, X' = P X + G F(n h + h/2), (z - P) X = G e^(i pi f h), z =
    e^(2 pi i f h); without steps w0^2/(w0^2 - w^2 + i g w).
    """
    w, w0, g = 2.0 * np.pi * np.array([tone_hz, eigenfrequency_hz, line_width_hz])
    if step_s == 0.0:
        return complex(w0**2 / (w0**2 - w**2 + 1j * g * w))
    whole = np.zeros((3, 3))
    whole[0, 1], whole[1] = 1.0, (-(w0**2), -g, w0**2)
    step = expm(whole * step_s)
    z, middle = np.exp(1j * w * step_s), np.exp(0.5j * w * step_s)
    return complex(np.linalg.solve(z * np.eye(2) - step[:2, :2], step[:2, 2] * middle)[0])
