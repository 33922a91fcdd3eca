"""The types that numbers have in every signature: arrays by their element, and one value of FMI."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]
# the value of an FMU's variable or of a campaign's key
Scalar = float | int | bool | str
