"""All samples of a free decay from a few of them: a linear system left alone repeats itself.

A state of r numbers moves by the matrix A from sample to sample, and by F = A^S over S of them:

    y(S i + j) = C F^i A^j x

Short blocks of samples, a long way S apart, determine both. The blocks moved against each other, by
whole strides and inside, fill a matrix whose columns are the starts and whose rows are what is
observed of them; its singular vectors are the states as they are observed, rows moved by one sample
give A, rows moved by a stride F. Lines that beat slowly are distinguished by F, what decays fast by
A. Where eigenvectors are shared and well apart, what multiplies each is z from sample to sample and
w over a stride, and the last digits of z are those of w^(1/S). Where poles meet there are no such
vectors, and the matrices themselves are multiplied.

What that is worth is seen at further samples that are not used. Source of the shift of a subspace:
R. Roy and T. Kailath, IEEE Trans. ASSP 37 (1989) 984.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import lstsq

from fitting.text.arrays import ComplexArray, FloatArray, IntArray

#: Samples that are checked, besides the last one: one in every stride, elsewhere in each. In the
#: first stride, where what decays fast is seen, there are further ones, each so many times as far
#: from the first block as the one before.
GOLDEN, FARTHER = 0.6180339887498949, 2
#: How many times the difference at samples that are seen an error may be: there are few of them.
SAFETY = 10.0
#: An error below which no other number of states is tried, where nothing else is wanted.
ENOUGH = 1e-11
#: Numbers of states that are tried, those behind which singular values fall most.
TRIED = 3
#: Singular values below this share of the largest are rounding.
ROUNDING = 1e-16
#: Condition of eigenvectors above which poles meet.
MEETING = 1e6
#: Share of F in what eigenvectors are taken of: what neither A nor F distinguishes their sum does.
MIXED = 0.37
#: Factors over a stride below which a state has decayed, and the logarithm up to which z^S is w.
DECAYED, NEAR = 1e-3, 0.5
#: How far F may be from A^S, relative.
APART = 0.3


@dataclass(frozen=True)
class FewSamples:
    """Which samples of a decay are taken: blocks of neighbours, a stride apart from each other.

    Args:
        samples: of the whole decay.
        blocks: how many.
        length: samples of each.

    Raises:
        ValueError: blocks that do not determine two shifts, or that leave nothing between them.
    """

    samples: int
    blocks: int
    length: int

    def __post_init__(self) -> None:
        if self.blocks < 4 or self.length < 4 or self.stride < 2 * self.length:
            raise ValueError(f"{self!r}: wanted blocks of 4 or more, far apart")

    @property
    def stride(self) -> int:
        """Samples from the begin of one block to that of the next."""
        return (self.samples - self.length) // (self.blocks - 1)

    @cached_property
    def used(self) -> IntArray:
        """Samples of every block, (blocks, length)."""
        begins = self.stride * np.arange(self.blocks)
        return begins[:, np.newaxis] + np.arange(self.length)

    @cached_property
    def checked(self) -> IntArray:
        """Samples between blocks by which what was made of these is checked; the last is one."""
        block = np.arange(self.blocks - 1)
        inside = np.remainder((block + 1) * GOLDEN, 1.0) * (self.stride - self.length)
        between = self.stride * block + self.length + inside.astype(np.intp)
        early = self.length + FARTHER ** np.arange(int(np.log2(self.stride - self.length)) + 1) - 1
        return np.unique(np.concatenate([between, early, [self.samples - 1]]))

    @cached_property
    def indices(self) -> IntArray:
        """All of them, rising."""
        return np.unique(np.concatenate([self.used.ravel(), self.checked]))


@dataclass(frozen=True)
class Rebuilt:
    """All samples (n,), and what they may be off by, over the largest.

    `error` is `SAFETY` times the largest difference from the samples that were seen, or the share
    of these that does not repeat itself, if that is more.
    """

    samples: FloatArray
    error: float


@dataclass(frozen=True)
class _Motion:
    """States after strides, from those at the start (blocks, r, r), and what is seen of them.

    `observed` (r, stride) is that of one state at every sample of a stride.
    """

    over: FloatArray | ComplexArray
    observed: FloatArray | ComplexArray

    def samples(self, blocks: FloatArray) -> FloatArray:
        """All samples, as many as strides have, from the start that follows blocks best.

        Args:
            blocks: samples (blocks, length) that are followed.
        """
        short = self.observed[:, : blocks.shape[1]]
        design = np.einsum("mj,imk->ijk", short, self.over).reshape(blocks.size, -1)
        if not np.isfinite(design).all():
            return np.full(len(blocks) * self.observed.shape[1], np.nan)
        start = lstsq(design, blocks.ravel().astype(design.dtype))[0]
        return np.asarray(((self.over @ start) @ self.observed).real.ravel())


def rebuilt(
    few: FewSamples, values: FloatArray, tolerance: float, enough: float = ENOUGH
) -> Rebuilt | None:
    """All samples of a free decay; None where those that are checked show that they are not.

    Args:
        few: which samples were taken.
        values: of these, shape (m,), in the order of their indices.
        tolerance: largest error that they may have, over the largest value.
        enough: error below which no other number of states is tried.
    """
    largest = float(np.max(np.abs(values)))
    if not 0.0 < largest < np.inf:
        return None
    blocks = values[np.searchsorted(few.indices, few.used)] / largest
    best, least = None, tolerance
    with np.errstate(all="ignore"):  # what a wrong number of states makes is not finite
        for motion, unsure in _motions(few, blocks, tolerance):
            samples = motion.samples(blocks)[: few.samples]
            off = float(np.max(np.abs(samples[few.indices] - values / largest)))
            error = max(SAFETY * off, unsure)
            if error <= least:
                best, least = Rebuilt(np.asarray(largest * samples), error), error
            if error <= enough:
                break
    return best


def _motions(
    few: FewSamples, blocks: FloatArray, tolerance: float
) -> Iterator[tuple[_Motion, float]]:
    """What moves so, the likeliest first, and the share of what is seen that may not."""
    rows, inside = few.blocks // 2, few.length // 2
    moved = sliding_window_view(blocks, (few.blocks - rows + 1, few.length - inside + 1))
    left, singular, _ = np.linalg.svd(moved.reshape(rows * inside, -1), full_matrices=False)
    for count in _states(singular, (rows - 1) * inside):
        observed = left[:, :count].reshape(rows, inside, count)
        one = _propagator(observed[:, :-1], observed[:, 1:])
        far = _propagator(observed[:-1], observed[1:])
        unsure = _unsure(few, one, far, singular[:count])
        if not unsure <= tolerance:
            continue
        for motion in (_of_poles(few, one, far), _of_matrices(few, one, far, observed[0, 0])):
            if motion is not None:
                yield motion, unsure


def _states(singular: FloatArray, most: int) -> list[int]:
    """Numbers of states behind which singular values fall most."""
    floor = np.maximum(singular, ROUNDING * singular[0])
    falls = floor[:-1] / floor[1:]
    return [1 + int(k) for k in np.argsort(-falls[: most // 2], kind="stable")[:TRIED]]


def _propagator(before: FloatArray, after: FloatArray) -> FloatArray:
    """The matrix (r, r) that rows (..., r) are multiplied by to be those after them."""
    count = before.shape[-1]
    return np.asarray(lstsq(before.reshape(-1, count), after.reshape(-1, count))[0])


def _unsure(few: FewSamples, one: FloatArray, far: FloatArray, observed: FloatArray) -> float:
    """Share of what is seen whose F is not A^S, as if it was there in some blocks alone.

    So does what an event leaves behind it; of what is hardly seen A is hardly known.

    Args:
        few: which samples were taken.
        one: A, (r, r).
        far: F, (r, r).
        observed: how much of each state is, (r,).
    """
    apart = np.linalg.matrix_power(one, few.stride) - far
    if not np.isfinite(apart).all():
        return np.inf
    off = np.linalg.norm(apart, axis=0)
    sure = off <= APART * max(1.0, float(np.linalg.norm(far, 2)))
    return float(np.sum(np.where(sure, 0.0, off * observed))) / float(observed[0])


def _of_poles(few: FewSamples, one: FloatArray, far: FloatArray) -> _Motion | None:
    """Powers of the factors of every state; None where poles meet."""
    shapes = np.linalg.eig(far + MIXED * one)[1].astype(complex)
    if not np.linalg.cond(shapes) < MEETING:
        return None
    log_w, log_z = (np.log(np.diag(np.linalg.solve(shapes, m @ shapes))) for m in (far, one))
    off = log_w - few.stride * log_z
    off -= 2j * np.pi * np.round(off.imag / (2.0 * np.pi))
    sure = (np.abs(off) < NEAR) & (log_w.real > np.log(DECAYED))
    log_z = np.where(sure, log_z + off / few.stride, log_z)
    over = np.exp(np.arange(few.blocks)[:, np.newaxis] * log_w)[:, :, np.newaxis]
    return _Motion(over * np.eye(log_w.size), np.exp(log_z[:, np.newaxis] * np.arange(few.stride)))


def _of_matrices(few: FewSamples, one: FloatArray, far: FloatArray, first: FloatArray) -> _Motion:
    """Powers of the matrices: A and F commute, and C A^j F^i x is what is seen."""
    rows = first[np.newaxis]
    power = one
    while len(rows) < few.stride:
        rows = np.concatenate([rows, rows @ power])
        power = power @ power
    over = [np.eye(first.size)]
    for _ in range(few.blocks - 1):
        over.append(far @ over[-1])
    return _Motion(np.array(over), rows[: few.stride].T)
