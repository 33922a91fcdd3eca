"""Driven linear modes by scipy's matrix exponential: the equations written down once more.

    x'' + D x' + C x = g (A1 e1 + A2 e2 + b),    e_k' = 2 pi i u_k e_k,    real parts are meant

The tones are states of the system, so that their phases go on by themselves when frequencies
change. The envelope x = a exp(2 pi i c t) without a'' and D a' obeys

    4 pi i c (x' - 2 pi i c x) + (C - (2 pi c)^2 + 2 pi i c D) x = g (A1 e1 + A2 e2)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import expm

Matrix = npt.NDArray[np.float64]
Vector = npt.NDArray[np.complex128]
TWO_PI = 2.0 * np.pi


@dataclass(frozen=True)
class Modes:
    """Matrices in rad/s, and the tones: frequency in Hz, amplitude, phase in rad."""

    stiffness: Matrix
    damping: Matrix
    gains: Matrix
    tones: tuple[tuple[float, float, float], ...]
    #: Centre of the envelope's frame where no tone is on, Hz.
    centre: float = 0.0

    @property
    def frame(self) -> float:
        """Centre of the envelope's frame, Hz."""
        active = [u for u, size, _ in self.tones if size]
        return sum(active) / len(active) if active else self.centre

    def response(self, u: float, *, envelope: bool = False) -> Vector:
        """Steady state under cos(2 pi u t).

        Args:
            u: Hz.
            envelope: in the rotating frame.
        """
        w, c = TWO_PI * u, TWO_PI * (self.frame if envelope else u)
        square = c * (2.0 * w - c)
        system = self.stiffness - square * np.eye(len(self.gains)) + 1j * c * self.damping
        return np.asarray(np.linalg.solve(system, self.gains.astype(complex)))

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
    n, scale = len(first.gains), float(np.sqrt(np.max(np.abs(first.stiffness))))
    turns = [np.exp(1j * TWO_PI * (u * begin % 1.0)) for u, _, _ in first.tones]
    y = np.concatenate([np.zeros(n if envelope else 2 * n), turns, [1.0]]).astype(complex)
    if periodic:
        y[:n] += first.response(0.0).real * pieces[0].b
        for (u, size, phase), turn in zip(first.tones, turns, strict=True):
            x = first.response(u, envelope=envelope) * size * np.exp(1j * phase) * turn
            y[:n] += x
            if not envelope:
                y[n : 2 * n] += 1j * TWO_PI * u * x / scale
    rows, now = [], begin
    for piece in pieces:
        generator = piece.modes.generator(scale, envelope=envelope)
        y[-1] = piece.b
        for time in piece.times:
            y = expm(generator * (time - now)) @ y
            now = time
            rows.append(y[:n].real)
    return np.array(rows)
