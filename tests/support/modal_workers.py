"""Two coupled modes in closed form, answering runs as workers of an FMU do: fast, and never exact.

The same equations as `CoupledOscillator`, written here on their own, so that hundreds of random
scenes can be driven; and what no linear FMU has: noise, and a response that depends on its size.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from fitting.campaign import Drive, Setup
from fitting.campaign.parameters import Parameter
from fitting.fmu.runs import Run
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.plan import Plan
from fitting.simulate.budget import Budget
from fitting.text.arrays import ComplexArray, FloatArray, Scalar

#: What a fit would vary; everything else is a setting.
FITTED = ("theta", "d1", "d2", "eta_plus", "eta_minus")
OUTPUTS = ("q1_hybrid", "q2_hybrid")


def phasors(values: Mapping[str, Scalar], u_hz: FloatArray, mode: int) -> ComplexArray:
    """A^-1(u) g A1 of one mode at single tones (m,), A = (eta - u)(eta + u) + i u D, in 1/Hz^2."""
    v = {name: float(value) for name, value in values.items()}
    c, s = math.cos(v["theta"]), math.sin(v["theta"])
    t = np.array([[c, -s], [s, c]])
    d = t @ np.diag([v["d1"], v["d2"]]) @ t.T
    first = (v["eta_plus"] - u_hz) * (v["eta_plus"] + u_hz) + 1j * u_hz * d[0, 0]
    second = (v["eta_minus"] - u_hz) * (v["eta_minus"] + u_hz) + 1j * u_hz * d[1, 1]
    beside = 1j * u_hz * d[0, 1]
    g1, g2 = v.get("g1", 1.0), v.get("g2", 1.0)
    top = second * g1 - beside * g2 if mode == 0 else first * g2 - beside * g1
    return np.asarray(v.get("A1", 1.0) * top / (first * second - beside**2))


@dataclass
class ModalWorkers:
    """Workers of the two modes, which count their `runs`.

    `noise` is relative, and new in every run; a setting `bend` makes the response nonlinear: the
    phasor is P (1 + bend |P|^2).
    """

    noise: float = 0.0
    seed: int = 1
    runs: int = 0

    def run(self, runs: Sequence[Run]) -> list[FloatArray]:
        rng = np.random.default_rng([self.seed, self.runs])
        self.runs += len(runs)
        return [self._samples(run, rng) for run in runs]

    def _samples(self, run: Run, rng: np.random.Generator) -> FloatArray:
        u = float(run.start_values["u1"])
        times = [run.settle_s + j * run.sample_step_s for j in range(run.samples)]
        turns = np.array([float(Fraction(u) * Fraction(t) % 1) for t in times])
        columns = []
        for name in run.outputs:
            [p] = phasors(run.start_values, np.array([u]), OUTPUTS.index(name))
            p *= 1.0 + float(run.start_values.get("bend", 0.0)) * abs(p) ** 2
            p *= 1.0 + self.noise * complex(rng.standard_normal(), rng.standard_normal())
            columns.append(np.real(p * np.exp(2j * np.pi * turns)))
        return np.stack(columns, axis=1)


def modal_model(
    start: Mapping[str, Scalar], *, output: str = "q1_hybrid", accuracy: float = 1e-6
) -> DrivenModel:
    """How the two modes are driven, with `FITTED` as parameters; nothing has to settle."""
    drive = Drive(frequency_names=("u1",), amplitude_names=("A1",))
    setup = Setup(drive, output, start_values=start, steady_start=True, accuracy=accuracy)
    parameters = tuple(
        Parameter(name=n, unit="", lower=0.0, upper=1e9, start=1.0, reference=1.0, scale=1.0)
        for n in FITTED
    )
    plan = Plan(0.0, budget=Budget(accuracy))
    return DrivenModel(setup=setup, parameters=parameters, plan=plan)


@dataclass(frozen=True)
class RandomScene:
    """A sweep of 1,001 points over what a laboratory may look at, and parameters about it.

    Q from 50 to 1e6, eigenfrequencies from 1 kHz to 10 MHz, lines a tenth of their width to a
    thousand widths apart, coupled by any angle; the sweep sees one of them, both, or a wing.
    """

    u_hz: FloatArray
    start: Mapping[str, Scalar]
    vectors: tuple[FloatArray, ...]
    output: str

    @property
    def mode(self) -> int:
        return OUTPUTS.index(self.output)

    def truth(self, p: FloatArray) -> ComplexArray:
        values = {**self.start, **dict(zip(FITTED, map(float, p), strict=True))}
        return phasors(values, self.u_hz, self.mode)


def random_scene(seed: int, *, vectors: int = 4) -> RandomScene:
    """The scene of a seed; the first of its parameter vectors is the one that a plan is made at."""
    rng = np.random.default_rng(seed)
    eta = 10.0 ** rng.uniform(3.0, 7.0)
    width = eta / 10.0 ** rng.uniform(math.log10(50.0), 6.0)
    split = min(width * 10.0 ** rng.uniform(-1.0, 3.0), 0.5 * eta)
    below, above, near = rng.uniform(2.0, 30.0), rng.uniform(2.0, 30.0), rng.uniform(1.0, 20.0)
    low, high = (
        (eta - below * width, eta + above * width),
        (eta - below * width, eta + split + above * width),
        (eta + near * width, eta + (near + above) * width),
    )[seed % 3]
    low, high = max(low, 0.2 * eta), min(high, 2.0 * eta)
    dampings = width * np.exp(rng.normal(0.0, 0.5, 2))
    first = np.array([rng.uniform(0.0, math.pi), *dampings, eta, eta + split])
    others = [
        np.array(
            [
                rng.uniform(0.0, math.pi),
                *(dampings * np.exp(rng.normal(0.0, 0.5, 2))),
                *(first[3:] + width * rng.normal(0.0, 1.0, 2)),
            ]
        )
        for _ in range(vectors - 1)
    ]
    return RandomScene(
        u_hz=np.linspace(low, high, 1001),
        start={"g2": float(rng.choice([1.0, 0.8, 0.0, -1.0]))},
        vectors=(first, *others),
        output=OUTPUTS[int(rng.integers(2))],
    )
