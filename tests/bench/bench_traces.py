"""Coverage of the intervals of traces: steps of first order and ringdowns, noise from seeds.

    python -m tests.bench.bench_traces [LABORATORIES]

Truth comes from closed forms and the matrix exponential; the noise is told by the residuals alone.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

import fitting as ff
from fitting.text.arrays import FloatArray
from tests.support.cfmu_build import build_c_fmu, build_lag_fmu
from tests.support.linear_traces import held_response, oscillator

QUICK = ff.Tikhonov(nu=1e-6, levels=1, misfit="squares")
Truth = dict[str, float]
Laboratory = tuple[ff.Problem, Truth]


def step(fmu: ff.Fmu, rng: np.random.Generator) -> Laboratory:
    """Step response of first order, 2 % noise."""
    t = np.linspace(0.0, 1.99, 200)
    u = np.where(t >= 0.1, 1.0, 0.0)
    y = 2.0 * -np.expm1(-np.maximum(t - 0.1, 0.0) / 0.3) + 0.04 * rng.standard_normal(t.size)
    setup = ff.Setup(ff.Drive(), "y")
    trace = ff.Trace(t, y, setup=setup, input="u", driven=(t, u), interpolation="held")
    parameters = [
        ff.Parameter("tau", 0.5, bounds=(0.05, 2.0)),
        ff.Parameter("gain", 1.0, bounds=(0.1, 10.0)),
    ]
    return ff.Problem(fmu, parameters, trace), {"tau": 0.3, "gain": 2.0}


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


def coverage(
    fmu: ff.Fmu, laboratory: Callable[[ff.Fmu, np.random.Generator], Laboratory], count: int
) -> None:
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


def main() -> None:
    """Both kinds of traces."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    with tempfile.TemporaryDirectory() as folder:
        with ff.Fmu(build_lag_fmu(Path(folder)), workers=1) as fmu:
            coverage(fmu, step, count)
        with ff.Fmu(build_c_fmu(Path(folder)), workers=1) as fmu:
            coverage(fmu, ringdown, count)


if __name__ == "__main__":
    main()
