"""Rotating part of free responses: what a demodulator makes of them, from samples of a pulse's.

A linear system that is left alone moves as x(t) = Re sum_k c_k exp(s_k t). Demodulated at f, with
a filter that is slower than a period, it shows

    z(t) = sum_k c_k exp((s_k - 2 pi i f) t),    Im s_k > 0

Samples of the response to one pulse, shifted against each other, span all exp(s_k t) and their
conjugates. From sample to sample this span turns by a matrix F whose eigenvalues are exp(s_k h):
those that turn forwards belong to z, their conjugates do not. A Schur form parts both whatever
lines lie next to each other, also where two of them meet. No period has to be resolved: f h may be
any number of turns, if only f and -f differ from sample to sample.

One sampling does not show which of exp(s_k h) and its conjugate turns forwards where a line is
not close to f: a line below f, seen every h, turns as the reverse of one above it. A second, short
response whose samples lie further apart by a part e of a period, 1/(8 f) to 1/2f, does: between
them exp(s_k (h + e)) is ahead of exp(s_k h) by f_k e turns, and behind it where it turns backwards.
That gives where the line is, too: its offset from f is (turns ahead)/e - f.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy.linalg import lstsq, schur

from fitting.text.arrays import ComplexArray, FloatArray, IntArray

#: Samples of a run between two of the record, at most.
MOST_BETWEEN = 64
#: How far f and -f are wanted apart from sample to sample, in turns, times the samples between two
#: of the record: lines half a sampling rate of the record next to f are on their own side then.
APART = 1.0
#: Turns of the reference by which samples of the second response lie further apart: one of them
#: keeps that one's turn and its reverse apart. No multiple of a line looks like the line in them.
AHEAD = (0.1381, 0.3573)
#: How near turn and reverse may be for the first of them, in turns.
NEAR_REVERSE = 0.1
#: Samples of the second response, and by how many of them it is shifted against itself.
SENSED, SENSED_SHIFTS = 96, 24
#: Share of a turn to which both responses determine a line: the remainder of lines that meet.
SURE = 1e-5
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
    def ahead(self) -> float:
        """Turns of the reference by which the samples of the second response lie further apart."""
        first, second = AHEAD
        return first if _apart(self.turn + first) >= 2.0 * NEAR_REVERSE else second

    @property
    def step_s(self) -> float:
        """Spacing of the samples of a run, s."""
        return self.spacing_s / self.between

    @property
    def sensing_step_s(self) -> float:
        """Spacing of the samples of the second response, s."""
        return self.step_s + self.ahead / self.frequency_hz

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
    """A reference with as many samples of a run as determine its sense of rotation.

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
    both = 2.0 * turn % 1.0
    return min(both, 1.0 - both)


def rotating_responses(
    decay: FloatArray,
    sensed: FloatArray,
    shifts: IntArray,
    reference: Reference,
    samples: int,
    count: int,
) -> ComplexArray:
    """Columns (samples, count) of demodulated free responses; zeros where there are fewer.

    Args:
        decay: response to a pulse at the samples of a run, as long as the record and all shifts.
        sensed: response at `SENSED` samples, `Reference.sensing_step_s` apart.
        shifts: in samples of a run, (m,), m at least the states of the system.
        reference: of the demodulator.
        samples: of the record.
        count: how many lines are seen: those nearest to the reference.
    """
    rows = (samples - 1) * reference.between + 1
    basis, forward = _propagated(decay, shifts, rows, count)
    own = np.arange(SENSED_SHIFTS, dtype=np.intp)
    _, sensing = _propagated(sensed, own, sensed.size - SENSED_SHIFTS + 1, count)
    second = np.linalg.eigvals(sensing).astype(complex)
    columns = np.zeros((samples, count), dtype=complex)
    distances = np.sort(_distances(np.linalg.eigvals(forward).astype(complex), second, reference))
    mine = distances[np.isfinite(distances)][: count + 1]
    if mine.size:
        limit = np.inf
        if mine.size > count:  # the last that is seen may meet the first that is not
            limit = max(float(np.mean(mine[-2:])), float(mine[-2]) * (1.0 + 1e-9) + 1e-12)
        _, shapes, kept = schur(
            forward.astype(complex),
            output="complex",
            sort=lambda z: bool(_distances(np.atleast_1d(z), second, reference)[0] < limit),
        )
        kept = min(kept, count)
        back = reference.backwards(samples)[:, None]
        columns[:, :kept] = back * (basis[:: reference.between] @ shapes[:, :kept])
    return columns


def _propagated(
    decay: FloatArray, shifts: IntArray, rows: int, count: int
) -> tuple[FloatArray, FloatArray]:
    """A basis (rows, r) of a response shifted against itself, and F (r, r) from row to row."""
    left, singular = shifted_basis(decay, shifts, rows)
    basis = left[:, : _states(singular, 2 * count)]
    return basis, np.asarray(lstsq(basis[:-1], basis[1:])[0])


def shifted_basis(
    response: FloatArray, shifts: IntArray, rows: int
) -> tuple[FloatArray, FloatArray]:
    """Orthonormal columns (rows, m) that span a response shifted against itself, singular values.

    Each shift counts alike, however large the response is behind it.

    Args:
        response: as long as the rows and all shifts.
        shifts: in samples, (m,).
        rows: how many.
    """
    moved = np.stack([response[k : k + rows] for k in shifts], axis=1)
    sizes = np.linalg.norm(moved, axis=0)
    left, singular, _ = np.linalg.svd(
        moved / np.where(sizes > 0.0, sizes, 1.0), full_matrices=False
    )
    return left, singular


def _states(singular: FloatArray, least: int) -> int:
    """How many states are seen: the singular values fall most behind them."""
    most = min(MOST_STATES, singular.size - 1)
    clear = int(np.count_nonzero(singular[:most] > ROUNDING * singular[0]))
    floor = np.maximum(singular, 1e-16 * singular[0])
    falls = floor[:most] / floor[1 : most + 1]
    begin = max(1, min(least, clear))
    return begin + int(np.argmax(falls[begin - 1 : max(clear, begin)]))


def _distances(z: ComplexArray, second: ComplexArray, reference: Reference) -> FloatArray:
    """How far the lines of factors z are from the reference, Hz; of what turns backwards infinite.

    Args:
        z: factors from sample to sample of a run, (m,).
        second: the same of the second response, (k,).
        reference: of the demodulator.
    """
    forwards, backwards = (_as_if_forwards(x, second, reference) for x in (z, np.conj(z)))
    return np.where(forwards <= backwards, forwards, np.inf)


def _as_if_forwards(z: ComplexArray, second: ComplexArray, reference: Reference) -> FloatArray:
    """How far lines would be from the reference if their factors z turned forwards, Hz.

    A pair of both responses gives the offset from how much one is ahead, and its last digits anew
    from z, but for multiples of the sampling: pairs of two different lines differ there.

    Args:
        z: factors from sample to sample of a run, (m,).
        second: the same of the second response, (k,).
        reference: of the demodulator.
    """
    turns = float(reference.frequency_hz * reference.step_s)
    ahead = _wrapped((np.angle(second) - np.angle(z)[:, None]) / (2.0 * np.pi) - reference.ahead)
    coarse = ahead * turns / reference.ahead
    off = _wrapped(np.angle(z) / (2.0 * np.pi) - reference.turn)[:, None]
    sure = SURE * (1.0 + turns)
    apart = _wrapped(coarse - off) / sure
    pair = np.argmin(np.abs(coarse) * (1.0 + apart**2), axis=1)[:, None]
    coarse, apart = (np.take_along_axis(x, pair, axis=1) for x in (coarse, apart))
    fine = off + np.round(coarse - off)
    return np.asarray((np.abs(fine) * (1.0 + apart**2))[:, 0] / reference.step_s)


def _wrapped(turns: FloatArray) -> FloatArray:
    """Turns from -1/2 to 1/2."""
    return np.asarray((turns + 0.5) % 1.0 - 0.5)
