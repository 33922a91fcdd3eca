"""Coverage of the intervals of traces: steps of first order and ringdowns, noise from seeds.

    python -m tests.bench.bench_traces [LABORATORIES] [--own-steps]

Truth comes from closed forms, the matrix exponential and scipy's integrator; the noise is told by
the residuals alone.
"""

from __future__ import annotations

import itertools
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import build_fmu
import fitting as ff
from fitting.text.arrays import FloatArray
from tests.support.cfmu_build import (
    build_c_fmu,
    build_euler_lag_fmu,
    build_lag_fmu,
    build_reference_fmu,
)
from tests.support.linear_traces import held_response, oscillator, string

QUICK = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
#: Steps of Euler's method of an FMU's own, s.
OWN_STEPS_S = (0.002, 0.01, 0.05)
Truth = dict[str, float]
Laboratory = tuple[ff.Problem, Truth]
Maker = Callable[[ff.Fmu, np.random.Generator], Laboratory]


def step(fmu: ff.Fmu, rng: np.random.Generator) -> Laboratory:
    """Step response of first order, 2 % noise."""
    return step_response(fmu, rng, 0.04)


def quiet_step(fmu: ff.Fmu, rng: np.random.Generator) -> Laboratory:
    """Step response of first order, 0.1 % noise: less than an FMU by Euler's method is off by."""
    return step_response(fmu, rng, 0.002)


def step_response(fmu: ff.Fmu, rng: np.random.Generator, sigma: float) -> Laboratory:
    """Step response of first order by its closed form, with noise."""
    t = np.linspace(0.0, 1.99, 200)
    u = np.where(t >= 0.1, 1.0, 0.0)
    y = 2.0 * -np.expm1(-np.maximum(t - 0.1, 0.0) / 0.3) + sigma * rng.standard_normal(t.size)
    setup = ff.Setup(ff.Drive(), "y")
    trace = ff.Trace(t, y, setup=setup, input="u", driven=(t, u), interpolation="held")
    parameters = [
        ff.Parameter("tau", 0.5, bounds=(0.05, 2.0)),
        ff.Parameter("gain", 1.0, bounds=(0.1, 10.0)),
    ]
    return ff.Problem(fmu, parameters, trace), {"tau": 0.3, "gain": 2.0}


@dataclass(frozen=True, kw_only=True)
class Decay:
    """x' = -k x of the Reference FMU Dahlquist by its closed form, 0.1 % noise, 5 s."""

    begun: float
    k: float
    spacing_s: float

    @property
    def __name__(self) -> str:
        """What the answer is called."""
        return f"Dahlquist, k = {self.k:g} from {self.begun:g}, {self.spacing_s:g} s apart"

    def __call__(self, fmu: ff.Fmu, rng: np.random.Generator) -> Laboratory:
        """One of them, and what it was made of."""
        t = self.spacing_s * np.arange(round(5.0 / self.spacing_s) + 1)
        y = 2.0 * np.exp(-self.k * t) + 0.002 * rng.standard_normal(t.size)
        trace = ff.Trace(t, y, setup=ff.Setup(ff.Drive(), "x"), unit="")
        parameters = [
            ff.Parameter("k", self.begun, bounds=(0.05, 9.0)),
            ff.Parameter("x", 1.0, bounds=(0.1, 10.0)),
        ]
        return ff.Problem(fmu, parameters, trace), {"k": self.k, "x": 2.0}


@dataclass(frozen=True, kw_only=True)
class Relaxation:
    """x'' = mu (1 - x^2) x' - x of the Reference FMU VanDerPol, 1 % noise, 20 samples a second."""

    begun: float
    mu: float
    length_s: float

    @property
    def __name__(self) -> str:
        """What the answer is called."""
        return f"VanDerPol, mu = {self.mu:g} from {self.begun:g}, {self.length_s:g} s"

    @cached_property
    def clean(self) -> tuple[FloatArray, FloatArray]:
        """Times and values."""
        t = np.linspace(0.0, self.length_s, round(20.0 * self.length_s) + 1)
        found = solve_ivp(
            lambda _, x: (x[1], self.mu * (1.0 - x[0] ** 2) * x[1] - x[0]),
            (0.0, self.length_s),
            (2.0, 0.0),
            t_eval=t,
            rtol=1e-10,
            atol=1e-12,
        )
        return t, found.y[0]

    def __call__(self, fmu: ff.Fmu, rng: np.random.Generator) -> Laboratory:
        """One of them, and what it was made of."""
        t, clean = self.clean
        y = clean + 0.02 * rng.standard_normal(t.size)
        trace = ff.Trace(t, y, setup=ff.Setup(ff.Drive(), "x0"), unit="")
        parameter = ff.Parameter("mu", self.begun, bounds=(0.1, 5.0))
        return ff.Problem(fmu, parameter, trace), {"mu": self.mu}


#: Decays and relaxations through Reference FMUs.
DECAYS = (
    Decay(begun=1.0, k=1.3, spacing_s=0.1),
    Decay(begun=1.0, k=1.3, spacing_s=0.02),
    Decay(begun=1.0, k=1.3, spacing_s=0.25),
    Decay(begun=0.2, k=4.0, spacing_s=0.1),
    Decay(begun=8.0, k=0.3, spacing_s=0.1),
)
RELAXATIONS = (
    Relaxation(begun=1.0, mu=0.5, length_s=20.0),
    Relaxation(begun=1.0, mu=1.2, length_s=20.0),
    Relaxation(begun=1.0, mu=1.2, length_s=200.0),
    Relaxation(begun=1.0, mu=2.0, length_s=20.0),
    Relaxation(begun=2.7, mu=3.0, length_s=60.0),
    Relaxation(begun=4.2, mu=4.5, length_s=20.0),
    Relaxation(begun=4.2, mu=4.5, length_s=60.0),
)


def ringdown(fmu: ff.Fmu, rng: np.random.Generator) -> Laboratory:
    """Two decay times of one mode of Q = 100, unknown start and gain, an offset, 2 % noise."""
    t = np.linspace(0.0, 0.2, 401)
    start = (float(rng.standard_normal()), 2e3 * float(rng.standard_normal()))
    matrices = oscillator(1e-3, 2e-2, 4e3)
    clean: FloatArray = held_response(matrices, np.zeros(t.size), 5e-4, start=start)
    y = 1.0 + clean + 0.02 * float(np.max(np.abs(clean))) * rng.standard_normal(t.size)
    setup = ff.Setup(ff.Drive(), "displacement")
    trace = ff.Trace(t, y, setup=setup, input="force", start="unknown", offset=True, unit="m")
    parameters = [
        ff.Parameter("damping", 2.5e-2, bounds=(0.005, 0.1)),
        ff.Parameter("stiffness", 3.99e3, bounds=(3.8e3, 4.2e3)),
    ]
    return ff.Problem(fmu, parameters, trace), {"damping": 2e-2, "stiffness": 4e3}


@dataclass(frozen=True, kw_only=True)
class LetGo:
    """One mode, or two that beat, of one quality over some decay times; 400 samples, 2 % noise.

    Their start, gain and offset are unknown. Samples are further apart than periods where the
    quality is high: the solver of the FMU is exact at any step.
    """

    quality: float
    decays: float
    modes: int

    @property
    def __name__(self) -> str:
        """What the answer is called."""
        return f"{self.modes} modes, Q = {self.quality:.0e}, {self.decays:g} decay times"

    def __call__(self, fmu: ff.Fmu, rng: np.random.Generator) -> Laboratory:
        """One of them, and what it was made of."""
        width, length = 1e3 / self.quality, self.decays * self.quality / (1e3 * np.pi)
        two = self.modes == 2
        theta = 1.2 if two else 0.0
        known = {
            "eta_plus": 1e3,
            "d1": width,
            "eta_minus": 1e3 + 4.0 * width,
            "d2": 1.3 * width,
        }
        t = np.linspace(0.0, 0.987 * length, 400)
        matrices = string(
            theta, width, 1.3 * width, (1e3, known["eta_minus"]), (np.cos(theta), np.sin(theta))
        )
        start = (*rng.standard_normal(2), *(6e3 * rng.standard_normal(2)))
        clean = held_response(matrices, np.zeros(t.size), t[1], start=start)
        y = 1.0 + clean + 0.02 * float(np.max(np.abs(clean))) * rng.standard_normal(t.size)
        truth = known if two else {name: known[name] for name in ("eta_plus", "d1")}
        still = {"A1": 0.0, "A2": 0.0, "theta": theta}
        still |= {name: value for name, value in known.items() if name not in truth}
        setup = ff.Setup(ff.Drive(), "q1" if two else "q1_hybrid", start_values=still)
        trace = ff.Trace(
            t,
            y,
            setup=setup,
            input="b",
            start="unknown",
            states=2 * self.modes,
            offset=True,
            unit="m",
        )
        parameters = [
            ff.Parameter(name, x + 0.1 * width, bounds=(x - width, x + width), unit="Hz")
            if name.startswith("eta")
            else ff.Parameter(name, 1.2 * x, bounds=(0.1 * x, 6.0 * x), unit="Hz")
            for name, x in truth.items()
        ]
        return ff.Problem(fmu, parameters, trace), truth


def coverage(fmu: ff.Fmu, laboratory: Maker, count: int) -> None:
    """Print how often 95 % intervals hold the truth, and the spread of the deviations."""
    inside: dict[str, list[bool]] = {}
    deviations: dict[str, list[float]] = {}
    for seed in range(count):
        problem, truth = laboratory(fmu, np.random.default_rng(seed))
        fit = ff.fit(problem, method=QUICK, starts=1)
        for name, true in truth.items():
            value = fit[name]
            low, high = value.interval()
            inside.setdefault(name, []).append(low <= true <= high)
            deviations.setdefault(name, []).append((value.value - true) / value.std)
    for name, held in inside.items():
        spread = float(np.sqrt(np.mean(np.square(deviations[name]))))
        print(
            f"{laboratory.__name__}: {name}: {sum(held)} of {count} intervals hold the truth "
            f"({100.0 * sum(held) / count:.1f} %); rms of deviation over error {spread:.2f}"
        )


def steps(folder: Path, count: int) -> None:
    """FMUs that advance in steps of their own."""
    for heun in (False, True):
        for own_s in OWN_STEPS_S:
            print(f"steps of {own_s:g} s by {'Heun' if heun else 'Euler'}'s method:")
            with ff.Fmu(build_euler_lag_fmu(folder, own_s, heun=heun), workers=1) as fmu:
                coverage(fmu, quiet_step, count)
    named: tuple[tuple[str, Sequence[Maker]], ...] = (
        ("Dahlquist", DECAYS),
        ("VanDerPol", RELAXATIONS),
    )
    for name, laboratories in named:
        path = build_reference_fmu(folder, name)
        with ff.Fmu(path, workers=1, interface="co-simulation") as fmu:
            for laboratory in laboratories:
                coverage(fmu, laboratory, count)


def main() -> None:
    """All kinds of traces, or those through FMUs with steps of their own."""
    words = [word for word in sys.argv[1:] if word != "--own-steps"]
    count = int(words[0]) if words else 200
    if len(words) < len(sys.argv) - 1:
        with tempfile.TemporaryDirectory() as folder:
            steps(Path(folder), count)
        return
    with tempfile.TemporaryDirectory() as folder:
        with ff.Fmu(build_lag_fmu(Path(folder)), workers=1) as fmu:
            coverage(fmu, step, count)
        steps(Path(folder), count)
        with ff.Fmu(build_c_fmu(Path(folder)), workers=1) as fmu:
            coverage(fmu, ringdown, count)
        path = build_fmu.build("CoupledOscillator", Path(folder))
        with ff.Fmu(path, workers=1) as fmu:
            for quality, decays, modes in itertools.product((1e3, 1e8), (1.0, 10.0), (1, 2)):
                coverage(fmu, LetGo(quality=quality, decays=decays, modes=modes), count)


if __name__ == "__main__":
    main()
