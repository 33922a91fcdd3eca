"""Sweeps under a pump at the distance of two modes and at half of it: lambda without the depth.

With P = [[p11, p12], [p12, p22]] in Hz^2 what the pump adds to the squares, and P~ = T P T^T, the
observed line opens at the n-th subharmonic of the distance, u_p = (eta_minus - eta_plus)/n, by

    |P~12|/(2 sqrt(eta_plus eta_minus)) 2 n |J_n(beta)/beta|,
    beta = (P~22/(2 eta_minus) - P~11/(2 eta_plus))/u_p

The first opening goes with |sin 2 theta|, beta with |cos 2 theta|, both with the depth: their ratio
gives theta without it. The truth comes from `fitting.lab.modes`, which shares no code with the FMU.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar

import numpy as np

from fitting.lab.modes import CoupledModes, Pump
from fitting.lab.names import SUBHARMONIC
from fitting.lab.pumped import PumpedString, pumped_modes
from fitting.text.arrays import FloatArray


@dataclass(frozen=True, kw_only=True)
class PumpedSweep:
    """One sweep: voltage and frequency of the pump, and how far the sweep goes about eta_plus.

    A pump that is off has no voltage, and any frequency.
    """

    volts: float
    pump_hz: float
    span_hz: float


@dataclass(frozen=True, kw_only=True)
class SubharmonicBench(PumpedString):
    """Sweeps under a pump of any voltage and frequency; nothing drifts.

    A pump of ``volts`` modulates f1^2 by ``depth_per_volt`` times that: p11 = depth f1^2, which a
    fit is not stated. ``coupling_share`` is p12/p11 and ``second_share`` p22/p11, both 0 where the
    pump acts on the mode called 1 alone.
    """

    kind = SUBHARMONIC
    ELSEWHERE = ("string", "sweeps")
    UNITS: ClassVar[Mapping[str, str]] = {"volts": "V", "pump": "Hz"}
    STRENGTH: ClassVar[str] = "{volts:g} V"
    COLUMNS: ClassVar[Mapping[str, tuple[str, float]]] = {
        "volts (V)": ("volts", 1.0),
        "pump (kHz)": ("pump", 1e3),
    }

    depth_per_volt: float = 3e-4
    # the last pump is where the two peaks are closest, to 1 Hz
    sweeps: tuple[PumpedSweep, ...] = (
        PumpedSweep(volts=0.0, pump_hz=0.0, span_hz=1000.0),
        PumpedSweep(volts=1.0, pump_hz=87340.0, span_hz=1000.0),
        PumpedSweep(volts=10.0, pump_hz=43769.0, span_hz=1200.0),
    )
    points: int = 41
    coupling_share: float = 0.0
    second_share: float = 0.0

    def __post_init__(self) -> None:
        if len(self.sweeps) < 2:
            raise ValueError(f"{len(self.sweeps)} sweeps, wanted two or more")
        if not self.depth_per_volt >= 0.0:
            raise ValueError("wanted a depth_per_volt that is not negative")
        for s in self.sweeps:
            if not (s.span_hz > 0.0 and s.volts >= 0.0 and (s.pump_hz > 0.0 or s.volts == 0.0)):
                raise ValueError("wanted positive spans and pump frequencies, volts from 0")
        super().__post_init__()

    @property
    def eta_apart_hz(self) -> float:
        """eta_minus - eta_plus, Hz."""
        return self.string.eta_minus_hz - self.string.eta_plus_hz

    @property
    def volts_per_m(self) -> float:
        """Of the detector, by its unpumped line."""
        width, at = self.string.widths_hz()[0], {"volts": 0.0, "pump": self.eta_apart_hz}
        u_hz = self.string.eta_plus_hz + np.linspace(-0.1, 0.1, 21) * width
        return self.crest_v / float(np.max(np.abs(self.phasors(at, u_hz))))

    def places(self) -> list[tuple[Mapping[str, float], FloatArray]]:
        """Voltages and frequencies of the pump, and the frequencies of every sweep."""
        return [
            ({"volts": s.volts, "pump": s.pump_hz}, self.about_plus_hz(s.span_hz))
            for s in self.sweeps
        ]

    def true_v(self) -> FloatArray:
        """Amplitudes (sweeps, points) without noise, V."""
        return np.asarray(np.abs([self.swept_at(at, u_hz) for at, u_hz in self.places()]))

    def truth(self, seed: int) -> dict[str, Any]:
        """Everything that was put in, frequencies of the uncoupled modes, and their coupling.

        Args:
            seed: of the noise.
        """
        at = {"volts": 0.0, "pump": self.eta_apart_hz}
        result, sample = super().truth(seed), self.pumped(at)
        f1_hz, f2_hz = sample.f_hz
        result["outcome"] |= {
            "f1_hz": f1_hz,
            "f2_hz": f2_hz,
            "lambda_hz": sample.coupling_hz[0, 1],
        }
        return {**result, "sweep": [asdict(sweep) for sweep in self.sweeps]}

    def pumped(self, at: Mapping[str, float]) -> CoupledModes:
        """The string under a pump, which may act on the coupling and the second mode, too.

        Args:
            at: voltage and frequency of the pump.
        """
        depth = self.depth_per_volt * at["volts"]
        sample = pumped_modes(self.string, depth, at["pump"])
        if not depth:
            return sample
        (f1, f2), coupling = sample.f_hz, sample.coupling_hz[0, 1]
        second = self.second_share * depth * (f1 / f2) ** 2
        on_coupling = self.coupling_share * depth * (f1 / coupling) ** 2 if coupling else 0.0
        pump = Pump(
            frequency_hz=at["pump"], depth_f=(depth, second), depth_coupling={(0, 1): on_coupling}
        )
        return replace(sample, pump=pump)
