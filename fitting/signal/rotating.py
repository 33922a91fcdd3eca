"""Rotating part of free responses: what a demodulator makes of them, from samples of a pulse's.

A linear system that is left alone moves as x(t) = Re sum_k c_k exp(s_k t). Demodulated at f, with
a filter that is slower than a period, it shows

    z(t) = sum_k c_k exp((s_k - 2 pi i f) t),    Im s_k > 0

Samples of the response to one pulse, shifted against each other, span all exp(s_k t) and their
conjugates. From sample to sample this span turns by a matrix F whose eigenvalues are exp(s_k h):
those that turn as f does, forwards, belong to z, their conjugates do not. A Schur form parts both
whatever lines lie beside each other, also where two of them meet. No period has to be resolved:
f h may be any number of turns, if only f and -f differ from sample to sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy.linalg import lstsq, schur

from fitting.text.arrays import ComplexArray, FloatArray, IntArray

#: Samples of a run between two of the record, at most.
MOST_BETWEEN = 64
#: How far f and -f are wanted apart from sample to sample, in turns, times the samples between two
#: of the record: lines half a sampling rate of the record beside f are on their own side then.
APART = 1.0
#: Singular values below this share of the largest are rounding, and states of an FMU at most.
ROUNDING, MOST_STATES = 1e-11, 16


@dataclass(frozen=True)
class Reference:
    """A frequency that is looked at with samples ``spacing_s`` apart, ``between`` of a run each."""

    frequency_hz: float
    spacing_s: float
    between: int

    @property
    def turn(self) -> float:
        """Turns from one sample of a run to the next, of 0 to 1."""
        return float(self._turns / self.between % 1)

    @property
    def _turns(self) -> Fraction:
        """Turns from sample to sample, as they are: their last digits are what is left of them."""
        return Fraction(self.frequency_hz) * Fraction(self.spacing_s)

    def backwards(self, samples: int) -> ComplexArray:
        """exp(-2 pi i f t) at the samples of the record, (n,).

        Args:
            samples: how many.
        """
        turn = float(self._turns % 1)
        return np.asarray(np.exp(-2j * np.pi * np.remainder(turn * np.arange(samples), 1.0)))


def reference(frequency_hz: float, spacing_s: float) -> Reference:
    """A reference with as many samples of a run as tell its sense of rotation.

    Args:
        frequency_hz: of the demodulator, Hz.
        spacing_s: of its samples, s.
    """
    tried = [Reference(frequency_hz, spacing_s, k) for k in range(1, MOST_BETWEEN + 1)]
    apart = [r.between * _apart(r.turn) for r in tried]
    first = next((k for k, each in enumerate(apart) if each >= APART), int(np.argmax(apart)))
    return tried[first]


def _apart(turn: float) -> float:
    """How far a turn and its reverse are apart, in turns, of 0 to 1/2."""
    twice = 2.0 * turn % 1.0
    return min(twice, 1.0 - twice)


def rotating_responses(
    decay: FloatArray, shifts: IntArray, reference: Reference, samples: int, count: int
) -> ComplexArray:
    """Columns (samples, count) of demodulated free responses; zeros where there are fewer.

    Args:
        decay: response to a pulse at the samples of a run, as long as the record and all shifts.
        shifts: in samples of a run, (m,), m at least the states of the system.
        reference: of the demodulator.
        samples: of the record.
        count: how many lines are seen: those nearest to the reference.
    """
    rows = (samples - 1) * reference.between + 1
    moved = np.stack([decay[k : k + rows] for k in shifts], axis=1)
    sizes = np.linalg.norm(moved, axis=0)
    left, singular, _ = np.linalg.svd(
        moved / np.where(sizes > 0.0, sizes, 1.0), full_matrices=False
    )
    basis = left[:, : _states(singular, 2 * count)]
    turned = lstsq(basis[:-1], basis[1:])[0]
    mine = _nearest(np.linalg.eigvals(turned), reference.turn, count)
    found = np.zeros((samples, count), dtype=complex)
    if mine.size:
        limit = float(np.max(mine)) * (1.0 + 1e-9) + 1e-12
        _, shapes, kept = schur(
            turned.astype(complex),
            output="complex",
            sort=lambda z: bool(_off(np.asarray(z), reference.turn) <= limit),
        )
        kept = min(kept, count)
        back = reference.backwards(samples)[:, None]
        found[:, :kept] = back * (basis[:: reference.between] @ shapes[:, :kept])
    return found


def _states(singular: FloatArray, least: int) -> int:
    """How many states are seen: the singular values fall most behind them."""
    most = min(MOST_STATES, singular.size - 1)
    clear = int(np.count_nonzero(singular[:most] > ROUNDING * singular[0]))
    floor = np.maximum(singular, 1e-16 * singular[0])
    falls = floor[:most] / floor[1 : most + 1]
    begin = max(1, min(least, clear))
    return begin + int(np.argmax(falls[begin - 1 : max(clear, begin)]))


def _off(z: ComplexArray, turn: float) -> FloatArray:
    """How far factors turn otherwise than the reference, in turns, of 0 to 1/2."""
    return np.asarray(np.abs((np.angle(z) / (2.0 * np.pi) - turn + 0.5) % 1.0 - 0.5))


def _nearest(z: ComplexArray, turn: float, count: int) -> FloatArray:
    """Offsets of the nearest factors that turn with the reference, not with its reverse."""
    off, reverse = _off(z, turn), _off(z, -turn)
    return np.sort(off[off < reverse])[:count]


def line_columns(columns: ComplexArray) -> Sequence[FloatArray]:
    """Real columns (2 n,) of what complex factors of columns (n, k) change: X above Y.

    Args:
        columns: complex, (n, k).
    """
    both = [each for column in columns.T for each in (column, 1j * column)]
    return [np.concatenate([each.real, each.imag]) for each in both]
