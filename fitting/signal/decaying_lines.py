"""Lines that decay side by side in a record over time, in closed form.

    y(t) = sum_k e^(-pi w_k t) (a_k cos 2 pi f_k t + b_k sin 2 pi f_k t)  [+ c]

f_k, w_k frequency and full width of a line; what enters linearly is solved inside (variable
projection, G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413). Lines begin one after the
other where the spectrum of what is left is highest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fitting.signal.least_squares import minimise_squares
from fitting.text.arrays import FloatArray

#: Logarithm of a width over the first one, either way, and periods of a line over the record.
WIDEST, FEWEST = 7.0, 2.0
#: Evaluations of each fit at most, and relative fall that ends it.
ROUNDS, GAIN = 60, 1e-9


@dataclass(frozen=True, eq=False)
class DecayingLines:
    """Lines of a record: frequencies and widths, Hz, in rising order.

    `left` (n,) is what they leave, `columns` (n, k) what is solved for, `unknowns` their number and
    those of the lines.
    """

    frequency_hz: tuple[float, ...]
    width_hz: tuple[float, ...]
    left: FloatArray
    columns: FloatArray

    @property
    def unknowns(self) -> int:
        """Of all lines together."""
        return 2 * len(self.frequency_hz) + int(self.columns.shape[1])

    @property
    def squares(self) -> float:
        """Sum of squares of what is left."""
        return float(self.left @ self.left)


def decaying_lines(
    values: FloatArray, spacing_s: float, count: int, *, offset: bool = False
) -> DecayingLines | None:
    """So many decaying lines, by least squares; None where one of them hardly oscillates.

    Args:
        values: of the record, evenly spaced, shape (n,), in any unit.
        spacing_s: between two of them, s.
        count: of lines.
        offset: whether there is a constant beside them.
    """
    n = values.size
    span_s = n * spacing_s
    t = np.arange(n) / n
    x = np.empty(0)
    left = np.asarray(values - np.mean(values))

    def columns(x: FloatArray) -> FloatArray:
        made = [np.ones(n)] if offset else []
        for turns, wide in x.reshape(-1, 2):
            fall = np.exp(-math.pi * math.exp(float(np.clip(wide, -WIDEST, WIDEST))) * t)
            made += [
                fall * np.cos(2.0 * math.pi * turns * t),
                fall * np.sin(2.0 * math.pi * turns * t),
            ]
        return np.stack(made, axis=1)

    def rows(x: FloatArray) -> FloatArray:
        basis = np.linalg.qr(columns(x))[0]
        return np.asarray(values - basis @ (basis.T @ values))

    for _ in range(count):
        sizes = np.abs(np.fft.rfft(left * np.hanning(n)))
        x = minimise_squares(
            rows, np.append(x, [float(np.argmax(sizes[1:]) + 1), 0.0]), rounds=ROUNDS, gain=GAIN
        ).values
        left = rows(x)
    turns, wide = x.reshape(-1, 2).T
    if np.any(np.abs(turns) < FEWEST) or not np.all(np.isfinite(x)):
        return None
    order = np.argsort(np.abs(turns))
    widths = np.exp(np.clip(wide, -WIDEST, WIDEST))
    return DecayingLines(
        frequency_hz=tuple(float(abs(turns[k])) / span_s for k in order),
        width_hz=tuple(float(widths[k]) / span_s for k in order),
        left=left,
        columns=columns(x),
    )
