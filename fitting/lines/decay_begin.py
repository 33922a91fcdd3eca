"""Where a free decay begins in a record: after its drive was switched off, or after a blow.

The modes z_k of the decay are determined in its loud part by the shift of the signal's subspace
(ESPRIT). From every sample i on they are fitted to the rest of the record; what is before i is a
tone and a constant, or noise of its own size. The sum of both,

    C(i) = sum_{j < i} e_j^2/s^2 + i ln(s^2/sigma^2) + sum_{j >= i} r_j^2/sigma^2

is least where the decay begins; the last i of a C within `CERTAIN` of that is taken: a decay that
is cut a little late is still one.

Amplitudes show little of a drive that holds them in noise. Their squares, to which noise adds a
constant,

    R^2(t) = a^2 e^(-2 pi w max(t - b, 0)) + c

are compared with b = 0 (F test), and the later begin of both counts.

Source: R. Roy and T. Kailath, IEEE Trans. ASSP 37 (1989) 984.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.fft import next_fast_len
from scipy.linalg import lstsq
from scipy.sparse.linalg import LinearOperator, svds

from fitting.lines.choice import BY_CHANCE, gain_p
from fitting.lines.trace import AMPLITUDES, PHASORS
from fitting.signal.residual_tests import SMALLEST_RESIDUAL
from fitting.text.arrays import ComplexArray, FloatArray

#: Stretches whose loudness shows roughly where the decay is, and the share of the loudest that
#: counts.
STRETCHES, LOUD = 64, 0.5
#: Samples of a decay, at least, for each of its states.
LEAST = 8
#: Cost beyond the least one up to which a decay may begin later: four standard deviations.
CERTAIN = 16.0
#: What a sample costs that is left out while only the decay is known: noise of twice its variance.
LEFT_OUT = 2.0
#: Variances of tails that differ by less are alike.
ALIKE = 1.5
#: Steps of Gauss and Newton towards the frequency of a tone.
TONE_STEPS = 5
#: Noise below this share of the largest value is rounding.
ROUNDING = 1e-9
#: Share of the squares of what is solved for that keeps it solvable.
SINGULAR = 1e-14
#: Logarithm up to which a mode is followed back from where it was found.
LARGEST = 100.0
#: Samples up to which the begin is looked for in all of them.
MOST = 20_000
#: Stretches of amplitudes, at most, and share of them behind which no begin is looked for.
MEANS, LATEST = 400, 0.7
#: Logarithms of widths over the first one that are tried behind a begin.
WIDTHS = np.linspace(-2.0, 4.0, 61)
#: Stretches over which their scatter is smoothed.
SMOOTH = 9
#: Unknowns of a begin, width, height and constant.
UNKNOWNS = 4


def decay_start(values: FloatArray, states: int) -> int | None:
    """Index of the first sample of a free decay; None where there is no decay to be seen.

    Args:
        values: of the record, (n,), evenly sampled.
        states: of the decay: two for each mode.
    """
    y = np.asarray(values - np.mean(values))
    tried = [_tail(y, k, states) for k in _after_loud(y) if y.size - k >= LEAST * states]
    if not tried:
        return None
    least = min(variance for _, variance, _ in tried)
    loud, variance, basis = next(tail for tail in tried if tail[1] <= ALIKE * least)
    if variance > 0.5 * float(np.mean(y[loud:] ** 2)):
        return None
    after = _tails(basis, y, loud) / variance
    count = np.arange(after.size)
    rough = int(np.argmin(after + LEFT_OUT * count))
    if rough < LEAST:
        return rough
    before = _heads(y, rough, loud)
    own = max(before[rough] / rough, variance)
    cost = before / own + count * np.log(own / variance) + after
    return int(np.flatnonzero(cost <= np.min(cost) + CERTAIN)[-1])


def _tail(y: FloatArray, begin: int, states: int) -> tuple[int, float, FloatArray]:
    """Where a tail begins, the variance of what a decay leaves of it, and the decay's columns."""
    basis = _basis(_modes(y[begin:], states), y.size, begin)
    rest = y[begin:] - basis[begin:] @ lstsq(basis[begin:], y[begin:])[0]
    variance = float(np.mean(rest**2)) + (ROUNDING * float(np.max(np.abs(y)))) ** 2
    return begin, variance, basis


def _after_loud(y: FloatArray) -> list[int]:
    """Ends of the last stretch that is half as powerful as the loudest, and of the next two.

    The loudest may be the drive, which then lasts into the stretch behind.
    """
    ends = np.linspace(0, y.size, min(STRETCHES, y.size // LEAST) + 1).astype(int)
    power = np.add.reduceat(y**2, ends[:-1]) / np.diff(ends)
    last = 1 + int(np.flatnonzero(power >= LOUD * np.max(power))[-1])
    return [int(end) for end in ends[last : last + 3]]


def _modes(y: FloatArray, states: int) -> ComplexArray:
    """Factors z (states,) by which the modes of a decay change from sample to sample."""
    columns = y.size // 3
    rows = y.size - columns + 1
    size = next_fast_len(y.size + columns)
    spectrum = np.fft.rfft(y, size)

    def times(x: FloatArray) -> FloatArray:
        wave = np.fft.irfft(spectrum * np.fft.rfft(np.ravel(x)[::-1], size), size)
        return np.asarray(wave[columns - 1 : columns - 1 + rows])

    def transposed(x: FloatArray) -> FloatArray:
        wave = np.fft.irfft(spectrum * np.fft.rfft(np.ravel(x)[::-1], size), size)
        return np.asarray(wave[rows - 1 : rows - 1 + columns])

    hankel = LinearOperator((rows, columns), matvec=times, rmatvec=transposed, dtype=float)
    start = np.random.default_rng(0).standard_normal(min(rows, columns))
    _, _, right = svds(hankel, k=states, v0=start)
    shapes = right.T
    z = np.linalg.eigvals(lstsq(shapes[:-1], shapes[1:])[0])
    return np.asarray(z / np.maximum(np.abs(z), 1.0), dtype=complex)


def _basis(z: ComplexArray, count: int, origin: int) -> FloatArray:
    """Real columns (count, states + 1) that the modes span, and a constant."""
    upper = z[z.imag >= 0.0]
    powers = np.log(upper) * (np.arange(count) - origin)[:, None]
    powers = np.exp(np.minimum(powers.real, LARGEST) + 1j * powers.imag)
    real = upper.imag <= 0.0
    columns = [powers.real, powers.imag[:, ~real], np.ones((count, 1))]
    return np.asarray(np.concatenate(columns, axis=1))


def _tails(basis: FloatArray, y: FloatArray, last: int) -> FloatArray:
    """Squares that are left of y from every sample up to the last on, (last + 1,)."""
    sizes = np.linalg.norm(basis[last:], axis=0)
    columns = basis / np.where(sizes > 0.0, sizes, 1.0)
    rows = columns[:last, :, None] * columns[:last, None, :]
    gram = columns[last:].T @ columns[last:]
    grams = np.concatenate([[gram], gram + np.cumsum(rows[::-1], axis=0)])[::-1]
    push = columns[last:].T @ y[last:]
    pushes = np.concatenate(
        [[push], push + np.cumsum((columns[:last] * y[:last, None])[::-1], axis=0)]
    )[::-1]
    power = float(y[last:] @ y[last:])
    powers = np.concatenate([[power], power + np.cumsum(y[:last][::-1] ** 2)])[::-1]
    # a mode that nothing is left of, or two of one kind, would leave them singular
    grams = grams + SINGULAR * np.trace(gram) * np.eye(gram.shape[0])
    solved = np.linalg.solve(grams, pushes[:, :, None])[:, :, 0]
    return np.asarray(np.maximum(powers - np.sum(solved * pushes, axis=1), 0.0))


def _heads(y: FloatArray, known: int, last: int) -> FloatArray:
    """Squares that are left of y before every sample up to the last, (last + 1,).

    They are those about the tone and the constant that follow the first `known` samples best.
    """
    t = np.arange(last, dtype=float)
    size = 4 * next_fast_len(known)
    spectrum = np.abs(np.fft.rfft(y[:known] - np.mean(y[:known]), size))
    f = float(np.argmax(spectrum)) / size
    for _ in range(TONE_STEPS):
        design = _tone(f, t)
        a, b, _ = solved = lstsq(design[:known], y[:known])[0]
        slope = 2.0 * np.pi * t * (b * design[:, 0] - a * design[:, 1])
        rest = y[:known] - design[:known] @ solved
        steps = lstsq(np.column_stack([design, slope])[:known], rest)[0]
        f += float(steps[3])
    design = _tone(f, t)
    rest = y[:last] - design @ lstsq(design[:known], y[:known])[0]
    return np.concatenate([[0.0], np.cumsum(rest**2)])


def _tone(f: float, t: FloatArray) -> FloatArray:
    """Columns (n, 3) of a tone of f cycles a sample, and a constant."""
    turn = 2.0 * np.pi * f * t
    return np.stack([np.cos(turn), np.sin(turn), np.ones(t.size)], axis=1)


def begin_of(values: FloatArray | ComplexArray, kind: str, lines: int = 1) -> int:
    """Number of the first sample of the free decay; 0 where none before it is seen.

    Args:
        values: of the record, (n,), evenly sampled.
        kind: what was recorded, see `fitting.lines.trace.KINDS`.
        lines: that decay.
    """
    every = -(-values.size // MOST)
    y, states = values[::every], 2 * lines
    if kind in (PHASORS, AMPLITUDES):
        # a decay that swings, for what looks for one; a constant is then a line of its own
        y, states = y * np.exp(0.5j * np.pi * (np.arange(y.size) % 4 + 0.5)), states + 2
    first = (decay_start(np.asarray(y.real), states) or 0) * every
    return max(first, driven_samples(values.real)) if kind == AMPLITUDES else first


def driven_samples(amplitudes: FloatArray) -> int:
    """How many amplitudes are held before they fall; 0 where that is not seen.

    Args:
        amplitudes: of the record, (n,), evenly sampled.
    """
    each = max(1, amplitudes.size // MEANS)
    count = amplitudes.size // each
    y = np.mean(amplitudes[: count * each].reshape(count, each) ** 2, axis=1)
    y = y / np.max(y)
    # the scatter of squares goes with the amplitude, and as the square of the noise in it
    about = sliding_window_view(np.pad(y, SMOOTH // 2, mode="edge"), SMOOTH)
    scatter = np.sqrt(np.maximum(np.median(about, axis=1), SMALLEST_RESIDUAL))
    squares = [_least(y, scatter, begin) for begin in range(int(LATEST * count))]
    best, dof = int(np.argmin(squares)), count - UNKNOWNS
    if dof < 1 or squares[best] <= count * SMALLEST_RESIDUAL**2:
        return 0
    chance = count * gain_p(squares[0], squares[best], 1, dof)
    return (best + 1) * each if best > 0 and chance < BY_CHANCE else 0


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
