"""A sample of the virtual laboratory: N coupled modes, perhaps under a parametric pump.

It solves the equations by numpy in hybridised coordinates and shares no code with the FMU, which
eliminates sideband by sideband in physical ones, so that a fit through the FMU is tried against
something else than itself. Spectra, noise and instruments are built on `CoupledModes.response`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import reduce

import numpy as np
from scipy.linalg import expm

from fitting.text.arrays import ComplexArray, FloatArray

TWO_PI = 2.0 * math.pi
#: The sidebands grow until another pair changes no response by more than this part.
SIDEBAND_ACCURACY = 1e-12
MOST_SIDEBANDS = 400
#: Steps in a period of the fastest oscillation, and in one of the pump at most: slower ones are not
#: followed.
STEPS, MOST_STEPS = 40, 200_000

Pairs = Mapping[tuple[int, int], float]


@dataclass(frozen=True, kw_only=True)
class Pump:
    """A harmonic modulation: f_i^2 and lambda_ij^2 times 1 + depth cos(2 pi u_p t + phase).

    ``depth_f`` has a depth for each mode, none: zeros; ``depth_coupling`` one for each pair (i, j),
    i < j, counted from 0, that is modulated.

    Raises:
        ValueError: no positive frequency.
    """

    frequency_hz: float
    phase_rad: float = 0.0
    depth_f: tuple[float, ...] = ()
    depth_coupling: Pairs = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0.0 < self.frequency_hz < math.inf:
            raise ValueError(f"pump frequency {self.frequency_hz} Hz must be positive")


@dataclass(frozen=True, kw_only=True)
class CoupledModes:
    """N modes x_i'' + 2 pi d_i x_i' + (2 pi)^2 (f_i^2 x_i - sum_j lambda_ij^2 x_j) = g_i b(t).

    ``coupling_hz`` has lambda_ij of each coupled pair (i, j), i < j, counted from 0; ``gains`` g_i,
    none: ones; ``pump`` modulates frequencies and couplings.

    Raises:
        ValueError: lengths that differ, values out of range, a motion without a restoring force.
    """

    f_hz: tuple[float, ...]
    d_hz: tuple[float, ...]
    coupling_hz: Pairs = field(default_factory=dict)
    gains: tuple[float, ...] = ()
    pump: Pump | None = None

    def __post_init__(self) -> None:
        n = len(self.f_hz)
        depths = self.pump.depth_f if self.pump else ()
        for name, values in (("d_hz", self.d_hz), ("gains", self.gains), ("depth_f", depths)):
            if len(values) != n and (values or name == "d_hz"):
                raise ValueError(f"{name} has {len(values)} values, wanted {n}, one for each mode")
        if not all(0.0 < x < math.inf for x in (*self.f_hz, *self.d_hz)):
            raise ValueError(f"f = {self.f_hz} and d = {self.d_hz} Hz must be positive")
        modulated = self.pump.depth_coupling if self.pump else {}
        for pair in (*self.coupling_hz, *modulated):
            if not 0 <= pair[0] < pair[1] < n:
                raise ValueError(f"pair {pair}: wanted (i, j) with 0 <= i < j < {n}")
        if min(self.coupling_hz.values(), default=0.0) < 0.0:
            raise ValueError(f"couplings {dict(self.coupling_hz)} Hz must not be negative")
        if np.min(np.linalg.eigvalsh(self._stiffness())) <= 0.0:
            raise ValueError("coupled so strongly that a motion has no restoring force")

    def _stiffness(self) -> FloatArray:
        """The stiffness matrix over (2 pi)^2 in Hz^2, (N, N)."""
        ones = dict.fromkeys(self.coupling_hz, 1.0)
        return self._matrix(np.ones(len(self.f_hz)), ones)

    def _modulation(self) -> FloatArray:
        """What the pump adds to it at its largest, (N, N)."""
        if self.pump is None:
            return np.zeros((len(self.f_hz),) * 2)
        depths = self.pump.depth_f or (0.0,) * len(self.f_hz)
        return self._matrix(np.array(depths), self.pump.depth_coupling)

    def _matrix(self, on_f: FloatArray, on_coupling: Pairs) -> FloatArray:
        result = np.diag(np.square(self.f_hz) * on_f)
        for (i, j), size in self.coupling_hz.items():
            result[i, j] = result[j, i] = -(size**2) * on_coupling.get((i, j), 0.0)
        return result

    def eigenfrequencies_hz(self) -> FloatArray:
        """Eigenfrequencies of the coupled modes without pump and damping, (N,), Hz, rising."""
        return np.asarray(np.sqrt(np.linalg.eigvalsh(self._stiffness())))

    def response(self, frequency_hz: FloatArray, sideband: int = 0) -> ComplexArray:
        """Complex amplitudes (n, N) of the modes at u + k u_p under cos(2 pi u t), in s^2.

        sum over k of A(u + k u_p) X_k + P/2 (e^(i phase) X_(k-1) + e^(-i phase) X_(k+1)) = g for
        k = 0 and 0 else, A(v) = C - v^2 + i v D over (2 pi)^2, solved as one dense system per
        frequency in the coordinates in which C is diagonal, (eta - v)(eta + v).

        Args:
            frequency_hz: drive frequencies (n,), Hz.
            sideband: k, 0 without a pump.

        Raises:
            ValueError: the sidebands do not converge.
        """
        u = np.atleast_1d(np.asarray(frequency_hz, dtype=float))
        if self.pump is None:
            if sideband:
                return np.zeros((u.size, len(self.f_hz)), dtype=complex)
            return self._truncated(u, 0, 0)
        reach = abs(sideband) + 2
        before = self._truncated(u, reach, sideband)
        while reach <= MOST_SIDEBANDS:
            reach += max(2, reach // 2)
            result = self._truncated(u, reach, sideband)
            if np.abs(result - before).max() <= SIDEBAND_ACCURACY * np.abs(result).max():
                return result
            before = result
        raise ValueError(f"more than {MOST_SIDEBANDS} sidebands of the pump would be needed")

    def growth(self) -> float:
        """By how much a free motion grows in a period of the pump, at most; below 1: all decay.

        The largest Floquet multiplier, |eigenvalues| of the product over one period of

            exp(h G/2) (1 + h K cos(2 pi t/period)) exp(h G/2)

        with G of the modes without pump and K of the pump alone, t in the middle of each step h.

        Raises:
            ValueError: there is no pump, or one so slow that its period is not followed.
        """
        if self.pump is None:
            raise ValueError("without a pump nothing can grow")
        n, fastest = len(self.f_hz), float(self.eigenfrequencies_hz()[-1])
        count = math.ceil(STEPS * max(fastest / self.pump.frequency_hz, 1.0))
        if count > MOST_STEPS:
            raise ValueError(
                f"a pump at {self.pump.frequency_hz} Hz is too slow to decide whether the motion "
                f"grows: wanted above {STEPS * fastest / MOST_STEPS:.6g} Hz"
            )
        nothing, unit = np.zeros((n, n)), fastest * np.eye(n)
        still = np.block([[nothing, unit], [-self._stiffness() / fastest, -np.diag(self.d_hz)]])
        kick = np.block([[nothing, nothing], [-self._modulation() / fastest, nothing]])
        step = TWO_PI / (self.pump.frequency_hz * count)
        half = expm(0.5 * step * still)
        turns = np.cos(TWO_PI * (np.arange(count) + 0.5) / count)
        moved = half @ (np.eye(2 * n) + step * turns[:, np.newaxis, np.newaxis] * kick) @ half
        period = reduce(lambda before, then: then @ before, moved)
        return float(np.abs(np.linalg.eigvals(period)).max())

    def _truncated(self, u: FloatArray, reach: int, sideband: int) -> ComplexArray:
        """The response with the sidebands -reach to reach."""
        n, size = len(self.f_hz), 2 * reach + 1
        square, shapes = np.linalg.eigh(self._stiffness())
        eta = np.sqrt(square)
        damping = shapes.T @ np.diag(self.d_hz) @ shapes
        step = self.pump.frequency_hz if self.pump else 0.0
        matrix = np.zeros((u.size, size, n, size, n), dtype=complex)
        for k in range(size):
            v = u + (k - reach) * step
            matrix[:, k, :, k, :] = 1j * v[:, np.newaxis, np.newaxis] * damping
            for i in range(n):
                matrix[:, k, i, k, i] += (eta[i] - v) * (eta[i] + v)
        if self.pump is not None:
            half = 0.5 * shapes.T @ self._modulation() @ shapes
            turn = np.exp(1j * self.pump.phase_rad)
            for k in range(size - 1):
                matrix[:, k + 1, :, k, :] = turn * half
                matrix[:, k, :, k + 1, :] = np.conj(turn) * half
        right = np.zeros((size, n), dtype=complex)
        right[reach] = shapes.T @ np.array(self.gains or (1.0,) * n)
        solved = np.linalg.solve(
            matrix.reshape(u.size, size * n, size * n),
            np.broadcast_to(right.reshape(-1, 1), (u.size, size * n, 1)),
        )
        hybrid = solved.reshape(u.size, size, n)[:, reach + sideband]
        return np.asarray(hybrid @ shapes.T / TWO_PI**2)
