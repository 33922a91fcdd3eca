"""Coverage and bias of notches and reflections, and the time of 1,001 complex points.

    python -m tests.bench.bench_wiring                     # 200 laboratories of each kind
    python -m tests.bench.bench_wiring --laboratories 20

Every laboratory is a closed form that is not the FMU: a mode beside a line, behind a gain, a delay
and a sloping baseline, with noise on each quadrature. It is fitted through the FMU, and the table
tells how often the 95 % intervals of eigenfrequency, loaded and coupling quality hold the truth,
and how far values are off on average, in standard deviations.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

import fitting as ff
from fitting.api.fmu import Fmu
from fitting.campaign import Setup
from fitting.text.arrays import ComplexArray, FloatArray, Scalar
from tests.support.complex_data import notch, with_noise
from tests.support.processes import spent_s

ETA = 5e6
START: dict[str, Scalar] = {
    "periodic_start": True,
    "theta": 0.0,
    "g2": 0.0,
    "d2": 100.0,
    "eta_minus": 6e6,
    "u2": 5.5e6,
}
DRIVE = ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2"))
SETUP = Setup(DRIVE, "q1_hybrid", start_values=START, steady_start=True)
METHOD = ff.Tikhonov(nu=1e-6, beta=0.01, levels=2, misfit="squares")
NAMES = ("frequency", "loaded Q", "coupling Q")


@dataclass(frozen=True, kw_only=True)
class Laboratory:
    """One resonance of known qualities, measured at `u_hz` as `values`; `kind` of wiring."""

    kind: str
    eta_hz: float
    loaded_q: float
    coupling_q: float
    u_hz: FloatArray
    values: ComplexArray


def laboratory(kind: str, seed: int, points: int = 101) -> Laboratory:
    """A seeded resonance: qualities, phase of the coupling, gain, delay, slope and noise.

    Args:
        kind: "notch" or "reflection".
        seed: of everything.
        points: number of frequencies.
    """
    rng = np.random.default_rng(seed)
    width = float(rng.uniform(500.0, 1200.0))
    eta = ETA + float(rng.uniform(-200.0, 200.0))
    q, phi = eta / width, float(rng.uniform(-0.6, 0.6))
    coupling = q * float(rng.uniform(1.3, 3.0)) * np.exp(-1j * phi)
    twice = 2.0 if kind == "reflection" else 1.0
    u = ETA + np.linspace(-6.0, 6.0, points) * width
    dip = notch(u, eta, q, coupling / twice)
    slope = 0.05 * complex(*rng.standard_normal(2)) * (u - ETA) / np.ptp(u)
    gain = rng.uniform(0.1, 1.0) * np.exp(2j * np.pi * rng.uniform())
    exact = gain * (dip + slope) * np.exp(-2j * np.pi * u * rng.uniform(-0.5, 3.0) / np.ptp(u))
    values = with_noise(exact, abs(gain) * float(rng.uniform(0.003, 0.02)), seed + 1000)
    return Laboratory(
        kind=kind,
        eta_hz=eta,
        loaded_q=q,
        coupling_q=float(1.0 / np.real(1.0 / coupling)),
        u_hz=u,
        values=values,
    )


def problem_of(lab: Laboratory, fmu: Fmu) -> ff.Problem:
    """The laboratory's sweep beside the FMU, with the delay fitted.

    Args:
        lab: with its sweep.
        fmu: CoupledOscillator.
    """
    wiring = ff.Wiring(kind=lab.kind, background="slope")
    curve = ff.ComplexCurve(lab.u_hz, lab.values, delay_s=None, wiring=wiring, unit="1")
    reach = float(np.ptp(lab.u_hz)) / 4.0
    parameters = [
        ff.Parameter("eta_plus", ETA, bounds=(ETA - reach, ETA + reach), scale=100.0),
        ff.Parameter("d1", 700.0, bounds=(50.0, 10000.0), scale=100.0),
    ]
    return ff.Problem(fmu, parameters, ff.ComplexSweep(SETUP, curve), derived="Q_plus")


def deviations(lab: Laboratory, fmu: Fmu) -> FloatArray:
    """Value minus truth of `NAMES`, in standard deviations; of qualities in logarithms, (3,).

    Args:
        lab: with its truth.
        fmu: CoupledOscillator.
    """
    found = ff.fit(problem_of(lab, fmu), method=METHOD, starts=1)
    inferred = found.inferred
    [coupling] = [q for q in inferred.quadratures.qualities if q.name == "Q_coupling"]
    eta, loaded = inferred.parameters["eta_plus"], inferred.derived["Q_plus"]
    return np.array(
        [
            (eta.value - lab.eta_hz) / eta.std,
            (loaded.value - lab.loaded_q) / loaded.std,
            np.log(coupling.value / lab.coupling_q) * coupling.value / coupling.std,
        ]
    )


def table(kind: str, count: int, fmu: Fmu) -> list[str]:
    """Lines that tell coverage and bias over laboratories of a kind.

    Args:
        kind: "notch" or "reflection".
        count: number of laboratories.
        fmu: CoupledOscillator.
    """
    apart = np.array([deviations(laboratory(kind, seed), fmu) for seed in range(count)])
    lines = [f"{kind}, {count} laboratories: value  covered by 95 %  mean  scatter (sigma)"]
    for name, column in zip(NAMES, apart.T, strict=True):
        held = np.mean(np.abs(column) < 1.959964)
        lines.append(
            f"  {name:12s} {100.0 * held:5.1f} %  {np.mean(column):+.3f}  {np.std(column):.3f}"
        )
    return lines


def main() -> None:
    """Print both tables, and the processor time of 1,001 points."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--laboratories", type=int, default=200)
    count = parser.parse_args().laboratories
    fmu = Fmu("CoupledOscillator", workers=1)
    for kind in ("notch", "reflection"):
        print("\n".join(table(kind, count, fmu)), flush=True)
    fmu.close()
    lab = laboratory("notch", 1, points=1001)
    begun, own = spent_s(), time.process_time()
    with Fmu("CoupledOscillator", workers=1) as fmu:  # a worker's time is known when it has ended
        found = ff.fit(problem_of(lab, fmu), method=METHOD, starts=1)
    print(
        f"1,001 points: {spent_s() - begun:.2f} s of processor time with the FMU and its start, "
        f"{time.process_time() - own:.2f} s of it here, {found.record.cost}"
    )


if __name__ == "__main__":
    main()
