"""Two hybridised modes in mpmath, written from the paper alone: ln X as many digits as are asked.

X(u) = A(u)^-1 (1, 1)^T        A(u) = (2 pi)^2 [diag((eta - u)(eta + u)) + i u T diag(d) T^T]
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import mpmath as mp


def log_responses(
    p: Sequence[Any],
    tones_hz: Iterable[float],
    eta_hz: tuple[Any, Any],
    output: str,
    *,
    reflection: bool = False,
) -> list[Any]:
    """ln X of one mode at some tones, complex numbers of mpmath.

    Args:
        p: theta (rad), d1 and d2 (Hz).
        tones_hz: frequencies, Hz.
        eta_hz: eigenfrequencies of both modes, Hz.
        output: "q1_hybrid" or "q2_hybrid".
        reflection: the other form of T.
    """
    theta, d1, d2 = p
    c, s = mp.cos(theta), mp.sin(theta)
    across = (-1 if reflection else 1) * c * s * (d1 - d2)
    found = []
    for tone in tones_hz:
        u = mp.mpf(float(tone))
        plus, minus = (mp.mpf(eta) for eta in eta_hz)
        a = (plus - u) * (plus + u) + mp.mpc(0, 1) * u * (c * c * d1 + s * s * d2)
        b = (minus - u) * (minus + u) + mp.mpc(0, 1) * u * (s * s * d1 + c * c * d2)
        off = mp.mpc(0, 1) * u * across
        own = b if output == "q1_hybrid" else a
        found.append(mp.log((own - off) / ((2 * mp.pi) ** 2 * (a * b - off * off))))
    return found
