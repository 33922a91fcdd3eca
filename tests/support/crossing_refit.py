"""A crossing measured by virtual laboratories, fitted by plain least squares over a closed form.

It shares no code with the fit: scales of spectra are solved in one line each, that of tones is the
one of the sweep, known as well as its noise allows.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

import fitting as ff
from fitting.lab.curves import AvoidedCrossing
from fitting.lab.plans import PlannedSweep
from fitting.text.arrays import FloatArray

BENCH = AvoidedCrossing(reference=True)
LAMBDA = BENCH.lambda_hz
#: a0, a1, f2, lambda, d1, d2; the seventh is the relative error of the scale of tones.
TRUTH = np.array(
    [BENCH.f1_hz, BENCH.tuning_hz_v, BENCH.f2_hz, LAMBDA, BENCH.d1_hz, BENCH.d2_hz, 0.0]
)


def amplitude(p: FloatArray, volts: float, u: FloatArray) -> FloatArray:
    """|q1| of two modes, q1 driven, in 1/(2 pi Hz)^2."""
    first = (p[0] + p[1] * volts) ** 2 - u**2 + 1j * u * p[4]
    second = p[2] ** 2 - u**2 + 1j * u * p[5]
    return np.asarray(np.abs(second / (first * second - p[3] ** 4)))


def table(text: str | bytes) -> FloatArray:
    lines = [line for line in str(text).splitlines() if line and not line.startswith("#")]
    return np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]])


def without_floor(y: FloatArray, sigma: FloatArray | float) -> FloatArray:
    """Magnitudes without what noise of each quadrature adds to them on average."""
    return np.asarray(np.sqrt(np.maximum(y**2 - np.square(sigma), 0.0)))


def scaled_rows(p: FloatArray, volts: float, u: FloatArray, y: FloatArray) -> FloatArray:
    """Amplitudes (n,) of one spectrum less its own scale times the model's."""
    a = amplitude(p, volts, u)
    return np.asarray(y - a * (a @ y) / (a @ a))


def planned_rows(plan: Path, seed: int) -> list[tuple[float, FloatArray, FloatArray, FloatArray]]:
    """(V, frequencies, amplitudes, noise) of whole sweeps, or of one pair of tones each."""
    made = ff.synthesize("crossing", plan=plan, seed=seed)
    if isinstance(made.measured[0], PlannedSweep):
        lines = [line for line in plan.read_text().splitlines() if "noise_floor" in line]
        sigma = float(lines[0].split('"')[1].split()[0])
        return [
            (m.at["V"], m.u_hz, m.columns[0], np.full(m.u_hz.size, sigma)) for m in made.measured
        ]
    text = str(made.files["experiments.csv"])
    head = next(line for line in text.splitlines() if line.startswith("experiment")).split(",")
    at = {name.split(" (")[0]: k for k, name in enumerate(head)}
    found = []
    for line in text.splitlines():
        if line.startswith("next"):
            cells = line.split(",")
            u, y, s = (
                np.array([float(cells[at[f"{name}{k}"]]) for k in (1, 2)])
                for name in ("u", "peak_", "sigma_")
            )
            found.append((float(cells[at["V"]]), u, y, s))
    return found


def refitted(plans: Sequence[Path], seed: int) -> float:
    """lambda, Hz, of one laboratory: its map, and every plan measured by it."""
    files = ff.synthesize_curves("crossing", seed=seed, reference=True).files
    spectra, sweep = table(files["map.csv"]), table(files["sweep.csv"])
    of_map = [
        (float(v), part[:, 1], part[:, 2], BENCH.noise * float(part[:, 2].max()))
        for v in np.unique(spectra[:, 0])
        for part in [spectra[spectra[:, 0] == v]]
    ]
    further = [row for k, plan in enumerate(plans) for row in planned_rows(plan, 10_000 + seed + k)]
    of_map = [(v, u, without_floor(y, s), s) for v, u, y, s in of_map]
    further = [(v, u, without_floor(y, s), s) for v, u, y, s in further]
    first_v = float(BENCH.voltages()[0])
    noise = BENCH.noise * float(np.max(sweep[:, 1]))
    sweep[:, 1] = without_floor(sweep[:, 1], noise)
    chi_sigma = noise / float(np.linalg.norm(sweep[:, 1]))

    def rows(p: FloatArray) -> FloatArray:
        a = amplitude(p, first_v, sweep[:, 0])
        chi = float(a @ sweep[:, 1] / (a @ a)) * (1.0 + p[6])
        found = [scaled_rows(p, v, u, y) / s for v, u, y, s in of_map]
        for v, u, y, s in further:
            whole = u.size > 2
            left = scaled_rows(p, v, u, y) if whole else y - chi * amplitude(p, v, u)
            found.append(left / s)
        return np.concatenate([*found, [p[6] / chi_sigma]])

    scale = np.array([1e-2, 1e-2, 1e-2, 1e-1, 1e-2, 1e-2, 1e-3])
    fitted = least_squares(lambda x: rows(TRUTH + scale * x), np.zeros(7), x_scale="jac")
    return float(TRUTH[3] + scale[3] * fitted.x[3])
