"""The exact solver with one mode only: the other answers at once, like a spring, or not at all.

The mode whose eigenfrequency is nearest to the drive moves by its own equation, without the
damping's coupling,

    q~n'' + D~nn q~n' + (2 pi eta_n)^2 q~n = g_n b~(t),

in closed form: phasors and a damped oscillation. The other mode is quasi-static: at each tone it
has its off-resonant phasor X_o = (g_o - i w D~12 X_n)/(C~oo - w^2 + i w D~oo) from the first moment
on, without a transient; or it is left out and rests at 0. What that costs is known beforehand, see
``error``.
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING, Any

from .model_error import ModelError
from .oscillator_equations import FOUR_PI_SQUARED, TWO_PI, Parameters, damping, phasors
from .oscillator_linear import centre_of
from .oscillator_phase import Frequency, difference, kept_phases

if TYPE_CHECKING:
    from .oscillator_linear import State

FULL, QUASI_STATIC, LEFT_OUT = 0, 1, 2


class SingleModeSolver:
    """The mode nearest to the drive between changes of parameters; the other one by ``other``."""

    def __init__(
        self, p: Parameters, other: int, offsets: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        self.p, self.other, self.offsets = p, other, offsets
        centre = centre_of(p)
        eta = p.eta_plus, p.eta_minus
        self.near = 0 if abs(eta[0] - centre) <= abs(eta[1] - centre) else 1
        self._decay = math.pi * damping(p)[self.near]
        self._omega = TWO_PI * eta[self.near]
        self._tones = [
            (Frequency(u), u, offset, tuple(cmath.rect(size, phase) * x for x in self.response(u)))
            for u, size, phase, offset in (
                (p.u1, p.A1, p.phase1, offsets[0]),
                (p.u2, p.A2, p.phase2, offsets[1]),
            )
            if size
        ]

    def response(self, u: float) -> tuple[complex, complex]:
        """Return the phasors of both modes for a drive of unit amplitude at ``u`` Hz, in s^2."""
        p, n = self.p, self.near
        widths = damping(p)
        gains = p.g1, p.g2
        own = [
            FOUR_PI_SQUARED * complex((eta - u) * (eta + u), u * width)
            for eta, width in zip((p.eta_plus, p.eta_minus), widths)
        ]
        if not own[n]:
            raise ModelError(f"a drive at {u!r} Hz has no steady state: it is on an undamped mode")
        near = gains[n] / own[n]
        far = 0j
        if self.other == QUASI_STATIC:
            coupling = FOUR_PI_SQUARED * complex(0.0, u * widths.w12)
            far = (gains[1 - n] - coupling * near) / own[1 - n] if own[1 - n] else 0j
        return (near, far) if n == 0 else (far, near)

    # -- the course of a run --------------------------------------------------------------------

    @property
    def grows(self) -> bool:
        """Whether a transient can leave the range of a double."""
        return self._free is not None and self._decay < 0.0

    def start(self, t: float, state: State | None, b: float) -> None:
        """Begin at ``t`` s from a state (None: on the periodic orbit) with input ``b``."""
        p, n = self.p, self.near
        self.anchor, self.b = t, b
        self._free: tuple[float, float] | None = None
        own = b * (p.g1, p.g2)[n] / self._omega**2
        far = 0.0
        if self.other == QUASI_STATIC:
            far = b * (p.g1, p.g2)[1 - n] / (TWO_PI * (p.eta_plus, p.eta_minus)[1 - n]) ** 2
        self._static = (own, far) if n == 0 else (far, own)
        if state is None:
            return
        square = (self._omega - self._decay) * (self._omega + self._decay)
        if square <= 0.0:
            raise ModelError(
                f"a mode is overdamped (d1 = {p.d1!r} Hz, d2 = {p.d2!r} Hz): use solver 2 (rk4) or "
                "periodic_start"
            )
        self._turning = math.sqrt(square)
        self._cycles = Frequency(self._turning / TWO_PI)
        q, v = self._orbit(t), self._orbit_velocity(t)
        x = state[n].real - q[n]
        self._free = x, (TWO_PI * state[2 + n].real - v + self._decay * x) / self._turning

    def advance(self, t: float) -> None:
        """Do nothing: the motion at ``t`` s is evaluated from the anchor when it is asked for."""

    def displacement(self, t: float) -> tuple[float, float]:
        """Return q~1, q~2 at ``t`` s."""
        q1, q2 = self._orbit(t)
        x, _ = self._transient(t)
        return (q1 + x, q2) if self.near == 0 else (q1, q2 + x)

    def full_state(self, t: float) -> State:
        """Return displacements and velocities over 2 pi; the other mode's velocity counts as 0."""
        q1, q2 = self.displacement(t)
        v = (self._orbit_velocity(t) + self._transient(t)[1]) / TWO_PI
        speeds = (v, 0.0) if self.near == 0 else (0.0, v)
        return complex(q1), complex(q2), complex(speeds[0]), complex(speeds[1])

    def with_input(self, b: float, t: float) -> None:
        """Hold the input at ``b`` from ``t`` s on."""
        self.start(t, self.full_state(t), b)

    def retuned(self, p: Parameters, t: float) -> SingleModeSolver:
        """Return the solver for new parameters, with state and drive phases kept at ``t`` s."""
        before = self.p.u1, self.p.u2
        offsets = kept_phases(self.offsets, before, (p.u1, p.u2), t)
        solver = SingleModeSolver(p, self.other, offsets)
        solver.start(t, self.full_state(t), self.b)
        return solver

    def snapshot(self) -> dict[str, Any]:
        """Return what must be stored, besides parameters, to continue bit for bit."""
        free = None if self._free is None else list(self._free)
        return {"anchor": self.anchor, "free": free, "b": self.b, "offsets": list(self.offsets)}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Take up a snapshot of a solver with the same parameters and offsets."""
        free = snapshot["free"]
        state = None if free is None else (0j, 0j, 0j, 0j)
        self.start(snapshot["anchor"], state, snapshot["b"])
        self._free = None if free is None else (free[0], free[1])

    # -- evaluation -----------------------------------------------------------------------------

    def _orbit(self, t: float) -> tuple[float, float]:
        """Return the periodic and the static part."""
        q1, q2 = self._static
        for frequency, _, offset, (y1, y2) in self._tones:
            turn = cmath.rect(1.0, TWO_PI * (frequency.cycles(t) + offset))
            q1 += (y1 * turn).real
            q2 += (y2 * turn).real
        return q1, q2

    def _orbit_velocity(self, t: float) -> float:
        """Return the velocity of the near mode's periodic part."""
        return sum(
            (TWO_PI * u * 1j * y[self.near] * cmath.rect(1.0, TWO_PI * (f.cycles(t) + offset))).real
            for f, u, offset, y in self._tones
        )

    def _transient(self, t: float) -> tuple[float, float]:
        """Return displacement and velocity of the near mode's damped oscillation."""
        if self._free is None:
            return 0.0, 0.0
        dt, dt_low = difference(t, self.anchor)
        c, s = self._free
        turn = cmath.rect(math.exp(-self._decay * dt), TWO_PI * self._cycles.cycles(dt, dt_low))
        x = c * turn.real + s * turn.imag
        v = self._turning * (s * turn.real - c * turn.imag) - self._decay * x
        return x, v


def error(p: Parameters, result: tuple[complex, complex], u: float) -> tuple[float, float]:
    """Return how far phasors at ``u`` Hz are from those of the full equations, mode by mode.

    |X - X_full|/|X_full|, which bounds the relative error of the amplitude; 1 where only one of
    them is 0.
    """
    full = phasors(p, u)
    return (_part(result[0], full[0]), _part(result[1], full[1]))


def _part(result: complex, full: complex) -> float:
    if result == full:
        return 0.0
    return abs(result - full) / abs(full) if full else 1.0
