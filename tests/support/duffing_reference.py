"""The Duffing oscillator by scipy's DOP853, twice: once finer, so that it knows its own error.

The full equations, written here on their own from the potential

    V = sum (2 pi eta_j)^2 q_j^2/2 + alpha_j q_j^4/4 + kappa q_1^2 q_2^2/2

in the time unit 1/(2 pi eta_plus) and the given length unit; each tone's phase is reduced in turns,
so that long runs keep it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

from fitting.text.arrays import FloatArray


class Truth(NamedTuple):
    """q~1 and q~2 at the times, shape (n, 2), the state at the end, and an error estimate in m."""

    q: FloatArray
    end: FloatArray
    error: float


def motion(
    p: Any, times: npt.ArrayLike, start: npt.ArrayLike | None = None, rtol: float = 1e-11
) -> Truth:
    """Return the motion at ascending times from ``start`` = (q1, q2, v1, v2) at time 0 (rest).

    ``p`` has the attributes of the FMU's parameters. ``error`` is the largest difference from a
    run with a hundred times the tolerance, which is far above what the finer run lacks.
    """
    coarse, _ = _integrate(p, times, start, 100.0 * rtol)
    fine, end = _integrate(p, times, start, rtol)
    return Truth(fine, end, float(np.abs(fine - coarse).max()))


def _integrate(
    p: Any, times: npt.ArrayLike, start: npt.ArrayLike | None, rtol: float
) -> tuple[FloatArray, FloatArray]:
    c, s = np.cos(p.theta), np.sin(p.theta)
    t = np.array([[-c, s], [s, c]] if p.reflection else [[c, -s], [s, c]])
    d = 2 * np.pi * t @ np.diag([p.d1, p.d2]) @ t.T
    d11, d12, d22 = float(d[0, 0]), float(d[0, 1]), float(d[1, 1])
    k1, k2 = (2 * np.pi * p.eta_plus) ** 2, (2 * np.pi * p.eta_minus) ** 2
    tones = [(a, u, f) for a, u, f in ((p.A1, p.u1, p.phase1), (p.A2, p.u2, p.phase2)) if a]
    moments = np.asarray(times, dtype=float)
    a1, a2, kappa, g1, g2 = p.alpha1, p.alpha2, p.kappa, p.g1, p.g2

    def slope(time: float, y: FloatArray) -> list[float]:
        q1, q2, v1, v2 = y.tolist()
        b = sum(a * np.cos(2 * np.pi * (u * time % 1.0) + f) for a, u, f in tones)
        return [
            v1,
            v2,
            g1 * b - d11 * v1 - d12 * v2 - k1 * q1 - a1 * q1**3 - kappa * q1 * q2**2,
            g2 * b - d12 * v1 - d22 * v2 - k2 * q2 - a2 * q2**3 - kappa * q1**2 * q2,
        ]

    y0 = np.zeros(4) if start is None else np.asarray(start, dtype=float)
    speed = 2 * np.pi * p.eta_plus
    size = sum(abs(a) for a, _, _ in tones) / speed**2 + float(np.abs(y0[:2]).max())
    found = solve_ivp(
        slope,
        (0.0, float(moments[-1])),
        y0,
        method="DOP853",
        t_eval=moments,
        rtol=max(rtol, 3e-14),
        atol=rtol * np.array([size, size, size * speed, size * speed]),
        max_step=0.5 / p.eta_plus,
    )
    if not found.success:
        raise ArithmeticError(found.message)
    return found.y[:2].T, found.y[:, -1]
