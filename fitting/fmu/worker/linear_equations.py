"""Equations of motion that are linear, x' = A x + b u + c: found by asking, solved exactly.

An FMU of model exchange gives x' at any x. Where that is linear in x and in its driven input, the
motion over a step follows from a matrix exponential, to rounding and at a tenth of the work of an
integration. That equations are linear everywhere is not known: they are compared with the
FMU at states of all sizes beforehand, and wherever the motion comes by.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import expm, matrix_balance

from fitting.fmu.runs import Tone
from fitting.text.arrays import FloatArray

TURN = 2.0 * math.pi
#: States up to which A is asked for, one evaluation each.
MOST_STATES = 30
#: Difference from the FMU's x', of the sum of all terms' sizes, from which it is not linear.
CURVED = 1e-11
#: A constant is rounding that is this part of the sizes whose difference it is.
ROUNDED = 1e-14

#: Sizes of states and input, in their scales, at which equations are looked at beforehand, and how
#: often at each: limits, gaps and powers show themselves at some of them.
SIZES, TIMES = 10.0 ** np.arange(-9, 4), 4

#: x' at some x, with the input at some value.
Rate = Callable[[FloatArray, float], FloatArray]


@dataclass(frozen=True)
class LinearEquations:
    """x' = A x + b u + c: ``matrix`` (n, n), ``drive`` (n,) and ``constant`` (n,)."""

    matrix: FloatArray
    drive: FloatArray
    constant: FloatArray

    def describe(self, rate: FloatArray, x: FloatArray, u: float) -> bool:
        """Whether they give the FMU's x' (n,) at x (n,).

        Args:
            rate: as the FMU has it, (n,).
            x: states, (n,).
            u: the input.
        """
        terms = self.matrix * x
        pushed = u * self.drive + self.constant
        size = np.abs(terms).sum(axis=1) + abs(u) * np.abs(self.drive) + np.abs(self.constant)
        return bool((np.abs(rate - terms.sum(axis=1) - pushed) <= CURVED * size).all())

    def with_constant(self, rate: FloatArray, x: FloatArray, u: float) -> LinearEquations:
        """The same A and b with the c that x' has at x, as after an event.

        Args:
            rate: as the FMU has it, (n,).
            x: states, (n,).
            u: the input.
        """
        terms = np.abs(self.matrix * x).sum(axis=1) + np.abs(u * self.drive)
        constant = rate - self.matrix @ x - u * self.drive
        # what rounding leaves of a difference is no constant: where all terms are small it is large
        constant[np.abs(constant) <= ROUNDED * terms] = 0.0
        return LinearEquations(self.matrix, self.drive, constant)

    @cached_property
    def fastest_hz(self) -> float:
        """Frequency of the fastest free oscillation, Hz."""
        return float(np.max(np.abs(np.linalg.eigvals(self.matrix).imag))) / TURN

    def propagator(self, step_s: float, tones: Sequence[Tone]) -> FloatArray:
        """What makes x(t + h) of x(t), cosine and sine of each tone at t, and c: (n, 2 n + 2 m).

        Args:
            step_s: h, s.
            tones: frequency in Hz, amplitude and phase of each of m.
        """
        n, m = len(self.matrix), len(tones)
        whole = np.zeros((2 * n + 2 * m, 2 * n + 2 * m))
        whole[:n, :n] = self.matrix
        for k, (frequency_hz, amplitude, _) in enumerate(tones):
            i, w = n + 2 * k, TURN * frequency_hz
            whole[:n, i] = amplitude * self.drive
            whole[i, i + 1], whole[i + 1, i] = -w, w
        whole[:n, n + 2 * m :] = np.eye(n)
        # states differ by many powers of ten: unscaled, that would cost digits
        balanced, (scale, _) = matrix_balance(step_s * whole, permute=False, separate=True)
        return np.asarray(expm(balanced)[:n] * scale[:n, None] / scale[None, :])

    def moved(self, by: FloatArray, x: FloatArray, phases: Sequence[float]) -> FloatArray:
        """x(t + h), (n,).

        Args:
            by: the propagator over h.
            x: states at t, (n,).
            phases: of the tones at t, rad.
        """
        turning = [part for phase in phases for part in (math.cos(phase), math.sin(phase))]
        return np.asarray(by @ np.concatenate([x, turning, self.constant]))


@np.errstate(all="ignore")  # what is no number is not linear
def linear_equations(rate: Rate, scales: FloatArray, *, driven: bool) -> LinearEquations | None:
    """The equations, from x' about x = 0; None: they are not linear, or of too many states.

    Args:
        rate: of the FMU.
        scales: sizes of the states, (n,).
        driven: whether the input drives it.
    """
    n = len(scales)
    if not 0 < n <= MOST_STATES:
        return None
    here = np.zeros(n)
    constant = rate(here, 0.0)
    columns = []
    for j, scale in enumerate(scales.tolist()):
        x = here.copy()
        x[j] = scale
        columns.append((rate(x, 0.0) - constant) / scale)
    drive = rate(here, 1.0) - constant if driven else np.zeros(n)
    equations = LinearEquations(np.array(columns).T.copy(), drive, constant)
    if not all(np.isfinite(part).all() for part in (equations.matrix, drive, constant)):
        return None
    # at seeded states and inputs of all sizes
    draws = np.random.default_rng(1).standard_normal((TIMES, len(SIZES), n + 1))
    for *x_scaled, u in (SIZES[:, None] * draws).reshape(-1, n + 1):
        x = scales * np.array(x_scaled)
        if not equations.describe(rate(x, float(u)), x, float(u)):
            return None
    return equations
