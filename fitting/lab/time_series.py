"""Time series of the virtual laboratory: a string that is let go, or driven by a chirp.

    q'' + 2 pi T diag(d) T^T q' + (2 pi eta)^2 q = (1, 1) u(t)

in normal coordinates: with x = (q, q') = V z the equation is z' = s z + V^-1 b u, so that z turns
by exp(s t) where u is zero, and by steps of h, exp(s h) z + (exp(s h) - 1)/s V^-1 b u, where a
generator holds u. Nothing here is the FMU. Noise is Gaussian and white.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fitting.lab.names import CHIRP, RINGDOWN, TRUTH_NAME
from fitting.lab.string import TWO_PI, TwoModes, steady_state
from fitting.lab.truth import REMARK
from fitting.lab.writer import CAMPAIGN_NAME, csv_text
from fitting.text.arrays import ComplexArray, FloatArray
from fitting.text.errors import BadInput
from fitting.text.toml import toml_text

#: Columns of the file: what is seen, and what drives.
TIME, OUTPUT, SOURCE = "time (ms)", "string (mV)", "source (m/s2)"
#: Levels of the regularisation: the start is near.
FEW_LEVELS = {"nu_start": 1e-6, "beta": 0.01, "iterations": 1, "misfit": "squares", "starts": 1}
LEAST_SAMPLES = 64
#: Numbers that need not be above zero, and those of them that are not below it.
SIGNED, NOT_NEGATIVE = ("theta_rad", "offset_v", "noise", "before_s"), ("noise", "before_s")


def refuse_impossible(numbers: Mapping[str, Any], samples: Callable[[], int]) -> None:
    """Refuse numbers that no string over time has.

    Args:
        numbers: of the laboratory, by name; words are passed over.
        samples: how many samples they make, asked once they are sound.

    Raises:
        BadInput: names the number.
    """
    for name, value in numbers.items():
        if isinstance(value, str):
            continue
        if not math.isfinite(value) or not (name in SIGNED or value > 0.0):
            wanted = "a number" if name in SIGNED else "a number above zero"
            raise BadInput(f"synthesize: {name}: found {value!r}, wanted {wanted}")
    for name in NOT_NEGATIVE:
        if numbers[name] < 0.0:
            raise BadInput(f"synthesize: {name}: found {numbers[name]}, wanted zero or more")
    if not numbers["eta_plus_hz"] < numbers["eta_minus_hz"]:
        raise BadInput(
            f"synthesize: eta_plus_hz: found {numbers['eta_plus_hz']}, wanted less than "
            f"eta_minus_hz ({numbers['eta_minus_hz']})"
        )
    if samples() < LEAST_SAMPLES:
        raise BadInput(
            f"synthesize: length_s: found {numbers['length_s']}, wanted {LEAST_SAMPLES} samples"
        )


@dataclass(frozen=True, kw_only=True)
class StringTrace:
    """A string over time: ``ringdown``, a tone until zero, then nothing; or under a ``chirp``.

    ``rate_hz`` samples a second over ``length_s`` s, of the first of both strings; a ringdown is
    recorded from ``before_s`` before zero on. It is seen with
    ``gain_v`` V per m, and ``offset_v``; ``level`` (m/s^2) is the amplitude of the drive, of a
    ringdown at ``drive_hz`` until zero, of a chirp from ``start_hz`` to ``stop_hz`` over its first
    nine tenths. ``noise`` is the standard deviation of a sample over the largest distance from the
    mean.

    Raises:
        BadInput: numbers that no string has.
    """

    kind: str = RINGDOWN
    theta_rad: float = 1.95
    d1_hz: float = 4.0
    d2_hz: float = 2.0
    eta_plus_hz: float = 1000.0
    eta_minus_hz: float = 1012.0
    level: float = 50.0
    drive_hz: float = 1006.0
    start_hz: float = 980.0
    stop_hz: float = 1035.0
    length_s: float = 0.3
    before_s: float = 0.02
    rate_hz: float = 2500.0
    gain_v: float = 100.0
    offset_v: float = 0.02
    noise: float = 0.01

    def __post_init__(self) -> None:
        refuse_impossible(asdict(self), lambda: self.times_s().size)

    @property
    def modes(self) -> TwoModes:
        """The string at rest."""
        return TwoModes(
            theta_rad=self.theta_rad,
            d1_hz=self.d1_hz,
            d2_hz=self.d2_hz,
            eta_plus_hz=self.eta_plus_hz,
            eta_minus_hz=self.eta_minus_hz,
        )

    def times_s(self) -> FloatArray:
        """Of the samples, (n,); the drive of a ringdown ends at zero."""
        before = round(self.before_s * self.rate_hz) if self.kind == RINGDOWN else 0
        return np.arange(-before, round(self.length_s * self.rate_hz)) / self.rate_hz

    def source(self) -> FloatArray:
        """What the generator holds from each sample to the next, (n,), m/s^2; of a chirp."""
        t, length = self.times_s(), 0.9 * self.length_s
        rate = 0.5 * (self.stop_hz - self.start_hz) / length
        wave = self.level * np.sin(TWO_PI * t * (self.start_hz + rate * t))
        return np.where(t < length, wave, 0.0)

    def values(self) -> FloatArray:
        """What is seen at the samples, (n,), V, without noise."""
        seen = self._let_go() if self.kind == RINGDOWN else self._driven()
        return np.asarray(self.offset_v + self.gain_v * seen)

    def _let_go(self) -> FloatArray:
        """Of the first string, m: steady under the tone until zero, free from then on."""
        decays, shapes = normal_modes(self.modes)
        t, read = self.times_s(), self.modes.transform()[:, 0]
        [x] = steady_state(self.modes, np.array([self.drive_hz])) * self.level
        tone = 2j * math.pi * self.drive_hz
        z = np.linalg.solve(shapes, np.concatenate([x, tone * x]).real + 0j)
        free = read @ shapes[:2] @ (np.exp(decays[:, None] * np.maximum(t, 0.0)) * z[:, None])
        steady = (read @ x) * np.exp(tone * t)
        return np.asarray(np.where(t < 0.0, steady.real, free.real))

    def _driven(self) -> FloatArray:
        """Of the first string, m: from rest, under the source."""
        decays, shapes = normal_modes(self.modes)
        push = np.linalg.solve(shapes, np.array([0.0, 0.0, 1.0, 1.0]) + 0j).astype(complex)
        z = _held(decays, push, self.source(), 1.0 / self.rate_hz)
        return np.asarray((self.modes.transform()[:, 0] @ shapes[:2] @ z).real)

    def files(self, seed: int, head: Sequence[str]) -> dict[str, str]:
        """Texts by file name: campaign, trace and truth.

        Args:
            seed: of the noise.
            head: lines that open every file.
        """
        exact, rng = self.values(), np.random.default_rng(seed)
        sigma = self.noise * float(np.max(np.abs(exact - np.mean(exact))))
        seen = exact + sigma * rng.standard_normal(exact.size)
        columns = {TIME: 1e3 * self.times_s(), OUTPUT: 1e3 * seen}
        if self.kind == CHIRP:
            columns[SOURCE] = self.source()
        truth = {"trace": asdict(self), "outcome": {"seed": seed, "sigma_v": sigma}}
        return {
            CAMPAIGN_NAME: toml_text(self._campaign(), head),
            "trace.csv": csv_text(columns, head),
            TRUTH_NAME: toml_text(truth, [*head, REMARK]),
        }

    def _campaign(self) -> dict[str, Any]:
        """A free decay tells frequencies and widths; a driven trace the angle besides."""
        trace: dict[str, Any] = {"file": "trace.csv", "input": "b", "gain": "fit", "offset": True}
        names: dict[str, str] = {"output": "string"}
        fixed: dict[str, Any] = {"A1": 0.0, "A2": 0.0}
        if self.kind == RINGDOWN:
            del trace["gain"]  # the start is free, and with it the gain
            trace |= {"start": "unknown", "begin": "found", "states": 4}
            fixed["theta"] = self.theta_rad
        else:
            names["input"] = "source"
            trace["interpolation"] = "held"
        return {
            "title": f"A string's {self.kind} (synthetic)",
            "synthetic": True,
            "fmu": {"model": "CoupledOscillator", "start": fixed},
            "observe": {"output": "q1"},
            "trace": [trace | {"columns": names}],
            "parameters": self._parameters(),
            "continuation": FEW_LEVELS,
        }

    def _parameters(self) -> list[dict[str, Any]]:
        """Starts beside the truth: a tenth of what both lines are apart, half as wide again."""
        apart = self.eta_minus_hz - self.eta_plus_hz
        etas = (("eta_plus", self.eta_plus_hz, -0.08), ("eta_minus", self.eta_minus_hz, 0.1))
        widths = (("d1", self.d1_hz), ("d2", self.d2_hz))
        found = [
            parameter(name, "Hz", (eta - 0.45 * apart, eta + 0.45 * apart), eta + off * apart)
            for name, eta, off in etas
        ]
        found += [parameter(name, "Hz", (0.1 * d, 10.0 * d), 1.5 * d) for name, d in widths]
        if self.kind == CHIRP:
            theta, quarter = self.theta_rad, 0.25 * math.pi
            found.append(parameter("theta", "rad", (theta - quarter, theta + quarter), theta - 0.1))
        return found


def parameter(
    name: str, unit: str, box: tuple[float, float], start: float, digits: int = 6
) -> dict[str, float | str]:
    """Table of a parameter for a campaign.

    Args:
        name: of the variable.
        unit: of all numbers.
        box: bounds.
        start: where a fit starts.
        digits: that are written.
    """
    numbers = {"lower": box[0], "upper": box[1], "start": start}
    return {"name": name, "unit": unit, **{k: float(f"{v:.{digits}g}") for k, v in numbers.items()}}


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


def _held(rates: ComplexArray, push: ComplexArray, u: FloatArray, step_s: float) -> ComplexArray:
    """Normal coordinates (4, n) from rest, under values u (n,) that are held over steps."""
    turn = np.exp(rates * step_s)
    gain = np.expm1(rates * step_s) / rates * push
    z, found = np.zeros(rates.size, dtype=complex), np.empty((rates.size, u.size), dtype=complex)
    for k, value in enumerate(u):
        found[:, k] = z
        z = turn * z + gain * value
    return found
