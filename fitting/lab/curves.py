"""Curves of the virtual laboratory: a resonance behind a wiring, and spectra over a voltage.

    transmission   S = a e H            notch, reflection   S = a e (1 + s x + c H)
    e = exp(-i 2 pi (u - u0) tau)       x = (u - u0)/half the span

H is the closed form of one mode of the string (`fitting.lab.string`), the spectra are |q1| of two
coupled modes (`fitting.lab.modes`) whose first frequency a voltage tunes through the second. Noise
is Gaussian. Nothing here is the FMU, nor the fit's own wiring.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from fitting.lab.curve import FEW_LEVELS, Curve, parameter
from fitting.lab.modes import CoupledModes
from fitting.lab.names import CROSSING
from fitting.lab.string import TwoModes, steady_state
from fitting.text.arrays import ComplexArray, FloatArray

TWO_TONES = {"kind": "tones", "frequencies": ["u1", "u2"], "amplitudes": ["A1", "A2"]}


@dataclass(frozen=True, kw_only=True)
class WiredResonance(Curve):
    """One mode as a network analyser sees it.

    ``coupling`` is |Qc|/Q of a notch, or of a reflection, ``phase_rad`` that of the dip; ``gain``
    and ``gain_phase_rad`` of the line, ``delay_s`` of the cable, ``slope`` s of the baseline;
    ``span_widths`` the span in line widths. ``noise`` is the standard deviation of each quadrature
    over the largest modulus.

    Raises:
        ValueError: numbers that no resonance has.
    """

    kind: str = "notch"
    eta_hz: float = 5e9
    width_hz: float = 420e3
    coupling: float = 1.6
    phase_rad: float = 0.35
    gain: float = 0.3
    gain_phase_rad: float = 1.1
    delay_s: float = 41e-9
    slope: float = 0.05
    span_widths: float = 12.0
    points: int = 201
    noise: float = 0.005

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.width_hz * self.span_widths >= 2.0 * self.eta_hz:
            raise ValueError("the span reaches below zero frequency")

    @property
    def coupling_q(self) -> float:
        """Q_coupling, diameter corrected: 1/Qc = Re(exp(i phase))/|Qc|."""
        return self.coupling * self.eta_hz / self.width_hz / math.cos(self.phase_rad)

    def frequencies_hz(self) -> FloatArray:
        """Of the points, (n,)."""
        half = 0.5 * self.span_widths * self.width_hz
        return np.asarray(self.eta_hz + np.linspace(-half, half, self.points))

    def values(self) -> ComplexArray:
        """S at the points, without noise, (n,)."""
        u = self.frequencies_hz()
        modes = TwoModes(
            theta_rad=0.0,
            d1_hz=self.width_hz,
            d2_hz=self.width_hz,
            eta_plus_hz=self.eta_hz,
            eta_minus_hz=2.0 * self.eta_hz,
        )
        h = steady_state(modes, np.append(u, self.eta_hz), (1.0, 0.0))[:, 0]
        h, top = h[:-1], h[-1]
        x = (u - self.eta_hz) / (0.5 * float(np.ptp(u)))
        gain = self.gain * np.exp(1j * self.gain_phase_rad)
        rotated = np.exp(-2j * np.pi * (u - self.eta_hz) * self.delay_s)
        if self.kind == "transmission":
            return np.asarray(gain * rotated * h / abs(top))
        depth = (2.0 if self.kind == "reflection" else 1.0) / self.coupling
        dip = depth * np.exp(1j * self.phase_rad) * h / top
        return np.asarray(gain * rotated * (1.0 + self.slope * x - dip))

    def recorded(
        self, rng: np.random.Generator
    ) -> tuple[dict[str, dict[str, Any]], dict[str, float]]:
        """X and Y of the sweep; qualities."""
        u, exact = self.frequencies_hz(), self.values()
        draws = rng.standard_normal((2, u.size))
        sigma = self.noise * float(np.max(np.abs(exact)))
        observed = exact + sigma * (draws[0] + 1j * draws[1])
        columns = {"frequency (Hz)": u, "X (V)": observed.real, "Y (V)": observed.imag}
        outcome = {} if self.kind == "transmission" else {"Q_coupling": self.coupling_q}
        return {"sweep.csv": columns}, outcome | {"Q_plus": self.eta_hz / self.width_hz}

    def campaign(self) -> dict[str, Any]:
        """Starts are a third of a width off, and twice the width."""
        eta, width = self.eta_hz, self.width_hz
        sweep: dict[str, Any] = {"file": "sweep.csv", "wiring": self.kind, "delay": "fit"}
        if self.kind != "transmission" and self.slope:
            sweep["background"] = "slope"
        start = {
            "periodic_start": True,
            "theta": 0.0,
            "g2": 0.0,
            "d2": width,
            "eta_minus": 2.0 * eta,
            "u2": 1.5 * eta,
        }
        return {
            "title": f"One mode in {self.kind} (synthetic)",
            "synthetic": True,
            "fmu": {"model": "CoupledOscillator", "start": start},
            "observe": {"output": "q1_hybrid", "steady_start": True},
            "drive": TWO_TONES,
            "complex_sweep": [sweep],
            "parameters": [
                parameter("eta_plus", "Hz", (eta - 3 * width, eta + 3 * width), eta + width / 3.0),
                parameter("d1", "Hz", (0.1 * width, 10.0 * width), 2.0 * width),
            ],
            "derived": {"outputs": ["Q_plus"]},
            "continuation": FEW_LEVELS | {"iterations": 3},
        }


@dataclass(frozen=True, kw_only=True)
class AvoidedCrossing(Curve):
    """Spectra |q1| over a voltage: f1 = ``f1_hz`` + ``tuning_hz_v`` V, f2, lambda, widths d, Hz.

    ``volts`` V from -``reach_v`` to ``reach_v``, ``points`` frequencies each over ``span_hz``;
    of three ``modes`` f3 is coupled to f2 by ``lambda23_hz``, and V and the frequencies reach as
    far beyond f3 as beyond f2; ``gain`` in V per m; ``drift_hz`` is what all frequencies move by
    from the first to the last spectrum, ``noise`` the standard deviation of each quadrature over
    its spectrum's largest. Their magnitude is measured; with ``phases`` both are, behind a cable of
    ``delay_s``, the phase of the gain anew in every spectrum. With ``reference`` there is one sweep
    of amplitudes at the first voltage besides, which the scale of tones rests on.

    Raises:
        ValueError: numbers that no laboratory has.
    """

    #: Controls of its sweeps, with their units, and what the FMU calls what is swept.
    UNITS: ClassVar[Mapping[str, str]] = {"V": "V"}
    OUTPUT: ClassVar[str] = "q1"

    kind: str = CROSSING
    f1_hz: float = 1001.0
    tuning_hz_v: float = 4.0
    f2_hz: float = 1000.0
    lambda_hz: float = 100.0
    d1_hz: float = 3.0
    d2_hz: float = 3.0
    reach_v: float = 3.0
    volts: int = 7
    span_hz: float = 40.0
    points: int = 61
    gain: float = 1e6
    drift_hz: float = 0.0
    noise: float = 0.01
    phases: bool = False
    delay_s: float = 0.03
    modes: int = 2
    f3_hz: float = 1010.0
    lambda23_hz: float = 110.0
    d3_hz: float = 3.0
    reference: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.modes not in (2, 3):
            raise ValueError(f"modes: found {self.modes}, wanted 2 or 3")

    def frequencies_hz(self) -> FloatArray:
        """Of the points of every spectrum, (n,)."""
        half, further = 0.5 * self.span_hz, self._apart_hz
        low, high = min(0.0, further) - half, max(0.0, further) + half
        return np.asarray(self.f2_hz + np.linspace(low, high, self.points))

    def voltages(self) -> FloatArray:
        """Of the spectra, (m,)."""
        further = self._apart_hz / self.tuning_hz_v if self.tuning_hz_v else 0.0
        low, high = min(0.0, further) - self.reach_v, max(0.0, further) + self.reach_v
        return np.linspace(low, high, self.volts)

    def values(self) -> ComplexArray:
        """q1 in V of every spectrum, without noise and cable, (m, n)."""
        u, last = self.frequencies_hz(), self.volts - 1
        return np.array(
            [
                self.spectrum(float(volt), self.drift_hz * (k / last - 0.5), u)
                for k, volt in enumerate(self.voltages())
            ]
        )

    def swept_at(self, at: Mapping[str, float], u_hz: FloatArray) -> ComplexArray:
        """One more spectrum, (n,), after the modes have drifted through its own; V, without noise.

        Args:
            at: values of the controls, in their units.
            u_hz: frequencies, (n,), Hz.
        """
        return self.spectrum(at["V"], 0.5 * self.drift_hz, u_hz)

    def turned(
        self, values: ComplexArray, u_hz: FloatArray, rng: np.random.Generator
    ) -> ComplexArray:
        """A spectrum behind the cable, with a phase of its own.

        Args:
            values: of the spectrum in V, (n,).
            u_hz: frequencies, (n,), Hz.
            rng: of the phase.
        """
        turns = rng.uniform() - (u_hz - self.f2_hz) * self.delay_s
        return np.asarray(values * np.exp(2j * np.pi * turns))

    def spectrum(self, volt: float, moved_hz: float, u_hz: FloatArray) -> ComplexArray:
        """q1 in V at one voltage, without noise and cable, (n,).

        Args:
            volt: the voltage, V.
            moved_hz: what all frequencies have drifted by, Hz.
            u_hz: frequencies of the points, (n,), Hz.
        """
        tuned = self.f1_hz + self.tuning_hz_v * volt
        f, d = [tuned, self.f2_hz, self.f3_hz], (self.d1_hz, self.d2_hz, self.d3_hz)
        coupling = {(0, 1): self.lambda_hz, (1, 2): self.lambda23_hz}
        sample = CoupledModes(
            f_hz=tuple(hz + moved_hz for hz in f[: self.modes]),
            d_hz=d[: self.modes],
            coupling_hz={pair: hz for pair, hz in coupling.items() if pair[1] < self.modes},
            gains=(1.0, 0.0, 0.0)[: self.modes],
        )
        return np.asarray(self.gain * sample.response(u_hz)[:, 0])

    @property
    def _apart_hz(self) -> float:
        """From the second mode to the last, 0 where that is the same."""
        return self.f3_hz - self.f2_hz if self.modes == 3 else 0.0

    def recorded(
        self, rng: np.random.Generator
    ) -> tuple[dict[str, dict[str, Any]], dict[str, float]]:
        """The spectra, and the sweep of reference."""
        u_hz, exact = self.frequencies_hz(), self.values()
        one, other = rng.standard_normal((2, *exact.shape))
        noise = self.noise * np.max(np.abs(exact), axis=1, keepdims=True) * (one + 1j * other)
        volts, u = np.meshgrid(self.voltages(), u_hz, indexing="ij")
        columns = {"V (V)": volts.ravel(), "frequency (Hz)": u.ravel()}
        if self.phases:
            turns = rng.uniform(size=(self.volts, 1)) - (u - self.f2_hz) * self.delay_s
            observed = exact * np.exp(2j * np.pi * turns) + noise
            columns |= {"X (V)": observed.real.ravel(), "Y (V)": observed.imag.ravel()}
        else:
            columns["amplitude (V)"] = np.abs(np.abs(exact) + noise).ravel()
        data = {"map.csv": columns}
        if self.reference:
            # at the first voltage, at the points of a spectrum, with the noise of one
            exact = self.spectrum(float(self.voltages()[0]), -0.5 * self.drift_hz, u_hz)
            one, other = rng.standard_normal((2, u_hz.size))
            noise = self.noise * float(np.max(np.abs(exact))) * (one + 1j * other)
            data["sweep.csv"] = {"frequency (Hz)": u_hz, "amplitude (V)": np.abs(exact + noise)}
        return data, {}

    def campaign(self) -> dict[str, Any]:
        """Boxes as wide as the spectra, starts next to the truth."""
        half, u = 0.5 * self.span_hz, self.frequencies_hz()
        bounds, tuning = (float(u[0]), float(u[-1])), abs(self.tuning_hz_v) or 1.0
        modes, width = [str(k) for k in range(1, self.modes + 1)], self.d1_hz
        undriven = {f"g{k}": 0.0 for k in modes[1:]}
        swept = {"file": "map.csv", "controls": ["V"]}
        tables: dict[str, Any] = (
            {"complex_control_sweep": swept | {"delay": "fit"}}
            if self.phases
            else {"control_sweep": swept | {"amplitude": "V peak"}}
        )
        if self.reference:
            tables["sweep"] = {"file": "sweep.csv", "amplitude": "V peak", "scale": "fit"}
            tables["sweep"]["set"] = {"V": f"{float(self.voltages()[0])!r} V"}
        parameters = [
            parameter("a0", "Hz", bounds, self.f1_hz + 0.05 * half),
            parameter("a1", "Hz/V", (-5.0 * tuning, 5.0 * tuning), 0.8 * self.tuning_hz_v),
            parameter("f2", "Hz", bounds, self.f2_hz - 0.05 * half),
        ]
        couplings = [("lambda12", self.lambda_hz)]
        if self.modes == 3:
            parameters.append(parameter("f3", "Hz", bounds, self.f3_hz + 0.05 * half))
            couplings.append(("lambda23", self.lambda23_hz))
        for name, coupling in couplings:
            start = 1.3 * coupling
            parameters.append(parameter(name, "Hz", (0.1 * start, 3.0 * start), start))
        for k in modes:
            parameters.append(parameter(f"d{k}", "Hz", (0.1 * width, 10.0 * width), 1.5 * width))
        return {
            "title": "An avoided crossing (synthetic)",
            "synthetic": True,
            "fmu": {
                "model": f"CoupledModes{self.modes}",
                "start": {"periodic_start": True, "A2": 0.0, **undriven, "u2": 2.0 * self.f2_hz},
            },
            "observe": {"output": "q1", "steady_start": True},
            "drive": TWO_TONES,
            **tables,
            "laws": {"f1": "a0 + a1*V"},
            "parameters": parameters,
            "continuation": FEW_LEVELS | {"iterations": 3},
        }
