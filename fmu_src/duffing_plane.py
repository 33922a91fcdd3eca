"""The plane of the two oscillating modes in the state space of the linear system.

    q~ = z + conj(z),   q~' = S z + conj(S z),   z' = S z,   S^2 + D~ S + C~ = 0

The solvent S (P. Lancaster, Lambda-matrices and Vibrating Systems, Pergamon 1966) follows from its
trace and determinant, which are those of the poles; no eigenvector is needed, so an exceptional
point is a point like any other. Away from one, coordinates along the eigenvectors make S a pair
of rates.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

from .model_error import ModelError
from .oscillator_equations import TWO_PI, Parameters, damping
from .oscillator_exact import oscillator_pencil
from .oscillator_precise import Precise, in_precise_arithmetic

if TYPE_CHECKING:
    from .oscillator_exact import Pencil

    Pair = tuple[complex, complex]
    Matrix = tuple[complex, complex, complex, complex]
    Gain = tuple[float, float, float, float]

#: Eigenvectors are taken as coordinates while the determinant of the normed pair is larger.
INDEPENDENT = 0.1


class Plane(NamedTuple):
    """S in 1/s and what is made of it, in a frame that rotates at a given frequency.

    ``gain`` is (2 Im S)^-1 in s. The coordinates w of y = V w have the ``rates``, apart from which
    ``cross`` is left where the eigenvectors do not serve; ``mix`` holds V12 and V21, V11 = V22 = 1.
    """

    solvent: Matrix
    gain: Gain
    rates: Pair
    cross: Pair
    mix: Pair

    def amplitudes(self, w1: complex, w2: complex) -> Pair:
        """Return y = V w."""
        v12, v21 = self.mix
        return w1 + v12 * w2, v21 * w1 + w2

    def coordinates(self, y1: complex, y2: complex) -> Pair:
        """Return w = V^-1 y."""
        v12, v21 = self.mix
        scale = 1.0 / (1.0 - v12 * v21)
        return scale * (y1 - v12 * y2), scale * (y2 - v21 * y1)


def plane(p: Parameters, centre: float) -> Plane:
    """Return the plane seen from a frame at ``centre`` Hz; raise ModelError if overdamped."""
    solvent, gain, rates, cross, mix = _modes(
        p._replace(u1=0.0, u2=0.0, A1=0.0, A2=0.0, phase1=0.0, phase2=0.0, g1=0.0, g2=0.0)
    )
    with in_precise_arithmetic():
        frame = Precise(0.0, centre)
        first, second = (TWO_PI * complex(rate - frame) for rate in rates)
    return Plane(solvent, gain, (first, second), cross, mix)


@lru_cache(maxsize=16)
def _modes(p: Parameters) -> tuple[Matrix, Gain, tuple[Precise, Precise], Pair, Pair]:
    """Return the fields of a plane without a frame, its rates over 2 pi and precise.

    They are kept for runs that differ in their drive alone.
    """
    with in_precise_arithmetic():
        pencil = _pencil(p)
        s11, s12, s21, s22 = _solvent(p, pencil)
        rates, cross, mix = (s11, s22), (s12, s21), (0j, 0j)
        first, second = pencil.poles
        if (second - s11).size() < (first - s11).size():
            first, second = second, first
        gap1, gap2 = first - s22, second - s11
        if not (gap1.is_zero() or gap2.is_zero()):
            vectors = complex(s12 / gap2), complex(s21 / gap1)
            if abs(1.0 - vectors[0] * vectors[1]) > INDEPENDENT:
                rates, cross, mix = (first, second), (Precise(0), Precise(0)), vectors
        solvent = (
            TWO_PI * complex(s11),
            TWO_PI * complex(s12),
            TWO_PI * complex(s21),
            TWO_PI * complex(s22),
        )
        scaled = TWO_PI * complex(cross[0]), TWO_PI * complex(cross[1])
        return solvent, _gain(solvent), rates, scaled, mix


def inverse(a: complex, b: complex, c: complex, d: complex) -> Matrix:
    """Return the inverse of [[a, b], [c, d]], row by row."""
    determinant = a * d - b * c
    return d / determinant, -b / determinant, -c / determinant, a / determinant


def _gain(solvent: Matrix) -> Gain:
    h11, h12, h21, h22 = inverse(*(2.0 * s.imag for s in solvent))
    return h11.real, h12.real, h21.real, h22.real


def _pencil(p: Parameters) -> Pencil:
    try:
        return oscillator_pencil(p)
    except ModelError as error:
        raise ModelError(
            f"a mode is overdamped (d1 = {p.d1!r} Hz, d2 = {p.d2!r} Hz at eta_plus = "
            f"{p.eta_plus!r} Hz, eta_minus = {p.eta_minus!r} Hz): the envelope needs oscillating "
            "modes; use solver 2 (rk4)"
        ) from error


def _solvent(p: Parameters, pencil: Pencil) -> tuple[Precise, Precise, Precise, Precise]:
    """Return S over 2 pi, in Hz: S = (e1 + D~)^-1 (e2 - C~), e1 its trace, e2 its determinant."""
    e2, minus_e1, _ = pencil.upper
    w11, w22, w12 = (Precise(w) for w in damping(p))
    a, d = w11 - minus_e1, w22 - minus_e1
    determinant = a * d - w12 * w12
    plus, minus = Precise(p.eta_plus), Precise(p.eta_minus)
    k1, k2 = (e2 - plus * plus) / determinant, (e2 - minus * minus) / determinant
    return d * k1, -(w12 * k2), -(w12 * k1), a * k2
