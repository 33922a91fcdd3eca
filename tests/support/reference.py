"""The coupled oscillator at 50 digits, by a method of its own: a matrix exponential in mpmath.

The FMU sums phasors and divided differences; here the first-order system, augmented by the drive,
is propagated by scaling and squaring. Both take the same double parameters and times as exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mpmath as mp

#: Squaring a phase of 1e15 rad loses 15 digits, its preparation as many.
DIGITS = 90


def _matrices(p: Any) -> tuple[mp.matrix, mp.matrix]:
    """Return D~ and C~ of the equations."""
    c, s = mp.cos(mp.mpf(p.theta)), mp.sin(mp.mpf(p.theta))
    rows = [[-c, s], [s, c]] if p.reflection else [[c, -s], [s, c]]
    t = mp.matrix(rows)
    d = 2 * mp.pi * t * mp.diag([mp.mpf(p.d1), mp.mpf(p.d2)]) * t.T
    k = mp.diag([(2 * mp.pi * mp.mpf(p.eta_plus)) ** 2, (2 * mp.pi * mp.mpf(p.eta_minus)) ** 2])
    return d, k


def _system(p: Any) -> mp.matrix:
    """Return the generator of (q~, q~'/w, cos1, sin1, cos2, sin2, b) with w = 2 pi eta_plus."""
    d, k = _matrices(p)
    w = 2 * mp.pi * mp.mpf(p.eta_plus)
    m = mp.zeros(9)
    for i in range(2):
        m[i, 2 + i] = w
        for j in range(2):
            m[2 + i, j] = -k[i, j] / w
            m[2 + i, 2 + j] = -d[i, j]
        gain = mp.mpf((p.g1, p.g2)[i]) / w
        m[2 + i, 4], m[2 + i, 6] = gain * mp.mpf(p.A1), gain * mp.mpf(p.A2)
        m[2 + i, 8] = gain
    for place, u in ((4, p.u1), (6, p.u2)):
        speed = 2 * mp.pi * mp.mpf(u)
        m[place, place + 1], m[place + 1, place] = -speed, speed
    return m


def phasors(p: Any, u: float) -> tuple[Any, Any]:
    """Return the steady-state response to cos(2 pi u t) by solving A(u) X = g at 50 digits."""
    with mp.workdps(DIGITS):
        d, k = _matrices(p)
        w = 2 * mp.pi * mp.mpf(u)
        a = k - w * w * mp.eye(2) + 1j * w * d
        x = mp.lu_solve(a, mp.matrix([mp.mpf(p.g1), mp.mpf(p.g2)]))
        return x[0], x[1]


def _start(p: Any, periodic: bool, b: float) -> mp.matrix:
    """Return the augmented state at time 0."""
    w = 2 * mp.pi * mp.mpf(p.eta_plus)
    y = mp.zeros(9, 1)
    tones = ((p.u1, p.A1, p.phase1, 4), (p.u2, p.A2, p.phase2, 6))
    for u, size, phase, place in tones:
        y[place], y[place + 1] = mp.cos(mp.mpf(phase)), mp.sin(mp.mpf(phase))
        if periodic and size:
            for i, x in enumerate(phasors(p, u)):
                z = x * mp.mpf(size) * mp.expj(mp.mpf(phase))
                y[i] += mp.re(z)
                y[2 + i] += mp.re(1j * 2 * mp.pi * mp.mpf(u) * z) / w
    y[8] = mp.mpf(b)
    return y


def retuned(p1: Any, p2: Any, change: float, times: Sequence[float]) -> list[tuple[Any, ...]]:
    """Return what ``displacements`` does, from rest, with p1 until ``change`` and p2 from then on.

    The tones are states of the system here, so their phases go on by themselves.
    """
    with mp.workdps(DIGITS):
        y = mp.expm(_system(p1) * mp.mpf(change), method="taylor") * _start(p1, False, 0.0)
        scale = mp.mpf(p2.eta_plus) / mp.mpf(p1.eta_plus)
        y[2], y[3] = y[2] / scale, y[3] / scale
        generator = _system(p2)
        result = []
        for t in times:
            span = mp.mpf(t) - mp.mpf(change)
            z = mp.expm(generator * span, method="taylor") * y
            result.append((+z[0], +z[1], +z[2], +z[3]))
        return result


def _nonzero(m: mp.matrix) -> list[list[tuple[int, Any]]]:
    """Return the rows of a matrix as (column, entry) without zeros, for many cheap products."""
    return [[(j, m[i, j]) for j in range(m.cols) if m[i, j]] for i in range(m.rows)]


def displacements(
    p: Any, times: Sequence[float], periodic: bool = False, inputs: Sequence[float] | None = None
) -> list[tuple[Any, Any, Any, Any]]:
    """Return q~1, q~2 and their velocities over 2 pi eta_plus at the times.

    ``inputs[k]`` is held from ``times[k-1]`` (0) to ``times[k]``.
    ``p`` has the attributes of the FMU's parameters. Times ascend. The result is good to 50 digits.
    """
    with mp.workdps(DIGITS):
        generator = _system(p)
        y = _start(p, periodic, inputs[0] if inputs else 0.0)
        propagators: dict[Any, list[list[tuple[int, Any]]]] = {}
        now, result = mp.mpf(0), []
        for k, t in enumerate(times):
            span = mp.mpf(t) - now
            if span not in propagators:
                propagators[span] = _nonzero(mp.expm(generator * span, method="taylor"))
            if inputs:
                y[8] = mp.mpf(inputs[k])
            y = [mp.fsum(m * y[j] for j, m in row) for row in propagators[span]]
            now = mp.mpf(t)
            result.append((+y[0], +y[1], +y[2], +y[3]))
        return result


def held(p: Any, step: float, inputs: Sequence[float], every: int) -> list[list[Any]]:
    """Return q~1, q~2 from rest, without tones, after each ``every`` steps of equal length.

    ``inputs[k]`` is held over step k. Many steps are one sum: y_n = sum P^(n-1-k) r b_k, with P the
    propagator of a step and r what a unit input does in it.
    """
    with mp.workdps(DIGITS):
        whole = mp.expm(_system(p) * mp.mpf(step), method="taylor")
        one = mp.matrix(4, 4)
        for i in range(4):
            for j in range(4):
                one[i, j] = whole[i, j]
        response, power = [whole[:4, 8]], mp.eye(4)
        for _ in range(every - 1):
            response.append(one * response[-1])
            power = one * power
        power = one * power
        y, rows = mp.zeros(4, 1), []
        for k in range(0, len(inputs), every):
            block = [mp.mpf(b) for b in reversed(inputs[k : k + every])]
            driven = [
                mp.fdot((r[i], b) for r, b in zip(response, block, strict=True)) for i in range(4)
            ]
            y = power * y + mp.matrix(driven)
            rows.append([+y[0], +y[1]])
        return rows
