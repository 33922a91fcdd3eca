"""Points of a curve that an instrument cut off at its limit: they are left out, and it is said."""

from __future__ import annotations

import numpy as np

from fitting.signal.clipped_top import clipped_parts, clipped_top
from fitting.signal.peaks import MIN_SWEEP_POINTS
from fitting.text.arrays import BoolArray, ComplexArray, FloatArray
from fitting.text.notation import hertz, number, prefixed


def cut_off(
    u_hz: FloatArray, values: FloatArray | ComplexArray, unit: str, source: str
) -> tuple[BoolArray, str]:
    """Points that are cut off, (n,), and what is said of them; none where too few would be left.

    Args:
        u_hz: frequencies of the tone, rising, shape (n,), Hz.
        values: amplitudes, or X + i Y, shape (n,).
        unit: of the values.
        source: what the sentence names them by.
    """
    if np.iscomplexobj(values):
        what, (cut, limit) = "X, Y or the amplitude", clipped_parts(u_hz, np.asarray(values))
    else:
        amplitude = np.asarray(values, dtype=float)
        what, cut = "the amplitude", clipped_top(amplitude)
        limit = float(np.max(amplitude, initial=0.0))
    if not np.any(cut) or np.sum(~cut) < MIN_SWEEP_POINTS:
        return np.zeros(cut.size, dtype=np.bool_), ""
    factor, of_unit = prefixed(limit, "" if unit == "1" else unit)
    most = f"{number(limit / factor, 4)} {of_unit}".rstrip()
    left = u_hz[cut]
    ends = hertz(float(left[0]), float(left[-1]), digits=8, joined=" and ")
    return cut, (
        f"{source}: {int(np.sum(cut))} points between {ends} are left out: {what} is the same "
        f"there at its largest, {most}, or as close to it as noise goes, as an instrument makes it "
        "at its limit."
    )
