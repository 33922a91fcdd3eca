"""Linear systems over time, x' = A x + B u, y = C x, by the matrix exponential."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from fitting.text.arrays import FloatArray
from tests.support.closed_form import damping

TWO_PI = 2.0 * np.pi


def held_response(
    matrices: tuple[FloatArray, FloatArray, FloatArray],
    u: FloatArray,
    step_s: float,
    start: Sequence[float] = (),
) -> FloatArray:
    """Samples y_k = C x_k (n,) with u_k (n,) held from each sample to the next."""
    a, b, c = matrices
    n = len(a)
    both = np.zeros((n + 1, n + 1))
    both[:n, :n], both[:n, n] = a, b
    moved = expm(both * step_s)
    x, seen = np.array(start or np.zeros(n)), []
    for value in u:
        seen.append(float(c @ x))
        x = moved[:n, :n] @ x + moved[:n, n] * value
    return np.array(seen)


def toned_response(
    matrices: tuple[FloatArray, FloatArray, FloatArray],
    tones: Sequence[tuple[float, float]],
    step_s: float,
    samples: int,
) -> FloatArray:
    """Samples y_k = C x_k (n,) from rest under u = sum of A cos(2 pi f t), tones (f in Hz, A)."""
    a, b, c = matrices
    n = len(a)
    whole = np.zeros((n + 2 * len(tones),) * 2)
    whole[:n, :n] = a
    x, seen = np.zeros(len(whole)), []
    for k, (tone_hz, level) in enumerate(tones):
        at = n + 2 * k
        whole[:n, at] = level * b
        whole[at, at + 1], whole[at + 1, at] = -TWO_PI * tone_hz, TWO_PI * tone_hz
        x[at] = 1.0
    moved = expm(whole * step_s)
    for _ in range(samples):
        seen.append(float(c @ x[:n]))
        x = moved @ x
    return np.array(seen)


def oscillator(mass: float, c: float, k: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """M x'' + c x' + k x = u."""
    return (
        np.array([[0.0, 1.0], [-k / mass, -c / mass]]),
        np.array([0.0, 1.0 / mass]),
        np.array([1.0, 0.0]),
    )


def string(
    theta: float, d1: float, d2: float, eta_hz: tuple[float, float], seen: tuple[float, float]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """q'' + 2 pi T diag(d) T^T q' + (2 pi eta)^2 q = (1, 1) u, seen as a sum of both modes."""
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    a[2:, :2] = -np.diag(np.square(TWO_PI * np.array(eta_hz)))
    a[2:, 2:] = -TWO_PI * damping(theta, d1, d2, reflection=False)
    return a, np.array([0.0, 0.0, 1.0, 1.0]), np.array([*seen, 0.0, 0.0])
