"""Exact propagation of the coupled oscillator: phasors and divided differences of exponentials.

With all frequencies in Hz and s = 2 pi x, the response to exp(2 pi i u t) from rest is, by the
residue theorem, the divided difference of F(x) exp(2 pi x t) over the poles, F = adj(P) g / V,

    P(x) = (x^2 + eta^2) + x D~/2 pi,    det P = U V,    U = (x - x1)(x - x2),  V = conj(U),

over {i u, x1, x2}, plus the same for {conj(x1), conj(x2)} with U (x - i u) in the place of V.
Poles that lie close together are never separated: E[a, b] = (e^a - e^b)/(a - b) is evaluated as
such, so repeated eigenvalues, exceptional points and a drive on resonance need no special case
(A. C. McCurdy, K. C. Ng, B. N. Parlett, Math. Comp. 43, 501, 1984). The coefficients are made with
50 digits once per set of parameters. The rotating-frame model (``envelope``) is the same
calculation with another P and without the second set of poles.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from decimal import Decimal
from typing import TYPE_CHECKING, NamedTuple

from .model_error import ModelError
from .oscillator_equations import (
    FOUR_PI_SQUARED,
    TWO_PI,
    Parameters,
    damping,
)
from .oscillator_phase import Frequency
from .oscillator_precise import (
    Precise,
    add,
    in_precise_arithmetic,
    multiply,
    polynomial_differences,
    rational_differences,
    upper_factor,
)

if TYPE_CHECKING:  # subscripted here, these would need a host with Python 3.9 or later
    from .oscillator_precise import Polynomial

    Pair = tuple[complex, complex]

#: Below this phase angle between two poles the response is evaluated as one divided difference;
#: above it periodic part and transient are added up, which costs at most two digits.
CONFLUENT = 1e-2
#: A transient with this exponent is lost beside any number it could be added to.
DECAYED = -100.0

#: Poles closer to the real axis than this part of their size are real: oscillating ones made of
#: doubles keep half the digits of a double between them and the axis.
_REAL_POLE = Decimal("1e-12")

NOTHING: Pair = (0j, 0j)


class ToneKernel(NamedTuple):
    """Divided differences of F for one tone of unit amplitude: vectors over the two modes.

    ``confluent`` holds F[iu], F[iu, x1], F[iu, x1, x2]; ``periodic`` the phasor X(u); ``pair`` the
    coefficients of E[x1, x2] and E[x2] next to the phasor; ``mirror`` those of their conjugates;
    ``gaps`` are i u - x1 and i u - x2.
    """

    node: complex
    gaps: tuple[complex, complex]
    confluent: tuple[Pair, Pair, Pair]
    periodic: Pair
    pair: tuple[Pair, Pair]
    mirror: tuple[Pair, Pair]


class Roots(NamedTuple):
    """The eigenvalues above the real axis: x1, x2, their difference, and 2 pi times growth rates.

    x1 is the one that decays no faster than the other.
    """

    x1: complex
    x2: complex
    gap: complex
    growth1: float
    growth2: float
    frequency1: Frequency
    frequency2: Frequency


class Pencil(NamedTuple):
    """P(x) of a model: adj(P) as polynomials, the poles in 50 digits, and V (None: no mirror)."""

    adjugate: tuple[tuple[Polynomial, Polynomial], tuple[Polynomial, Polynomial]]
    upper: Polynomial
    lower: Polynomial | None
    poles: tuple[Precise, Precise]


def oscillator_pencil(p: Parameters) -> Pencil:
    """Return the pencil x^2 + x D~/2 pi + diag(eta^2) of the full equations."""
    w11, w22, w12 = (Precise(w) for w in damping(p))
    plus, minus = Precise(p.eta_plus), Precise(p.eta_minus)
    one, zero = Precise(1), Precise(0)
    mode1, mode2 = [plus * plus, w11, one], [minus * minus, w22, one]
    off = [zero, w12]
    quartic = add(multiply(mode1, mode2), [-c for c in multiply(off, off)])
    guess1 = Precise(-p.d1 / 2.0, p.eta_plus)
    guess2 = Precise(-p.d2 / 2.0, p.eta_minus)
    try:
        e1, e2 = upper_factor(quartic, (guess1 + guess2, guess1 * guess2))
        poles = _roots_of(e1, e2)
    except ArithmeticError:
        poles = None
    # a real pole of an overdamped mode shows up with a rounding error above or below the axis
    if poles is None or any(x.im <= abs(x.re) * _REAL_POLE for x in poles):
        raise ModelError(
            f"a mode is overdamped (d1 = {p.d1!r} Hz, d2 = {p.d2!r} Hz at eta_plus = "
            f"{p.eta_plus!r} Hz, eta_minus = {p.eta_minus!r} Hz): the exact solver needs "
            "oscillating modes; use solver 2 (rk4) or periodic_start"
        )
    upper = [e2, -e1, one]
    minus_off = [zero, -w12]
    return Pencil(
        ((mode2, minus_off), (minus_off, mode1)), upper, [c.conjugate() for c in upper], poles
    )


def rotating_pencil(p: Parameters, centre: float) -> Pencil:
    """Return the pencil of the slow envelope in the frame rotating at ``centre`` Hz.

    q~ = Re z, z = a(t) exp(2 pi i centre t) with a'' and D~ a' dropped: P(x) =
    2 i centre (x - i centre) + eta^2 - centre^2 + i centre D~/2 pi, divided by 2 i centre. Raises
    ModelError for a frame that does not rotate.
    """
    if centre == 0.0:
        raise ModelError(
            "the rotating frame of solver 1 (envelope) needs a drive above 0 Hz; use solver 0 "
            "(exact) or 2 (rk4)"
        )
    w11, w22, w12 = (Precise(w) for w in damping(p))
    half, zero, one = Precise(0.5), Precise(0), Precise(1)
    carrier = Precise(0.0, centre)

    def diagonal(eta: float, width: Precise) -> Precise:
        exact = Precise(eta)
        detuning = (exact - Precise(centre)) * (exact + Precise(centre)) / (carrier + carrier)
        return width * half + detuning - carrier

    k11, k22, k12 = diagonal(p.eta_plus, w11), diagonal(p.eta_minus, w22), w12 * half
    upper = add(multiply([k11, one], [k22, one]), [-(k12 * k12)])
    poles = _roots_of(-upper[1], upper[0])
    scale = one / (carrier + carrier)
    mode1, mode2 = [k11 * scale, scale], [k22 * scale, scale]
    off = [-(k12 * scale), zero]
    return Pencil(((mode2, off), (off, mode1)), upper, None, poles)


def _roots_of(e1: Precise, e2: Precise) -> tuple[Precise, Precise]:
    """Return the roots of x^2 - e1 x + e2 as mean plus and minus half their gap.

    A principal root has no negative real part, so the first root has the larger one.
    """
    mean = e1 * Precise(0.5)
    half_gap = (mean * mean - e2).sqrt()
    return mean + half_gap, mean - half_gap


def expm1(z: complex) -> complex:
    """Return exp(z) - 1 without cancellation for small z."""
    if abs(z) > 0.5:
        return cmath.exp(z) - 1.0
    real = math.expm1(z.real)
    sine = math.sin(0.5 * z.imag)
    return complex(real - 2.0 * sine * sine * (real + 1.0), math.sin(z.imag) * (real + 1.0))


def first_difference(ea: complex, eb: complex, gap: complex, t: float) -> complex:
    """Return E[a, b] = (ea - eb)/(a - b) from ea = exp(2 pi a t), eb and gap = a - b."""
    angle = TWO_PI * t * gap
    if abs(angle) > 0.5:
        return (ea - eb) / gap
    return eb * (expm1(angle) / gap if gap else TWO_PI * t)


def second_difference(
    gaps: tuple[complex, complex, complex], values: tuple[complex, complex, complex], t: float
) -> complex:
    """Return E[a, b, c], the second divided difference of exp(2 pi x t) over three poles.

    ``gaps`` are a - b, a - c and b - c, which the poles themselves would give with too few digits;
    ``values`` the exponentials. The Taylor series of complete homogeneous polynomials where all
    lie close, else the recursion over the widest gap, so that no difference of nearly equal
    numbers is divided by a small one.
    """
    (ab, ac, bc), (ea, eb, ec) = gaps, values
    za, zb = TWO_PI * t * ac, TWO_PI * t * bc
    if abs(za) < 1.0 and abs(zb) < 1.0:
        total, term, power, factorial = 0j, 1.0 + 0j, 1.0 + 0j, 2.0
        for order in range(3, 25):
            total += term / factorial
            power *= zb
            term = term * za + power
            factorial *= order
        return ec * total * (TWO_PI * t) ** 2
    if abs(za) < abs(zb):
        ab, ac, bc, ea, eb = -ab, bc, ac, eb, ea
    near, far = first_difference(ea, eb, ab, t), first_difference(eb, ec, bc, t)
    return (near - far) / ac


class Kernel:
    """Everything about a set of parameters that does not depend on time or amplitude."""

    def __init__(self, pencil: Pencil, gains: tuple[float, float]) -> None:
        """Round the poles of the pencil to doubles (frequencies to pairs of them)."""
        self.pencil = pencil
        self._gains = (Precise(gains[0]), Precise(gains[1]))
        x1, x2 = pencil.poles
        decay1, high1, low1 = x1.split()
        decay2, high2, low2 = x2.split()
        self.roots = Roots(
            complex(x1),
            complex(x2),
            complex(x1 - x2),
            TWO_PI * decay1,
            TWO_PI * decay2,
            Frequency(high1, low1),
            Frequency(high2, low2),
        )

    def tone(self, u: float) -> ToneKernel:
        """Return the divided differences for a drive at ``u`` Hz of unit amplitude."""
        with in_precise_arithmetic():
            node = Precise(0.0, u)
            x1, x2 = self.pencil.poles
            numerators = [
                add(multiply(row[0], [self._gains[0]]), multiply(row[1], [self._gains[1]]))
                for row in self.pencil.adjugate
            ]
            nodes = [node, x1, x2]
            lower = self.pencil.lower
            table = polynomial_differences(lower or [Precise(1)], nodes)
            front = [rational_differences(n, table, nodes) for n in numerators]
            gap1, gap2 = x1 - node, x2 - node
            if gap1.is_zero() or gap2.is_zero():
                raise ModelError(
                    f"the drive frequency {u!r} Hz lies exactly on an undamped eigenfrequency: "
                    "the response has no steady state"
                )
            one = Precise(1)
            h1, h12 = one / gap1, -(one / (gap1 * gap2))
            # split form: X(u) beside the coefficients of E[x1, x2] and E[x2]
            periodic = [f[0] / (gap1 * gap2) for f in front]
            first = [f[0] * h1 + f[1] for f in front]
            second = [f[0] * h12 + f[2] for f in front]
            mirror = [[Precise(0)] * 2] * 2
            if lower is not None:
                images = [x1.conjugate(), x2.conjugate()]
                below = multiply(self.pencil.upper, [-node, one])
                image_table = polynomial_differences(below, images)
                mirror = [rational_differences(n, image_table, images) for n in numerators]
        return ToneKernel(
            1j * u,
            (complex(-gap1), complex(-gap2)),
            (_pair(front, 0), _pair(front, 1), _pair(front, 2)),
            (complex(periodic[0]) / FOUR_PI_SQUARED, complex(periodic[1]) / FOUR_PI_SQUARED),
            (_vector(first), _vector(second)),
            (_pair(mirror, 0), _pair(mirror, 1)),
        )

    def free(self, columns: Sequence[Sequence[Polynomial]]) -> tuple[list[Pair], list[Pair]]:
        """Return the coefficients of E[x1, x2] and E[x2] for each initial state of ``columns``.

        A column is the numerator polynomial vector n(x) of the Laplace transform P^-1(x) n(x).
        """
        with in_precise_arithmetic():
            nodes = list(self.pencil.poles)
            table = polynomial_differences(self.pencil.lower or [Precise(1)], nodes)
            first: list[Pair] = []
            second: list[Pair] = []
            for n1, n2 in columns:
                rows = [add(multiply(a, n1), multiply(b, n2)) for a, b in self.pencil.adjugate]
                differences = [rational_differences(row, table, nodes) for row in rows]
                first.append((complex(differences[0][0]), complex(differences[1][0])))
                second.append((complex(differences[0][1]), complex(differences[1][1])))
        return first, second


def _pair(rows: Sequence[Sequence[Precise]], index: int) -> Pair:
    """Return one divided difference of both modes as doubles, over (2 pi)^2."""
    return (
        complex(rows[0][index]) / FOUR_PI_SQUARED,
        complex(rows[1][index]) / FOUR_PI_SQUARED,
    )


def _vector(rows: Sequence[Precise]) -> Pair:
    return complex(rows[0]) / FOUR_PI_SQUARED, complex(rows[1]) / FOUR_PI_SQUARED
