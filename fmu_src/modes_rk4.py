"""The solver ``rk4`` of N modes: classical Runge-Kutta with a fixed substep, for comparison.

It takes the equations as they stand, pump included, and knows nothing of sidebands; only a start on
the periodic orbit and the lock-in outputs are those of the exact solver.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import Decimal
from typing import TYPE_CHECKING, Any

from .model_error import ModelError
from .modes_linear import NO_OFFSETS, TWO_PI, ModesSolver, kept_offsets
from .oscillator_phase import Frequency
from .oscillator_rk4 import SUBSTEPS_PER_PERIOD

if TYPE_CHECKING:  # subscripted here, these would need a host with Python 3.9 or later
    from .modes_equations import Parameters
    from .modes_linear import Offsets, State
    from .modes_steady import Steady

    #: cos of the pump and the drive, at one moment.
    Moment = tuple[float, float]


class ModesRungeKutta:
    """The modes integrated from communication point to communication point."""

    grows = True  # every step is checked: a long substep diverges whatever the damping

    def __init__(self, p: Parameters, substep: float, offsets: Offsets = NO_OFFSETS) -> None:
        self.p, self.offsets, self.requested = p, offsets, substep
        self.steady = ModesSolver(p, False, offsets)
        self.envelope = False
        driven = [u for u, size, _ in p.tones if size]  # others have no frequency
        fastest = max(self.steady.fastest_hz, *driven, p.pump_hz if p.pumped else 0.0)
        self.substep = substep or 1.0 / (SUBSTEPS_PER_PERIOD * fastest)
        m = self.steady.matrices
        square = TWO_PI * TWO_PI
        self._stiffness = [[square * float(x) for x in row] for row in m.stiffness]
        self._pump = [[square * x for x in row] for row in m.pump_values]
        self._damping = [TWO_PI * d for d in p.d]
        self._tones = [
            (size, Frequency(u), offset + phase / TWO_PI)
            for (u, size, phase), offset in self.steady.driven
        ]

    def response(self, u: float) -> Steady:
        """Return the response to cos(2 pi u t), over (2 pi)^2, in s^2."""
        return self.steady.response(u)

    def full_response(self, u: float) -> Steady:
        """Return the same: nothing is left out."""
        return self.steady.response(u)

    def start(self, t: float, state: State | None, b: float) -> None:
        """Begin at ``t`` s from displacements and velocities over 2 pi (None: periodic orbit)."""
        self.b, self.t = b, t
        for u, size, _ in self.p.tones:
            if size:
                self.response(u)  # refused now rather than when it is read
        y = (
            [z.real for z in self.steady.orbit(t, b)]
            if state is None
            else [float(x) for x in state]
        )
        n = self.steady.n
        self._q, self._v = y[:n], [TWO_PI * w for w in y[n:]]

    def advance(self, t: float) -> None:
        """Integrate to ``t`` s in equal substeps no longer than the one asked for."""
        span = t - self.t
        count = max(1, math.ceil(span / self.substep * (1.0 - 1e-12)))
        h, begin = span / count, self.t
        now = self._moment(begin)
        for k in range(count):
            middle = self._moment(begin + (k + 0.5) * h)
            after = self._moment(begin + (k + 1) * h if k + 1 < count else t)
            self._step(h, (now, middle, after))
            now = after
        if not all(map(math.isfinite, (*self._q, *self._v))):
            stable = 2.8 / (TWO_PI * self.steady.fastest_hz)
            raise ModelError(
                f"the rk4 solution left the range of numbers at t = {t!r} s with substeps of "
                f"{h!r} s; a stable substep is below {stable!r} s"
            )
        self.t = t

    def _moment(self, t: float) -> Moment:
        """Return the cosine of the pump and the drive at ``t`` s."""
        pump = math.cos(TWO_PI * self.steady.pump_cycles(t)) if self.p.pumped else 0.0
        return pump, self.b + sum(
            size * math.cos(TWO_PI * (frequency.cycles(t) + offset))
            for size, frequency, offset in self._tones
        )

    def _step(self, h: float, moments: tuple[Moment, Moment, Moment]) -> None:
        """Take a substep of the classical fourth-order method."""
        q, v = self._q, self._v
        k, a = v, self._acceleration(moments[0], q, v)
        sum_k, sum_a = list(k), list(a)
        for weight, part, moment in (
            (2.0, 0.5, moments[1]),
            (2.0, 0.5, moments[1]),
            (1.0, 1.0, moments[2]),
        ):
            s = part * h
            q_there = [x + s * y for x, y in zip(q, k)]
            k = [x + s * y for x, y in zip(v, a)]
            a = self._acceleration(moment, q_there, k)
            sum_k = [x + weight * y for x, y in zip(sum_k, k)]
            sum_a = [x + weight * y for x, y in zip(sum_a, a)]
        s = h / 6.0
        self._q = [x + s * y for x, y in zip(q, sum_k)]
        self._v = [x + s * y for x, y in zip(v, sum_a)]

    def _acceleration(self, moment: Moment, q: Sequence[float], v: Sequence[float]) -> list[float]:
        """Return x'' of the modes."""
        pump, force = moment
        result = []
        for i, (gain, damping) in enumerate(zip(self.p.g, self._damping)):
            a = gain * force - damping * v[i]
            for stiff, pumped, x in zip(self._stiffness[i], self._pump[i], q):
                a -= (stiff + pump * pumped) * x
            result.append(a)
        return result

    def displacement(self, t: float) -> list[float]:
        """Return the displacements at the communication point reached."""
        return list(self._q)

    def with_input(self, b: float, t: float) -> None:
        """Hold the input at ``b`` from ``t`` s on."""
        self.b = b

    def retuned(self, p: Parameters, t: float) -> ModesRungeKutta:
        """Return the solver for new parameters, with state and drive phases kept at ``t`` s."""
        solver = ModesRungeKutta(p, self.requested, kept_offsets(self.offsets, self.p, p, t))
        state = (*self._q, *(x / TWO_PI for x in self._v))
        solver.start(t, tuple(Decimal(x) for x in state), self.b)
        return solver

    def snapshot(self) -> dict[str, Any]:
        """Return what must be stored, besides parameters, to continue bit for bit."""
        return {
            "t": self.t,
            "q": list(self._q),
            "v": list(self._v),
            "b": self.b,
            "offsets": list(self.offsets),
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Take up a snapshot of a solver with the same parameters and offsets."""
        self.t, self.b = snapshot["t"], snapshot["b"]
        self._q, self._v = list(snapshot["q"]), list(snapshot["v"])
