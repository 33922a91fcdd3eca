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
from fitting.lab.pumped import PumpedString, check_steady, pumped_modes
from fitting.text.arrays import ComplexArray, FloatArray

#: Points in a line width where peaks are looked for; half spans at first and at last, in widths.
SOUGHT, FIRST_REACH, LAST_REACH = 10.0, 6.0, 60.0
#: Detunings of the pump that are tried, in line widths of the two modes together.
TRIED = np.linspace(-1.0, 1.0, 5)


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

    depth_per_volt: float = 3e-4
    # the last pump is where the two peaks are closest, as `closest_peaks_hz` finds it, to 1 Hz
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
    def detector_v(self) -> float:
        """Of the detector for each m, by its unpumped line, V/m."""
        width = self.string.widths_hz()[0]
        u_hz = self.string.eta_plus_hz + np.linspace(-0.1, 0.1, 21) * width
        return self.crest_v / float(np.max(np.abs(self.phasors(0.0, self.eta_apart_hz, u_hz))))

    def true_v(self) -> FloatArray:
        """Amplitudes (sweeps, points) without noise, V."""
        waves = [
            self.swept_at({"volts": s.volts, "pump": s.pump_hz}, self.about_plus_hz(s.span_hz))
            for s in self.sweeps
        ]
        return np.asarray(np.abs(np.array(waves)))

    def columns(self) -> dict[str, FloatArray]:
        """Controls and frequencies of all points of all sweeps, by the names of columns."""
        return {
            "volts (V)": np.repeat([s.volts for s in self.sweeps], self.points),
            "pump (kHz)": np.repeat([s.pump_hz / 1e3 for s in self.sweeps], self.points),
            "frequency (MHz)": np.concatenate(
                [self.about_plus_hz(s.span_hz) / 1e6 for s in self.sweeps]
            ),
        }

    def swept_at(self, at: Mapping[str, float], u_hz: FloatArray) -> ComplexArray:
        """Phasors of one more sweep, V, (n,), without noise.

        Args:
            at: voltage and frequency of the pump.
            u_hz: frequencies, (n,), Hz.

        Raises:
            ValueError: the pump makes the motion grow, which has no steady state.
        """
        volts, pump_hz = at["volts"], at["pump"]
        check_steady(self.sample(volts, pump_hz), f"a pump of {volts:g} V at {pump_hz:g} Hz")
        return np.asarray(self.detector_v * self.phasors(volts, pump_hz, u_hz))

    def truth(self, seed: int) -> dict[str, Any]:
        """Everything that was put in, frequencies of the uncoupled modes, and their coupling.

        Args:
            seed: of the noise.
        """
        result, sample = super().truth(seed), self.sample(0.0, self.eta_apart_hz)
        f1_hz, f2_hz = sample.f_hz
        result["outcome"] |= {
            "f1_hz": f1_hz,
            "f2_hz": f2_hz,
            "lambda_hz": sample.coupling_hz[0, 1],
        }
        return {**result, "sweep": [asdict(sweep) for sweep in self.sweeps]}

    def sample(self, volts: float, pump_hz: float) -> CoupledModes:
        """The string under a pump, in its uncoupled coordinates.

        Args:
            volts: of the pump.
            pump_hz: its frequency, Hz.
        """
        depth = self.depth_per_volt * volts
        sample = pumped_modes(self.string, depth, pump_hz)
        if not depth:
            return sample
        (f1, f2), coupling = sample.f_hz, sample.coupling_hz[0, 1]
        second = self.second_share * depth * (f1 / f2) ** 2
        on_coupling = self.coupling_share * depth * (f1 / coupling) ** 2 if coupling else 0.0
        pump = Pump(
            frequency_hz=pump_hz, depth_f=(depth, second), depth_coupling={(0, 1): on_coupling}
        )
        return replace(sample, pump=pump)

    def phasors(self, volts: float, pump_hz: float, u_hz: FloatArray) -> ComplexArray:
        """Phasors (n,) of the observed mode, in m under 1 m/s2.

        Args:
            volts: of the pump.
            pump_hz: its frequency, Hz.
            u_hz: frequencies, (n,), Hz.
        """
        waves = self.sample(volts, pump_hz).response(u_hz)
        return np.asarray(waves @ self.string.transform()[0])

    def peaks_hz(self, volts: float, pump_hz: float, reach_hz: float) -> tuple[float, float]:
        """The two highest peaks of the line under a pump, Hz, lower one first; equal: there is one.

        Args:
            volts: of the pump.
            pump_hz: its frequency, Hz.
            reach_hz: how far from eta_plus they are looked for.
        """
        count = int(2.0 * reach_hz * SOUGHT / self.string.widths_hz()[0]) + 1
        u_hz = self.string.eta_plus_hz + np.linspace(-reach_hz, reach_hz, count)
        observed = np.abs(self.phasors(volts, pump_hz, u_hz))
        at = 1 + np.flatnonzero((observed[1:-1] > observed[:-2]) & (observed[1:-1] >= observed[2:]))
        tops = sorted(at, key=lambda k: -observed[k])[:2]
        result = sorted(_top(u_hz[k - 1 : k + 2], observed[k - 1 : k + 2]) for k in tops)
        return (result[0], result[-1]) if result else (float("nan"), float("nan"))


def _top(u_hz: FloatArray, observed: FloatArray) -> float:
    """Where the parabola through three points is highest."""
    left, middle, right = observed
    bend = left - 2.0 * middle + right
    return float(u_hz[1] + 0.5 * (u_hz[1] - u_hz[0]) * (left - right) / bend)


def closest_peaks_hz(bench: SubharmonicBench, volts: float, order: int) -> tuple[float, float]:
    """Frequency of a pump near a subharmonic at which the two peaks are closest, and how close, Hz.

    What a laboratory does: the pump is moved until the opening is smallest. The squares of the
    distances are a parabola of the detuning, as of any avoided crossing.

    Args:
        bench: whose string is pumped.
        volts: of the pump.
        order: of the subharmonic: 1 at the distance of the modes, 2 at half of it.

    Raises:
        ValueError: the line does not open there.
    """
    width = sum(bench.string.widths_hz()) / 2.0
    middle, reach = bench.eta_apart_hz / order, FIRST_REACH * width
    # the dynamic Stark shift goes with the square of the voltage and may be many widths
    for _ in range(16):
        pumps = middle + TRIED * width / order
        apart = np.array([np.ptp(bench.peaks_hz(volts, pump, reach)) for pump in pumps])
        if not np.all(apart > 0.0):
            if reach > LAST_REACH * width:
                raise ValueError(
                    f"a pump of {volts:g} V near {middle:.6g} Hz does not open the line by more "
                    "than its width; wanted a higher voltage"
                )
            reach *= 2.0
            continue
        bend, slope, _rest = np.polyfit(pumps - middle, apart**2, 2)
        step = float(np.clip(-0.5 * slope / bend, -5.0 * width, 5.0 * width))
        middle += step
        reach = 3.0 * width + 0.75 * float(apart.max())
        if abs(step) < 1e-3 * width:
            break
    return middle, float(np.ptp(bench.peaks_hz(volts, middle, reach)))
