"""Types of numbers in every signature, and arrays as people hand them over, checked."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any

import numpy as np
import numpy.typing as npt

from fitting.text.errors import BadInput, shown

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


#: Largest of measured values: its square, and sums of squares of squares, are still numbers.
LEAST, MOST = 1e-70, 1e70


def as_numbers(values: npt.ArrayLike, where: str) -> FloatArray:
    """An array of doubles.

    Args:
        values: what is meant as one.
        where: file, row or key, for complaints.

    Raises:
        BadInput: it is none.
    """
    return np.asarray(_as_array(values, float, where), dtype=float)


def as_values(values: npt.ArrayLike, where: str) -> FloatArray | ComplexArray:
    """An array of doubles, or of complex numbers where these are handed over.

    Args:
        values: what is meant as one.
        where: file, row or key, for complaints.

    Raises:
        BadInput: it is none.
    """
    array = _as_array(values, None, where)
    if np.iscomplexobj(array):
        return np.asarray(_as_array(array, complex, where), dtype=complex)
    return as_numbers(array, where)


def _as_array(values: npt.ArrayLike, kind: type | None, where: str) -> Any:
    try:
        array = np.asarray(values, dtype=kind)
        if array.dtype.kind in "SUMm":  # text would be read, times would be counted
            raise TypeError
    except (TypeError, ValueError, OverflowError):
        what = " ".join(shown(values).split())  # arrays are shown on several lines
        raise BadInput(f"{where}: found {what}, wanted an array of numbers") from None
    return array


def require_size(values: FloatArray | ComplexArray, where: str) -> None:
    """Complain of values of which nothing can be computed in their unit; zeros alone pass.

    Args:
        values: finite ones.
        where: file, row or key, for complaints.

    Raises:
        BadInput: the largest of them is below `LEAST` or above `MOST`.
    """
    largest = float(np.max(np.abs(values), initial=0.0))
    if largest > 0.0 and not LEAST <= largest <= MOST:
        raise BadInput(
            f"{where}: the largest is {largest:.6g}, wanted {LEAST:g} to {MOST:g}, in another unit"
        )


def is_whole(value: object) -> bool:
    """Whether a value is a whole number, of Python or numpy, and no truth value.

    Args:
        value: what was handed over.
    """
    return isinstance(value, Integral) and not isinstance(value, bool)


def is_real(value: object) -> bool:
    """Whether a value is a real number, of Python or numpy, and no truth value.

    Args:
        value: what was handed over.
    """
    return isinstance(value, Real) and not isinstance(value, bool)
