"""Lines that decay side by side in a record over time, in closed form.

    y(t) = sum_k e^(-pi w_k t) (a_k cos 2 pi f_k t + b_k sin 2 pi f_k t)  [+ c]
    z(t) = sum_k c_k e^(-pi w_k t + 2 pi i f_k t)  [+ c]                    demodulated

f_k, w_k frequency and full width of a line; of demodulated values f_k is the offset from the
reference, of either sign, and c complex. What enters linearly is solved inside (variable
projection, G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413). Lines begin one after the
other where a decay that is as wide as one of `BEGINS` follows what is left best.

The frequency of one line may move with the square of its amplitude, as a Duffing oscillator's does:
f + s e^(-2 pi w t), s at the first sample, adds to its turns

    s (1 - e^(-2 pi w t))/(2 pi w)

Source: A. Nayfeh and D. Mook, Nonlinear Oscillations (1979), section 2.2, by averaging.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fitting.signal.least_squares import LeastSquaresFit, minimise_squares
from fitting.text.arrays import ComplexArray, FloatArray, both_parts

#: Logarithm of a width over the first one, either way, and periods of a line over the record.
WIDEST, FEWEST = 7.0, 2.0
#: Logarithms of the widths over the first one with which a line may begin.
BEGINS = (-1.0, 0.0, 1.0, 2.0, 3.5, 5.0)
#: Shifts that are tried, over the width of a line, either way, and widths over that of a fixed one.
SHIFTS, MOVED_WIDTHS = np.arange(0.5, 40.5, 0.5), (-0.5, 0.0, 0.5)
#: Share of the squares of what is solved for below which it is rounding.
ROUNDING = 1e-13
#: Evaluations of each fit at most, and relative fall that ends it.
ROUNDS, GAIN = 60, 1e-9


@dataclass(frozen=True, eq=False)
class DecayingLines:
    """Lines of a record: frequencies and widths, Hz, in rising order.

    `left` (m,) is what they leave, m = n, of complex values all real parts before all imaginary
    ones, m = 2 n; `columns` (m, k) what is solved for, `solved` (k,) how much of each: two for each
    line in this order, then the constant. `slopes` (m, 2 lines) are derivatives of what follows the
    record by the frequency and the width of each line, over Hz. `shift_hz` is how far the frequency
    is moved at the first sample, empty where it does not move: its slope stands last then.
    """

    frequency_hz: tuple[float, ...]
    width_hz: tuple[float, ...]
    left: FloatArray
    columns: FloatArray
    solved: FloatArray
    slopes: FloatArray
    shift_hz: tuple[float, ...] = ()

    @property
    def unknowns(self) -> int:
        """Number of all unknowns together."""
        return int(self.slopes.shape[1] + self.columns.shape[1])

    @property
    def squares(self) -> float:
        """Sum of squares of what is left."""
        return float(self.left @ self.left)


@dataclass(frozen=True, eq=False)
class _Record:
    """Values over time, t from 0 to 1, and lines that may follow them.

    x holds turns and logarithm of the width of each line; with `moves` it is one, and its shift at
    the first sample, in turns over the record, comes last.
    """

    values: FloatArray | ComplexArray
    offset: bool
    moves: bool = False

    @property
    def is_complex(self) -> bool:
        """Whether they are demodulated."""
        return np.iscomplexobj(self.values)

    @property
    def t(self) -> FloatArray:
        """Times of the samples, over the record, (n,)."""
        return np.arange(self.values.size) / self.values.size

    @property
    def rows(self) -> FloatArray:
        """The values, all real parts before all imaginary ones, (m,)."""
        if self.is_complex:
            return both_parts(np.asarray(self.values, dtype=complex))
        return np.asarray(self.values.real)

    def waves(self, x: FloatArray) -> ComplexArray:
        """Each line with the factor one, (n, lines)."""
        turns, wide = x[: x.size - self.moves].reshape(-1, 2).T
        width = _widths(wide)
        waves = np.exp(math.pi * self.t[:, None] * (2j * turns - width))
        if self.moves:
            waves *= np.exp(2j * math.pi * float(x[-1]) * _turned(self.t, width))
        return np.asarray(waves)

    def columns(self, x: FloatArray) -> FloatArray:
        """What is solved for at x, (m, k): both parts of the factor of a line, and constants."""
        made = [
            self._as_rows(factor * wave) for wave in self.waves(x).T for factor in (1.0 + 0j, 1j)
        ]
        if self.offset:
            one = np.ones(self.values.size, dtype=complex)
            made += [self._as_rows(one)] + ([self._as_rows(1j * one)] if self.is_complex else [])
        return np.stack(made, axis=1)

    def solved(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """At x: columns (m, k), how much of each is solved for (k,), and what is left (m,)."""
        rows, columns = self.rows, self.columns(x)
        found = _least(columns, rows)
        return columns, found, np.asarray(rows - columns @ found)

    def left(self, x: FloatArray) -> FloatArray:
        """What lines at x leave, (m,)."""
        return self.solved(x)[2]

    def falls(self, x: FloatArray) -> FloatArray:
        """Derivatives of what is left by x, (m, n), but for those of what is solved for.

        Source: L. Kaufman, BIT 15 (1975) 49.
        """
        columns, found, _ = self.solved(x)
        slopes = self.slopes(x, found, 1.0)
        slopes[:, 1 : x.size - self.moves : 2] *= _widths(x[1 : x.size - self.moves : 2])
        return np.asarray(columns @ _least(columns, slopes) - slopes)

    def lowered(self, x: FloatArray) -> LeastSquaresFit:
        """The lines that leave least, from those at x."""
        return minimise_squares(self.left, x, rounds=ROUNDS, gain=GAIN, slopes=self.falls)

    def slopes(self, x: FloatArray, solved: FloatArray, span_s: float) -> FloatArray:
        """Derivatives by frequency and width of each line, and by the shift, over Hz, (m, k)."""
        t, waves = self.t, self.waves(x)
        factors = solved[0 : 2 * waves.shape[1] : 2] + 1j * solved[1 : 2 * waves.shape[1] : 2]
        seen = math.pi * span_s * factors * waves
        faster, wider = np.asarray(2j * t), np.asarray(-t + 0j)
        along: list[tuple[ComplexArray, ...]] = [(faster, wider) for _ in seen.T]
        if self.moves:
            width = float(_widths(x[1:2])[0])
            turned = _turned(t, width)
            narrower = (t * np.exp(-2.0 * math.pi * width * t) - turned) / width
            wider = np.asarray(-t + 2j * float(x[-1]) * narrower)
            along = [(faster, wider, np.asarray(2j * turned))]
        parts = [
            self._as_rows(by * wave)
            for wave, each in zip(seen.T, along, strict=True)
            for by in each
        ]
        return np.stack(parts, axis=1)

    def begin(self, x: FloatArray) -> FloatArray:
        """Turns and logarithm of the width of a further line, (2,), by what those at x leave."""
        rest = self.left(x) if x.size else self.rows - self._middle()
        if self.is_complex:
            rest = rest[: self.values.size] + 1j * rest[self.values.size :]
        tried = [np.array([self._turns(rest, wide), wide]) for wide in BEGINS]
        squares = [float(np.sum(self.left(np.append(x, each)) ** 2)) for each in tried]
        return tried[int(np.argmin(squares))]

    def moving_begin(self, wide: float) -> FloatArray:
        """Turns, logarithm of the width, and shift of a line that moves, (3,).

        Args:
            wide: logarithm of the width of one that does not.
        """
        rest = np.asarray(self.values - self._middle())
        tried = []
        for log_width in wide + np.array(MOVED_WIDTHS):
            width = float(_widths(log_width))
            turned = _turned(self.t, width)
            for shift in width * np.append(-SHIFTS, SHIFTS):
                back = np.exp(-2j * math.pi * shift * turned)
                turns, height = self._highest(rest * back, float(log_width))
                tried.append((height, (turns, float(log_width), float(shift))))
        return np.array(max(tried)[1])

    def _turns(self, rest: FloatArray | ComplexArray, wide: float) -> float:
        """Where the spectrum is highest under a decay of that width, in turns over the record."""
        return self._highest(rest, wide)[0]

    def _highest(self, rest: FloatArray | ComplexArray, wide: float) -> tuple[float, float]:
        """Where the spectrum under a decay of that width is highest, in turns, and how high."""
        size = 2 * rest.size
        under = np.exp(-math.pi * float(_widths(wide)) * self.t)
        sizes = np.abs(np.fft.fft(rest * under, size)) / np.linalg.norm(under)
        if not self.is_complex:  # its other half is that of the conjugate, which turns backwards
            sizes[: int(2 * FEWEST)] = 0.0
            sizes = sizes[: rest.size + 1]
        at = int(np.argmax(sizes))
        return 0.5 * (at if at <= rest.size else at - size), float(sizes[at])

    def _middle(self) -> float:
        """What is taken off before the first line is looked for: a real decay swings about it."""
        return 0.0 if self.is_complex else float(np.mean(self.values.real))

    def _as_rows(self, wave: ComplexArray) -> FloatArray:
        return both_parts(wave) if self.is_complex else np.asarray(wave.real)

    def at(self, x: FloatArray, spacing_s: float) -> DecayingLines | None:
        """The lines at x, which least squares have; None where one hardly oscillates.

        Args:
            x: of the lines.
            spacing_s: between two samples, s.
        """
        lines = np.array(x[: x.size - self.moves])
        if not self.is_complex and not self.moves:  # what turns backwards is the same
            lines[::2] = np.abs(lines[::2])
        slow = not self.is_complex and bool(np.any(lines[::2] < FEWEST))
        if slow or not np.all(np.isfinite(x)):
            return None
        lines = np.ravel(lines.reshape(-1, 2)[np.argsort(lines[::2], kind="stable")])
        x = np.append(lines, x[lines.size :])
        span_s = self.values.size * spacing_s
        columns, solved, left = self.solved(x)
        return DecayingLines(
            frequency_hz=tuple(float(turns) / span_s for turns in lines[::2]),
            width_hz=tuple(float(width) / span_s for width in _widths(lines[1::2])),
            left=left,
            columns=columns,
            solved=solved,
            slopes=self.slopes(x, solved, span_s),
            shift_hz=tuple(float(shift) / span_s for shift in x[lines.size :]),
        )


def _least(columns: FloatArray, rows: FloatArray) -> FloatArray:
    """How much of each column (m, k) follows rows (m,) or (m, n) best: (k,) or (k, n)."""
    sizes = np.linalg.norm(columns, axis=0)
    unit = 1.0 / np.where(sizes > 0.0, sizes, 1.0)
    gram = (columns.T @ columns) * np.outer(unit, unit)
    found = np.linalg.lstsq(gram, (rows.T @ columns * unit).T, rcond=ROUNDING)[0]
    return np.asarray((found.T * unit).T)


def _widths(wide: FloatArray | float) -> FloatArray:
    """Widths over the first one of their logarithms."""
    return np.asarray(np.exp(np.clip(wide, -WIDEST, WIDEST)))


def _turned(t: FloatArray, width: FloatArray | float) -> FloatArray:
    """Turns by a shift of one turn over the record at its first sample, (n,) or (n, 1)."""
    rate = 2.0 * math.pi * width
    shape = t[:, None] if np.ndim(width) else t
    return np.asarray(-np.expm1(-rate * shape) / rate)


def decaying_lines(
    values: FloatArray | ComplexArray,
    spacing_s: float,
    count: int,
    *,
    offset: bool = False,
    near: DecayingLines | None = None,
) -> DecayingLines | None:
    """So many decaying lines, by least squares; None where one of them hardly oscillates.

    Demodulated lines need not oscillate.

    Args:
        values: of the record, evenly spaced, shape (n,), in any unit; complex ones are demodulated.
        spacing_s: between two of them, s.
        count: of lines.
        offset: whether there is a constant beside them.
        near: fewer lines, of the same record, with which it begins; None: with none.
    """
    record = _Record(values, offset)
    x = np.empty(0) if near is None else _x_of(near, values.size * spacing_s)
    for _ in range(x.size // 2, count):
        x = record.lowered(np.append(x, record.begin(x))).values
    return record.at(x, spacing_s)


def moving_line(
    values: FloatArray | ComplexArray, spacing_s: float, near: DecayingLines, *, offset: bool
) -> DecayingLines | None:
    """One line whose frequency moves with the square of its amplitude; None as `decaying_lines`.

    Args:
        values: of the record, evenly spaced, shape (n,), in any unit; complex ones are demodulated.
        spacing_s: between two of them, s.
        near: one line that does not move.
        offset: whether there is a constant beside it.
    """
    record = _Record(values, offset, moves=True)
    still = _x_of(near, values.size * spacing_s)
    begins = (record.moving_begin(float(still[1])), np.append(still, 0.0))
    fits = [record.lowered(begin) for begin in begins]
    best = min(fits, key=lambda fit: float(fit.residuals @ fit.residuals))
    return record.at(best.values, spacing_s)


def _x_of(lines: DecayingLines, span_s: float) -> FloatArray:
    """Turns and logarithm of the width of each line."""
    pairs = zip(lines.frequency_hz, lines.width_hz, strict=True)
    return np.array([each for f, w in pairs for each in (f * span_s, math.log(w * span_s))])
