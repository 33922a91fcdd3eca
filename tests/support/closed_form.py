"""Outside truth for the fitting tests: two coupled modes by phasors, in numpy, without any FMU.

The periodic response of two hybridised modes to single tones (Bartsch et al., arXiv:2412.07301):

    X(u) = A(u)^-1 (1, 1)^T,  A(u) = (2 pi)^2 (eta - u)(eta + u) + i 2 pi u D,
    D = T 2 pi diag(d) T^T

written here on its own, from the paper, so that the code under test is never its own judge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from fitting.campaign import (
    BoundCampaign,
    ContinuationSettings,
    Drive,
    Experiment,
    Setup,
    SweepData,
)
from fitting.campaign.parameters import Parameter
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import Evaluation
from fitting.measurements.sweep import Sweep
from fitting.signal.scale import Maximum
from fitting.text.arrays import FloatArray
from tests.support.datasets import SETUP, answer, dataset

#: Factor between the amplitudes of the laboratory and those of the model.
GAIN = 1e6
#: The five drive pairs of the paper's first series, MHz.
Q1_PAIRS_MHZ = (
    (6.94016, 6.94036),
    (6.94018, 6.94034),
    (6.94020, 6.94032),
    (6.94024, 6.94028),
    (6.94025, 6.94027),
)
#: The paper's reference angle, pi/2 + pi/8.
THETA_REFERENCE = np.pi / 2 + np.pi / 8


def damping(theta: float, d1: float, d2: float, reflection: bool) -> FloatArray:
    """T diag(d1, d2) T^T in Hz, shape (2, 2)."""
    c, s = np.cos(theta), np.sin(theta)
    t = np.array([[-c, s], [s, c]]) if reflection else np.array([[c, -s], [s, c]])
    product: FloatArray = t @ np.diag([d1, d2]) @ t.T
    return product


def amplitude(
    u_hz: npt.ArrayLike, eta_hz: tuple[float, float], d_hz: FloatArray, mode: int
) -> FloatArray:
    """|X_mode(u)| for tones u (any shape), eigenfrequencies eta and damping matrix d, all in Hz."""
    u = np.asarray(u_hz, dtype=float)
    a11, a22 = (
        (2 * np.pi) ** 2 * (eta - u) * (eta + u) + 1j * (2 * np.pi) ** 2 * u * d_hz[i, i]
        for i, eta in enumerate(eta_hz)
    )
    a12 = 1j * (2 * np.pi) ** 2 * u * d_hz[0, 1]
    determinant = a11 * a22 - a12 * a12
    numerator = (a22 - a12) if mode == 0 else (a11 - a12)
    result: FloatArray = np.abs(numerator / determinant)
    return result


@dataclass(frozen=True)
class ClosedFormResponse:
    """`Response` of the string: parameters (theta, d1, d2) in rad and Hz."""

    pairs_hz: tuple[tuple[float, float], ...]
    eta_plus_hz: tuple[float, ...]
    eta_minus_hz: tuple[float, ...]
    sweep_hz: FloatArray
    reflection: bool = False
    mode: int = 0
    with_sweep: bool = False
    held: dict[str, float] = field(default_factory=dict)
    calls: list[int] = field(default_factory=list, compare=False)

    def _model(self, p: FloatArray) -> FloatArray:
        free = [name for name in ("theta", "d1", "d2") if name not in self.held]
        values = dict(zip(free, map(float, p), strict=True)) | self.held
        return damping(values["theta"], values["d1"], values["d2"], self.reflection)

    def peaks(self, p: FloatArray) -> FloatArray:
        d = self._model(p)
        eta = zip(self.pairs_hz, self.eta_plus_hz, self.eta_minus_hz, strict=True)
        return np.concatenate([amplitude(u, (plus, minus), d, self.mode) for u, plus, minus in eta])

    def sweep(self, p: FloatArray) -> FloatArray:
        eta = (self.eta_plus_hz[0], self.eta_minus_hz[0])
        return amplitude(self.sweep_hz, eta, self._model(p), self.mode)

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        self.calls.append(len(ps))
        return [self._evaluate(p, whole=whole) for p in ps]

    def maximum(self, p: FloatArray) -> Maximum:
        """The top of the resonance, found by scipy's bounded minimisation of 1/A^2."""
        eta = (self.eta_plus_hz[0], self.eta_minus_hz[0])
        centre = eta[self.mode]
        d = self._model(p)
        found = minimize_scalar(
            lambda t: 1.0 / float(amplitude(centre + t, eta, d, self.mode)) ** 2,
            bounds=(-50.0, 50.0),
            method="bounded",
            options={"xatol": 1e-5},
        )
        top = float(amplitude(centre + found.x, eta, d, self.mode))
        return Maximum(value=top, frequency_hz=centre + float(found.x), bias=0.0, bracketed=True)

    def _evaluate(self, p: FloatArray, *, whole: bool) -> Evaluation:
        sweep = self.sweep(p) if whole or self.with_sweep else np.empty(0)
        return answer(self.peaks(p), sweep, self.maximum(p))

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [self._derived(p) for p in ps]

    def _derived(self, p: FloatArray) -> dict[str, FloatArray]:
        theta = float(np.asarray(p)[0])
        plus, minus = np.array(self.eta_plus_hz), np.array(self.eta_minus_hz)
        with np.errstate(invalid="ignore"):
            coupling = np.sqrt(-0.5 * np.sin(2 * theta) * (minus - plus) * (minus + plus))
        d = self._model(p)
        return {"lambda": coupling, "D11": np.full(len(plus), 2 * np.pi * d[0, 0])}


def string_response(
    *, mode: int = 0, reflection: bool = False, drift_hz: float = 0.0, with_sweep: bool = False
) -> ClosedFormResponse:
    """The paper's first series at eta = 6.94026/7.02760 MHz, eta+ drifting by drift_hz."""
    pairs = tuple((a * 1e6, b * 1e6) for a, b in Q1_PAIRS_MHZ)
    fractions = np.linspace(-0.5, 0.5, len(pairs))
    return ClosedFormResponse(
        pairs_hz=pairs,
        eta_plus_hz=tuple(6.94026e6 + drift_hz * fractions),
        eta_minus_hz=tuple(7.02760e6 + drift_hz * fractions),
        sweep_hz=6.94026e6 + np.linspace(-400.0, 400.0, 41),
        reflection=reflection,
        mode=mode,
        with_sweep=with_sweep,
    )


def string_parameters(
    *, theta: tuple[float, float, float, float] = (-2 * np.pi, 2 * np.pi, 0.0, THETA_REFERENCE)
) -> tuple[Parameter, ...]:
    """theta (lower, upper, start, reference) and two dampings around a measured 94 Hz width."""
    lower, upper, start, reference = theta
    return (
        Parameter(
            name="theta",
            unit="rad",
            lower=lower,
            upper=upper,
            start=start,
            reference=reference,
            scale=1.0,
            period=np.pi,
        ),
        Parameter(
            name="d1", unit="Hz", lower=40.0, upper=160.0, start=94.0, reference=94.0, scale=50.0
        ),
        Parameter(
            name="d2", unit="Hz", lower=40.0, upper=160.0, start=94.0, reference=94.0, scale=50.0
        ),
    )


def held(response: ClosedFormResponse, **values: float) -> ClosedFormResponse:
    """The same response with some model parameters held at values that no fit may change."""
    return replace(response, held=values)


def measured_by(
    response: ClosedFormResponse,
    truth: tuple[float, float, float] = (1.9498, 120.0, 90.0),
    *,
    noise: float = 0.0,
    seed: int = 1,
    scale: str = "maximum",
    fit_sweep: bool = False,
) -> Dataset:
    """What a laboratory with this response would measure; the true scale is `GAIN`."""
    generator = np.random.default_rng(seed)
    p = np.array(truth)
    z = response.peaks(p)
    peaks = GAIN * z * (1.0 + noise * generator.standard_normal(z.size))
    sweep = Sweep(
        setup=SETUP,
        frequency_hz=response.sweep_hz,
        amplitude_v=GAIN * response.sweep(p),
        fitted=fit_sweep,
        scaled_by=scale,
        maximum_v=GAIN * response.maximum(p).value,
    )
    return dataset(peaks, max(noise, 1e-9) * GAIN * z, sweep)


def measured_peaks(data: Dataset) -> FloatArray:
    """Measured amplitudes of all tones (n_peaks,)."""
    return np.concatenate([tones.peaks_v for tones in data.tones])


def string_campaign(data: Dataset, response: ClosedFormResponse, folder: Path) -> BoundCampaign:
    """A bound campaign with these data, as reading a campaign file would give it."""
    file = folder / "campaign.toml"
    file.write_text("# synthetic, made by a test\n")
    peaks_v, sigmas_v = measured_peaks(data), data.tones[0].sigmas_v
    [sweep] = [m for m in data.measurements if isinstance(m, Sweep)]
    experiments = tuple(
        Experiment(
            label=f"pair{m + 1}",
            settings={},
            tones_hz=pair,
            peaks_v=peaks_v[2 * m : 2 * m + 2],
            sigmas_v=sigmas_v[2 * m : 2 * m + 2],
            floor_v=0.0,
            spectrum=None,
        )
        for m, pair in enumerate(response.pairs_hz)
    )
    return BoundCampaign(
        title="string",
        path=file,
        synthetic=True,
        setup=Setup(
            drive=Drive(
                frequency_names=("u1", "u2"),
                amplitude_names=("A1", "A2"),
            ),
            output="q1_hybrid",
            steady_start=True,
            accuracy=1e-6,
            source=str(file),
        ),
        experiments=experiments,
        sweep=SweepData(
            frequency_hz=response.sweep_hz,
            amplitude_v=sweep.amplitude_v,
            phase_rad=None,
            settings={},
            use="scale",
            scale=sweep.scaled_by,
            source=file,
        ),
        parameters=string_parameters(),
        derived=("lambda", "D11"),
        alternatives=({"reflection": False}, {"reflection": True}),
        continuation=ContinuationSettings(),
        amplitude_unit="V",
        notes=(),
        files=(file,),
    )
