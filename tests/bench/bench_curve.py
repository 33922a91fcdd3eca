"""A sweep of 1,001 points from few runs: is the promise kept, and what does it save?

    python -m tests.bench.bench_curve [--scenes 300] [--noise 1e-11] [--before]

First random scenes in closed form (Q 50 to 1e6, coupled by any angle, sweeps that see one line, two
or a wing), each planned at one parameter vector and answered at four: nodes, runs, the largest
error against the truth over what was promised. Then a sweep of 1,001 points that is fitted through
CoupledOscillator by `ff.fit`, with its processor time, that of caller and worker together, and one
of 201 points through an oscillator in C, whose input the tool drives: several tones share a run
there, and in the next row none does. `--before` fits both by a run at every point as well. Exit
code 1 if a promise is not kept.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

import build_fmu
import fitting as ff
from fitting.measurements import response_curve
from fitting.measurements.response_curve import ResponseCurve, plan_curve
from fitting.simulate.batch import Batch
from fitting.text.arrays import Scalar
from tests.support.cfmu_build import build_c_fmu
from tests.support.modal_workers import ModalWorkers, modal_model, phasors, random_scene
from tests.support.processes import spent_s

WHOLE = 1001
#: The string's first mode as its sweep sees it; theta = 0 leaves d1 to it.
TRUTH: Mapping[str, Scalar] = {
    "theta": 0.0,
    "d1": 95.0,
    "d2": 100.0,
    "eta_plus": 6.94026e6,
    "eta_minus": 7.0276e6,
}
SPAN_HZ, TOP_V, NOISE_V = 500.0, 30e-6, 0.3e-6


def scenes(count: int, noise: float) -> bool:
    """A table of random scenes; whether all kept their promise."""
    degrees: Counter[str] = Counter()
    runs: Counter[int] = Counter()
    worst, planned, broken = 0.0, [], 0
    for seed in range(count):
        scene, workers = random_scene(seed), ModalWorkers(noise=noise, seed=seed)
        model = modal_model(scene.start, output=scene.output)
        first = np.abs(scene.truth(scene.vectors[0]))
        curve = ResponseCurve(model, output=scene.output)
        top = float(scene.u_hz[int(np.argmax(first))])
        plan = plan_curve(curve, scene.u_hz, scene.vectors[:1], workers, top)
        [found] = plan.curves
        planned.append(workers.runs)
        name = f"degree {len(found.supports_hz) - 1}" if found.is_interpolated else found.basis
        degrees[str(name)] += 1
        batch, model = Batch(), replace(model, plan=plan)
        answer = ResponseCurve(model, output=scene.output).predict(
            np.array(scene.vectors), scene.u_hz, batch
        )
        try:
            while True:
                next(answer)
                batch.simulate(workers)
        except StopIteration as ended:
            rows = ended.value
        for row, spent, p in zip(rows, batch.count(len(rows)), scene.vectors, strict=True):
            runs[int(spent)] += 1
            if spent >= WHOLE:
                continue  # what is simulated is as good as the runs
            exact = scene.truth(p)
            error = float(np.max(np.abs(row / exact - 1.0))) / found.tolerance
            worst, broken = max(worst, error), broken + (error > 1.0)
    print(f"{count} scenes, noise {noise:g}: {dict(sorted(degrees.items()))}")
    print(f"  runs of an evaluation of {WHOLE} points: {dict(sorted(runs.items()))}")
    print(f"  runs of a plan: {np.mean(planned):.0f} on average, at most {max(planned)}")
    print(f"  largest error over the promised one: {worst:.2g}; broken promises: {broken}")
    return broken == 0


def fitted(path: Path, misfit: str) -> str:
    """A row: runs, evaluations, processor time and result of one fit."""
    f = float(TRUTH["eta_plus"]) + np.linspace(-SPAN_HZ, SPAN_HZ, WHOLE)
    shape = np.abs(phasors(TRUTH, f, 0))
    noise = NOISE_V * np.random.default_rng(1).standard_normal(WHOLE)
    held = {name: TRUTH[name] for name in ("theta", "d2", "eta_minus")}
    begun = spent_s()
    with ff.Fmu(path, workers=1) as fmu:
        setup = ff.Setup(
            ff.Drive(frequency_names=("u1", "u2"), amplitude_names=("A1", "A2")),
            "q1_hybrid",
            start_values={**held, "periodic_start": True},
            steady_start=True,
        )
        sweep = ff.Sweep(setup, f, TOP_V * shape / np.max(shape) + noise, use="fit", scale="fit")
        parameters = [
            ff.Parameter("d1", 80.0, bounds=(1.0, 1000.0), unit="Hz"),
            ff.Parameter("eta_plus", 6.94024e6, bounds=(6.9398e6, 6.9407e6), scale=100.0),
        ]
        problem = ff.Problem(fmu, parameters, [sweep], noise=ff.Noise(absolute_v=NOISE_V))
        fit = ff.fit(problem, ff.Tikhonov(misfit=misfit), starts=1)
    cost = fit.result.evaluations
    return (
        f"{misfit:8} {cost.fmu_runs:8} runs {cost.objective:5} evaluations "
        f"{spent_s() - begun:7.1f} s  d1 {fit.x[0]:.4f} Hz, eta_plus {fit.x[1]:.4f} Hz"
    )


def driven(path: Path) -> str:
    """A row: runs, evaluations, processor time and result of a fit through a driven input."""
    mass, damping, stiffness, force = 1e-3, 1.0, 4e4, 2.5
    f = math.sqrt(stiffness / mass) / (2.0 * math.pi) + np.linspace(-500.0, 500.0, 201)
    w = 2.0 * math.pi * f
    shape = force / np.abs(stiffness - mass * w**2 + 1j * w * damping)
    noise = 0.003 * float(np.max(shape))
    begun = spent_s()
    with ff.Fmu(path, workers=1) as fmu:
        setup = ff.Setup(
            ff.Drive(input="force", amplitude=force, samples_per_period=40), "displacement"
        )
        measured = shape + noise * np.random.default_rng(1).standard_normal(f.size)
        sweep = ff.Sweep(setup, f, measured, use="fit", scale="fit")
        parameters = [
            ff.Parameter("damping", 0.8, bounds=(0.1, 10.0), unit="N.s/m"),
            ff.Parameter("stiffness", 3.99e4, bounds=(3.9e4, 4.1e4), unit="N/m", scale=100.0),
        ]
        problem = ff.Problem(fmu, parameters, [sweep], noise=ff.Noise(absolute_v=noise))
        fit = ff.fit(problem, ff.Tikhonov(misfit="squares"), starts=1)
    cost = fit.result.evaluations
    return (
        f"{cost.fmu_runs:8} runs {cost.objective:5} evaluations {spent_s() - begun:7.1f} s  "
        f"damping {fit.x[0]:.5f} N.s/m, stiffness {fit.x[1]:.2f} N/m"
    )


def by_input(folder: Path, before: bool) -> None:
    """The table of the driven input."""
    path, worth = build_c_fmu(folder), response_curve.WORTH
    print("a sweep of 201 points through an input that is held over 40 steps in a period")
    print(f"  few runs of several tones  {driven(path)}")
    response_curve.WORTH = 0.0
    print(f"  few runs of single tones   {driven(path)}")
    response_curve.WORTH = worth
    if before:
        response_curve.LEAST_POINTS = WHOLE + 1
        print(f"  every point                {driven(path)}")


def main() -> int:
    """All tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--noise", type=float, default=1e-11)
    parser.add_argument("--before", action="store_true")
    args = parser.parse_args()
    kept = [scenes(args.scenes, noise) for noise in (0.0, args.noise)]
    with tempfile.TemporaryDirectory() as folder:
        path = build_fmu.build("CoupledOscillator", Path(folder))
        fitted(path, "squares")  # what is loaded once for all is no part of a fit
        print(f"a sweep of {WHOLE} points through ff.fit, processor time of caller and worker")
        for misfit in ("squares", "slack"):
            print(f"  few runs    {fitted(path, misfit)}")
        by_input(Path(folder), args.before)
        if args.before:
            response_curve.LEAST_POINTS = WHOLE + 1
            for misfit in ("squares", "slack"):
                print(f"  every point {fitted(path, misfit)}")
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())
