"""One Lorentzian line with additive noise: what can be known of it has a closed form.

    a(f) = A/sqrt(1 + x^2), x = 2 (f - eta)/w, at points df apart with noise sigma each

Fisher's information over all frequencies, integrals instead of sums: with int x^2/(1+x^2)^3 = pi/8,
int x^4/(1+x^2)^3 = 3 pi/8, int x^2/(1+x^2)^2 = pi/2, int 1/(1+x^2) = pi, each times w/(2 df):

    var eta = (sigma/A)^2 4 w df/pi                                 (nothing is tied to it)
    var w   = (sigma/A)^2 16 w df/pi                                (A fitted too: 3/8 - 1/4 = 1/8)
    var A   = sigma^2 6 df/(pi w)                                   (w fitted too: 1 - 2/3 = 1/3)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fitting.campaign.parameters import Parameter
from fitting.fit.objective import Objective, make_objective
from fitting.measurements.measurement import Evaluation
from tests.support.datasets import answer, dataset

ETA_HZ, WIDTH_HZ, TOP = 1000.0, 8.0, 2.0


@dataclass(frozen=True)
class LineResponse:
    """`Response` of one line: parameters (eta, w, A); output Q = eta/w."""

    tones_hz: np.ndarray

    def peaks(self, p: np.ndarray) -> np.ndarray:
        eta, width, top = p[:3]
        return np.asarray(top / np.sqrt(1.0 + (2.0 * (self.tones_hz - eta) / width) ** 2))

    def evaluate_many(self, ps: Sequence[np.ndarray], *, whole: bool = False) -> list[Evaluation]:
        return [answer(self.peaks(p), runs=1) for p in ps]

    def derived_many(self, ps: Sequence[np.ndarray]) -> list[dict[str, np.ndarray]]:
        return [{"Q": np.array([p[0] / p[1]])} for p in ps]


def line_parameters(*, prior_hz: float | None = None) -> tuple[Parameter, ...]:
    """eta, w and A in wide boxes; if wanted, eta with a Gaussian prior one sigma off the truth."""
    centre = ETA_HZ if prior_hz is None else ETA_HZ + prior_hz
    eta = Parameter(
        name="eta",
        unit="Hz",
        lower=900.0,
        upper=1100.0,
        start=1000.5,
        reference=centre,
        scale=10.0,
        prior=prior_hz,
    )
    return (
        eta,
        Parameter(name="w", unit="Hz", lower=1.0, upper=40.0, start=9.0, reference=9.0, scale=5.0),
        Parameter(name="A", unit="V", lower=0.1, upper=10.0, start=1.0, reference=1.0, scale=1.0),
    )


def line_objective(
    *,
    sigma: float = 0.02,
    seed: int | None = None,
    span: float = 60.0,
    per_width: int = 3,
    prior_hz: float | None = None,
) -> Objective:
    """The line measured at points w/per_width apart over +- span widths; exact without a seed."""
    half = int(span * per_width)
    tones = ETA_HZ + WIDTH_HZ / per_width * np.arange(-half, half + 1)
    response = LineResponse(tones)
    exact = response.peaks(np.array([ETA_HZ, WIDTH_HZ, TOP]))
    data = exact
    if seed is not None:
        noise = np.random.default_rng(seed).standard_normal(tones.size)
        data = exact + sigma * noise
    measured = dataset(data, np.full(tones.size, sigma))
    return make_objective(response, line_parameters(prior_hz=prior_hz), measured)


def bounds_of(sigma: float, per_width: int) -> dict[str, float]:
    """Cramér and Rao's bound on the standard deviation of eta, w and A (see the module)."""
    step = WIDTH_HZ / per_width
    return {
        "eta": sigma / TOP * math.sqrt(4.0 * WIDTH_HZ * step / math.pi),
        "w": sigma / TOP * math.sqrt(16.0 * WIDTH_HZ * step / math.pi),
        "A": sigma * math.sqrt(6.0 * step / (math.pi * WIDTH_HZ)),
    }
