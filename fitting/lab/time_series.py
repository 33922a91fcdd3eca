"""Time series of the virtual laboratory: a string that is let go, or driven by a chirp.

    q'' + 2 pi T diag(d) T^T q' + (2 pi eta)^2 q = (1, 1) u(t)

in normal coordinates: with x = (q, q') = V z the equation is z' = s z + V^-1 b u, so that z turns
by exp(s t) where u is zero, and by steps of h, exp(s h) z + (exp(s h) - 1)/s V^-1 b u, where a
generator holds u. Demodulated at the frequency f of a tone that ends at zero it is

    q(t) = Re[z(t) exp(2 pi i f t)],   z = x before zero, sum_k c_k exp((s_k - 2 pi i f) t) after

with the steady answer x, and the rates s_k (Im s_k > 0) and parts c_k of free motion; no sample
lies within a period. A lock-in amplifier records X and Y of z, an analyser with a span of zero |z|
as a level. Nothing here is the FMU. Noise is Gaussian and white, of phasors in each quadrature.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from fitting.lab.curve import FEW_LEVELS, Curve, parameter
from fitting.lab.names import CHIRP, LOCK_IN, RINGDOWN
from fitting.lab.string import TWO_PI, TwoModes, steady_state
from fitting.text.arrays import ComplexArray, FloatArray

#: Columns of the file: what is seen, and what drives.
TIME, OUTPUT, SOURCE = "time (ms)", "string (mV)", "source (m/s2)"
LEAST_SAMPLES = 64


@dataclass(frozen=True, kw_only=True)
class StringRecord(TwoModes, Curve):
    """A string over time, of which the first of both strings is observed.

    ``kind`` is what is recorded. ``rate_hz`` samples a second over ``length_s`` s, from
    ``before_s`` before zero on where the drive ends there; seen with ``gain_v`` V per m, and
    ``offset_v``; ``level`` (m/s^2) is the amplitude of the drive, at ``drive_hz`` where it is a
    tone. ``noise`` is the standard deviation of a sample over the largest one.

    Raises:
        ValueError: numbers that no string has.
    """

    TABLE: ClassVar[str] = "trace"

    kind: str
    level: float = 50.0
    drive_hz: float
    length_s: float
    before_s: float
    rate_hz: float
    gain_v: float
    offset_v: float = 0.02
    noise: float = 0.01

    def __post_init__(self) -> None:
        Curve.__post_init__(self)
        if not self.eta_plus_hz < self.eta_minus_hz:
            raise ValueError(
                f"eta_plus_hz: found {self.eta_plus_hz}, wanted less than eta_minus_hz "
                f"({self.eta_minus_hz})"
            )
        if self.times_s().size < LEAST_SAMPLES:
            raise ValueError(f"length_s: found {self.length_s}, wanted {LEAST_SAMPLES} samples")

    def times_s(self) -> FloatArray:
        """Of the samples, (n,); the drive ends at zero."""
        before = round(self.before_s * self.rate_hz)
        return np.arange(-before, round(self.length_s * self.rate_hz)) / self.rate_hz

    def free_motion(self) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Rates s (4,), shapes V (4, 4) and normal coordinates (4,) when the tone ends."""
        rates, shapes = normal_modes(self.modes)
        x = self.steady()
        tone = 2j * math.pi * self.drive_hz
        z = np.linalg.solve(shapes, np.concatenate([x, tone * x]).real + 0j)
        return rates, shapes, np.asarray(z)

    def steady(self) -> ComplexArray:
        """Complex amplitudes (2,) of the modes under the tone, m."""
        [x] = steady_state(self.modes, np.array([self.drive_hz]))
        return np.asarray(x * self.level)

    def campaign_of(
        self,
        title: str,
        name: str,
        table: Mapping[str, Any],
        start: Mapping[str, float],
        parameters: Sequence[Mapping[str, Any]],
    ) -> dict[str, Any]:
        """Tables of a campaign of one record, whose FMU drives itself by nothing.

        Args:
            title: without its end.
            name: of the table of the record.
            table: its keys apart from those of every record.
            start: further start values of the FMU.
            parameters: tables of the parameters.
        """
        return {
            "title": f"{title} (synthetic)",
            "synthetic": True,
            "fmu": {"model": "CoupledOscillator", "start": {"A1": 0.0, "A2": 0.0, **start}},
            "observe": {"output": "q1"},
            name: [{"file": "trace.csv", "input": "b", **table}],
            "parameters": parameters,
            "continuation": FEW_LEVELS,
        }

    def parameters(self, digits: int) -> list[dict[str, Any]]:
        """Starts next to the truth: a tenth of what both lines are apart, half as wide again.

        Args:
            digits: of frequencies that are written.
        """
        apart, result = self.eta_minus_hz - self.eta_plus_hz, []
        etas = (("eta_plus", self.eta_plus_hz, -0.08), ("eta_minus", self.eta_minus_hz, 0.1))
        for name, eta, off in etas:
            bounds = (eta - 0.45 * apart, eta + 0.45 * apart)
            result.append(parameter(name, "Hz", bounds, eta + off * apart, digits))
        for name, d in (("d1", self.d1_hz), ("d2", self.d2_hz)):
            result.append(parameter(name, "Hz", (0.1 * d, 10.0 * d), 1.5 * d, 6))
        return result


@dataclass(frozen=True, kw_only=True)
class StringTrace(StringRecord):
    """A string over time: ``ringdown``, a tone until zero, then nothing; or under a ``chirp``.

    A chirp goes from ``start_hz`` to ``stop_hz`` over the first nine tenths of its record. Noise is
    relative to the largest distance from the mean.
    """

    start_hz: float
    stop_hz: float

    def times_s(self) -> FloatArray:
        """Of the samples, (n,); the drive of a ringdown ends at zero, a chirp begins there."""
        times = super().times_s()
        return times if self.kind == RINGDOWN else times[times >= 0.0]

    def source(self) -> FloatArray:
        """What the generator holds from each sample to the next, (n,), m/s^2; of a chirp."""
        t, length = self.times_s(), 0.9 * self.length_s
        rate = 0.5 * (self.stop_hz - self.start_hz) / length
        wave = self.level * np.sin(TWO_PI * t * (self.start_hz + rate * t))
        return np.where(t < length, wave, 0.0)

    def values(self) -> FloatArray:
        """What is seen at the samples, (n,), V, without noise."""
        t, read = self.times_s(), self.modes.transform()[:, 0]
        if self.kind == RINGDOWN:
            # steady under the tone until zero, free from then on
            rates, shapes, z = self.free_motion()
            free = read @ shapes[:2] @ (np.exp(rates[:, None] * np.maximum(t, 0.0)) * z[:, None])
            steady = (read @ self.steady()) * np.exp(2j * math.pi * self.drive_hz * t)
            observed = np.where(t < 0.0, steady.real, free.real)
        else:
            # from rest, under what the source holds over a step
            rates, shapes = normal_modes(self.modes)
            push = np.linalg.solve(shapes, np.array([0.0, 0.0, 1.0, 1.0]) + 0j).astype(complex)
            turn = np.exp(rates * (1.0 / self.rate_hz))
            gain = np.expm1(rates * (1.0 / self.rate_hz)) / rates * push
            normal, source = np.zeros((rates.size, t.size), dtype=complex), self.source()
            for k in range(1, t.size):
                normal[:, k] = turn * normal[:, k - 1] + gain * source[k - 1]
            observed = (read @ shapes[:2] @ normal).real
        return np.asarray(self.offset_v + self.gain_v * observed)

    def recorded(
        self, rng: np.random.Generator
    ) -> tuple[dict[str, dict[str, Any]], dict[str, float]]:
        """Times, what is observed, and the source of a chirp; the noise of a sample."""
        exact = self.values()
        sigma = self.noise * float(np.max(np.abs(exact - np.mean(exact))))
        observed = exact + sigma * rng.standard_normal(exact.size)
        columns = {TIME: 1e3 * self.times_s(), OUTPUT: 1e3 * observed}
        columns |= {SOURCE: self.source()} if self.kind == CHIRP else {}
        return {"trace.csv": columns}, {"sigma_v": sigma}

    def campaign(self) -> dict[str, Any]:
        """Of a free decay start and gain are free, and it does not show the angle."""
        table: dict[str, Any]
        title, parameters, theta = f"A string's {self.kind}", self.parameters(6), self.theta_rad
        if self.kind == RINGDOWN:
            table = {"offset": True, "start": "unknown", "begin": "found", "states": 4}
            table["columns"] = {"output": "string"}
            return self.campaign_of(title, "trace", table, {"theta": theta}, parameters)
        table = {"gain": "fit", "offset": True, "interpolation": "held"}
        table["columns"] = {"output": "string", "input": "source"}
        bounds = (theta - 0.25 * math.pi, theta + 0.25 * math.pi)
        parameters.append(parameter("theta", "rad", bounds, theta - 0.1, 6))
        return self.campaign_of(title, "trace", table, {}, parameters)


class StringPhasors(StringRecord):
    """A string whose tone at ``drive_hz`` ends at zero, demodulated at that frequency.

    ``lock-in``: X and Y of the first of both strings, on which two modes beat; ``zero-span``: the
    level of its one mode, in dBm of a 50 ohm load. ``offset_v`` leaks into X. ``noise`` is the
    standard deviation of each quadrature over the largest amplitude.
    """

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

    def recorded(
        self, rng: np.random.Generator
    ) -> tuple[dict[str, dict[str, Any]], dict[str, float]]:
        """Times with X and Y, or with levels; the noise of a quadrature."""
        exact = self.values()
        sigma = self.noise * float(np.max(np.abs(exact)))
        draws = rng.standard_normal((2, exact.size))
        observed = exact + sigma * (draws[0] + 1j * draws[1])
        columns = {TIME: 1e3 * self.times_s()}
        if self.kind == LOCK_IN:
            observed = observed + self.offset_v
            columns |= {"X (mV)": 1e3 * observed.real, "Y (mV)": 1e3 * observed.imag}
        else:
            # peak amplitude A is A^2/(2 R) in watts
            power = np.abs(observed) ** 2 / (2.0 * 50.0)
            columns["amplitude (dBm)"] = 10.0 * np.log10(power / 1e-3)
        return {"trace.csv": columns}, {"sigma_v": sigma}

    def campaign(self) -> dict[str, Any]:
        """Phasors determine frequencies and widths, levels of one mode its width alone."""
        title, theta = f"A string's decay, {self.kind}", self.modes.theta_rad
        table: dict[str, Any] = {"frequency": f"{self.drive_hz!r} Hz", "begin": "found"}
        start, parameters = {"theta": theta}, self.parameters(12)
        if self.kind == LOCK_IN:
            table |= {"modes": 2, "offset": True}
        else:
            start |= {"eta_plus": self.eta_plus_hz, "eta_minus": 2.0 * self.eta_plus_hz}
            parameters = [p for p in parameters if p["name"] == "d1"]
        return self.campaign_of(title, "demodulated_trace", table, start, parameters)


#: A string that is let go, or driven by a chirp, as the laboratory has it.
LET_GO = StringTrace(
    kind=RINGDOWN,
    theta_rad=1.95,
    d1_hz=4.0,
    d2_hz=2.0,
    eta_plus_hz=1000.0,
    eta_minus_hz=1012.0,
    drive_hz=1006.0,
    start_hz=980.0,
    stop_hz=1035.0,
    length_s=0.3,
    before_s=0.02,
    rate_hz=2500.0,
    gain_v=100.0,
)
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


def normal_modes(modes: TwoModes) -> tuple[ComplexArray, ComplexArray]:
    """Rates s (4,) and shapes V (4, 4) of free motion, positions before velocities.

    Args:
        modes: both, in Hz.
    """
    t = modes.transform()
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    a[2:, :2] = -np.diag(np.square(TWO_PI * np.array([modes.eta_plus_hz, modes.eta_minus_hz])))
    a[2:, 2:] = -TWO_PI * (t @ np.diag([modes.d1_hz, modes.d2_hz]) @ t.T)
    decays, shapes = np.linalg.eig(a)
    return decays.astype(complex), shapes.astype(complex)
