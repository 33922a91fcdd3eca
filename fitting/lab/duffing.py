"""A sample of the virtual laboratory: two modes with cubic terms, by harmonic balance on a torus.

The steady response to one or two tones is a sum of lines at whole combinations of them,

    q~(t) = Re sum_k X_k exp(2 pi i k.u t),   sum |k_i| <= order, odd orders only,

and X solves A(u_k) X_k + N_k(X) = F_k, with A of the linear system and N_k the lines of the cubic
forces, taken on a grid of the tones' phases fine enough that nothing folds. Newton's method on X,
from rest along growing drive. No averaging and no time stepping: it shares neither code nor method
with the FMU. Source: A. Cardona, A. Lerusse, M. Geradin, Fast Fourier nonlinear vibration analysis,
Comput. Mech. 22 (1998) 128.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitting.lab.string import Drive, TwoModes, dynamic_stiffness
from fitting.text.arrays import ComplexArray, FloatArray

#: Orders that are tried one after the other, and the change of a line, relative to the largest, at
#: which the one before was enough.
ORDERS = (7, 11, 15, 19, 23)
ENOUGH = 1e-5
MOST_NEWTON = 25
CLOSED = 1e-11  # change of the lines, relative to the largest, at which Newton's method ends
SHORTEST_RAMP = 1e-4  # of the whole drive


#: A steady response: complex amplitudes (2,) in m of both modes at each combination of the tones,
#: "2 u1 - u2" as (2, -1); at k and -k conjugate ones.
Lines = Mapping[tuple[int, ...], ComplexArray]


class NoSteadyState(ArithmeticError):
    """Newton's method found no response near the one it came from: a branch ends there."""


@dataclass(frozen=True)
class CubicModes:
    """A sample of the virtual laboratory: two modes with cubic terms.

    The coefficients, in 1/(m^2 s^2), are those of forces per mass from a potential, which is
    alpha1 q1^4/4 + alpha2 q2^4/4 + kappa q1^2 q2^2/2 in the hybridised modes.

    Raises:
        ValueError: a coefficient that is no number.
    """

    modes: TwoModes
    alpha1: float
    alpha2: float = 0.0
    kappa: float = 0.0

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, self.cubic)):
            raise ValueError(f"cubic coefficients {self.cubic} must be finite")

    @property
    def cubic(self) -> tuple[float, float, float]:
        """The cubic coefficients."""
        return self.alpha1, self.alpha2, self.kappa

    def shifted(self, shift_hz: float) -> CubicModes:
        """The same sample, both eigenfrequencies higher by so much.

        Args:
            shift_hz: by which both resonances move, Hz.
        """
        return replace(self, modes=self.modes.shifted(shift_hz))

    def amplitudes(self, drive: Drive) -> ComplexArray:
        """Complex amplitudes (lines, 2) in m of both modes at the lines that the drive reads.

        Args:
            drive: tones and amplitudes that drive.

        Raises:
            ValueError: a drive so strong that its response does not grow out of rest steadily, or a
                combination of an even order, at which there is no line.
        """
        try:
            lines = steady_lines(self, drive)
        except NoSteadyState as error:
            raise ValueError(
                f"tones {drive.tones_hz} Hz at {max(drive.amplitudes)!r} m/s^2: {error}; "
                "wanted a weaker drive"
            ) from error
        for factors in drive.read:
            if factors not in lines:
                raise ValueError(f"no line {factors}")
        return np.array([lines[factors] for factors in drive.read])


def steady_lines(sample: CubicModes, drive: Drive, start: Lines | None = None) -> Lines:
    """The response that grows out of rest with the drive, or the one near ``start``.

    Orders are added until the last ones change no line by more than ``ENOUGH`` of the largest.

    Args:
        sample: both modes and the cubic terms.
        drive: tones and amplitudes that drive.
        start: of the balance, None to begin from rest.

    Raises:
        NoSteadyState: a branch ends before the whole drive is reached, or the lines do not fall
            off with their order.
        ValueError: more than two tones.
    """
    if len(drive.tones_hz) > 2:
        raise ValueError(f"tones {drive.tones_hz} Hz, wanted one or two that differ")
    lines = lines_to_order(sample, drive, ORDERS[0], start)
    for order in ORDERS[1:]:
        balance = _Balance(sample, drive, order)
        more = lines_to_order(sample, drive, order, lines)
        change = np.abs(balance.vector(more) - balance.vector(lines)).max()
        lines = more
        if change <= ENOUGH * np.abs(balance.vector(more)).max():
            return lines
    raise NoSteadyState(f"lines of order {ORDERS[-1]} still count")


def lines_to_order(
    sample: CubicModes, drive: Drive, order: int, start: Lines | None = None
) -> Lines:
    """As :func:`steady_lines`, with the lines up to one order.

    Args:
        sample: both modes and the cubic terms.
        drive: tones and amplitudes that drive.
        order: highest sum of the absolute factors.
        start: of the balance, None to begin from rest.
    """
    balance = _Balance(sample, drive, order)
    if start is not None:
        return balance.lines(balance.solve(balance.vector(start), 1.0))
    x: ComplexArray = np.zeros((balance.count, 2), dtype=complex)
    done, step = 0.0, 1.0
    while done < 1.0:
        try:
            x = balance.solve(x * (min(1.0, done + step) / done if done else 1.0), done + step)
        except NoSteadyState:
            step *= 0.5
            if step < SHORTEST_RAMP:
                raise
            continue
        done += step
        step = min(2.0 * step, 1.0 - done)
    return balance.lines(x)


class _Balance:
    """The equations of one drive, lengths in ``unit``, forces in those of the linear response."""

    def __init__(self, sample: CubicModes, drive: Drive, order: int) -> None:
        # odd combinations of the tones; of each pair k, -k one
        rows = [
            k
            for k in itertools.product(range(-order, order + 1), repeat=len(drive.tones_hz))
            if sum(map(abs, k)) <= order and sum(k) % 2 and next(x for x in k if x) > 0
        ]
        self.factors: NDArray[np.int64] = np.array(rows, dtype=np.int64)
        self.count = len(self.factors)
        lines_hz = self.factors @ np.array(drive.tones_hz)
        self.linear = dynamic_stiffness(sample.modes, lines_hz)
        force = np.zeros((self.count, 2), dtype=complex)
        for tone, amplitude in enumerate(drive.amplitudes):
            alone = (self.factors == np.eye(len(drive.tones_hz), dtype=int)[tone]).all(axis=1)
            force[alone] = amplitude * np.array(drive.gains)
        response = np.linalg.solve(self.linear, force[:, :, np.newaxis])[:, :, 0]
        self.unit = float(np.abs(response).max()) or 1.0
        self.force = force / self.unit
        self.cubic = tuple(c * self.unit**2 for c in sample.cubic)
        self.size = 4 * order + 1 + order % 2  # products of three lines fold onto none of them

    def vector(self, lines: Lines) -> ComplexArray:
        """The lines as unknowns; those that are not there are zero."""
        none = np.zeros(2, dtype=complex)
        rows: ComplexArray = np.array([lines.get(tuple(k), none) for k in self.factors.tolist()])
        return np.asarray(rows / self.unit)

    def lines(self, x: ComplexArray) -> Lines:
        """The unknowns as lines, those of negative combinations too."""
        lines = {tuple(k): a for k, a in zip(self.factors.tolist(), x * self.unit, strict=True)}
        return lines | {tuple(-n for n in k): a.conj() for k, a in lines.items()}

    def solve(self, x: ComplexArray, part: float) -> ComplexArray:
        """Newton's method from ``x`` under ``part`` of the drive."""
        a1, a2, kappa = self.cubic
        for _ in range(MOST_NEWTON):
            q = self._motion(x)
            forces = (
                a1 * q[0] ** 3 + kappa * q[0] * q[1] ** 2,
                a2 * q[1] ** 3 + kappa * q[1] * q[0] ** 2,
            )
            lines = np.stack([2.0 * self._at_lines(f, self.factors) for f in forces], axis=1)
            residual = np.einsum("nij,nj->ni", self.linear, x) + lines - part * self.force
            change = self._newton(q, residual)
            x = x - change
            size = float(np.abs(change).max())
            if not math.isfinite(size) or size > 10.0:
                break
            if size <= CLOSED * max(float(np.abs(x).max()), np.finfo(float).tiny):
                return x
        raise NoSteadyState(f"no steady state near the last one at {part:.6g} of the drive")

    def _motion(self, x: ComplexArray) -> FloatArray:
        """q~ on the grid of phases, (2, size, ...)."""
        grid = np.zeros((2, *(self.size,) * self.factors.shape[1]), dtype=complex)
        for mode in (0, 1):
            grid[(mode, *self.factors.T)] = x[:, mode]
        axes = tuple(range(1, grid.ndim))
        return np.asarray(np.fft.ifftn(grid, axes=axes).real * grid[0].size)

    def _at_lines(self, values: FloatArray, factors: NDArray[np.int64]) -> ComplexArray:
        """Complex Fourier coefficients of values on the grid, at some combinations."""
        coefficients = np.fft.fftn(values) / values.size
        return np.asarray(coefficients[tuple(np.moveaxis(factors % self.size, -1, 0))])

    def _newton(self, q: FloatArray, residual: ComplexArray) -> ComplexArray:
        """Solve J dX = residual, where J dX = P dX + M conj(dX) has a part with the conjugate."""
        a1, a2, kappa = self.cubic
        cross = 2.0 * kappa * q[0] * q[1]
        slopes = (
            (3.0 * a1 * q[0] ** 2 + kappa * q[1] ** 2, cross),
            (cross, 3.0 * a2 * q[1] ** 2 + kappa * q[0] ** 2),
        )
        n, k = self.count, self.factors
        apart, summed = k[:, np.newaxis] - k[np.newaxis], k[:, np.newaxis] + k[np.newaxis]
        plain = np.zeros((n, 2, n, 2), dtype=complex)
        mirror = np.zeros_like(plain)
        for i, j in itertools.product((0, 1), repeat=2):
            plain[:, i, :, j] = self._at_lines(slopes[i][j], apart)
            mirror[:, i, :, j] = self._at_lines(slopes[i][j], summed)
        index = np.arange(n)
        plain[index, :, index, :] += self.linear
        p, m = plain.reshape(2 * n, 2 * n), mirror.reshape(2 * n, 2 * n)
        system = np.block([[(p + m).real, (m - p).imag], [(p + m).imag, (p - m).real]])
        right = np.concatenate([residual.ravel().real, residual.ravel().imag])
        scale = 1.0 / np.abs(system).max(axis=1)
        result: FloatArray = np.linalg.solve(system * scale[:, np.newaxis], right * scale)
        return np.asarray((result[: 2 * n] + 1j * result[2 * n :]).reshape(n, 2))
