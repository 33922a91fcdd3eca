"""The noise of a datum, by which the accuracy of its simulation is chosen where none is named."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from fitting.text.arrays import FloatArray

#: Of the noise of a datum, what its simulation may be off by where no accuracy is requested.
PART = 0.1
#: That accuracy at least and at most.
LEAST, MOST = 1e-9, 1e-2
#: Values from which noise is estimated, at least.
FEWEST = 16


def accuracy_for(noises: Iterable[float]) -> float | None:
    """The relative accuracy for data of such noise; None: nothing is known of any.

        a = min(max(0.1 min sigma/|y|, 1e-9), 1e-2)

    Args:
        noises: relative standard deviations of data; zero where unknown.
    """
    known = [noise for noise in noises if 0.0 < noise < math.inf]
    return float(np.clip(PART * min(known), LEAST, MOST)) if known else None


def least_noise(sigma: FloatArray, sizes: FloatArray) -> float:
    """The smallest noise of a datum over its size; zero where none is known.

    Args:
        sigma: standard deviations of rows, (n,); zero where unknown.
        sizes: of the same rows, (n,), or empty; where zero, rows are relative already.
    """
    known = sigma > 0.0
    if not np.any(known):
        return 0.0
    whole = np.abs(sizes) if sizes.shape == sigma.shape else np.ones(sigma.shape)
    return float(np.min(sigma[known] / np.where(whole > 0.0, whole, 1.0)[known]))


def white_noise(y: npt.NDArray[np.float64] | npt.NDArray[np.complex128]) -> float:
    """Standard deviation of the noise in values, from the upper half of their spectrum.

    A signal that the values resolve is in the lower half. |F|^2 of white noise is exponentially
    distributed with the mean sigma^2 sum(w^2) under a window w, and ln 2 of that is its median.

    Args:
        y: values (n,), real or complex.

    Returns:
        In the unit of y, of real and imaginary part each where they are complex; zero for fewer
        than 16 values.
    """
    if y.size < FEWEST:
        return 0.0
    window = np.blackman(y.size + 2)[1:-1]
    spectrum = np.abs(np.fft.fft((y - np.mean(y)) * window)) ** 2
    high = spectrum[y.size // 4 : y.size - y.size // 4]
    parts = 2.0 if np.iscomplexobj(y) else 1.0
    return float(np.sqrt(np.median(high) / (math.log(2.0) * parts * np.sum(window**2))))
