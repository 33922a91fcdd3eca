"""One resonance that tests write into files of every kind, and a fit that no reader has part in."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from fitting.text.arrays import ComplexArray, FloatArray

#: The resonance of all these files: Hz, full width Hz.
F_HZ, WIDTH_HZ = 6940.25, 31.0
AXIS_HZ = np.linspace(6800.0, 7080.0, 57)
VALUES = 2e-3 * WIDTH_HZ * np.exp(0.4j) / (2 * (AXIS_HZ - F_HZ) - 1j * WIDTH_HZ)


def found_line(f: FloatArray, values: ComplexArray) -> tuple[float, float]:
    """Frequency and full width of one pole, by least squares of its complex gain and both."""

    def gain(x: FloatArray) -> tuple[complex, ComplexArray]:
        shape = 1.0 / (2 * (f - x[0]) - 1j * x[1])
        return np.vdot(shape, values) / np.vdot(shape, shape), shape

    def rest(x: FloatArray) -> FloatArray:
        a, shape = gain(x)
        return np.concatenate([(a * shape - values).real, (a * shape - values).imag])

    values = values / np.max(np.abs(values))
    start = [f[np.argmax(np.abs(values))], np.ptp(f) / 5]
    x = least_squares(rest, start, x_scale=[1.0, 1.0], xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    return float(x[0]), abs(float(x[1]))
