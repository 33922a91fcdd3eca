"""The coupled oscillator of Bartsch et al., arXiv:2412.07301, in SI units: closed forms.

    q~'' + D~ q~' + C~ q~ = (g1, g2) b~(t)
    b~(t) = A1 cos(2 pi u1 t + phase1) + A2 cos(2 pi u2 t + phase2) + b

with D~ = 2 pi T diag(d1, d2) T^T, C~ = diag((2 pi eta_plus)^2, (2 pi eta_minus)^2) and T the
rotation or the reflection of the angle theta. The symbols without a tilde live in the uncoupled
coordinates q = T^T q~, in which the stiffness matrix shows the coupling lambda.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from .model_error import ModelError

TWO_PI = 2.0 * math.pi
FOUR_PI_SQUARED = TWO_PI * TWO_PI
#: Displacements and velocities of both modes in a start at rest, as the solvers take them.
AT_REST = (0j, 0j, 0j, 0j)


class Parameters(NamedTuple):
    """The physical parameters: angles in rad, all frequencies and damping coefficients in Hz."""

    theta: float
    reflection: bool
    d1: float
    d2: float
    eta_plus: float
    eta_minus: float
    u1: float
    u2: float
    A1: float
    A2: float
    phase1: float
    phase2: float
    g1: float
    g2: float


class Damping(NamedTuple):
    """The hybridised damping matrix over 2 pi, D~ / 2 pi, in Hz: the line widths of the modes."""

    w11: float
    w22: float
    w12: float


def transformation(theta: float, reflection: bool) -> tuple[float, float, float, float]:
    """Return (T11, T12, T21, T22) of q~ = T q, for either form of O(2)."""
    c, s = math.cos(theta), math.sin(theta)
    return (-c, s, s, c) if reflection else (c, -s, s, c)


def damping(p: Parameters) -> Damping:
    """Return D~ / 2 pi = T diag(d1, d2) T^T in Hz."""
    c, s = math.cos(p.theta), math.sin(p.theta)
    w12 = c * s * (p.d1 - p.d2)
    return Damping(
        c * c * p.d1 + s * s * p.d2, s * s * p.d1 + c * c * p.d2, -w12 if p.reflection else w12
    )


def coupling(p: Parameters) -> tuple[float, float, float]:
    """Return (lambda, f1, f2) in Hz; lambda is NaN where lambda^2 < 0.

    lambda^2 = -sin(2 theta)/2 (eta_minus^2 - eta_plus^2), f1^2 = c^2 eta_plus^2 + s^2 eta_minus^2,
    f2^2 = s^2 eta_plus^2 + c^2 eta_minus^2: C = T^T C~ T, alike for both forms of T.
    """
    c, s = math.cos(p.theta), math.sin(p.theta)
    f1 = math.hypot(c * p.eta_plus, s * p.eta_minus)
    f2 = math.hypot(s * p.eta_plus, c * p.eta_minus)
    # sqrt of each factor, so that no square leaves the range of a double
    factor = -0.5 * math.sin(2.0 * p.theta) * (p.eta_minus - p.eta_plus)
    if not factor >= 0.0:
        return math.nan, f1, f2
    return math.sqrt(factor) * math.sqrt(p.eta_minus + p.eta_plus), f1, f2


def phasors(p: Parameters, u: float) -> tuple[complex, complex]:
    """Return the steady-state response X(u) = A(u)^-1 (g1, g2)^T to cos(2 pi u t), in s^2.

    A(u) = C~ - (2 pi u)^2 I + i 2 pi u D~. Differences of squares are written as products and the
    determinant with D~11 D~22 - D~12^2 = (2 pi)^2 d1 d2, so that nothing cancels at high Q or
    where one damping coefficient is far above the other. Raises ModelError where A(u) is singular
    (no damping and u on an eigenfrequency).
    """
    return _solve(p, *_detunings(p, u), u, u)


def rotating_phasors(p: Parameters, u: float, centre: float) -> tuple[complex, complex]:
    """Return the phasors of the envelope model in the frame rotating at ``centre`` Hz.

    eta^2 - u^2 becomes eta^2 - centre^2 - 2 centre (u - centre), and u D~ becomes centre D~.
    """
    shift = 2.0 * centre * (u - centre)
    x = (p.eta_plus - centre) * (p.eta_plus + centre) - shift
    y = (p.eta_minus - centre) * (p.eta_minus + centre) - shift
    return _solve(p, x, y, centre, u)


def _detunings(p: Parameters, u: float) -> tuple[float, float]:
    """Return eta^2 - u^2 of both modes as products."""
    x = (p.eta_plus - u) * (p.eta_plus + u)
    y = (p.eta_minus - u) * (p.eta_minus + u)
    return x, y


def _determinant(p: Parameters, x: float, y: float, carrier: float) -> complex:
    """Return det(diag(x, y) + i carrier D~/2 pi), the squares of D~ contracted to d1 d2."""
    w11, w22, _ = damping(p)
    return complex(x * y - carrier * carrier * p.d1 * p.d2, carrier * (x * w22 + y * w11))


def _solve(p: Parameters, x: float, y: float, carrier: float, u: float) -> tuple[complex, complex]:
    """Return ([diag(x, y) + i carrier D~/2 pi]^-1 (g1, g2)^T) / (2 pi)^2."""
    determinant = _determinant(p, x, y, carrier)
    if not determinant:
        raise ModelError(
            f"a drive at {u!r} Hz has no steady state: it lies on an undamped eigenfrequency"
        )
    v1, v2 = _damping_adjugate(p)
    scale = FOUR_PI_SQUARED * determinant
    return complex(y * p.g1, carrier * v1) / scale, complex(x * p.g2, carrier * v2) / scale


def _damping_adjugate(p: Parameters) -> tuple[float, float]:
    """Return adj(D~ / 2 pi) g = d_low g + (d_high - d_low) n (n . g), n the column of T across.

    Split so, the small damping coefficient keeps its digits next to a large one, and nothing is
    left of the coupling where both are equal.
    """
    t11, t12, t21, t22 = transformation(p.theta, p.reflection)
    low, high, n1, n2 = (p.d2, p.d1, t12, t22) if p.d1 >= p.d2 else (p.d1, p.d2, t11, t21)
    across = (high - low) * (n1 * p.g1 + n2 * p.g2)
    return low * p.g1 + across * n1, low * p.g2 + across * n2


def physical(
    matrix: tuple[float, float, float, float], q1: float, q2: float
) -> tuple[float, float]:
    """Return the uncoupled displacements q = T^T q~, T row by row."""
    t11, t12, t21, t22 = matrix
    return t11 * q1 + t21 * q2, t12 * q1 + t22 * q2


def check(p: Parameters, periodic_start: bool) -> list[str]:
    """Return warnings; raise ModelError, naming parameter and value, for what has no meaning."""
    if not all(map(math.isfinite, p)):
        name, value = next(pair for pair in zip(p._fields, p) if not math.isfinite(pair[1]))
        raise ModelError(f"{name} = {value!r} is not a finite number")
    for name, value in (("eta_plus", p.eta_plus), ("eta_minus", p.eta_minus)):
        if value <= 0.0:
            raise ModelError(f"{name} = {value!r} Hz: an eigenfrequency must be above 0 Hz")
    for name, value in (("u1", p.u1), ("u2", p.u2)):
        if value < 0.0:
            raise ModelError(f"{name} = {value!r} Hz: a drive frequency must not be negative")
    if p.d1 > 0.0 and p.d2 > 0.0:
        return []
    return _check_undamped(p, periodic_start)


def _check_undamped(p: Parameters, periodic_start: bool) -> list[str]:
    """Return warnings of growth; raise ModelError where there is no orbit or no steady state."""
    warnings = []
    for name, value in (("d1", p.d1), ("d2", p.d2)):
        if periodic_start and value <= 0.0:
            raise ModelError(
                f"{name} = {value!r} Hz: the damping matrix is not positive definite, so there is "
                "no attracting periodic orbit to start on; set periodic_start to false"
            )
        if value < 0.0:
            warnings.append(f"{name} = {value!r} Hz is negative: the oscillation may grow")
    for name, u, size in (("u1", p.u1, p.A1), ("u2", p.u2, p.A2)):
        if size and not _determinant(p, *_detunings(p, u), u):
            raise ModelError(
                f"{name} = {u!r} Hz lies exactly on an undamped eigenfrequency (eta_plus = "
                f"{p.eta_plus!r} Hz, eta_minus = {p.eta_minus!r} Hz, d1 = {p.d1!r} Hz, "
                f"d2 = {p.d2!r} Hz): the drive has no steady state"
            )
    return warnings
