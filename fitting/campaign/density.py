"""Power spectral densities in a file: of what, in which unit, or as levels."""

from __future__ import annotations

import contextlib
import re
from dataclasses import dataclass

import numpy as np

from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.units import COMMON, convert

#: Units of what is seen whose squares per Hz a density may have.
OBSERVED_UNITS = ("m", "V", "m/s", "m/s**2", "A", "1")
#: Words for what a column holds where its unit does not tell it.
DENSITY, ROOT = HOLDS = ("density", "root")
#: Levels over a bandwidth, as "dBm/Hz" or "dBV/√Hz": ten decibels are a factor of ten in power.
LEVEL = re.compile(r"dB\w*\s*/\s*.*Hz.*")


@dataclass(frozen=True, eq=False)
class Density:
    """A power spectral density (n,) in `unit` squared per Hz, or relative; made of its root."""

    numbers: FloatArray
    unit: str
    is_relative: bool = False
    is_root: bool = False


def density_of(numbers: FloatArray, unit: str) -> Density | None:
    """The density that a column holds, or its root, or levels; None: none follows from the unit.

    Args:
        numbers: of the column, shape (n,).
        unit: of the column.
    """
    if LEVEL.fullmatch(unit):
        return Density(_powers(numbers), "1", is_relative=True)
    if unit in COMMON and not unit.endswith("/Hz"):
        return None
    for observed in OBSERVED_UNITS:
        for power, whole in ((1, f"({observed})**2/Hz"), (2, f"({observed})/Hz**0.5")):
            with contextlib.suppress(BadInput):
                factor = convert(1.0, unit, whole, where="")
                return Density((factor * numbers) ** power, observed, is_root=power == 2)
    return None


def relative_density(numbers: FloatArray, unit: str | None, holds: str) -> Density:
    """The density of a column whose unit does not determine it, as relative numbers.

    Args:
        numbers: of the column, shape (n,).
        unit: of the column; None: none is stated.
        holds: `DENSITY` or `ROOT`.
    """
    if (unit or "").startswith("dB"):
        return Density(_powers(numbers), "1", is_relative=True)
    is_root = holds == ROOT
    return Density(numbers ** (2 if is_root else 1), "1", is_relative=True, is_root=is_root)


def _powers(levels: FloatArray) -> FloatArray:
    return np.asarray(10.0 ** ((levels - np.max(levels)) / 10.0))
