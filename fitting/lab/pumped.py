"""Pumped sweeps of the virtual laboratory: the string's lower line, split by a parametric pump.

Sweeps of one tone over the line, one for each depth and detuning of the pump, unpumped ones before
and after. The truth comes from `fitting.lab.modes`, which shares no code with the FMU; noise of
both quadratures comes from a seed, and both eigenfrequencies drift while the sweeps are taken.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from fitting.lab.modes import CoupledModes, Pump
from fitting.lab.names import PUMPED
from fitting.lab.string import STRING, TwoModes
from fitting.lab.writer import record_table, sample_campaign, synthetic_files, written_mhz
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.toml import Tables

#: Depth of the pump and its detuning from `PumpedBench.apart_hz`, Hz, one pair for each sweep.
SETTINGS = (
    (0.0, 0.0),
    (1e-4, 0.0),
    (3e-4, -250.0),
    (3e-4, -80.0),
    (3e-4, 0.0),
    (3e-4, 80.0),
    (3e-4, 250.0),
    (0.0, 0.0),
)


@dataclass(frozen=True, kw_only=True)
class PumpedString(ABC):
    """A string under a pump whose lower line is swept, as all benches with a pump have it.

    The pump modulates f1^2 of ``string``. Every sweep has ``points`` frequencies about eta_plus,
    which are read with Gaussian noise of ``noise_v`` in each quadrature, ``noise_scale`` times;
    ``crest_v`` is the height of the unpumped line.

    Raises:
        ValueError: numbers that are no bench.
    """

    #: Name of the bench, of its sample campaign, and of its table in truth.toml.
    kind: ClassVar[str]
    #: Fields with a table of their own.
    ELSEWHERE: ClassVar[tuple[str, ...]] = ("string",)
    #: Controls of its sweeps, with their units.
    UNITS: ClassVar[Mapping[str, str]]
    #: How strong a pump is, in words, of these.
    STRENGTH: ClassVar[str]
    #: Heads of their columns: a control, and the unit of the column in that of the control.
    COLUMNS: ClassVar[Mapping[str, tuple[str, float]]]
    #: What the FMU calls what is swept.
    OUTPUT: ClassVar[str] = "readout_at_u1"

    string: TwoModes = STRING
    points: int
    crest_v: float = 40e-6
    noise_v: float = 0.2e-6
    noise_scale: float = 1.0

    def __post_init__(self) -> None:
        if self.points < 8 or not (self.crest_v > 0.0 and self.noise_v > 0.0):
            raise ValueError("wanted 8 points or more, a positive crest and noise")
        if self.noise_scale < 0.0:
            raise ValueError("wanted a noise_scale that is not negative")
        theta = self.string.theta_rad
        if self.string.reflection or math.sin(theta) * math.cos(theta) > 0.0:
            raise ValueError(
                f"theta = {theta} rad has no lambda: wanted a rotation with sin 2 theta not above 0"
            )

    @abstractmethod
    def true_v(self) -> FloatArray:
        """Amplitudes (sweeps, points) without noise, V.

        Raises:
            ValueError: a pump makes the motion grow, which has no steady state.
        """

    @abstractmethod
    def places(self) -> list[tuple[Mapping[str, float], FloatArray]]:
        """Values of the controls, in their units, and frequencies (points,), Hz, of every sweep."""

    @abstractmethod
    def pumped(self, at: Mapping[str, float]) -> CoupledModes:
        """The string under a pump, in its uncoupled coordinates.

        Args:
            at: values of the controls, in their units.
        """

    @property
    @abstractmethod
    def volts_per_m(self) -> float:
        """Of the detector, by its unpumped line."""

    def columns(self) -> dict[str, FloatArray]:
        """Controls and frequencies of all points of all sweeps, by the names of columns."""
        places = self.places()
        columns = {
            head: np.repeat([at[name] / unit for at, _ in places], self.points)
            for head, (name, unit) in self.COLUMNS.items()
        }
        columns["frequency (MHz)"] = np.concatenate([u_hz / 1e6 for _, u_hz in places])
        return columns

    def swept_at(self, at: Mapping[str, float], u_hz: FloatArray) -> ComplexArray:
        """Phasors of one more sweep, V, (n,), without noise.

        Args:
            at: values of the controls, in their units.
            u_hz: frequencies, (n,), Hz.

        Raises:
            ValueError: the pump makes the motion grow, which has no steady state.
        """
        self.check_steady(at)
        return np.asarray(self.volts_per_m * self.phasors(at, u_hz))

    def check_steady(self, at: Mapping[str, float], where: str = "") -> None:
        """Complain of a pump under which the motion grows.

        Args:
            at: values of the controls, in their units.
            where: key of the pump, for complaints.

        Raises:
            ValueError: the motion grows in each period.
        """
        sample = self.pumped(at)
        if sample.pump is None or (growth := sample.growth()) < 1.0:
            return
        raise ValueError(
            f"{where}a pump of {self.STRENGTH.format(**at)} at {sample.pump.frequency_hz:g} Hz "
            f"makes the motion grow, by {growth:.6g} in each of its periods: there is no steady "
            "state; wanted less depth, or a pump farther from twice an eigenfrequency or a sum of "
            "two"
        )

    def phasors(self, at: Mapping[str, float], u_hz: FloatArray) -> ComplexArray:
        """Phasors (n,) of the observed mode, in m under 1 m/s2.

        Args:
            at: values of the controls, in their units.
            u_hz: frequencies, (n,), Hz.
        """
        return np.asarray(self.pumped(at).response(u_hz) @ self.string.transform()[0])

    def turned(
        self, values: ComplexArray, u_hz: FloatArray, rng: np.random.Generator
    ) -> ComplexArray:
        """The bench records no phases.

        Args:
            values: S in V, (n,).
            u_hz: frequencies, (n,), Hz.
            rng: of a phase.

        Raises:
            BadInput: always.
        """
        raise BadInput(
            f"plan: asks for both quadratures, but the bench {self.kind!r} records amplitudes; "
            "wanted [control_sweep]"
        )

    def constants(self) -> dict[str, str]:
        """Constants of its campaign."""
        return {
            "plus": written_mhz(self.string.eta_plus_hz),
            "minus": written_mhz(self.string.eta_minus_hz),
        }

    def edit(self, tables: Tables) -> None:
        """Write its numbers into a campaign.

        Args:
            tables: of the sample campaign.
        """
        tables["control_sweep"]["sigma"] = f"{self.noise_v!r} V"
        for name, value in self.constants().items():
            tables["constants"][name] = value

    def truth(self, seed: int) -> dict[str, Any]:
        """Everything that was put in; all tables but [outcome] make the bench again.

        Args:
            seed: of the noise.
        """
        widths = self.string.widths_hz()
        return {
            self.kind: record_table(self, self.ELSEWHERE),
            "modes": record_table(self.string),
            "outcome": {"seed": seed, "width_plus_hz": widths[0], "width_minus_hz": widths[1]},
        }

    def made(
        self, seed: int, head: Sequence[str]
    ) -> tuple[PumpedSweeps, dict[str, Any], dict[str, str]]:
        """What was measured, its truth, and the files of the campaign by relative name.

        Args:
            seed: of the noise.
            head: lines that open every file.

        Raises:
            ValueError: a pump makes the motion grow, which has no steady state.
        """
        measured, truth = measure_pumped(self, seed), self.truth(seed)
        columns = self.columns() | {"amplitude (uV)": measured.amplitude_v.ravel() * 1e6}
        campaign = sample_campaign(self.kind, self.edit, head)
        return measured, truth, synthetic_files(campaign, {"sweeps.csv": columns}, truth, head)

    def about_plus_hz(self, span_hz: float) -> FloatArray:
        """Frequencies of a sweep, (points,).

        Args:
            span_hz: of the sweep.
        """
        reach = 0.5 * span_hz
        return np.asarray(self.string.eta_plus_hz + np.linspace(-reach, reach, self.points))


@dataclass(frozen=True, kw_only=True)
class PumpedBench(PumpedString):
    """Sweeps at depths and detunings of a pump, drifting.

    The pump modulates f1^2 of ``string`` as it is in the middle of the series: f1^2 (1 + depth
    cos(2 pi u_p t)), u_p = ``apart_hz`` + detuning. ``settings`` are (depth, detuning in Hz) of the
    sweeps over ``span_hz``, taken one every ``pause_h`` hours; ``drift_hz`` is what both
    eigenfrequencies change by over all of them.
    """

    kind = PUMPED
    UNITS: ClassVar[Mapping[str, str]] = {"detuning": "Hz", "depth": "1", "time": "h"}
    STRENGTH: ClassVar[str] = "depth {depth:g}"
    COLUMNS: ClassVar[Mapping[str, tuple[str, float]]] = {
        "detuning (Hz)": ("detuning", 1.0),
        "depth (1)": ("depth", 1.0),
        "time (h)": ("time", 1.0),
    }

    settings: tuple[tuple[float, float], ...] = SETTINGS
    apart_hz: float = 87340.0
    span_hz: float = 800.0
    points: int = 61
    drift_hz: float = 20.0
    pause_h: float = 0.1

    def __post_init__(self) -> None:
        if len(self.settings) < 2:
            raise ValueError(f"{len(self.settings)} sweeps, wanted two or more")
        if not (self.span_hz > 0.0 and self.pause_h > 0.0):
            raise ValueError("wanted a positive span and a positive pause_h")
        super().__post_init__()

    def places(self) -> list[tuple[Mapping[str, float], FloatArray]]:
        """Settings, when each is taken, and the frequencies, the same in every sweep."""
        u_hz, middle = self.about_plus_hz(self.span_hz), 0.5 * (len(self.settings) - 1)
        return [
            ({"detuning": detuning, "depth": depth, "time": self.pause_h * (k - middle)}, u_hz)
            for k, (depth, detuning) in enumerate(self.settings)
        ]

    def true_v(self) -> FloatArray:
        """Amplitudes (sweeps, points) without noise, V."""
        places = self.places()
        for k, (at, _) in enumerate(places):
            self.check_steady(at, f"settings[{k}]: ")
        waves = np.array([np.abs(self.phasors(at, u_hz)) for at, u_hz in places])
        return np.asarray(waves * self.volts_per_m)

    def constants(self) -> dict[str, str]:
        """Constants of its campaign."""
        return super().constants() | {"apart": f"{self.apart_hz!r} Hz"}

    def truth(self, seed: int) -> dict[str, Any]:
        """Everything that was put in, and the coupling.

        Args:
            seed: of the noise.
        """
        result = super().truth(seed)
        coupling = pumped_modes(self.string, 0.0, self.apart_hz).coupling_hz
        result["outcome"]["lambda_hz"] = coupling[0, 1]
        return result

    @property
    def volts_per_m(self) -> float:
        """Of the detector, by its unpumped line at the beginning of the drift."""
        first, u_hz = self.places()[0]
        unpumped = self.phasors({**first, "detuning": 0.0, "depth": 0.0}, u_hz)
        return self.crest_v / float(np.max(np.abs(unpumped)))

    def pumped(self, at: Mapping[str, float]) -> CoupledModes:
        """The string at some time of its drift.

        Args:
            at: depth, detuning and time, which may be after the series.
        """
        duration_h = self.pause_h * (len(self.settings) - 1)
        string = self.string.shifted(self.drift_hz * at["time"] / duration_h)
        return pumped_modes(string, at["depth"], self.apart_hz + at["detuning"])


def pumped_modes(string: TwoModes, depth: float, pump_hz: float) -> CoupledModes:
    """The string in its uncoupled coordinates, f1^2 pumped.

    Args:
        string: the two modes, by angle and eigenfrequencies.
        depth: of the pump on f1^2; 0: none.
        pump_hz: its frequency, Hz.
    """
    c, s = math.cos(string.theta_rad), math.sin(string.theta_rad)
    plus, minus = string.eta_plus_hz, string.eta_minus_hz
    return CoupledModes(
        f_hz=(math.hypot(c * plus, s * minus), math.hypot(s * plus, c * minus)),
        d_hz=(string.d1_hz, string.d2_hz),
        coupling_hz={(0, 1): math.sqrt(max(-s * c * (minus - plus) * (minus + plus), 0.0))},
        gains=tuple(map(float, string.transform().T @ np.ones(2))),
        pump=Pump(frequency_hz=pump_hz, depth_f=(depth, 0.0)) if depth else None,
    )


@dataclass(frozen=True, kw_only=True)
class PumpedSweeps:
    """What was read, ``amplitude_v`` (sweeps, points), and without noise, ``true_v``."""

    bench: PumpedString
    seed: int
    amplitude_v: FloatArray
    true_v: FloatArray


def measure_pumped(bench: PumpedString, seed: int) -> PumpedSweeps:
    """Take all sweeps of a bench; the same arguments give the same numbers.

    Args:
        bench: the truth and how it is swept.
        seed: of the noise.

    Raises:
        ValueError: a pump makes the motion grow, which has no steady state.
    """
    true_v = bench.true_v()
    noise = np.random.default_rng(seed).standard_normal((2, *true_v.shape))
    noise = noise * bench.noise_v * bench.noise_scale
    amplitude_v = np.asarray(np.hypot(true_v + noise[0], noise[1]))
    return PumpedSweeps(bench=bench, seed=seed, amplitude_v=amplitude_v, true_v=true_v)
