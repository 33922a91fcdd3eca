"""Scenes of N coupled modes for the FMU: from kHz to GHz, Q from 10 to 1e8, near and far drives."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

Scene = dict[str, Any]
#: Numbers of modes, and how many scenes of each: 200 in all.
SIZES = {2: 80, 3: 70, 5: 50}
#: Three modes and two tones near 1 Hz, and a pump of all of them but one coupling.
TONES: Scene = {"u1": 0.97, "u2": 1.31, "A1": 1.0, "A2": 0.6, "phase1": 0.3, "phase2": -1.0}
THREE: Scene = TONES | {
    "f1": 1.0,
    "f2": 1.3,
    "f3": 1.45,
    "d1": 0.05,
    "d2": 0.08,
    "d3": 0.06,
    "lambda12": 0.4,
    "lambda13": 0.2,
    "lambda23": 0.3,
    "g1": 1.0,
    "g2": -0.5,
    "g3": 0.7,
}
PUMP: Scene = {
    "pump_hz": 0.31,
    "pump_phase": 0.8,
    "depth_f1": 0.25,
    "depth_f2": -0.2,
    "depth_f3": 0.1,
    "depth_lambda12": 0.5,
    "depth_lambda23": -0.4,
}


def eigenfrequencies(scene: Scene) -> Any:
    """Return the eigenfrequencies without pump, rising, in Hz."""
    n = sum(name[0] == "f" for name in scene)
    c = np.diag([scene[f"f{i + 1}"] ** 2 for i in range(n)])
    for i, j in itertools.combinations(range(n), 2):
        c[i, j] = c[j, i] = -(scene[f"lambda{i + 1}{j + 1}"] ** 2)
    return np.sqrt(np.linalg.eigvalsh(c))


def scenes(n: int, number: int, seed: int) -> list[Scene]:
    """Return scenes of n modes; each kind of extreme comes up every few of them."""
    rng = np.random.default_rng(seed)
    return [_scene(n, k, rng) for k in range(number)]


def _scene(n: int, k: int, rng: np.random.Generator) -> Scene:
    base = 10.0 ** rng.uniform(3.0, 9.0)
    spread = 10.0 ** rng.uniform(-6.0, 0.0)
    f = base * (1.0 + spread * rng.uniform(0.0, 1.0, n))
    if k % 5 == 1:
        f[:] = base  # degenerate without coupling
    quality = 10.0 ** rng.uniform(1.0, 8.0, n)
    size = base * 10.0 ** rng.uniform(-4.0, -0.5, (n, n)) / np.sqrt(n)
    if k % 5 in (2, 3):
        size *= 0.0 if k % 5 == 2 else rng.integers(0, 2, (n, n))
    scene: Scene = {f"f{i + 1}": float(x) for i, x in enumerate(f)}
    scene |= {
        f"lambda{i + 1}{j + 1}": float(size[i, j]) for i, j in itertools.combinations(range(n), 2)
    }
    scene |= {f"d{i + 1}": float(f[i] / q) for i, q in enumerate(quality)}
    scene |= {f"g{i + 1}": float(x) for i, x in enumerate(rng.uniform(-2.0, 2.0, n))}
    scene |= {f"readout{i + 1}": float(x) for i, x in enumerate(rng.uniform(-2.0, 2.0, n))}
    eta = eigenfrequencies(scene)
    near = rng.choice(eta) + rng.uniform(-3.0, 3.0) * base / float(rng.choice(quality))
    far = base * 10.0 ** rng.uniform(-3.0, 3.0)
    scene |= {"u1": float(abs(near)), "u2": float(far) if k % 3 else 0.0}
    scene |= {f"A{t}": float(rng.uniform(-2.0, 2.0)) for t in (1, 2)}
    return scene | {f"phase{t}": float(rng.uniform(-3.0, 3.0)) for t in (1, 2)}
