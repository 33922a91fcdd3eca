"""N coupled modes in physical coordinates with a parametric pump, in SI units: their matrices.

    x'' + D x' + (C + C_p cos(2 pi u_p t + phi_p)) x = g b~(t)
    b~(t) = A1 cos(2 pi u1 t + phase1) + A2 cos(2 pi u2 t + phase2) + b

with D = 2 pi diag(d_i), C_ii = (2 pi f_i)^2, C_ij = -(2 pi lambda_ij)^2, and C_p the same matrix
with every entry times its own depth. Without a pump and for N = 2 these are the equations of
Bartsch et al., arXiv:2412.07301, in the uncoupled coordinates q, with g = T^T (g1, g2) of the
hybridised ones.
All matrices here are over (2 pi)^2, in Hz^2.
"""

from __future__ import annotations

import math
from decimal import Decimal
from typing import TYPE_CHECKING, NamedTuple

from .model_error import ModelError
from .modes_matrices import eigensystem, frobenius
from .oscillator_precise import in_precise_arithmetic

if TYPE_CHECKING:  # subscripted here, these would need a host with Python 3.9 or later
    Reals = tuple[float, ...]
    Exact = list[list[Decimal]]


#: The parameters that are not one for each mode or pair.
SINGLE = ("u1", "u2", "A1", "A2", "phase1", "phase2", "pump_hz", "pump_phase")


class Parameters(NamedTuple):
    """The physical parameters: frequencies, damping and coupling in Hz, angles in rad.

    ``coupling`` and ``depth_coupling`` go through the pairs i < j row by row, see ``pairs``;
    ``tolerance`` is what accuracy is asked for under a pump, and ``readout`` of which sum.
    """

    f: Reals
    d: Reals
    coupling: Reals
    g: Reals
    u1: float
    u2: float
    A1: float
    A2: float
    phase1: float
    phase2: float
    pump_hz: float
    pump_phase: float
    depth_f: Reals
    depth_coupling: Reals
    readout: Reals = ()
    tolerance: float = 1e-14

    @property
    def pumped(self) -> bool:
        """Whether anything is modulated."""
        return any(self.depth_f) or any(self.depth_coupling)

    @property
    def moves(self) -> Parameters:
        """What moves the modes without the drive: the same, drives and what is read left out."""
        still = self._replace(u1=0.0, u2=0.0, A1=0.0, A2=0.0, phase1=0.0, phase2=0.0)
        return still._replace(pump_phase=0.0, g=(), readout=(), tolerance=0.0)

    @property
    def tones(self) -> tuple[tuple[float, float, float], ...]:
        """Frequency in Hz, amplitude and phase in rad of both tones."""
        return (self.u1, self.A1, self.phase1), (self.u2, self.A2, self.phase2)


class Matrices(NamedTuple):
    """C, C_p and D over (2 pi)^2 in 50 digits and as doubles, and what bounds them.

    ``eta`` are the eigenfrequencies of C, rising, in Hz, ``shapes`` their vectors as columns;
    ``lowest`` and ``highest`` bound the eigenvalues of C, ``narrowest`` and ``widest`` are the
    least and the largest d, ``pump_norm`` bounds the 2-norm of C_p, ``relative_pump`` that of
    C^-1/2 C_p C^-1/2.
    """

    stiffness: Exact
    stiffness_values: list[list[float]]
    pump: Exact
    pump_values: list[list[float]]
    damping: list[Decimal]
    damping_values: Reals
    eta: Reals
    shapes: list[list[float]]
    lowest: float
    highest: float
    narrowest: float
    widest: float
    pump_norm: float
    relative_pump: float


def pairs(n: int) -> list[tuple[int, int]]:
    """Return the pairs i < j of n modes, row by row."""
    return [(i, j) for i in range(n) for j in range(i + 1, n)]


def matrices(p: Parameters) -> Matrices:
    """Return the matrices; raises ModelError where C is not positive definite."""
    n = len(p.f)
    with in_precise_arithmetic():
        stiffness = _symmetric(p, [1.0] * n, [1.0] * len(p.coupling))
        pump = _symmetric(p, p.depth_f, p.depth_coupling)
        _check_positive(p, stiffness)
    stiffness_values = [[float(x) for x in row] for row in stiffness]
    values, shapes = eigensystem(stiffness_values)
    highest = values[-1] * (1.0 + 1e-12)
    # Jacobi's eigenvalues are good to rounding of the largest
    lowest = max(values[0] - 1e-14 * highest, 0.0)
    pump_values = [[float(x) for x in row] for row in pump]
    return Matrices(
        stiffness,
        stiffness_values,
        pump,
        pump_values,
        [Decimal(d) for d in p.d],
        p.d,
        tuple(math.sqrt(max(v, 0.0)) for v in values),
        shapes,
        lowest,
        highest,
        min(p.d),
        max(p.d),
        frobenius(pump_values) * (1.0 + 1e-12),
        _relative(pump_values, values, shapes),
    )


def _symmetric(p: Parameters, on_f: Reals | list[float], on_coupling: Reals | list[float]) -> Exact:
    """Return diag(f^2) - lambda^2, each entry times its factor."""
    n = len(p.f)
    rows = [[Decimal(0)] * n for _ in range(n)]
    for i in range(n):
        rows[i][i] = Decimal(p.f[i]) * Decimal(p.f[i]) * Decimal(on_f[i])
    for (i, j), size, factor in zip(pairs(n), p.coupling, on_coupling):
        rows[i][j] = rows[j][i] = -Decimal(size) * Decimal(size) * Decimal(factor)
    return rows


def _relative(pump: list[list[float]], values: list[float], shapes: list[list[float]]) -> float:
    """Return a bound of the 2-norm of C^-1/2 C_p C^-1/2."""
    n = len(values)
    rotated = [
        [
            sum(shapes[k][i] * pump[k][m] * shapes[m][j] for k in range(n) for m in range(n))
            / math.sqrt(max(values[i], 1e-300) * max(values[j], 1e-300))
            for j in range(n)
        ]
        for i in range(n)
    ]
    return frobenius(rotated) * (1.0 + 1e-9)


def _check_positive(p: Parameters, stiffness: Exact) -> None:
    """Raise ModelError where a pivot of the elimination is not positive (Sylvester)."""
    n = len(stiffness)
    rows = [list(row) for row in stiffness]
    for i in range(n):
        if rows[i][i] <= 0:
            names = ", ".join(
                f"lambda{a + 1}{b + 1} = {size!r} Hz"
                for (a, b), size in zip(pairs(n), p.coupling)
                if size and b <= i
            )
            raise ModelError(
                f"the stiffness matrix is not positive definite: with f{i + 1} = {p.f[i]!r} Hz and "
                f"{names} the modes have a motion without a restoring force; weaker coupling is "
                "wanted"
            )
        for k in range(i + 1, n):
            factor = rows[k][i] / rows[i][i]
            for j in range(i, n):
                rows[k][j] -= factor * rows[i][j]


def check(p: Parameters, periodic_start: bool) -> list[str]:
    """Return warnings; raise ModelError, naming parameter and value, for what has no meaning."""
    named = _named(p)
    for name, value in named:
        if not math.isfinite(value):
            raise ModelError(f"{name} = {value!r} is not a finite number")
    for name, value in named:
        if name[0] == "f" and value <= 0.0:
            raise ModelError(f"{name} = {value!r} Hz: an eigenfrequency must be above 0 Hz")
        if name.startswith("lambda") and value < 0.0:
            raise ModelError(
                f"{name} = {value!r} Hz: a coupling must not be negative (its square counts; a "
                "force of the other sign is that of a mode with g and readout negated)"
            )
        if name in ("u1", "u2") and value < 0.0:
            raise ModelError(f"{name} = {value!r} Hz: a drive frequency must not be negative")
    if p.pumped and p.pump_hz <= 0.0:
        raise ModelError(
            f"pump_hz = {p.pump_hz!r} Hz: a pump with depths that are not 0 needs a frequency "
            "above 0 Hz"
        )
    return _check_damping(p, periodic_start)


def _named(p: Parameters) -> list[tuple[str, float]]:
    """Return all parameters by the names of the FMU's variables."""
    n = len(p.f)
    marks = [f"{i + 1}{j + 1}" for i, j in pairs(n)]
    rows = (("f", p.f), ("d", p.d), ("g", p.g), ("depth_f", p.depth_f))
    return [
        *((f"{stem}{i + 1}", x) for stem, values in rows for i, x in enumerate(values)),
        *((f"lambda{mark}", x) for mark, x in zip(marks, p.coupling)),
        *((f"depth_lambda{mark}", x) for mark, x in zip(marks, p.depth_coupling)),
        *((name, getattr(p, name)) for name in SINGLE),
    ]


def _check_damping(p: Parameters, periodic_start: bool) -> list[str]:
    """Return warnings of growth; raise ModelError where there is no orbit to start on."""
    warnings = []
    for i, value in enumerate(p.d):
        name = f"d{i + 1}"
        if value > 0.0:
            continue
        if periodic_start:
            raise ModelError(
                f"{name} = {value!r} Hz: the damping matrix is not positive definite, so there is "
                "no attracting periodic orbit to start on; set periodic_start to false"
            )
        if p.pumped:
            raise ModelError(
                f"{name} = {value!r} Hz: a pumped system needs a damping above 0 Hz of every mode"
            )
        if value < 0.0:
            warnings.append(f"{name} = {value!r} Hz is negative: the oscillation may grow")
    return warnings
