"""Langevin's equation by its exact discretisation, and its periodograms by scipy's Welch.

    m x'' + m 2 pi w x' + m (2 pi f)^2 x = F(t),   <F F> = 2 k_B T m 2 pi w delta

Over a step h the state (x, v) turns by expm(A h) and gains a Gaussian of the covariance that keeps
that of equilibrium, diag(k_B T/k, k_B T/m).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.constants import Boltzmann
from scipy.linalg import expm
from scipy.signal import lfilter, welch

from fitting.text.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class Langevin:
    """One mode of frequency f and full width w in Hz; samples, and white noise beside them."""

    f_hz: float = 100.0
    width_hz: float = 8.0
    mass_kg: float = 1e-12
    temperature_k: float = 300.0
    rate_hz: float = 800.0
    noise_m: float = 0.0

    def positions(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Of the mode in equilibrium, m, (count,)."""
        w0, damping = 2.0 * np.pi * self.f_hz, 2.0 * np.pi * self.width_hz
        turn = expm(np.array([[0.0, 1.0], [-(w0**2), -damping]]) / self.rate_hz)
        heat = Boltzmann * self.temperature_k / self.mass_kg
        rest = np.diag([heat / w0**2, heat])
        pushes = np.linalg.cholesky(rest - turn @ rest @ turn.T) @ rng.standard_normal((2, count))
        pushes[:, 0] = np.sqrt(np.diag(rest)) * rng.standard_normal(2)
        # (1 - tr z + det z^2) (x, v) = (1 + (turn - tr) z) pushes, by Cayley and Hamilton
        trace, determinant = float(np.trace(turn)), float(np.linalg.det(turn))
        mixed = pushes.copy()
        mixed[:, 1:] += (turn - trace * np.eye(2)) @ pushes[:, :-1]
        x = lfilter([1.0], [1.0, -trace, determinant], mixed[0])
        return np.asarray(x + self.noise_m * rng.standard_normal(count))

    def spectrum(
        self, averages: int, length: int, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Frequencies and one-sided densities, m^2/Hz, of segments that do not overlap."""
        x = self.positions(averages * length, rng)
        u_hz, density = welch(
            x, self.rate_hz, "hann", nperseg=length, noverlap=0, detrend=False, scaling="density"
        )
        return np.asarray(u_hz), np.asarray(density)

    def density(self, u_hz: FloatArray) -> FloatArray:
        """One-sided, m^2/Hz: 4 k_B T 2 pi w/m |1/((2 pi)^2 (f^2 - u^2 + i u w))|^2."""
        apart = (2.0 * np.pi) ** 2 * (self.f_hz**2 - u_hz**2 + 1j * u_hz * self.width_hz)
        push = 4.0 * Boltzmann * self.temperature_k * 2.0 * np.pi * self.width_hz / self.mass_kg
        return np.asarray(push / np.abs(apart) ** 2)
