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
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np

from fitting.lab.demodulated import DECAY, StringPhasors
from fitting.lab.modes import CoupledModes
from fitting.lab.names import CROSSING, CURVES, DEMODULATED, TIME_SERIES, TRUTH_NAME
from fitting.lab.string import TwoModes, steady_state
from fitting.lab.time_series import LET_GO, StringTrace
from fitting.lab.truth import REMARK, values_of
from fitting.lab.writer import CAMPAIGN_NAME, csv_text
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput, shown
from fitting.text.toml import toml_text


@dataclass(frozen=True, kw_only=True)
class WiredResonance:
    """One mode as a network analyser sees it.

    ``coupling`` is |Qc|/Q of a notch, or of a reflection, ``phase_rad`` that of the dip; ``gain``
    and ``gain_phase_rad`` of the line, ``delay_s`` of the cable, ``slope`` s of the baseline;
    ``span_widths`` the span in line widths. ``noise`` is the standard deviation of each quadrature
    over the largest modulus.

    Raises:
        BadInput: numbers that no resonance has.
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
        _check(self, ("eta_hz", "width_hz", "coupling", "gain", "span_widths"))
        if self.width_hz * self.span_widths >= 2.0 * self.eta_hz:
            raise BadInput("synthesize: the span reaches below zero frequency")

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

    def files(self, seed: int, head: tuple[str, ...]) -> dict[str, str]:
        """Texts by file name: campaign, sweep and truth.

        Args:
            seed: of the noise.
            head: lines that open every file.
        """
        u, exact = self.frequencies_hz(), self.values()
        draws = np.random.default_rng(seed).standard_normal((2, u.size))
        sigma = self.noise * float(np.max(np.abs(exact)))
        observed = exact + sigma * (draws[0] + 1j * draws[1])
        columns = {"frequency (Hz)": u, "X (V)": observed.real, "Y (V)": observed.imag}
        truth: dict[str, Any] = {CURVE: asdict(self), "outcome": {"seed": seed}}
        if self.kind != "transmission":
            truth["outcome"] |= {"Q_coupling": self.coupling_q}
        truth["outcome"] |= {"Q_plus": self.eta_hz / self.width_hz}
        return {
            CAMPAIGN_NAME: toml_text(self._campaign(), head),
            "sweep.csv": csv_text(columns, head),
            TRUTH_NAME: toml_text(truth, [*head, REMARK]),
        }

    def _campaign(self) -> dict[str, Any]:
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
            "drive": {
                "kind": "tones",
                "frequencies": ["u1", "u2"],
                "amplitudes": ["A1", "A2"],
            },
            "complex_sweep": [sweep],
            "parameters": [
                _parameter("eta_plus", "Hz", (eta - 3 * width, eta + 3 * width), eta + width / 3.0),
                _parameter("d1", "Hz", (0.1 * width, 10.0 * width), 2.0 * width),
            ],
            "derived": {"outputs": ["Q_plus"]},
            "continuation": FEW_LEVELS,
        }


@dataclass(frozen=True, kw_only=True)
class AvoidedCrossing:
    """Spectra |q1| over a voltage: f1 = ``f1_hz`` + ``tuning_hz_v`` V, f2, lambda, widths d, Hz.

    ``volts`` V from -``reach_v`` to ``reach_v``, ``points`` frequencies each over ``span_hz``;
    of three ``modes`` f3 is coupled to f2 by ``lambda23_hz``, and V and the frequencies reach as
    far beyond f3 as beyond f2; ``gain`` in V per m; ``drift_hz`` is what all frequencies move by
    from the first to the last spectrum, ``noise`` the standard deviation of each quadrature over
    its spectrum's largest. Their magnitude is measured; with ``phases`` both are, behind a cable of
    ``delay_s``, the phase of the gain anew in every spectrum. With ``reference`` there is one sweep
    of amplitudes at the first voltage besides, which the scale of tones rests on.

    Raises:
        BadInput: numbers that no laboratory has.
    """

    #: Controls of its sweeps, with their units, and what the FMU calls what is swept.
    UNITS: ClassVar[Mapping[str, str]] = {"V": "V"}
    OUTPUT: ClassVar[str] = "q1"

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
        names = ("f1_hz", "f2_hz", "lambda_hz", "d1_hz", "d2_hz", "reach_v", "span_hz", "gain")
        _check(self, (*names, "f3_hz", "lambda23_hz", "d3_hz"))
        if self.modes not in (2, 3):
            raise BadInput(f"synthesize: modes: found {self.modes}, wanted 2 or 3")
        if self.volts < 2:
            raise BadInput(f"synthesize: volts: found {self.volts}, wanted 2 spectra at least")

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

    def files(self, seed: int, head: tuple[str, ...]) -> dict[str, str]:
        """Texts by file name: campaign, map and truth.

        Args:
            seed: of the noise.
            head: lines that open every file.
        """
        exact = self.values()
        rng = np.random.default_rng(seed)
        one, other = rng.standard_normal((2, *exact.shape))
        noise = self.noise * np.max(np.abs(exact), axis=1, keepdims=True) * (one + 1j * other)
        volts, u = np.meshgrid(self.voltages(), self.frequencies_hz(), indexing="ij")
        columns = {"V (V)": volts.ravel(), "frequency (Hz)": u.ravel()}
        if self.phases:
            turns = rng.uniform(size=(self.volts, 1)) - (u - self.f2_hz) * self.delay_s
            observed = exact * np.exp(2j * np.pi * turns) + noise
            columns |= {"X (V)": observed.real.ravel(), "Y (V)": observed.imag.ravel()}
        else:
            columns["amplitude (V)"] = np.abs(np.abs(exact) + noise).ravel()
        made = {
            CAMPAIGN_NAME: toml_text(self._campaign(), head),
            "map.csv": csv_text(columns, head),
            TRUTH_NAME: toml_text(self.truth(seed), [*head, REMARK]),
        }
        if self.reference:
            made["sweep.csv"] = csv_text(self._reference(rng), head)
        return made

    def _reference(self, rng: np.random.Generator) -> dict[str, FloatArray]:
        """The sweep at the first voltage, at the points of a spectrum, with the noise of one."""
        u = self.frequencies_hz()
        exact = self.spectrum(float(self.voltages()[0]), -0.5 * self.drift_hz, u)
        one, other = rng.standard_normal((2, u.size))
        noise = self.noise * float(np.max(np.abs(exact))) * (one + 1j * other)
        return {"frequency (Hz)": u, "amplitude (V)": np.abs(exact + noise)}

    def truth(self, seed: int) -> dict[str, Any]:
        """Tables of truth.toml.

        Args:
            seed: of the noise.
        """
        return {CURVE: {"kind": CROSSING, **asdict(self)}, "outcome": {"seed": seed}}

    def _campaign(self) -> dict[str, Any]:
        """Boxes as wide as the spectra, starts next to the truth."""
        half, u = 0.5 * self.span_hz, self.frequencies_hz()
        box, tuning = (float(u[0]), float(u[-1])), abs(self.tuning_hz_v) or 1.0
        modes, width = [str(k) for k in range(1, self.modes + 1)], self.d1_hz
        undriven = {f"g{k}": 0.0 for k in modes[1:]}
        return {
            "title": "An avoided crossing (synthetic)",
            "synthetic": True,
            "fmu": {
                "model": f"CoupledModes{self.modes}",
                "start": {"periodic_start": True, "A2": 0.0, **undriven, "u2": 2.0 * self.f2_hz},
            },
            "observe": {"output": "q1", "steady_start": True},
            "drive": {
                "kind": "tones",
                "frequencies": ["u1", "u2"],
                "amplitudes": ["A1", "A2"],
            },
            **self._table(),
            "laws": {"f1": "a0 + a1*V"},
            "parameters": [
                _parameter("a0", "Hz", box, self.f1_hz + 0.05 * half),
                _parameter("a1", "Hz/V", (-5.0 * tuning, 5.0 * tuning), 0.8 * self.tuning_hz_v),
                _parameter("f2", "Hz", box, self.f2_hz - 0.05 * half),
                *([_parameter("f3", "Hz", box, self.f3_hz + 0.05 * half)] * (self.modes == 3)),
                *(
                    _parameter(f"lambda{k}", "Hz", (0.1 * start, 3.0 * start), start)
                    for k, start in self._couplings()
                ),
                *(
                    _parameter(f"d{k}", "Hz", (0.1 * width, 10.0 * width), 1.5 * width)
                    for k in modes
                ),
            ],
            "continuation": FEW_LEVELS,
        }

    def _couplings(self) -> list[tuple[str, float]]:
        """Names of the coupled pairs, and where their couplings start, Hz."""
        both = [("12", 1.3 * self.lambda_hz), ("23", 1.3 * self.lambda23_hz)]
        return both[: self.modes - 1]

    def _table(self) -> dict[str, Any]:
        given: dict[str, Any] = {"file": "map.csv", "controls": ["V"]}
        kind = "complex_control_sweep" if self.phases else "control_sweep"
        result = {kind: {**given, **({"delay": "fit"} if self.phases else {"amplitude": "V peak"})}}
        if self.reference:
            volts = f"{float(self.voltages()[0])!r} V"
            swept = {"file": "sweep.csv", "amplitude": "V peak", "scale": "fit"}
            result["sweep"] = {**swept, "set": {"V": volts}}
        return result


Curve = WiredResonance | AvoidedCrossing | StringTrace | StringPhasors
C = TypeVar("C", bound=Curve)

#: Tables of truth.toml that hold the record, one of them.
CURVE, TRACE = "curve", "trace"
FEW_LEVELS = {
    "nu_start": 1e-6,
    "beta": 0.01,
    "iterations": 3,
    "misfit": "squares",
    "starts": 1,
}


def curve_named(kind: str, changes: Mapping[str, Any]) -> Curve:
    """A built-in curve with numbers of its own.

    Args:
        kind: one of `CURVES`.
        changes: numbers that are different, by the names of the record's fields.

    Raises:
        BadInput: no such kind, a name that it does not have, impossible numbers.
    """
    if kind not in CURVES:
        raise BadInput(f"curve {kind!r}: wanted one of {', '.join(CURVES)}")
    made = _built_in(kind)
    if changes.get("modes") == 3 and isinstance(made, AvoidedCrossing):
        made = replace(made, volts=13, points=81)  # the map is wider
    return changed_curve(made, kind, changes)


def changed_curve(made: C, kind: str, changes: Mapping[str, Any]) -> C:
    """A curve with other numbers.

    Args:
        made: the curve.
        kind: what it is called.
        changes: numbers that are different, by the names of the record's fields.

    Raises:
        BadInput: a name that it does not have, impossible numbers.
    """
    known = {field.name for field in fields(made)} - {"kind"}
    for name in changes:
        if name not in known:
            raise BadInput(
                f"{name}: has no meaning for the curve {kind!r}, wanted {', '.join(sorted(known))}"
            )
    return replace(made, **changes)


def curve_of(tables: Mapping[str, Any], file: Path) -> Curve | None:
    """The curve that a truth file describes; None where it describes none.

    Args:
        tables: of the file.
        file: of complaints.

    Raises:
        BadInput: numbers that no such curve has, or some of them missing.
    """
    section = next((name for name in (CURVE, TRACE) if name in tables), None)
    if section is None:
        return None
    kind = values_of(tables, section, ["kind"], file)["kind"]
    if kind not in CURVES:
        raise BadInput(
            f"{file}: [{section}] kind: found {shown(kind)}, wanted one of {', '.join(CURVES)}"
        )
    made = _built_in(kind)
    names = [field.name for field in fields(made) if field.name in tables[section]]
    try:
        return replace(made, **values_of(tables, section, names, file))
    except (TypeError, BadInput) as error:
        raise BadInput(f"{file}: does not describe a virtual laboratory: {error}") from error


def kind_of(curve: Curve) -> str:
    """What a curve is called, one of `CURVES`.

    Args:
        curve: of the virtual laboratory.
    """
    return CROSSING if isinstance(curve, AvoidedCrossing) else curve.kind


def _built_in(kind: str) -> Curve:
    if kind in TIME_SERIES:
        return replace(LET_GO, kind=kind)
    if kind in DEMODULATED:
        return replace(DECAY, kind=kind)
    return AvoidedCrossing() if kind == CROSSING else WiredResonance(kind=kind)


def _parameter(
    name: str, unit: str, box: tuple[float, float], start: float
) -> dict[str, float | str]:
    return {"name": name, "unit": unit, "lower": box[0], "upper": box[1], "start": start}


def _check(record: WiredResonance | AvoidedCrossing, positive: tuple[str, ...]) -> None:
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, str):
            continue
        above = field.name in positive
        if not math.isfinite(value) or (above and value <= 0.0):
            wanted = "a number above zero" if above else "a number"
            raise BadInput(f"synthesize: {field.name}: found {value!r}, wanted {wanted}")
    if record.points < 8:
        raise BadInput(f"synthesize: points: found {record.points}, wanted 8 at least")
    if record.noise < 0.0:
        raise BadInput(f"synthesize: noise: found {record.noise}, wanted zero or more")
