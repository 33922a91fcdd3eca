"""Free decays of two modes as a lock-in shows them, from the eigenvalues of their equations.

    x' = A x,   z(t) = sum over Im s > 0 of 2 (c v_k) (w_k x0) exp((s_k - 2 pi i f) t)

so that q(t) = Re[z(t) exp(2 pi i f t)]. `string` writes the equations down; nothing is sampled.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from fitting.text.arrays import FloatArray


def demodulated(
    matrices: tuple[FloatArray, FloatArray, FloatArray],
    start: Sequence[float],
    frequency_hz: float,
    times_s: FloatArray,
) -> npt.NDArray[np.complex128]:
    """Phasors (n,) at times (n,) that follow a state at time zero, in Hz and s."""
    a, _, c = matrices
    rates, shapes = np.linalg.eig(a)
    parts = 2.0 * (c @ shapes) * np.linalg.solve(shapes, np.asarray(start, dtype=complex))
    found = np.zeros(times_s.size, dtype=complex)
    for rate, part in zip(rates, parts, strict=True):
        if rate.imag > 0.0:
            # what turns within a sample is left out before the product with a long time
            beside = float(Fraction(rate.imag / (2.0 * np.pi)) - Fraction(frequency_hz))
            found += part * np.exp((rate.real + 2j * np.pi * beside) * times_s)
    return found
