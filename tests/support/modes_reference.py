"""N coupled modes at 50 digits and more, in mpmath: a linear solve, and a matrix exponential.

The FMU corrects an elimination, or multiplies propagators in decimal arithmetic; here the equations
are written down once more. Both take the same double parameters and times as exact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mpmath as mp

DIGITS = 50
#: Squaring a phase of 1e8 rad loses 8 digits, its preparation as many.
DIGITS_IN_TIME = 50

Values = Mapping[str, Any]


def count(p: Values) -> int:
    """Return the number of modes."""
    return sum(1 for name in p if name[0] == "f" and name[1:].isdigit())


def _matrices(p: Values) -> tuple[mp.matrix, mp.matrix, mp.matrix, mp.matrix]:
    """Return stiffness, pump and damping matrix and the gains."""
    n = count(p)
    stiffness, pump, damping = mp.zeros(n), mp.zeros(n), mp.zeros(n)
    for i in range(n):
        square = (2 * mp.pi * mp.mpf(p[f"f{i + 1}"])) ** 2
        stiffness[i, i] = square
        pump[i, i] = square * mp.mpf(p.get(f"depth_f{i + 1}", 0.0))
        damping[i, i] = 2 * mp.pi * mp.mpf(p[f"d{i + 1}"])
        for j in range(i):
            mark = f"{j + 1}{i + 1}"
            square = -((2 * mp.pi * mp.mpf(p[f"lambda{mark}"])) ** 2)
            stiffness[i, j] = stiffness[j, i] = square
            modulated = square * mp.mpf(p.get(f"depth_lambda{mark}", 0.0))
            pump[i, j] = pump[j, i] = modulated
    return stiffness, pump, damping, mp.matrix([mp.mpf(p[f"g{i + 1}"]) for i in range(n)])


def phasors(p: Values, u: float) -> list[Any]:
    """Return the steady-state response of the unpumped modes to cos(2 pi u t)."""
    with mp.workdps(DIGITS):
        stiffness, _, damping, gains = _matrices(p)
        w = 2 * mp.pi * mp.mpf(u)
        a = stiffness - w * w * mp.eye(count(p)) + 1j * w * damping
        return list(mp.lu_solve(a, gains))


def sidebands(p: Values, u: float, reach: int, phase: float = 0.0) -> dict[int, list[Any]]:
    """Return the response to cos(2 pi u t) at u + k pump_hz for |k| <= reach, by one dense solve.

    The unknowns are the Fourier coefficients of the equations as they stand, pump phase included.
    """
    with mp.workdps(DIGITS):
        stiffness, pump, damping, gains = _matrices(p)
        n, size = count(p), 2 * reach + 1
        a, right = mp.zeros(n * size), mp.zeros(n * size, 1)
        turn = mp.expj(mp.mpf(phase)) / 2
        for k in range(size):
            v = 2 * mp.pi * (mp.mpf(u) + (k - reach) * mp.mpf(p["pump_hz"]))
            for i in range(n):
                for j in range(n):
                    own = stiffness[i, j] + 1j * v * damping[i, j] - (v * v if i == j else 0)
                    a[k * n + i, k * n + j] = own
                    if k > 0:  # exp(i psi) lifts the sideband below
                        a[k * n + i, (k - 1) * n + j] = turn * pump[i, j]
                    if k < size - 1:
                        a[k * n + i, (k + 1) * n + j] = mp.conj(turn) * pump[i, j]
        for i in range(n):
            right[reach * n + i] = gains[i]
        x = mp.lu_solve(a, right)
        return {k - reach: [x[k * n + i] for i in range(n)] for k in range(size)}


def long_sidebands(p: Values, u: float, reach: int, phase: float = 0.0) -> dict[int, list[Any]]:
    """Return what ``sidebands`` does, of long chains: eliminated block by block from both ends."""
    with mp.workdps(DIGITS):
        stiffness, pump, damping, gains = _matrices(p)
        n, half = count(p), pump / 2

        def schur(k: int, outer: list[Any]) -> Any:
            v = 2 * mp.pi * (mp.mpf(u) + k * mp.mpf(p["pump_hz"]))
            own = stiffness - v * v * mp.eye(n) + 1j * v * damping
            return (own + sum((half * r for r in outer), mp.zeros(n))) ** -1

        ratios: dict[int, Any] = {}
        for sign in (1, -1):
            for k in range(sign * reach, 0, -sign):
                outer = [ratios[k + sign]] if abs(k) < reach else []
                ratios[k] = -schur(k, outer) * half
        found = {0: schur(0, [ratios[1], ratios[-1]]) * gains}
        for k in range(1, reach + 1):
            for side in (k, -k):
                found[side] = ratios[side] * found[side - (1 if side > 0 else -1)]
        turn = mp.expj(mp.mpf(phase))
        return {k: [turn**k * z for z in x] for k, x in found.items()}


def tones(p: Values) -> list[tuple[float, Any]]:
    """Return frequency and complex amplitude of the tones that drive."""
    return [
        (p[f"u{k}"], mp.mpf(p[f"A{k}"]) * mp.expj(mp.mpf(p[f"phase{k}"])))
        for k in (1, 2)
        if p[f"A{k}"]
    ]


def lines(p: Values) -> list[tuple[float, list[Any]]]:
    """Return frequency and complex amplitudes of the modes, tone by tone, unpumped."""
    return [(u, [amplitude * x for x in phasors(p, u)]) for u, amplitude in tones(p)]


def at_time(found: Sequence[tuple[float, Sequence[Any]]], t: float) -> list[Any]:
    """Return the sum of such lines at ``t`` s."""
    with mp.workdps(DIGITS):
        turns = [mp.expj(2 * mp.pi * mp.mpf(u) * mp.mpf(t)) for u, _ in found]
        rows = zip(*(row for _, row in found), strict=True)
        return [
            mp.fsum(mp.re(x * turn) for x, turn in zip(row, turns, strict=True)) for row in rows
        ]


def from_rest(p: Values, times: Sequence[float], inputs: Sequence[float] = ()) -> list[list[Any]]:
    """Return the displacements from rest at the times, unpumped; ``inputs`` as in ``reference``."""
    n = count(p)
    with mp.workdps(DIGITS_IN_TIME):
        stiffness, _, damping, gains = _matrices(p)
        w = 2 * mp.pi * mp.mpf(p["f1"])
        driven = tones(p)
        size = 2 * n + 2 * len(driven) + 1
        m, y = mp.zeros(size), mp.zeros(size, 1)
        for i in range(n):
            m[i, n + i] = w
            for j in range(n):
                m[n + i, j], m[n + i, n + j] = -stiffness[i, j] / w, -damping[i, j]
            m[n + i, size - 1] = gains[i] / w
        for k, (u, amplitude) in enumerate(driven):
            c = 2 * n + 2 * k
            m[c, c + 1], m[c + 1, c] = -2 * mp.pi * mp.mpf(u), 2 * mp.pi * mp.mpf(u)
            y[c], y[c + 1] = mp.re(amplitude), mp.im(amplitude)
            for i in range(n):
                m[n + i, c] = gains[i] / w
        now, rows, known = mp.mpf(0), [], {}
        for k, t in enumerate(times):
            span = mp.mpf(t) - now
            if span not in known:
                known[span] = mp.expm(m * span, method="taylor")
            y[size - 1] = mp.mpf(inputs[k]) if inputs else mp.mpf(0)
            y = known[span] * y
            now = mp.mpf(t)
            rows.append([+y[i] for i in range(n)])
        return rows
