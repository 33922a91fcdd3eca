"""A string over its bias voltage, and under a pump by that electrode: lambda and its direction.

    C(V) = C(V0) + S (V^2 - V0^2)/(2 V0),    S = dC/dV at V0, in Hz^2/V

A voltage V_ac at the pump's frequency adds gain S V_ac cos(2 pi u_p t): what the pump does to f1^2,
f2^2 and lambda^2 is what the map over V shows, but for one factor. The detector observes the mode
called 1, which is what makes it one. The truth comes from `fitting.lab.modes`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar

import numpy as np

from fitting.lab.modes import CoupledModes, Pump
from fitting.lab.names import VOLTAGE
from fitting.lab.pumped import PumpedString, pumped_modes
from fitting.lab.subharmonic import PumpedSweep
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.toml import Tables

#: lambda^2 from which it is real wherever lines and slopes may be, Hz^2.
REAL = 5e9


@dataclass(frozen=True, kw_only=True)
class VoltageBench(PumpedString):
    """Spectra of both lines at ``volts``, and pumped sweeps of the lower one at ``bias_v``.

    ``string`` is what the two modes are at ``bias_v``; ``slopes_hz_v`` df1/dV and df2/dV there,
    ``coupling_share`` d(lambda^2)/dV over d(f1^2)/dV. A spectrum has half of its ``points`` within
    ``reach_hz`` of either line. The drive acts on mode 2 by ``drive`` of what it does to mode 1.
    """

    kind = VOLTAGE
    ELSEWHERE = ("string", "sweeps")
    UNITS: ClassVar[Mapping[str, str]] = {"V": "V", "Vac": "V", "pump": "Hz"}
    STRENGTH: ClassVar[str] = "{Vac:g} V"
    COLUMNS: ClassVar[Mapping[str, tuple[str, float]]] = {
        "V (V)": ("V", 1.0),
        "Vac (V)": ("Vac", 1.0),
        "pump (kHz)": ("pump", 1e3),
    }

    bias_v: float = 20.0
    volts: tuple[float, ...] = (10.0, 14.0, 17.0, 20.0, 22.0, 24.0, 26.0, 28.0, 30.0)
    slopes_hz_v: tuple[float, float] = (-3000.0, 2500.0)
    coupling_share: float = 0.1
    gain: float = 0.5
    drive: float = 0.6
    reach_hz: float = 300.0
    # the last pump is where the two peaks are closest
    sweeps: tuple[PumpedSweep, ...] = (
        PumpedSweep(volts=0.5, pump_hz=87340.0, span_hz=1000.0),
        PumpedSweep(volts=5.0, pump_hz=43769.0, span_hz=1200.0),
    )
    points: int = 42

    def __post_init__(self) -> None:
        if len(self.volts) + len(self.sweeps) < 2 or self.points % 2:
            raise ValueError("wanted two sweeps or more, and an even number of points")
        if not (self.bias_v > 0.0 and self.reach_hz > 0.0 and self.gain >= 0.0):
            raise ValueError("wanted positive bias_v and reach_hz, and a gain from 0")
        super().__post_init__()

    @property
    def slopes(self) -> FloatArray:
        """dC/dV at the bias over (2 pi)^2, (2, 2), Hz^2/V."""
        f_hz = pumped_modes(self.string, 0.0, 1.0).f_hz
        p11, p22 = (2.0 * f * slope for f, slope in zip(f_hz, self.slopes_hz_v, strict=True))
        p12 = self.coupling_share * p11
        return np.array([[p11, -p12], [-p12, p22]])

    def at_voltage(self, volts: float) -> CoupledModes:
        """The string at a bias voltage, without a pump.

        Args:
            volts: V_DC, V.

        Raises:
            ValueError: a coupling that is not real there.
        """
        sample = pumped_modes(self.string, 0.0, 1.0)
        change = self.slopes * (volts**2 - self.bias_v**2) / (2.0 * self.bias_v)
        square = sample.coupling_hz[0, 1] ** 2 - float(change[0, 1])
        if square < 0.0:
            raise ValueError(f"at {volts:g} V lambda^2 is {square:g} Hz^2: wanted it from 0")
        f1, f2 = (math.sqrt(f**2 + float(change[k, k])) for k, f in enumerate(sample.f_hz))
        return replace(
            sample,
            f_hz=(f1, f2),
            coupling_hz={(0, 1): math.sqrt(square)},
            gains=(1.0, self.drive),
        )

    def pumped(self, at: Mapping[str, float]) -> CoupledModes:
        """The string at a bias voltage and under a pump.

        Args:
            at: bias and voltage of the pump, V, and its frequency, Hz.
        """
        sample = self.at_voltage(at["V"])
        if not at["Vac"] * self.gain:
            return sample
        p = self.gain * at["Vac"] * self.slopes * at["V"] / self.bias_v
        coupling = sample.coupling_hz[0, 1]
        pump = Pump(
            frequency_hz=at["pump"],
            depth_f=tuple(float(p[k, k]) / f**2 for k, f in enumerate(sample.f_hz)),
            depth_coupling={(0, 1): -float(p[0, 1]) / coupling**2},
        )
        return replace(sample, pump=pump)

    def phasors(self, at: Mapping[str, float], u_hz: FloatArray) -> ComplexArray:
        """Phasors (n,) of the mode called 1, in m under 1 m/s2.

        Args:
            at: bias, voltage and frequency of the pump, in V and Hz.
            u_hz: frequencies, (n,), Hz.
        """
        return np.asarray(self.pumped(at).response(u_hz)[:, 0])

    @property
    def volts_per_m(self) -> float:
        """Of the detector, by its unpumped line at the bias."""
        width, at = self.string.widths_hz()[0], {"V": self.bias_v, "Vac": 0.0, "pump": 0.0}
        u_hz = self.string.eta_plus_hz + np.linspace(-0.1, 0.1, 21) * width
        return self.crest_v / float(np.max(np.abs(self.phasors(at, u_hz))))

    def places(self) -> list[tuple[Mapping[str, float], FloatArray]]:
        """Bias, voltage and frequency of the pump, and the frequencies of every sweep."""
        near = np.linspace(-self.reach_hz, self.reach_hz, self.points // 2)
        result: list[tuple[Mapping[str, float], FloatArray]] = []
        for volts in self.volts:
            lines_hz = self.at_voltage(volts).eigenfrequencies_hz()
            at = {"V": volts, "Vac": 0.0, "pump": 0.0}
            result.append((at, np.concatenate([np.round(line) + near for line in lines_hz])))
        for s in self.sweeps:
            at = {"V": self.bias_v, "Vac": s.volts, "pump": s.pump_hz}
            result.append((at, self.about_plus_hz(s.span_hz)))
        return result

    def true_v(self) -> FloatArray:
        """Amplitudes (sweeps, points) without noise, V."""
        return np.asarray(np.abs([self.swept_at(at, u_hz) for at, u_hz in self.places()]))

    @property
    def read_slopes(self) -> dict[str, float]:
        """Slopes in the coordinates of the lines at the bias, as read off these: four digits."""
        turn = self.string.transform()
        (s11, s12), (_, s22) = turn @ self.slopes @ turn.T
        return {n: float(f"{s:.4g}") for n, s in (("s11", s11), ("s22", s22), ("s12", s12))}

    def constants(self) -> dict[str, str]:
        """Constants of its campaign."""
        slopes = {name: f"{slope!r} Hz**2/V" for name, slope in self.read_slopes.items()}
        return {**super().constants(), "V0": f"{self.bias_v!r} V", **slopes}

    def edit(self, tables: Tables) -> None:
        """Write its numbers, and the angles at which lambda is real at all voltages.

        Args:
            tables: of the sample campaign.
        """
        super().edit(tables)
        theta, s = np.linspace(0.5, 0.75, 2001) * np.pi, self.read_slopes
        plus, minus = self.string.eta_plus_hz, self.string.eta_minus_hz
        x = (np.square([*self.volts, self.bias_v]) - self.bias_v**2) / (2.0 * self.bias_v)
        apart = (plus - minus) * (plus + minus) + (s["s11"] - s["s22"]) * x[:, np.newaxis]
        other = s["s12"] * x[:, np.newaxis]
        squares = 0.5 * np.sin(2.0 * theta) * apart - np.cos(2.0 * theta) * other
        real = theta[np.all(squares > REAL, axis=0)]
        low, high = math.ceil(1e3 * real[0]) / 1e3, math.floor(1e3 * real[-1]) / 1e3
        start = round(0.5 * (low + high), 3)
        tables["parameters"][0].update({"lower": low, "upper": high, "start": start})

    def truth(self, seed: int) -> dict[str, Any]:
        """Everything that was put in, and lambda at every voltage.

        Args:
            seed: of the noise.
        """
        result, sample = super().truth(seed), self.at_voltage(self.bias_v)
        f1_hz, f2_hz = sample.f_hz
        result["outcome"] |= {
            "f1_hz": f1_hz,
            "f2_hz": f2_hz,
            "lambda_hz": sample.coupling_hz[0, 1],
            "lambda_at_volts_hz": [self.at_voltage(v).coupling_hz[0, 1] for v in self.volts],
        }
        return {**result, "sweep": [asdict(sweep) for sweep in self.sweeps]}
