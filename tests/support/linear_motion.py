"""Driven linear modes by scipy's matrix exponential: the equations written down once more.

    x'' + D x' + C x = g (A1 e1 + A2 e2 + b),    e_k' = 2 pi i u_k e_k,    real parts are meant

The tones are states of the system, so that their phases go on by themselves when frequencies
change. The envelope x = a exp(2 pi i c t) without a'' and D a' obeys

    4 pi i c (x' - 2 pi i c x) + (C - (2 pi c)^2 + 2 pi i c D) x = g (A1 e1 + A2 e2)

A pump adds C_p cos psi to C; then there is no exponential, and scipy's DOP853 integrates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp
from scipy.linalg import expm

Matrix = npt.NDArray[np.float64]
Vector = npt.NDArray[np.complex128]
TWO_PI = 2.0 * np.pi
#: Sidebands on a side in a dense solve.
REACH = 24


@dataclass(frozen=True)
class Modes:
    """Matrices in rad/s, and the tones: frequency in Hz, amplitude, phase in rad."""

    stiffness: Matrix
    damping: Matrix
    gains: Matrix
    tones: tuple[tuple[float, float, float], ...]
    #: Centre of the envelope's frame where no tone is on, Hz.
    centre: float = 0.0
    #: C_p, the pump's frequency in Hz and its phase in rad.
    pump: Matrix | None = None
    pump_hz: float = 0.0
    pump_phase: float = 0.0

    @property
    def frame(self) -> float:
        """Centre of the envelope's frame, Hz."""
        active = [u for u, size, _ in self.tones if size]
        return sum(active) / len(active) if active else self.centre

    def response(self, u: float, *, envelope: bool = False) -> Vector:
        """Steady state under cos(2 pi u t), without a pump.

        Args:
            u: Hz.
            envelope: in the rotating frame.
        """
        return np.asarray(np.linalg.solve(self._block(u, envelope), self.gains.astype(complex)))

    def sidebands(self, u: float, *, envelope: bool = False) -> dict[int, Vector]:
        """Steady state at u + k pump_hz under cos(2 pi u t), by one dense solve.

        Args:
            u: Hz.
            envelope: in the rotating frame.
        """
        if self.pump is None:
            return {0: self.response(u, envelope=envelope)}
        n, size = len(self.gains), 2 * REACH + 1
        system = np.zeros((size, n, size, n), dtype=complex)
        for k in range(size):
            system[k, :, k, :] = self._block(u + (k - REACH) * self.pump_hz, envelope)
            for j, sign in ((k - 1, 1.0), (k + 1, -1.0)):
                if 0 <= j < size:
                    system[k, :, j, :] = 0.5 * self.pump * np.exp(1j * sign * self.pump_phase)
        right = np.zeros((size, n), dtype=complex)
        right[REACH] = self.gains
        found = np.linalg.solve(system.reshape(size * n, size * n), right.reshape(-1))
        rows = np.asarray(found.reshape(size, n), dtype=complex)
        return {k - REACH: rows[k] for k in range(size)}

    def _block(self, u: float, envelope: bool) -> Vector:
        w, c = TWO_PI * u, TWO_PI * (self.frame if envelope else u)
        square = c * (2.0 * w - c)
        made = self.stiffness - square * np.eye(len(self.gains)) + 1j * c * self.damping
        return np.asarray(made)

    def generator(self, scale: float, *, envelope: bool) -> Vector:
        """Of (x, x'/scale, e1, e2, 1), or of (x, e1, e2, 1) for the envelope.

        Args:
            scale: rad/s.
            envelope: in the rotating frame.
        """
        n = len(self.gains)
        size = (n if envelope else 2 * n) + 3
        made = np.zeros((size, size), dtype=complex)
        drive = np.zeros((n, 3), dtype=complex)
        for k, (u, amplitude, phase) in enumerate(self.tones):
            drive[:, k] = self.gains * amplitude * np.exp(1j * phase)
            made[size - 3 + k, size - 3 + k] = 1j * TWO_PI * u
        drive[:, 2] = self.gains
        if envelope:
            c = TWO_PI * self.frame
            left = self.stiffness - c * c * np.eye(n) + 1j * c * self.damping
            made[:n, :n] = 1j * c * np.eye(n) - left / (2j * c)
            made[:n, n:] = drive / (2j * c)
        else:
            made[:n, n : 2 * n] = scale * np.eye(n)
            made[n : 2 * n, :n] = -self.stiffness / scale
            made[n : 2 * n, n : 2 * n] = -self.damping
            made[n : 2 * n, 2 * n :] = drive / scale
        return made

    def modulation(self, scale: float, *, envelope: bool) -> Vector:
        """What the pump adds to the generator, times cos psi.

        Args:
            scale: rad/s.
            envelope: in the rotating frame.
        """
        n = len(self.gains)
        made = np.zeros_like(self.generator(scale, envelope=envelope))
        if self.pump is not None:
            rows = slice(0, n) if envelope else slice(n, 2 * n)
            made[rows, :n] = -self.pump / (2j * TWO_PI * self.frame if envelope else scale)
        return made


@dataclass(frozen=True)
class Piece:
    """Modes that stay as they are, under a held input, up to the last of some times."""

    modes: Modes
    times: tuple[float, ...]
    b: float = 0.0


def motion(
    pieces: Sequence[Piece], *, periodic: bool = False, envelope: bool = False, begin: float = 0.0
) -> Matrix:
    """Displacements at the times of all pieces, rows by time.

    Args:
        pieces: one after the other.
        periodic: from the periodic orbit of the first piece; else from rest.
        envelope: in the rotating frame.
        begin: start time, s.
    """
    first = pieces[0].modes
    scale = float(np.sqrt(np.max(np.abs(first.stiffness))))
    y = _begun(first, pieces[0].b, scale, (periodic, envelope), begin)
    n, now, turned = len(first.gains), begin, first.pump_hz * begin
    rows = []
    for piece in pieces:
        modes = piece.modes
        y[-1] = piece.b
        for time in piece.times:
            psi = TWO_PI * (turned % 1.0) + modes.pump_phase
            y = _moved(modes, scale, envelope, y, (time - now, psi))
            turned += modes.pump_hz * (time - now)
            now = time
            rows.append(y[:n].real)
    return np.array(rows)


def _begun(modes: Modes, b: float, scale: float, kind: tuple[bool, bool], begin: float) -> Vector:
    """The augmented state at the start, at rest or on the orbit."""
    n, (periodic, envelope) = len(modes.gains), kind
    turns = [np.exp(1j * TWO_PI * (u * begin % 1.0)) for u, _, _ in modes.tones]
    y = np.concatenate([np.zeros(n if envelope else 2 * n), turns, [1.0]]).astype(complex)
    if not periodic:
        return y
    held = [] if envelope else [(0.0, b, 0.0)]
    for u, size, phase in (*modes.tones, *held):
        for k, x in modes.sidebands(u, envelope=envelope).items():
            v = u + k * modes.pump_hz
            z = x * size * np.exp(1j * phase) * np.exp(1j * TWO_PI * (v * begin % 1.0))
            y[:n] += z
            if not envelope:
                y[n : 2 * n] += 1j * TWO_PI * v * z / scale
    return y


def _moved(
    modes: Modes, scale: float, envelope: bool, y: Vector, way: tuple[float, float]
) -> Vector:
    """The augmented state after some time that begins at a phase of the pump."""
    span, psi = way
    generator = modes.generator(scale, envelope=envelope)
    if modes.pump is None:
        return np.asarray(expm(generator * span) @ y)
    pumped = modes.modulation(scale, envelope=envelope)
    return _integrated(partial(_rate, generator, pumped, psi, TWO_PI * modes.pump_hz), span, y)


def _rate(still: Vector, pumped: Vector, psi: float, speed: float, t: float, y: Vector) -> Any:
    return still @ y + np.cos(psi + speed * t) * (pumped @ y)


def _integrated(rate: Any, span: float, y: Vector) -> Vector:
    size = float(np.max(np.abs(y[:-3]))) or 1e-3
    tolerance = np.full(len(y), 1e-13 * size)
    found = solve_ivp(rate, (0.0, span), y, method="DOP853", rtol=1e-12, atol=tolerance)
    return np.asarray(found.y[:, -1])
