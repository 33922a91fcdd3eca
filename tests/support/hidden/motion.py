"""Two coupled modes by their equations of motion, in numpy alone: no code of the FMUs.

    q'' + 2 pi G q' + (2 pi)^2 K q = g b(t)        y = r q

K (Hz^2) and G (Hz) are symmetric 2 x 2 matrices. In hybridised coordinates K = diag(eta+^2, eta-^2)
and G = T diag(d1, d2) T^T; in physical ones K = [[f1^2, -l^2], [-l^2, f2^2]] and G = diag(d1, d2).
Times go by the eigenvalues of the first-order system, its velocities counted in rad/s of the modes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitting.text.arrays import ComplexArray, FloatArray

Values = Mapping[str, float]
TWO_PI = 2.0 * math.pi


@dataclass(frozen=True, eq=False, kw_only=True)
class Motion:
    """One sample, how it is driven and what is seen of it.

    Args:
        own_hz: Roots of the diagonal of K, (2,), Hz: that of u^2 is taken off without cancelling.
        cross_hz2: K12, Hz^2.
        damping_hz: G, (2, 2), Hz.
        force: g, (2,).
        seen: r, (2,).
    """

    own_hz: FloatArray
    cross_hz2: float
    damping_hz: FloatArray
    force: FloatArray
    seen: FloatArray

    def transfer(self, u_hz: FloatArray) -> ComplexArray:
        """Response to a unit of force per mass at frequencies (n,), m per m/s2."""
        u = np.asarray(u_hz, dtype=float)
        a11, a22 = (
            (f - u) * (f + u) + 1j * u * self.damping_hz[i, i] for i, f in enumerate(self.own_hz)
        )
        a12 = self.cross_hz2 + 1j * u * self.damping_hz[0, 1]
        (g1, g2), (r1, r2) = self.force, self.seen
        whole = TWO_PI**2 * (a11 * a22 - a12 * a12)
        return np.asarray((r1 * (a22 * g1 - a12 * g2) + r2 * (a11 * g2 - a12 * g1)) / whole)

    def free(self, t_s: FloatArray, state: FloatArray) -> FloatArray:
        """What is seen of a free decay at times (n,); state: q (2,), velocity/(2 pi f) (2,)."""
        rates, vectors, _ = self._eigen()
        weights = np.linalg.solve(vectors, state.astype(complex))
        modes = (self.seen @ vectors[:2]) * weights
        return np.asarray(np.real(np.exp(np.outer(t_s, rates)) @ modes))

    def held(self, step_s: float, b: FloatArray) -> FloatArray:
        """What is seen from rest under a force (n,), held over each step, at the steps' starts."""
        rates, vectors, velocity = self._eigen()
        push = np.linalg.solve(vectors, np.concatenate([np.zeros(2), self.force / velocity]))
        turn, gain = np.exp(rates * step_s), push * np.expm1(rates * step_s) / rates
        z, found = np.zeros(4, dtype=complex), np.empty(b.size)
        for k, level in enumerate(b):
            found[k] = np.real((self.seen @ vectors[:2]) @ z)
            z = turn * z + gain * level
        return found

    def _eigen(self) -> tuple[ComplexArray, ComplexArray, FloatArray]:
        """Rates (4,), 1/s, their vectors, and the scale of the velocities (2,)."""
        w = TWO_PI * self.own_hz
        k = np.diag(w**2) + TWO_PI**2 * self.cross_hz2 * np.array([[0.0, 1.0], [1.0, 0.0]])
        system = np.block(
            [
                [np.zeros((2, 2)), np.diag(w)],
                [-k / w[:, None], -TWO_PI * self.damping_hz * w[None, :] / w[:, None]],
            ]
        )
        rates, vectors = np.linalg.eig(system)
        return rates, vectors, w


def hybrid(values: Values, output: str) -> Motion:
    """The string: theta, eta_plus, eta_minus, d1, d2, and g1, g2 of the hybridised coordinates.

    Args:
        values: by name; "reflection" above zero: the other form of T.
        output: q1_hybrid, q2_hybrid, q1 or q2.
    """
    c, s = math.cos(values["theta"]), math.sin(values["theta"])
    sign = -1.0 if values.get("reflection", 0.0) > 0.0 else 1.0
    t = np.array([[sign * c, -sign * s], [s, c]])
    seen = {"q1_hybrid": (1.0, 0.0), "q2_hybrid": (0.0, 1.0), "q1": t[:, 0], "q2": t[:, 1]}[output]
    return Motion(
        own_hz=np.array([values["eta_plus"], values["eta_minus"]]),
        cross_hz2=0.0,
        damping_hz=t @ np.diag([values["d1"], values["d2"]]) @ t.T,
        force=np.array([values.get("g1", 1.0), values.get("g2", 1.0)]),
        seen=np.asarray(seen, dtype=float),
    )


def chain(values: Values) -> Motion:
    """Two modes f1, f2, d1, d2, coupled by lambda12, in physical coordinates: 1 is driven, seen."""
    one = np.array([1.0, 0.0])
    return Motion(
        own_hz=np.array([values["f1"], values["f2"]]),
        cross_hz2=-(values["lambda12"] ** 2),
        damping_hz=np.diag([values["d1"], values["d2"]]),
        force=one,
        seen=one,
    )
