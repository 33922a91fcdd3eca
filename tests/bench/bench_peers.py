"""The task that other programs were given: theta, d1 and d2 of the string from a noise-free trace.

    python -m tests.bench.bench_peers

A string at rest is driven by a chirp that a generator holds from sample to sample; its first string
is seen. The trace comes from the matrix exponential, not from the FMU. Printed are the largest
relative error and what the fit takes of processor time, its worker's included; reading, loading and
building the FMU are not counted.
"""

from __future__ import annotations

import resource
import tempfile
from pathlib import Path

import numpy as np

import build_fmu
import fitting as ff
from tests.support.linear_traces import held_response, string

TRUTH = {"theta": 1.95, "d1": 3.0, "d2": 1.2}
START = {"theta": 1.8, "d1": 4.0, "d2": 2.0}
BOUNDS = {"theta": (1.58, 3.1), "d1": (0.3, 20.0), "d2": (0.3, 20.0)}
ETA = (100.0, 106.0)
#: Smooth least squares; at the second level the prior weighs 1e-10.
METHOD = ff.Tikhonov(nu=1e-6, beta=1e-4, levels=2, misfit="squares")


def problem(fmu: ff.Fmu) -> ff.Problem:
    """Both strings at rest under a chirp, seen at the first, 400 samples without noise."""
    t = np.linspace(0.0, 0.9975, 400)
    u = ff.Chirp(start_hz=80.0, stop_hz=125.0, length_s=0.8, level=100.0).at(t)
    theta = TRUTH["theta"]
    seen = (np.cos(theta), np.sin(theta))
    y = held_response(string(theta, TRUTH["d1"], TRUTH["d2"], ETA, seen), u, 2.5e-3)
    still = {"A1": 0.0, "A2": 0.0, "eta_plus": ETA[0], "eta_minus": ETA[1]}
    trace = ff.Trace(
        t,
        y,
        setup=ff.Setup(ff.Drive(), "q1", start_values=still),
        input="b",
        driven=(t, u),
        interpolation="held",
        unit="m",
    )
    parameters = [ff.Parameter(n, START[n], bounds=BOUNDS[n]) for n in TRUTH]
    return ff.Problem(fmu, parameters, trace)


def processor_s() -> float:
    """Processor time of this process and of those of its children that have ended, s."""
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(each.ru_utime + each.ru_stime for each in both)


def solved(path: Path) -> tuple[float, float]:
    """Largest relative error, and processor time of the fit with its worker, s."""
    begun = processor_s()
    with ff.Fmu(path, workers=1) as fmu:
        fit = ff.fit(problem(fmu), method=METHOD, starts=1)
    spent = processor_s() - begun
    errors = [abs(fit[name].value / true - 1.0) for name, true in TRUTH.items()]
    return max(errors), spent


def main() -> None:
    """With the native FMU and the one in Python; the first fit of a process loads libraries."""
    with tempfile.TemporaryDirectory() as folder:
        native = build_fmu.build("CoupledOscillator", Path(folder) / "native", native=())
        python = build_fmu.build("CoupledOscillator", Path(folder) / "python")
        for name, path in (("native, first", native), ("native", native), ("Python", python)):
            error, spent = solved(path)
            print(f"{name}: largest relative error {error:.1e}, {spent:.2f} s of processor time")


if __name__ == "__main__":
    main()
