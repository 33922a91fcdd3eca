"""Points of a curve that an instrument cut off at its limit: they are left out, with a finding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitting.lines.excluded import clipped_points
from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.text.arrays import BoolArray, ComplexArray, FloatArray
from fitting.text.finding import Finding, left_out


def cut_off(
    u_hz: FloatArray, values: FloatArray | ComplexArray, unit: str, source: str
) -> tuple[BoolArray, tuple[Finding, ...]]:
    """Points that are cut off, (n,), and a finding on them; none where too few would be left.

    Args:
        u_hz: frequencies of the tone, rising, shape (n,), Hz.
        values: amplitudes, or X + i Y, shape (n,).
        unit: of the values.
        source: name of the file, with the curve.
    """
    cut, limit = clipped_points(u_hz, values)
    if not np.any(cut) or np.sum(~cut) < MIN_SWEEP_POINTS:
        return np.zeros(cut.size, dtype=np.bool_), ()
    ends = {"low_hz": float(u_hz[cut][0]), "high_hz": float(u_hz[cut][-1])}
    numbers = {"limit": limit, "parts": float(np.iscomplexobj(values)), **ends}
    result = left_out(source, int(np.sum(cut)), **numbers)
    return cut, (replace(result, names={**result.names, "unit": (unit,)}),)
