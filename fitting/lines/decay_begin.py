"""Where a record begins to decay freely, as far as its samples tell.

`fitting.signal.decay` follows a tone, or noise, before and decaying modes behind. Of amplitudes it
sees little of a drive that holds them in noise; of their squares, to which noise adds a constant,

    R^2(t) = a^2 e^(-2 pi w max(t - b, 0)) + c

is held against b = 0 (F test), and the later begin of both counts: a decay that is cut a little
late is still one.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.special import fdtrc

from fitting.lines.decay_record import AMPLITUDES, PHASORS
from fitting.signal.decay import decay_start
from fitting.signal.residual_tests import SMALLEST_RESIDUAL
from fitting.text.arrays import ComplexArray, FloatArray

#: Samples up to which the begin is looked for in all of them.
MOST = 20_000
#: Stretches of amplitudes, at most, and share of them behind which no begin is looked for.
STRETCHES, LATEST = 400, 0.7
#: Logarithms of widths over the first one that are tried behind a begin.
WIDTHS = np.linspace(-2.0, 4.0, 61)
#: Stretches over which their scatter is smoothed.
SMOOTH = 9
#: Unknowns of a begin, width, height and constant.
UNKNOWNS = 4
#: Probability below which chance does not explain what a begin gains.
IMPROBABLE = 1e-4


def begin_of(values: FloatArray | ComplexArray, kind: str, lines: int = 1) -> int:
    """Number of the first sample of the free decay; 0 where none before it is seen.

    Args:
        values: of the record, (n,), evenly sampled.
        kind: what was recorded, see `fitting.lines.decay_record`.
        lines: that decay.
    """
    every = -(-values.size // MOST)
    y, states = values[::every], 2 * lines
    if kind in (PHASORS, AMPLITUDES):
        # a decay that swings, for what looks for one; a constant is then a line of its own
        y, states = y * np.exp(0.5j * np.pi * (np.arange(y.size) % 4 + 0.5)), states + 2
    found = (decay_start(np.asarray(y.real), states) or 0) * every
    return max(found, held_samples(values.real)) if kind == AMPLITUDES else found


def held_samples(amplitudes: FloatArray) -> int:
    """How many amplitudes are held before they fall; 0 where that is not seen.

    Args:
        amplitudes: of the record, (n,), evenly sampled.
    """
    each = max(1, amplitudes.size // STRETCHES)
    count = amplitudes.size // each
    y = np.mean(amplitudes[: count * each].reshape(count, each) ** 2, axis=1)
    y = y / np.max(y)
    # the scatter of squares goes with the amplitude, and as the square of the noise in it
    about = sliding_window_view(np.pad(y, SMOOTH // 2, mode="edge"), SMOOTH)
    scatter = np.sqrt(np.maximum(np.median(about, axis=1), SMALLEST_RESIDUAL))
    squares = [_least(y, scatter, begin) for begin in range(int(LATEST * count))]
    best, freedom = int(np.argmin(squares)), count - UNKNOWNS
    if freedom < 1 or squares[best] <= count * SMALLEST_RESIDUAL**2:
        return 0
    gain = (squares[0] / squares[best] - 1.0) * freedom
    chance = count * float(fdtrc(1, freedom, gain))
    return (best + 1) * each if best > 0 and chance < IMPROBABLE else 0


def _least(y: FloatArray, scatter: FloatArray, begin: int) -> float:
    """Least squares that a decay behind a begin leaves of y (n,), with the best of some widths."""
    t = np.maximum(np.arange(y.size) - begin, 0) / y.size
    one = 1.0 / scatter
    one = one / np.linalg.norm(one)
    rest = y / scatter
    rest = rest - one * (one @ rest)
    falls = np.exp(-2.0 * math.pi * np.exp(WIDTHS)[:, None] * t) / scatter
    falls = falls - (falls @ one)[:, None] * one
    sizes = np.sum(falls**2, axis=1)
    along = (falls @ rest) ** 2 / np.maximum(sizes, np.finfo(float).tiny)
    return float(rest @ rest - np.max(along))
