"""Demodulated decays of the virtual laboratory: a string's tone that ends, seen at its frequency.

    q(t) = Re[z(t) exp(2 pi i f t)],   z = x before zero, sum_k c_k exp((s_k - 2 pi i f) t) after

x is the steady answer to the tone at f, s_k (Im s_k > 0) and c_k are the rates and parts of free
motion in normal coordinates, which displacement and velocity at zero give. A lock-in amplifier
records X and Y of z, an analyser with a span of zero |z| as a level. Nothing here is the FMU, and
no sample lies within a period. Noise is Gaussian and white, in each quadrature.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fitting.lab.names import LOCK_IN, TRUTH_NAME
from fitting.lab.string import TwoModes, steady_state
from fitting.lab.time_series import FEW_LEVELS, normal_modes, parameter, refuse_impossible
from fitting.lab.truth import REMARK
from fitting.lab.writer import CAMPAIGN_NAME, csv_text
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.toml import toml_text


@dataclass(frozen=True, kw_only=True)
class StringPhasors:
    """A string whose tone at ``drive_hz`` ends at zero, demodulated at that frequency.

    ``lock-in``: X and Y of the first of both strings, on which two modes beat; ``zero-span``: the
    level of its one mode, in dBm of a 50 ohm load. ``rate_hz`` samples a second from ``before_s``
    before zero to ``length_s``; seen with ``gain_v`` V per m; ``level`` (m/s^2) is the amplitude of
    the drive; ``offset_v`` leaks into X. ``noise`` is the standard deviation of each quadrature
    over the largest amplitude.

    Raises:
        BadInput: numbers that no string has.
    """

    kind: str = LOCK_IN
    theta_rad: float = 1.95
    d1_hz: float = 1.4
    d2_hz: float = 0.8
    eta_plus_hz: float = 1e6
    eta_minus_hz: float = 1e6 + 4.0
    level: float = 50.0
    drive_hz: float = 1e6 + 1.5
    length_s: float = 1.0
    before_s: float = 0.1
    rate_hz: float = 400.0
    gain_v: float = 1e5
    offset_v: float = 0.02
    noise: float = 0.01

    def __post_init__(self) -> None:
        refuse_impossible(asdict(self), lambda: self.times_s().size)

    @property
    def modes(self) -> TwoModes:
        """The string; one that a zero span sees has a mode of its own."""
        return TwoModes(
            theta_rad=self.theta_rad if self.kind == LOCK_IN else 0.0,
            d1_hz=self.d1_hz,
            d2_hz=self.d2_hz,
            eta_plus_hz=self.eta_plus_hz,
            eta_minus_hz=self.eta_minus_hz,
        )

    def times_s(self) -> FloatArray:
        """Of the samples, (n,); the drive ends at zero."""
        before = round(self.before_s * self.rate_hz)
        return np.arange(-before, round(self.length_s * self.rate_hz)) / self.rate_hz

    def values(self) -> ComplexArray:
        """Phasors at the samples, (n,), V, without noise and offset."""
        rates, shapes = normal_modes(self.modes)
        t, read = self.times_s(), self.modes.transform()[:, 0]
        [x] = steady_state(self.modes, np.array([self.drive_hz])) * self.level
        tone = 2j * math.pi * self.drive_hz
        z = np.linalg.solve(shapes, np.concatenate([x, tone * x]).real + 0j)
        forwards = rates.imag > 0.0
        parts = 2.0 * (read @ shapes[:2]) * z
        free = parts[forwards] @ np.exp(
            (rates[forwards] - tone)[:, None] * np.maximum(t, 0.0)[None, :]
        )
        return np.asarray(self.gain_v * np.where(t < 0.0, read @ x, free))

    def files(self, seed: int, head: Sequence[str]) -> dict[str, str]:
        """Texts by file name: campaign, trace and truth.

        Args:
            seed: of the noise.
            head: lines that open every file.
        """
        exact, rng = self.values(), np.random.default_rng(seed)
        sigma = self.noise * float(np.max(np.abs(exact)))
        draws = rng.standard_normal((2, exact.size))
        seen = exact + sigma * (draws[0] + 1j * draws[1])
        columns: dict[str, FloatArray] = {"time (ms)": 1e3 * self.times_s()}
        if self.kind == LOCK_IN:
            seen = seen + self.offset_v
            columns |= {"X (mV)": 1e3 * seen.real, "Y (mV)": 1e3 * seen.imag}
        else:  # peak amplitude A is A^2/(2 R) in watts
            columns["amplitude (dBm)"] = 10.0 * np.log10(np.abs(seen) ** 2 / (2.0 * 50.0) / 1e-3)
        truth = {"trace": asdict(self), "outcome": {"seed": seed, "sigma_v": sigma}}
        return {
            CAMPAIGN_NAME: toml_text(self._campaign(), head),
            "trace.csv": csv_text(columns, head),
            TRUTH_NAME: toml_text(truth, [*head, REMARK]),
        }

    def _campaign(self) -> dict[str, Any]:
        """Phasors tell frequencies and widths, levels of one mode its width alone."""
        trace: dict[str, Any] = {"file": "trace.csv", "frequency": f"{self.drive_hz!r} Hz"}
        trace |= {"input": "b", "begin": "found"}
        fixed: dict[str, Any] = {"A1": 0.0, "A2": 0.0, "theta": self.modes.theta_rad}
        widths = [parameter("d1", "Hz", (0.1 * self.d1_hz, 10.0 * self.d1_hz), 1.5 * self.d1_hz)]
        if self.kind == LOCK_IN:
            trace |= {"modes": 2, "offset": True}
            widths.append(
                parameter("d2", "Hz", (0.1 * self.d2_hz, 10.0 * self.d2_hz), 1.5 * self.d2_hz)
            )
            parameters = [*self._frequencies(), *widths]
        else:
            parameters = widths
            fixed |= {"eta_plus": self.eta_plus_hz, "eta_minus": 2.0 * self.eta_plus_hz}
        return {
            "title": f"A string's decay, {self.kind} (synthetic)",
            "synthetic": True,
            "fmu": {"model": "CoupledOscillator", "start": fixed},
            "observe": {"output": "q1"},
            "demodulated_trace": [trace],
            "parameters": parameters,
            "continuation": FEW_LEVELS,
        }

    def _frequencies(self) -> list[dict[str, float | str]]:
        """Starts a tenth of what both lines are apart beside the truth."""
        apart = self.eta_minus_hz - self.eta_plus_hz
        etas = (("eta_plus", self.eta_plus_hz, -0.08), ("eta_minus", self.eta_minus_hz, 0.1))
        return [
            parameter(
                name, "Hz", (eta - 0.45 * apart, eta + 0.45 * apart), eta + off * apart, digits=12
            )
            for name, eta, off in etas
        ]
