"""The nine levels of Algorithm 2 on the q1 series as a plain script: fmpy, numpy, scipy, no more.

    python tests/support/hosts/plain_path.py CoupledOscillator.fmu series.json

`series.json` is what `bench_path` writes: peaks, tones, eigenfrequencies, bounds, weights of every
level. Amplitudes are those of the FMU's own lock-in, at one initialisation a run; the maximum of
the sweep is that of a parabola through three points. Slopes are forward differences, in which a
frequency offset moves one pair alone. Each level is scipy's trust-constr with slacks and all its
tolerances, 40 iterates at most, from the level before. Prints a line of JSON.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from scipy.optimize import Bounds, NonlinearConstraint, minimize
from scipy.sparse import block_array, csr_array, diags_array, eye_array

BEGUN = time.process_time()
FMU, DATA = sys.argv[1], json.loads(Path(sys.argv[2]).read_text())
SHARED = 3  # theta, d1, d2; the rest are offsets, one for each pair
TONES, ETAS = np.array(DATA["tones_hz"]), np.array(DATA["etas_hz"])
MEASURED, SWEEP = np.array(DATA["peaks_v"]), np.array(DATA["sweep_eta_hz"])
SCALE, REFERENCE = np.array(DATA["scale"]), np.array(DATA["reference"])
LOWER, UPPER = np.array(DATA["lower"]), np.array(DATA["upper"])
STEPS = np.array(DATA["steps"])

folder = extract(FMU)
model = read_model_description(folder)
number = {v.name: v.valueReference for v in model.modelVariables}
slave = FMU2Slave(
    guid=model.guid,
    unzipDirectory=folder,
    modelIdentifier=model.coSimulation.modelIdentifier,
)
slave.instantiate()
INPUTS = [number[n] for n in ("theta", "d1", "d2", "eta_plus", "eta_minus", "u1", "u2")]
LOCK_IN = [number[f"q1_hybrid_{part}_u{k}"] for k in (1, 2) for part in "XY"]
AMPLITUDES = [number["A1"], number["A2"]]
runs = 0


def lock_in(p: np.ndarray, eta: np.ndarray, tones: np.ndarray) -> np.ndarray:
    """Amplitudes of q1 at two tones, (2,)."""
    global runs
    runs += 1
    if runs > 1:
        slave.reset()
    slave.setupExperiment(startTime=0.0)
    slave.setReal(INPUTS + AMPLITUDES, [*p[:SHARED], *eta, *tones, 1.0, 1.0])
    slave.setBoolean([number["periodic_start"]], [True])
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    x1, y1, x2, y2 = slave.getReal(LOCK_IN)
    slave.terminate()
    return np.hypot([x1, x2], [y1, y2])


def top(p: np.ndarray) -> float:
    """Maximum of the simulated sweep: 1/|z|^2 of a line is a parabola."""
    off = np.array([-22.5, 0.0, 22.5])
    f = SWEEP[0] + off
    z = np.array([*lock_in(p, SWEEP, f[:2]), lock_in(p, SWEEP, f[1:])[1]])
    a, b, c = np.polyfit(off, z**-2, 2)
    return float((c - b**2 / (4.0 * a)) ** -0.5)


def pair(p: np.ndarray, k: int) -> np.ndarray:
    return lock_in(p, ETAS[k] + p[SHARED + k], TONES[k])


def parts(x: np.ndarray) -> tuple[float, np.ndarray]:
    p = REFERENCE + SCALE * x
    return top(p), np.array([pair(p, k) for k in range(len(TONES))])


def rows(maximum: float, z: np.ndarray) -> np.ndarray:
    return np.ravel(DATA["maximum_v"] / maximum * z / MEASURED - 1.0)


known: dict[bytes, tuple[float, np.ndarray]] = {}
slopes_known: dict[bytes, np.ndarray] = {}


def at(x: np.ndarray) -> tuple[float, np.ndarray]:
    key = x.tobytes()
    if key not in known:
        known.clear()
        known[key] = parts(x)
    return known[key]


def slopes(x: np.ndarray) -> np.ndarray:
    key = x.tobytes()
    if key not in slopes_known:
        maximum, z = at(x)
        here, columns = rows(maximum, z), []
        for i, step in enumerate(STEPS):
            step = step if x[i] + step <= UPPER[i] else -step
            moved = x.copy()
            moved[i] += step
            if i < SHARED:
                there = parts(moved)
            else:
                one = z.copy()
                one[i - SHARED] = pair(REFERENCE + SCALE * moved, i - SHARED)
                there = maximum, one
            columns.append((rows(*there) - here) / step)
        slopes_known.clear()
        slopes_known[key] = np.column_stack(columns)
    return slopes_known[key]


def level(start: np.ndarray, nu: np.ndarray) -> tuple[np.ndarray, float, int]:
    """The lowest iterate, J there, and iterations."""
    n, m = start.size, MEASURED.size
    margin = 1e-3 * np.minimum(UPPER - LOWER, 1.0)
    x0 = np.clip(start, LOWER + margin, UPPER - margin)
    j = lambda x: float(np.sum(np.abs(rows(*at(x)))) + 0.5 * np.sum(nu * x * x))  # noqa: E731
    lowest: list[Any] = [start, j(start)]  # type: ignore[no-untyped-call]
    barrier = 0.1 * min(lowest[1], 1.0)
    minus: Any = -eye_array(m)
    straight: Any = csr_array((n + m, n + m))

    def follow(y: np.ndarray, state: object) -> bool:
        x = np.array(y[:n])
        if (value := j(x)) < lowest[1]:  # type: ignore[no-untyped-call]
            lowest[:] = [x, value]
        return False

    def bands(y: np.ndarray) -> np.ndarray:
        r = rows(*at(np.array(y[:n])))
        return np.concatenate([r - y[n:], -r - y[n:]])

    def band_slopes(y: np.ndarray) -> object:
        matrix: Any = csr_array(slopes(np.array(y[:n])))
        return block_array([[matrix, minus], [-matrix, minus]], format="csr")

    free = np.full(m, np.inf)
    end = minimize(
        lambda y: float(np.sum(y[n:]) + 0.5 * np.sum(nu * y[:n] ** 2)),
        np.concatenate([x0, np.abs(rows(*at(x0))) + barrier]),
        method="trust-constr",
        jac=lambda y: np.concatenate([nu * y[:n], np.ones(m)]),
        hess=lambda y: diags_array(np.concatenate([nu, np.zeros(m)])),
        constraints=[
            NonlinearConstraint(bands, -np.inf, 0.0, jac=band_slopes, hess=lambda y, v: straight)
        ],
        bounds=Bounds(
            np.concatenate([LOWER, -free]),
            np.concatenate([UPPER, free]),
            keep_feasible=np.arange(n + m) < n,
        ),
        callback=follow,
        options={
            "maxiter": 40,
            "initial_barrier_parameter": barrier,
            "initial_barrier_tolerance": barrier,
        },
    )
    return lowest[0], lowest[1], end.nit


x, js, iterations = np.array(DATA["start"]), [], 0
for weight in DATA["weights"]:
    x, value, count = level(x, np.array(weight))
    js.append(value)
    iterations += count
seconds = time.process_time() - BEGUN
print(json.dumps({"j": js, "runs": runs, "iterations": iterations, "seconds": seconds}))
