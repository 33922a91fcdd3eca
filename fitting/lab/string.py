"""A sample of the virtual laboratory: two coupled modes, by the closed form of their steady state.

It is in numpy's complex arithmetic and shares no code with the FMU, so that a fit through the FMU
is tried against something else than itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fitting.lab.drive import Drive
from fitting.text.arrays import ComplexArray, FloatArray

TWO_PI = 2.0 * math.pi


@dataclass(frozen=True, kw_only=True)
class TwoModes:
    """Two coupled damped modes: angle, damping d1 and d2, eigenfrequencies.

    ``reflection`` selects T = [[-c, s], [s, c]] instead of the rotation [[c, -s], [s, c]].

    Raises:
        ValueError: damping not positive or eta_plus not below eta_minus.
    """

    theta_rad: float
    d1_hz: float
    d2_hz: float
    eta_plus_hz: float
    eta_minus_hz: float
    reflection: bool = False

    def __post_init__(self) -> None:
        if not (self.d1_hz > 0.0 and self.d2_hz > 0.0):
            raise ValueError(f"damping d1 = {self.d1_hz}, d2 = {self.d2_hz} Hz must be positive")
        if not 0.0 < self.eta_plus_hz < self.eta_minus_hz:
            raise ValueError(
                f"eta_plus = {self.eta_plus_hz} Hz must lie between 0 and "
                f"eta_minus = {self.eta_minus_hz} Hz"
            )

    def transform(self) -> FloatArray:
        """The orthogonal matrix T (2, 2)."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return np.array([[-c, s], [s, c]] if self.reflection else [[c, -s], [s, c]])

    def widths_hz(self) -> tuple[float, float]:
        """Full widths of the hybridised modes, (T D T^T)_ii / 2 pi, in Hz."""
        rotated = self.transform() @ np.diag([self.d1_hz, self.d2_hz]) @ self.transform().T
        return float(rotated[0, 0]), float(rotated[1, 1])

    @property
    def modes(self) -> TwoModes:
        """The linear part of the sample: all of it."""
        return self

    def shifted(self, shift_hz: float) -> TwoModes:
        """The same sample, both eigenfrequencies higher by so much.

        Args:
            shift_hz: by which both resonances move, Hz.
        """
        return replace(
            self,
            eta_plus_hz=self.eta_plus_hz + shift_hz,
            eta_minus_hz=self.eta_minus_hz + shift_hz,
        )

    def amplitudes(self, drive: Drive) -> ComplexArray:
        """Complex amplitudes (lines, 2) of both modes; a combination of tones has none.

        Args:
            drive: tones and amplitudes that drive.
        """
        waves = steady_state(self, np.array(drive.tones_hz), drive.gains)
        answer = np.array(drive.amplitudes)[:, np.newaxis] * waves
        tones = [drive.tone_of(line) for line in drive.read]
        return np.array([np.zeros(2) if tone is None else answer[tone] for tone in tones])


def steady_state(
    modes: TwoModes, frequency_hz: FloatArray, gains: tuple[float, float] = (1.0, 1.0)
) -> ComplexArray:
    """Complex amplitudes (n, 2) of both hybridised modes under cos(2 pi u t), ``gains`` on each.

    X(u) = A(u)^-1 g with A(u) = C - (2 pi u)^2 I + 2 pi i u T D T^T, in s^2. Differences of
    squares are factored, (2 pi)^2 (eta - u)(eta + u): at Q near 1e5 they cancel. Source: Bartsch et
    al., arXiv:2412.07301, the periodic solution of the coupled system.

    Args:
        modes: the two modes: η, damping and angle, as `TwoModes` explains.
        frequency_hz: frequencies (n,), Hz.
        gains: of the two modes into the output.
    """
    u = np.asarray(frequency_hz, dtype=float)
    t = modes.transform()
    damping = TWO_PI * (t @ np.diag([modes.d1_hz, modes.d2_hz]) @ t.T)
    matrix = 1j * TWO_PI * u[:, np.newaxis, np.newaxis] * damping
    for i, eta in enumerate((modes.eta_plus_hz, modes.eta_minus_hz)):
        matrix[:, i, i] += TWO_PI**2 * (eta - u) * (eta + u)
    drive = np.broadcast_to(np.array(gains, dtype=complex)[:, np.newaxis], (u.size, 2, 1))
    return np.asarray(np.linalg.solve(matrix, drive)[:, :, 0])
