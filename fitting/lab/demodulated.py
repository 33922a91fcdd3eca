"""Demodulated decays of the virtual laboratory: a string's tone that ends, seen at its frequency.

    q(t) = Re[z(t) exp(2 pi i f t)],   z = x before zero, sum_k c_k exp((s_k - 2 pi i f) t) after

x is the steady answer to the tone at f, s_k (Im s_k > 0) and c_k are the rates and parts of free
motion in normal coordinates, which displacement and velocity at zero give. A lock-in amplifier
records X and Y of z, an analyser with a span of zero |z| as a level. Nothing here is the FMU, and
no sample lies within a period. Noise is Gaussian and white, in each quadrature.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from fitting.lab.names import LOCK_IN
from fitting.lab.string import TwoModes
from fitting.lab.time_series import StringRecord
from fitting.text.arrays import ComplexArray, FloatArray


@dataclass(frozen=True, kw_only=True)
class StringPhasors(StringRecord):
    """A string whose tone at ``drive_hz`` ends at zero, demodulated at that frequency.

    ``lock-in``: X and Y of the first of both strings, on which two modes beat; ``zero-span``: the
    level of its one mode, in dBm of a 50 ohm load. ``offset_v`` leaks into X. ``noise`` is the
    standard deviation of each quadrature over the largest amplitude.
    """

    DIGITS: ClassVar[int] = 12

    @property
    def modes(self) -> TwoModes:
        """The string; one that a zero span sees has a mode of its own."""
        return self if self.kind == LOCK_IN else replace(self, theta_rad=0.0, kind=LOCK_IN)

    def values(self) -> ComplexArray:
        """Phasors at the samples, (n,), V, without noise and offset."""
        rates, shapes, z = self.free_motion()
        t, read = self.times_s(), self.modes.transform()[:, 0]
        tone = 2j * math.pi * self.drive_hz
        forwards = rates.imag > 0.0
        parts = 2.0 * (read @ shapes[:2]) * z
        free = parts[forwards] @ np.exp(
            (rates[forwards] - tone)[:, None] * np.maximum(t, 0.0)[None, :]
        )
        return np.asarray(self.gain_v * np.where(t < 0.0, read @ self.steady(), free))

    def recorded(self, rng: np.random.Generator) -> tuple[dict[str, FloatArray], float]:
        """Times with X and Y, or with levels; the noise of a quadrature."""
        exact = self.values()
        sigma = self.noise * float(np.max(np.abs(exact)))
        draws = rng.standard_normal((2, exact.size))
        observed = exact + sigma * (draws[0] + 1j * draws[1])
        times = {"time (ms)": 1e3 * self.times_s()}
        if self.kind == LOCK_IN:
            observed = observed + self.offset_v
            return times | {"X (mV)": 1e3 * observed.real, "Y (mV)": 1e3 * observed.imag}, sigma
        # peak amplitude A is A^2/(2 R) in watts
        levels = 10.0 * np.log10(np.abs(observed) ** 2 / (2.0 * 50.0) / 1e-3)
        return times | {"amplitude (dBm)": levels}, sigma

    @property
    def title(self) -> str:
        """Of the campaign."""
        return f"A string's decay, {self.kind}"

    def table(self) -> tuple[str, dict[str, Any]]:
        """The frequency of the demodulator; of phasors two modes and an offset."""
        both = {"modes": 2, "offset": True} if self.kind == LOCK_IN else {}
        result = {"frequency": f"{self.drive_hz!r} Hz", "begin": "found"}
        return "demodulated_trace", result | both

    def fixed(self) -> dict[str, Any]:
        """The angle; levels do not show frequencies either."""
        result = super().fixed() | {"theta": self.modes.theta_rad}
        if self.kind == LOCK_IN:
            return result
        return result | {"eta_plus": self.eta_plus_hz, "eta_minus": 2.0 * self.eta_plus_hz}

    def parameters(self) -> list[dict[str, Any]]:
        """Phasors determine frequencies and widths, levels of one mode its width alone."""
        result = super().parameters()
        return result if self.kind == LOCK_IN else [p for p in result if p["name"] == "d1"]


#: A decay that is demodulated, as the laboratory has it.
DECAY = StringPhasors(
    kind=LOCK_IN,
    theta_rad=1.95,
    d1_hz=1.4,
    d2_hz=0.8,
    eta_plus_hz=1e6,
    eta_minus_hz=1e6 + 4.0,
    drive_hz=1e6 + 1.5,
    length_s=1.0,
    before_s=0.1,
    rate_hz=400.0,
    gain_v=1e5,
)
