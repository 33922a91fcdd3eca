"""What a chirp, a pulse and noise determine of the string, against mpmath at 50 digits.

Singular values of dz/d(theta, d1, d2) over the largest value, z the motion of its first string,
held inputs by the matrix exponential.
"""

from __future__ import annotations

from collections.abc import Sequence

import mpmath as mp
import numpy as np
import pytest

import fitting as ff
from fitting.text.arrays import FloatArray

TRUTH = (1.9, 3.0, 1.2)
ETA_HZ = (100.0, 106.0)
STEP_S, SAMPLES = 2.5e-3, 160
T = STEP_S * np.arange(SAMPLES, dtype=float)
DRIVES: dict[str, FloatArray] = {
    "chirp": ff.Chirp(start_hz=80.0, stop_hz=125.0, length_s=0.35, level=100.0).at(T),
    "pulse": ff.Pulse(level=100.0, at_s=0.0, length_s=2.0 * STEP_S).at(T),
    "noise": 50.0 * np.random.default_rng(7).standard_normal(SAMPLES),
}


def exact(p: Sequence[mp.mpf], u: FloatArray) -> list[mp.mpf]:
    """q'' + 2 pi D q' + (2 pi eta)^2 q = (1, 1) u from rest, D = T diag(d) T^T; q1."""
    theta, d1, d2 = p
    c, s = mp.cos(theta), mp.sin(theta)
    damping = mp.matrix(
        [[c * c * d1 + s * s * d2, c * s * (d1 - d2)], [c * s * (d1 - d2), s * s * d1 + c * c * d2]]
    )
    both = mp.zeros(5)
    for i in range(2):
        both[i, 2 + i] = both[2 + i, 4] = mp.mpf(1)
        both[2 + i, i] = -((2 * mp.pi * mp.mpf(ETA_HZ[i])) ** 2)
        for k in range(2):
            both[2 + i, 2 + k] = -2 * mp.pi * damping[i, k]
    moved = mp.expm(both * mp.mpf(float(STEP_S)))
    x, seen = mp.zeros(4, 1), []
    for value in u:
        seen.append(c * x[0] + s * x[1])
        x = moved[:4, :4] * x + moved[:4, 4] * mp.mpf(float(value))
    return seen


def slopes(u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """z (n,) and dz/d(theta, d1, d2) (n, 3), rounded."""
    with mp.workdps(50):
        at, step, columns = [mp.mpf(v) for v in TRUTH], mp.mpf(10) ** -18, []
        for k in range(3):
            ends = []
            for sign in (1, -1):
                moved = list(at)
                moved[k] += sign * step
                ends.append(exact(moved, u))
            columns.append([float((a - b) / (2 * step)) for a, b in zip(*ends, strict=True)])
        return np.array([float(z) for z in exact(at, u)]), np.array(columns).T


@pytest.mark.parametrize(
    "drive", ["chirp", "pulse", pytest.param("noise", marks=pytest.mark.nightly)]
)
def test_singular_values_are_those_at_fifty_digits(drive: str, swift: ff.Fmu) -> None:
    u = DRIVES[drive]
    z, columns = slopes(u)
    setup = ff.Setup(
        ff.Drive(),
        "q1",
        start_values={"A1": 0.0, "A2": 0.0, "eta_plus": ETA_HZ[0], "eta_minus": ETA_HZ[1]},
    )
    trace = ff.Trace(T, z, setup=setup, input="b", driven=(T, u), interpolation="held", unit="m")
    parameters = [
        ff.Parameter("theta", 1.8, bounds=(1.58, 3.1)),
        ff.Parameter("d1", 2.5, bounds=(0.5, 10.0)),
        ff.Parameter("d2", 1.5, bounds=(0.5, 10.0)),
    ]
    found = ff.Problem(swift, parameters, trace).jac(np.array(TRUTH))
    wanted = np.linalg.svd(columns / np.max(np.abs(z - np.mean(z))), compute_uv=False)
    assert np.linalg.svd(found, compute_uv=False) == pytest.approx(wanted, rel=1e-3)
