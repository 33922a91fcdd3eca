"""A virtual laboratory: two coupled modes measured with drift and noise, known truth, no FMU.

Its simulator is the closed form of the steady state in numpy's complex arithmetic; it shares no
code with the FMU, so that a fit through the FMU is tried against something else than itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray

TWO_PI = 2.0 * math.pi


@dataclass(frozen=True)
class TwoModes:
    """Two coupled damped modes: angle, damping d1 and d2, eigenfrequencies.

    ``reflection`` selects T = [[-c, s], [s, c]] instead of the rotation [[c, -s], [s, c]].

    Raises:
        ValueError: damping not positive or eta_plus not below eta_minus.
    """

    theta_rad: float
    d1_hz: float
    d2_hz: float
    eta_plus_hz: float
    eta_minus_hz: float
    reflection: bool = False

    def __post_init__(self) -> None:
        if not (self.d1_hz > 0.0 and self.d2_hz > 0.0):
            raise ValueError(f"damping d1 = {self.d1_hz}, d2 = {self.d2_hz} Hz must be positive")
        if not 0.0 < self.eta_plus_hz < self.eta_minus_hz:
            raise ValueError(
                f"eta_plus = {self.eta_plus_hz} Hz must lie between 0 and "
                f"eta_minus = {self.eta_minus_hz} Hz"
            )

    def transform(self) -> FloatArray:
        """The orthogonal matrix T (2, 2)."""
        c, s = math.cos(self.theta_rad), math.sin(self.theta_rad)
        return np.array([[-c, s], [s, c]] if self.reflection else [[c, -s], [s, c]])

    def widths_hz(self) -> tuple[float, float]:
        """Full widths of the hybridised modes, (T D T^T)_ii / 2 pi, in Hz."""
        turned = self.transform() @ np.diag([self.d1_hz, self.d2_hz]) @ self.transform().T
        return float(turned[0, 0]), float(turned[1, 1])


def steady_state(
    modes: TwoModes, frequency_hz: FloatArray, gains: tuple[float, float] = (1.0, 1.0)
) -> ComplexArray:
    """Complex amplitudes (n, 2) of both hybridised modes under cos(2 pi u t), ``gains`` on each.

    X(u) = A(u)^-1 g with A(u) = C - (2 pi u)^2 I + 2 pi i u T D T^T, in s^2. Differences of
    squares are factored, (2 pi)^2 (eta - u)(eta + u): at Q near 1e5 they cancel. Source: Bartsch et
    al., arXiv:2412.07301, the periodic solution of the coupled system.
    """
    u = np.asarray(frequency_hz, dtype=float)
    t = modes.transform()
    damping = TWO_PI * (t @ np.diag([modes.d1_hz, modes.d2_hz]) @ t.T)
    matrix = 1j * TWO_PI * u[:, np.newaxis, np.newaxis] * damping
    for i, eta in enumerate((modes.eta_plus_hz, modes.eta_minus_hz)):
        matrix[:, i, i] += TWO_PI**2 * (eta - u) * (eta + u)
    drive = np.broadcast_to(np.array(gains, dtype=complex)[:, np.newaxis], (u.size, 2, 1))
    return np.asarray(np.linalg.solve(matrix, drive)[:, :, 0])


@dataclass(frozen=True)
class Bench:
    """Everything the virtual laboratory does: the truth and how it is measured.

    ``modes`` holds the eigenfrequencies at the middle of the series. ``observed`` is 0 or 1.
    ``drift_hz`` is the linear change of both over the series, ``curvature_hz`` the
    departure from linear at its middle. ``crest_v`` is the height of the sweep's maximum in volts,
    ``noise_scale`` multiplies every source of randomness (0: exact). ``floor_v`` is the range of
    the mean noise magnitude; ``resolution_hz`` the spectrum analyser's bandwidth and point
    distance; spans are full spans.
    """

    series: str
    modes: TwoModes
    observed: int
    pairs_hz: tuple[tuple[float, float], ...]
    drift_hz: float = 100.0
    curvature_hz: float = 5.0
    crest_v: float = 40e-6
    floor_v: tuple[float, float] = (0.2e-6, 0.3e-6)
    eta_error_hz: float = 0.2
    noise_scale: float = 1.0
    resolution_hz: float = 1.0
    spectrum_span_hz: float = 500.0
    sweep_span_hz: float = 600.0
    sweep_step_hz: float = 5.0

    def __post_init__(self) -> None:
        if self.observed not in (0, 1):
            raise ValueError(f"observed mode {self.observed}, wanted 0 or 1")
        if self.noise_scale < 0.0 or self.crest_v <= 0.0:
            raise ValueError("noise_scale must not be negative and crest_v must be positive")
        if not self.pairs_hz:
            raise ValueError("a series wants at least one drive pair")

    def at(self, position: float) -> TwoModes:
        """The modes at ``position`` in [0, 1] of the series, drifted."""
        shift = self.drift_hz * (position - 0.5) + self.curvature_hz * 4.0 * position * (
            1 - position
        )
        return replace(
            self.modes,
            eta_plus_hz=self.modes.eta_plus_hz + shift,
            eta_minus_hz=self.modes.eta_minus_hz + shift,
        )


@dataclass(frozen=True)
class Trace:
    """A measured curve: ``frequency_hz`` (n,) and ``amplitude_v`` (n,), V peak."""

    frequency_hz: FloatArray
    amplitude_v: FloatArray


@dataclass(frozen=True)
class Series:
    """What the laboratory hands over, and beside it the truth of each experiment.

    ``eta_before_hz`` and ``eta_after_hz`` are the measured (plus, minus) eigenfrequencies;
    ``true_modes`` one per experiment, ``true_peaks_v`` (m, 2), ``gain`` volts per model unit.
    """

    bench: Bench
    seed: int
    gain: float
    sweep: Trace
    spectra: tuple[Trace, ...]
    eta_before_hz: tuple[float, float]
    eta_after_hz: tuple[float, float]
    true_modes: tuple[TwoModes, ...]
    true_peaks_v: FloatArray


def measure(bench: Bench, seed: int) -> Series:
    """Run one measurement series: sweep, spectra of every drive pair, eigenfrequencies around it.

    The sweep is taken at the start of the series. The same ``bench`` and ``seed`` give the same
    numbers bit by bit.
    """
    rng = np.random.default_rng(seed)
    first, last = bench.at(0.0), bench.at(1.0)
    sweep_hz = sweep_grid(bench)
    sweep_wave = steady_state(first, sweep_hz)[:, bench.observed]
    crest_hz = _eta(first, bench.observed)
    gain = bench.crest_v / float(
        np.abs(steady_state(first, np.array([crest_hz]))[0, bench.observed])
    )
    sweep = Trace(sweep_hz, np.abs(gain * sweep_wave + noise(bench, rng, sweep_hz.size)))
    count = len(bench.pairs_hz)
    spectra, states, peaks = [], [], []
    for index, pair in enumerate(bench.pairs_hz):
        state = bench.at(0.5 if count == 1 else index / (count - 1))
        lines = gain * steady_state(state, np.array(pair))[:, bench.observed]
        spectra.append(spectrum(bench, rng, 0.5 * (pair[0] + pair[1]), pair, lines))
        states.append(state)
        peaks.append(np.abs(lines))
    error = bench.noise_scale * bench.eta_error_hz * rng.standard_normal(4)
    return Series(
        bench=bench,
        seed=seed,
        gain=gain,
        sweep=sweep,
        spectra=tuple(spectra),
        eta_before_hz=(first.eta_plus_hz + error[0], first.eta_minus_hz + error[1]),
        eta_after_hz=(last.eta_plus_hz + error[2], last.eta_minus_hz + error[3]),
        true_modes=tuple(states),
        true_peaks_v=np.array(peaks),
    )


def _eta(modes: TwoModes, observed: int) -> float:
    return (modes.eta_plus_hz, modes.eta_minus_hz)[observed]


def sweep_grid(bench: Bench) -> FloatArray:
    """Points around the undrifted mode, as many on either side."""
    half = round(bench.sweep_span_hz / bench.sweep_step_hz / 2.0)
    steps = np.arange(-half, half + 1, dtype=np.float64)
    return np.asarray(_eta(bench.modes, bench.observed) + bench.sweep_step_hz * steps)


def spectrum(
    bench: Bench,
    rng: np.random.Generator,
    centre_hz: float,
    tones_hz: Sequence[float] | FloatArray,
    lines: ComplexArray,
) -> Trace:
    """Magnitude of all lines through a Gaussian resolution filter, plus complex noise."""
    half = round(bench.spectrum_span_hz / bench.resolution_hz / 2.0)
    steps = np.arange(-half, half + 1, dtype=np.float64)
    frequency: FloatArray = centre_hz + bench.resolution_hz * steps
    wave = np.zeros(frequency.size, dtype=complex)
    for tone, line in zip(tones_hz, lines, strict=True):
        # amplitude 1/sqrt(2) half a bandwidth off the line: bandwidth between the 3 dB points
        offset = 2.0 * (frequency - tone) / bench.resolution_hz
        wave += line * np.exp(-0.5 * math.log(2.0) * offset**2)
    return Trace(frequency, np.abs(wave + noise(bench, rng, frequency.size)))


def noise(bench: Bench, rng: np.random.Generator, size: int) -> ComplexArray:
    """Complex Gaussian noise whose magnitude averages to a level drawn from ``floor_v``."""
    level = bench.noise_scale * rng.uniform(*bench.floor_v)
    sigma = level / math.sqrt(math.pi / 2.0)
    quadratures = rng.standard_normal((2, size))
    return np.asarray(sigma * (quadratures[0] + 1j * quadratures[1]))


DRIVE_PAIRS_MHZ = {
    # Bartsch et al., arXiv:2412.07301, drive pairs of the two measurement series
    "q1": (
        "6.94016/6.94036",
        "6.94018/6.94034",
        "6.94020/6.94032",
        "6.94024/6.94028",
        "6.94025/6.94027",
    ),
    "q2": (
        "7.02750/7.02770",
        "7.02752/7.02768",
        "7.02754/7.02766",
        "7.02758/7.02762",
        "7.02759/7.02761",
    ),
}
SERIES_THETA = {"q1": 1.9498, "q2": 2.0406}


def string_bench(series: str) -> Bench:
    """The bench of the paper's nanostring for ``series`` "q1" or "q2": its pairs, its angle."""
    # integer hertz: 6.94016e6 and 1e6 * 6.94016 differ in the last bit, whole numbers do not
    pairs = tuple(
        (float(round(float(low) * 1e6)), float(round(float(high) * 1e6)))
        for low, high in (pair.split("/") for pair in DRIVE_PAIRS_MHZ[series])
    )
    modes = TwoModes(SERIES_THETA[series], 120.0, 90.0, 6940260.0, 7027600.0)
    return Bench(series=series, modes=modes, observed=("q1", "q2").index(series), pairs_hz=pairs)
