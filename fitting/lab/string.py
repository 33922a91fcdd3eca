"""What is driven: two coupled modes by the closed form of their steady state, and what drives them.

It is in numpy's complex arithmetic and shares no code with the FMU, so that a fit through the FMU
is tried against something else than itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray

TWO_PI = 2.0 * math.pi


@dataclass(frozen=True)
class Drive:
    """Tones in Hz, all with phase zero, and the acceleration of each in m/s^2.

    ``gains`` is what each of the two modes sees of them; ``lines`` are the combinations that are
    read, "2 u1 - u2" as (2, -1); () the tones themselves.

    Raises:
        ValueError: not a tone, two that are equal, or not an amplitude for each.
    """

    tones_hz: tuple[float, ...]
    amplitudes: tuple[float, ...]
    _: KW_ONLY
    gains: tuple[float, float] = (1.0, 1.0)
    lines: tuple[tuple[int, ...], ...] = ()

    def __post_init__(self) -> None:
        if not self.tones_hz or len(set(self.tones_hz)) < len(self.tones_hz):
            raise ValueError(f"tones {self.tones_hz} Hz, wanted one or two that differ")
        if len(self.amplitudes) != len(self.tones_hz):
            raise ValueError(f"{len(self.amplitudes)} amplitudes for tones {self.tones_hz} Hz")

    @classmethod
    def equal(cls, tones_hz: Sequence[float], level: float) -> Drive:
        """Tones that all have the same amplitude.

        Args:
            tones_hz: frequencies of the tones, Hz.
            level: amplitude of every tone, m/s².
        """
        return cls(tuple(tones_hz), (level,) * len(tones_hz))

    @property
    def read(self) -> tuple[tuple[int, ...], ...]:
        """The combinations that are read, written out."""
        count = len(self.tones_hz)
        alone = tuple(tuple(int(i == k) for i in range(count)) for k in range(count))
        return self.lines or alone

    def tone_of(self, line: Sequence[int]) -> int | None:
        """The place of the tone that a combination is, None for one of several.

        Args:
            line: factors of the tones, one each.
        """
        return list(line).index(1) if sorted(line)[-1] == 1 and sum(map(abs, line)) == 1 else None


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


#: The paper's nanostring in its q1 series, in the middle of the drift.
STRING = TwoModes(
    theta_rad=1.9498, d1_hz=120.0, d2_hz=90.0, eta_plus_hz=6940260.0, eta_minus_hz=7027600.0
)


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
    drive = np.broadcast_to(np.array(gains, dtype=complex)[:, np.newaxis], (u.size, 2, 1))
    return np.asarray(np.linalg.solve(dynamic_stiffness(modes, u), drive)[:, :, 0])


def dynamic_stiffness(modes: TwoModes, frequency_hz: FloatArray) -> ComplexArray:
    """A(u) (n, 2, 2) of the hybridised modes at frequencies u, which may be negative, in 1/s^2.

    Args:
        modes: the two modes: η, damping and angle, as `TwoModes` explains.
        frequency_hz: frequencies (n,), Hz.
    """
    u, t = frequency_hz, modes.transform()
    damping = TWO_PI * (t @ np.diag([modes.d1_hz, modes.d2_hz]) @ t.T)
    matrix = 1j * TWO_PI * u[:, np.newaxis, np.newaxis] * damping
    for i, eta in enumerate((modes.eta_plus_hz, modes.eta_minus_hz)):
        matrix[:, i, i] += TWO_PI**2 * (eta - u) * (eta + u)
    return np.asarray(matrix)
