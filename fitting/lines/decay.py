"""A mode that is left alone: a decay of which frequency and damping may follow the amplitude.

    z(t) = q^(-1/2) exp(-pi w t + 2 pi i (f t + s ln(q)/(2 pi v)))
    q = 1 + 2 pi v T          T = (1 - exp(-2 pi w t))/(2 pi w)

solves z' = (-pi (w + v |z|^2) + 2 pi i (f + s |z|^2)) z from z = 1: w is the FWHM of small
amplitudes, and at the first sample v comes on top of it and the frequency is moved by s, as that of
a Duffing oscillator is. Without v the turns by s are s T.

Source: A. Nayfeh and D. Mook, Nonlinear Oscillations (1979), sections 2.2 and 3.2, by averaging.
"""

from __future__ import annotations

import math

import numpy as np

from fitting.lines.lorentzian import Response
from fitting.text.arrays import FloatArray

#: Widths over one over the record beyond which exponentials overflow.
WIDEST = 200.0
#: Size below which a ratio of differences is its series.
SMALL = 1e-4
#: Least q: beyond it the law has no solution.
LEAST = 1e-12


def decay(
    t: FloatArray, turns: float, width: float, shift: float = 0.0, extra: float = 0.0
) -> Response:
    """z with its derivatives by f, w, s and v, (4, n).

    Args:
        t: times over the length of the record, from zero, (n,).
        turns: f, turns over the record.
        width: w, over one over the record; negative of what grows.
        shift: s, turns over the record.
        extra: v, over one over the record.
    """
    width = float(np.clip(width, -WIDEST, WIDEST))
    rate = 2.0 * math.pi * width
    if abs(rate) < SMALL:
        at = rate * t
        passed = t * (1.0 - at / 2.0 + at**2 / 6.0)
        by_width = 2.0 * math.pi * t**2 * (-0.5 + at / 3.0 - at**2 / 8.0)
    else:
        passed = -np.expm1(-rate * t) / rate
        by_width = (t * np.exp(-rate * t) - passed) / width
    grown = 2.0 * math.pi * extra * passed
    q = np.maximum(1.0 + grown, LEAST)
    if abs(2.0 * math.pi * extra) < SMALL:
        moved = passed * (1.0 - grown / 2.0 + grown**2 / 3.0)
        by_extra = 2.0 * math.pi * passed**2 * (-0.5 + 2.0 * grown / 3.0 - 0.75 * grown**2)
    else:
        moved = np.log(q) / (2.0 * math.pi * extra)
        by_extra = (passed / q - moved) / extra
    turned = np.exp(-math.pi * width * t + 2j * math.pi * (turns * t + shift * moved))
    z = np.asarray(turned / np.sqrt(q), dtype=complex)
    slopes = (
        2j * math.pi * t,
        -math.pi * t + (-math.pi * extra + 2j * math.pi * shift) * by_width / q,
        2j * math.pi * moved,
        -math.pi * passed / q + 2j * math.pi * shift * by_extra,
    )
    return Response(z, np.stack([np.asarray(slope * z, dtype=complex) for slope in slopes]))
