"""Time series of the virtual laboratory: a string that is let go, or driven by a chirp.

    q'' + 2 pi T diag(d) T^T q' + (2 pi eta)^2 q = (1, 1) u(t)

in normal coordinates: with x = (q, q') = V z the equation is z' = s z + V^-1 b u, so that z turns
by exp(s t) where u is zero, and by steps of h, exp(s h) z + (exp(s h) - 1)/s V^-1 b u, where a
generator holds u. Nothing here is the FMU. Noise is Gaussian and white.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

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
        if isinstance(value, str | bool):
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
class StringRecord(TwoModes, ABC):
    """A string over time, of which the first of both strings is observed.

    ``kind`` is what is recorded. ``rate_hz`` samples a second over ``length_s`` s, from
    ``before_s`` before zero on where the drive ends there; seen with ``gain_v`` V per m, and
    ``offset_v``; ``level`` (m/s^2) is the amplitude of the drive, at ``drive_hz`` where it is a
    tone. ``noise`` is the standard deviation of a sample over the largest one.

    Raises:
        BadInput: numbers that no string has.
    """

    #: Digits of the lines' frequencies in the campaign.
    DIGITS: ClassVar[int] = 6

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
        refuse_impossible(asdict(self), lambda: self.times_s().size)

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

    @abstractmethod
    def recorded(self, rng: np.random.Generator) -> tuple[dict[str, FloatArray], float]:
        """Columns of the file, and the noise of a sample, V.

        Args:
            rng: of the noise.
        """

    @abstractmethod
    def table(self) -> tuple[str, dict[str, Any]]:
        """Name and keys of the campaign's table of the record."""

    @property
    @abstractmethod
    def title(self) -> str:
        """Of the campaign, without its end."""

    def fixed(self) -> dict[str, Any]:
        """Start values of the FMU, which drives itself by nothing."""
        return {"A1": 0.0, "A2": 0.0}

    def parameters(self) -> list[dict[str, Any]]:
        """Starts next to the truth: a tenth of what both lines are apart, half as wide again."""
        apart = self.eta_minus_hz - self.eta_plus_hz
        etas = (("eta_plus", self.eta_plus_hz, -0.08), ("eta_minus", self.eta_minus_hz, 0.1))
        widths = (("d1", self.d1_hz), ("d2", self.d2_hz))
        return [
            *(
                parameter(
                    name,
                    "Hz",
                    (eta - 0.45 * apart, eta + 0.45 * apart),
                    eta + off * apart,
                    digits=self.DIGITS,
                )
                for name, eta, off in etas
            ),
            *(parameter(name, "Hz", (0.1 * d, 10.0 * d), 1.5 * d) for name, d in widths),
        ]

    def files(self, seed: int, head: Sequence[str]) -> dict[str, str]:
        """Texts by file name: campaign, trace and truth.

        Args:
            seed: of the noise.
            head: lines that open every file.
        """
        columns, sigma = self.recorded(np.random.default_rng(seed))
        name, table = self.table()
        campaign = {
            "title": f"{self.title} (synthetic)",
            "synthetic": True,
            "fmu": {"model": "CoupledOscillator", "start": self.fixed()},
            "observe": {"output": "q1"},
            name: [{"file": "trace.csv", "input": "b"} | table],
            "parameters": self.parameters(),
            "continuation": FEW_LEVELS,
        }
        truth = {"trace": asdict(self), "outcome": {"seed": seed, "sigma_v": sigma}}
        return {
            CAMPAIGN_NAME: toml_text(campaign, head),
            "trace.csv": csv_text(columns, head),
            TRUTH_NAME: toml_text(truth, [*head, REMARK]),
        }


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
        observed = self._let_go() if self.kind == RINGDOWN else self._driven()
        return np.asarray(self.offset_v + self.gain_v * observed)

    def _let_go(self) -> FloatArray:
        """Of the first string, m: steady under the tone until zero, free from then on."""
        decays, shapes, z = self.free_motion()
        t, read = self.times_s(), self.modes.transform()[:, 0]
        free = read @ shapes[:2] @ (np.exp(decays[:, None] * np.maximum(t, 0.0)) * z[:, None])
        steady = (read @ self.steady()) * np.exp(2j * math.pi * self.drive_hz * t)
        return np.asarray(np.where(t < 0.0, steady.real, free.real))

    def _driven(self) -> FloatArray:
        """Of the first string, m: from rest, under the source."""
        decays, shapes = normal_modes(self.modes)
        push = np.linalg.solve(shapes, np.array([0.0, 0.0, 1.0, 1.0]) + 0j).astype(complex)
        z = _held(decays, push, self.source(), 1.0 / self.rate_hz)
        return np.asarray((self.modes.transform()[:, 0] @ shapes[:2] @ z).real)

    def recorded(self, rng: np.random.Generator) -> tuple[dict[str, FloatArray], float]:
        """Times, what is observed, and the source of a chirp; the noise of a sample."""
        exact = self.values()
        sigma = self.noise * float(np.max(np.abs(exact - np.mean(exact))))
        observed = exact + sigma * rng.standard_normal(exact.size)
        columns = {TIME: 1e3 * self.times_s(), OUTPUT: 1e3 * observed}
        return columns | ({SOURCE: self.source()} if self.kind == CHIRP else {}), sigma

    @property
    def title(self) -> str:
        """Of the campaign."""
        return f"A string's {self.kind}"

    def table(self) -> tuple[str, dict[str, Any]]:
        """Of a free decay the start is free, and with it the gain; a chirp is held and recorded."""
        if self.kind == RINGDOWN:
            free = {"offset": True, "start": "unknown", "begin": "found", "states": 4}
            return "trace", free | {"columns": {"output": "string"}}
        names = {"output": "string", "input": "source"}
        kept = {"gain": "fit", "offset": True, "interpolation": "held"}
        return "trace", kept | {"columns": names}

    def fixed(self) -> dict[str, Any]:
        """A free decay does not show the angle."""
        angle = {"theta": self.theta_rad} if self.kind == RINGDOWN else {}
        return super().fixed() | angle

    def parameters(self) -> list[dict[str, Any]]:
        """Frequencies and widths; of a driven trace the angle, too."""
        theta, quarter = self.theta_rad, 0.25 * math.pi
        angle = parameter("theta", "rad", (theta - quarter, theta + quarter), theta - 0.1)
        return super().parameters() + ([angle] if self.kind == CHIRP else [])


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
    z, result = np.zeros(rates.size, dtype=complex), np.empty((rates.size, u.size), dtype=complex)
    for k, value in enumerate(u):
        result[:, k] = z
        z = turn * z + gain * value
    return result
