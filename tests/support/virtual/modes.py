"""Two hybridised modes in closed form, over arrays: the truth of the virtual laboratories.

    X(u) = A(u)^-1 (g1, g2)^T        A(u) = (2 pi)^2 [diag((eta - u)(eta + u)) + i u T diag(d) T^T]

Written from the paper alone (Bartsch et al., arXiv:2412.07301, sections 2 and 3): no code of the
FMU, of `fitting.lab` or of the fit takes part, so that none of them is its own judge. Variables go
by the names of the model: theta (rad), reflection, d1, d2, eta_plus, eta_minus (Hz), g1, g2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from fitting.text.arrays import FloatArray

Values = Mapping[str, npt.ArrayLike]
ComplexArray = npt.NDArray[np.complex128]

#: What the model takes where nothing is said.
USUAL: Mapping[str, float] = {"reflection": 0.0, "g1": 1.0, "g2": 1.0}
OUTPUTS = ("q1_hybrid", "q2_hybrid", "q1", "q2")


def _array(values: Values, name: str) -> FloatArray:
    return np.asarray(values[name] if name in values else USUAL[name], dtype=float)


def _transformation(values: Values) -> tuple[FloatArray, FloatArray, FloatArray]:
    """cos theta, sin theta, and the sign of the first column: -1 for a reflection."""
    theta = _array(values, "theta")
    sign = np.where(_array(values, "reflection") > 0.5, -1.0, 1.0)
    return np.cos(theta), np.sin(theta), sign


def damping_hz(values: Values) -> tuple[FloatArray, FloatArray, FloatArray]:
    """D11, D22 and D12 of T diag(d1, d2) T^T, Hz.

    T = [[c, -s], [s, c]] or, as a reflection, [[-c, s], [s, c]].
    """
    c, s, sign = _transformation(values)
    d1, d2 = _array(values, "d1"), _array(values, "d2")
    return (
        np.asarray(c * c * d1 + s * s * d2),
        np.asarray(s * s * d1 + c * c * d2),
        np.asarray(sign * c * s * (d1 - d2)),
    )


def phasors(values: Values, u_hz: npt.ArrayLike) -> tuple[ComplexArray, ComplexArray]:
    """Steady-state response of both hybridised coordinates to cos(2 pi u t), each as broadcast."""
    u = np.asarray(u_hz, dtype=float)
    plus, minus = _array(values, "eta_plus"), _array(values, "eta_minus")
    d11, d22, d12 = damping_hz(values)
    a11 = (plus - u) * (plus + u) + 1j * u * d11
    a22 = (minus - u) * (minus + u) + 1j * u * d22
    a12 = 1j * u * d12
    g1, g2 = _array(values, "g1"), _array(values, "g2")
    whole = (2.0 * math.pi) ** 2 * (a11 * a22 - a12 * a12)
    return np.asarray((a22 * g1 - a12 * g2) / whole), np.asarray((a11 * g2 - a12 * g1) / whole)


def response(values: Values, u_hz: npt.ArrayLike, output: str) -> ComplexArray:
    """Complex amplitude of one output, m per m/s2: hybridised, or physical q = T^T q~."""
    one, two = phasors(values, u_hz)
    c, s, sign = _transformation(values)
    return {
        "q1_hybrid": one,
        "q2_hybrid": two,
        "q1": sign * c * one + s * two,
        "q2": -sign * s * one + c * two,
    }[output]


def derived(values: Values) -> dict[str, FloatArray]:
    """What else the model says of itself, by the names of its outputs; NaN where lambda is none.

    lambda^2 = -1/2 sin 2 theta (eta-^2 - eta+^2), f1^2 = c^2 eta+^2 + s^2 eta-^2,
    f2^2 = s^2 eta+^2 + c^2 eta-^2, the widths D11 and D22 in Hz, Q = eta/width.
    """
    plus, minus = _array(values, "eta_plus"), _array(values, "eta_minus")
    theta = _array(values, "theta")
    d11, d22, _ = damping_hz(values)
    square = -0.5 * np.sin(2.0 * theta) * (minus - plus) * (minus + plus)
    c2, s2 = np.cos(theta) ** 2, np.sin(theta) ** 2
    with np.errstate(invalid="ignore"):
        found = {
            "lambda": np.sqrt(square),
            "f1": np.sqrt(c2 * plus**2 + s2 * minus**2),
            "f2": np.sqrt(s2 * plus**2 + c2 * minus**2),
            "width_plus": d11,
            "width_minus": d22,
            "Q_plus": plus / d11,
            "Q_minus": minus / d22,
        }
    return {name: np.asarray(value) for name, value in found.items()}
