"""Frequencies of a column, whichever way it counts them."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from fitting.text.arrays import FloatArray
from fitting.text.units import convert, same_kind


def hertz_of(values: Iterable[float], unit: str, *, where: str) -> FloatArray:
    """Frequencies in Hz of a column, each rounded once: 6.94016 MHz is the tone 6940160 Hz exactly.

    Equal frequencies are then equal, whichever unit each file writes them in. Angular frequencies
    omega are omega/(2 pi): a column in rad/s means these.

    Args:
        values: of the column, shape (n,).
        unit: of the column.
        where: what complaints begin with.

    Raises:
        BadInput: another kind of unit.
    """
    if unit == "Hz":  # nothing is rounded
        return np.fromiter(values, dtype=float)
    if same_kind(unit, "rad/s"):
        return np.array([convert(float(v), unit, "rad/s", where=where) for v in values]) / math.tau
    return np.array([convert(float(v), unit, "Hz", where=where) for v in values])
