"""Single points far off a response that no line of its grid makes.

A line that is a third of the distance of the points wide, or wider, is seen in the neighbours of
its top, too. A point is none of a line where it stands off the straight line through its six
neighbours by `BESIDE` times as much as each of these does, by as many times the noise, and by
`LEAST` of what they make likely, which noise that grows with the amplitude is not: an overload, a
lost reading, or a line so narrow that these points cannot tell of it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from fitting.lines.names import MIN_SWEEP_POINTS
from fitting.lines.starts import point_noise
from fitting.text.arrays import ComplexArray, FloatArray

#: Neighbours on each side that tell where a point ought to be.
REACH = 3
#: Times their own distances, and the noise, that a point stands off.
BESIDE = 10.0
#: Share of what is likely there by which it does.
LEAST = 0.5
#: Most such points, and share of all; more of them are no single ones.
MOST, SHARE = 3, 0.02


def single_points(
    frequency_hz: FloatArray, values: FloatArray | ComplexArray
) -> tuple[tuple[int, complex], ...]:
    """Number of each point that no line of the grid makes, and what its neighbours make likely.

    None where there are many; the first and the last point have too few neighbours.

    Args:
        frequency_hz: rising, shape (n,), Hz.
        values: amplitudes, or complex values, shape (n,), any unit.
    """
    f, y = frequency_hz, values
    if f.size < MIN_SWEEP_POINTS + MOST:
        return ()
    parts = [np.asarray(part, dtype=float) for part in (y.real, y.imag)][: 1 + np.iscomplexobj(y)]
    noise = max(max(point_noise(part), _digit(part)) for part in parts)
    found = tuple(_off(f, y, noise))
    return found if len(found) <= max(MOST, SHARE * f.size) else ()


def _off(
    f: FloatArray, y: FloatArray | ComplexArray, noise: float
) -> Iterator[tuple[int, complex]]:
    share = (f[1:-1] - f[:-2]) / (f[2:] - f[:-2])
    between = (1.0 - share) * y[:-2] + share * y[2:]
    # as far off its two neighbours, but for their own distance from the line of all six
    doubtful = np.flatnonzero(np.abs(y[1:-1] - between) > (BESIDE - 1.0) * noise)
    for k in (1 + int(each) for each in doubtful):
        first = min(max(0, k - REACH), f.size - 2 * REACH - 1)
        beside = np.delete(np.arange(first, first + 2 * REACH + 1), k - first)
        x = f[beside] - f[k]
        columns = np.stack([np.ones_like(x), x / np.max(np.abs(x))], axis=1)
        line = np.linalg.lstsq(columns, y[beside], rcond=None)[0]
        scatter = float(np.max(np.abs(columns @ line - y[beside])))
        if abs(y[k] - line[0]) > max(BESIDE * scatter, BESIDE * noise, LEAST * abs(line[0])):
            yield k, complex(line[0])


def _digit(numbers: FloatArray) -> float:
    """The last digit of an instrument, as the smallest of all steps shows it."""
    steps = np.diff(np.unique(numbers))
    return float(np.min(steps)) if steps.size else 0.0
