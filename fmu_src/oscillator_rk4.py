"""The solver ``rk4``: the classical Runge-Kutta method with a fixed substep, for comparison.

What a conventional FMU would do: error O(substep^4) per unit time, tens of substeps per carrier
period, hence a cost that grows with the quality factor while the exact solver's does not.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from .model_error import ModelError
from .oscillator_equations import TWO_PI, Parameters, damping, phasors
from .oscillator_phase import Frequency, kept_phases

if TYPE_CHECKING:
    from .oscillator_linear import State

#: Substeps per period of the fastest frequency where the substep is left to the solver.
SUBSTEPS_PER_PERIOD = 40


class RungeKuttaSolver:
    """The oscillator integrated from communication point to communication point."""

    grows = True  # every step is checked: a long substep diverges whatever the damping

    def __init__(
        self, p: Parameters, substep: float, offsets: tuple[float, float] = (0.0, 0.0)
    ) -> None:
        self.p, self.offsets, self.requested = p, offsets, substep
        driven = [u for u, size in ((p.u1, p.A1), (p.u2, p.A2)) if size]  # others have no frequency
        fastest = max(p.eta_plus, p.eta_minus, *driven)
        self.substep = substep or 1.0 / (SUBSTEPS_PER_PERIOD * fastest)
        w11, w22, w12 = damping(p)
        self._damping = TWO_PI * w11, TWO_PI * w22, TWO_PI * w12
        self._stiffness = (TWO_PI * p.eta_plus) ** 2, (TWO_PI * p.eta_minus) ** 2
        self._tones = [
            (size, Frequency(u), offset + phase / TWO_PI)
            for size, u, offset, phase in (
                (p.A1, p.u1, offsets[0], p.phase1),
                (p.A2, p.u2, offsets[1], p.phase2),
            )
            if size
        ]

    def response(self, u: float) -> tuple[complex, complex]:
        """Return the phasors of both modes for a drive of unit amplitude at ``u`` Hz, in s^2."""
        return phasors(self.p, u)

    def start(self, t: float, state: State | None, b: float) -> None:
        """Begin at ``t`` s from displacements and velocities over 2 pi (None: periodic orbit)."""
        self.b = b
        self.t = t
        if state is None:
            state = self._orbit(t)
        self._y = (
            state[0].real,
            state[1].real,
            TWO_PI * state[2].real,
            TWO_PI * state[3].real,
        )

    def _orbit(self, t: float) -> State:
        """Return the state on the periodic orbit, the held input's displacement included."""
        p = self.p
        q = [
            complex(self.b * p.g1 / self._stiffness[0]),
            complex(self.b * p.g2 / self._stiffness[1]),
        ]
        w = [0j, 0j]
        for size, frequency, offset in self._tones:
            angle = TWO_PI * (frequency.cycles(t) + offset)
            turn = size * complex(math.cos(angle), math.sin(angle))
            for i, x in enumerate(phasors(p, frequency.high)):
                q[i] += (x * turn).real
                w[i] += (1j * frequency.high * x * turn).real
        return q[0], q[1], w[0], w[1]

    def advance(self, t: float) -> None:
        """Integrate to ``t`` s in equal substeps no longer than the one asked for."""
        span = t - self.t
        count = max(1, math.ceil(span / self.substep * (1.0 - 1e-12)))
        h, begin, y = span / count, self.t, self._y
        force = self._force(begin)
        for k in range(count):
            middle = self._force(begin + (k + 0.5) * h)
            after = self._force(begin + (k + 1) * h if k + 1 < count else t)
            y = self._substep(y, h, (force, middle, after))
            force = after
        if not all(map(math.isfinite, y)):
            raise ModelError(
                f"the rk4 solution left the range of numbers at t = {t!r} s with substeps of "
                f"{h!r} s; a stable substep is below {2.8 / max(self._stiffness) ** 0.5!r} s"
            )
        self.t, self._y = t, y

    def _force(self, t: float) -> float:
        """Return the drive at ``t`` s."""
        return self.b + sum(
            size * math.cos(TWO_PI * (frequency.cycles(t) + offset))
            for size, frequency, offset in self._tones
        )

    def _substep(
        self,
        y: tuple[float, float, float, float],
        h: float,
        force: tuple[float, float, float],
    ) -> tuple[float, float, float, float]:
        """Return the state after one substep of the classical fourth-order method."""
        q1, q2, v1, v2 = y
        a1, a2 = self._acceleration(force[0], q1, q2, v1, v2)
        total = [v1, v2, a1, a2]
        k1, k2, k3, k4 = v1, v2, a1, a2
        for weight, part, f in ((2.0, 0.5, force[1]), (2.0, 0.5, force[1]), (1.0, 1.0, force[2])):
            s = part * h
            k1, k2, p1, p2 = v1 + s * k3, v2 + s * k4, q1 + s * k1, q2 + s * k2
            k3, k4 = self._acceleration(f, p1, p2, k1, k2)
            total[0] += weight * k1
            total[1] += weight * k2
            total[2] += weight * k3
            total[3] += weight * k4
        s = h / 6.0
        return q1 + s * total[0], q2 + s * total[1], v1 + s * total[2], v2 + s * total[3]

    def _acceleration(
        self, force: float, q1: float, q2: float, v1: float, v2: float
    ) -> tuple[float, float]:
        """Return q~'' of both modes."""
        (d11, d22, d12), (c1, c2) = self._damping, self._stiffness
        return (
            self.p.g1 * force - d11 * v1 - d12 * v2 - c1 * q1,
            self.p.g2 * force - d12 * v1 - d22 * v2 - c2 * q2,
        )

    def displacement(self, t: float) -> tuple[float, float]:
        """Return q~1, q~2 at the communication point reached."""
        return self._y[0], self._y[1]

    def with_input(self, b: float, t: float) -> None:
        """Hold the input at ``b`` from ``t`` s on."""
        self.b = b

    def retuned(self, p: Parameters, t: float) -> RungeKuttaSolver:
        """Return the solver for new parameters, with state and drive phases kept at ``t`` s."""
        before = self.p.u1, self.p.u2
        offsets = kept_phases(self.offsets, before, (p.u1, p.u2), t)
        solver = RungeKuttaSolver(p, self.requested, offsets)
        solver.take_over(self)
        return solver

    def take_over(self, other: RungeKuttaSolver) -> None:
        """Go on from the state of another solver."""
        self.b, self.t, self._y = other.b, other.t, other._y

    def snapshot(self) -> dict[str, Any]:
        """Return what must be stored, besides parameters, to continue bit for bit."""
        return {"t": self.t, "y": list(self._y), "b": self.b, "offsets": list(self.offsets)}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Take up a snapshot of a solver with the same parameters and offsets."""
        self.t, self.b = snapshot["t"], snapshot["b"]
        y = snapshot["y"]
        self._y = (y[0], y[1], y[2], y[3])
