"""Types of numbers in every signature, arrays and one value of FMI; parts of complex arrays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]
# the value of an FMU's variable or of a campaign's key
Scalar = float | int | bool | str


def both_parts(values: ComplexArray, axis: int = 0) -> FloatArray:
    """All real parts before all imaginary ones, twice as many along an axis.

    Args:
        values: any shape.
        axis: along which they follow each other.
    """
    return np.concatenate([values.real, values.imag], axis=axis)
