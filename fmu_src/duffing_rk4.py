"""The solver ``rk4`` of the Duffing oscillator: the full equations with a fixed substep."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .duffing_envelope import EnvelopeSolver
from .duffing_equations import find_root
from .duffing_slow import frame_frequency
from .model_error import ModelError
from .oscillator_equations import TWO_PI
from .oscillator_phase import kept_phases
from .oscillator_rk4 import RungeKuttaSolver

if TYPE_CHECKING:
    from .duffing_envelope import Settings
    from .duffing_equations import Cubic
    from .duffing_slow import State
    from .oscillator_equations import Parameters


class DuffingRungeKutta(RungeKuttaSolver):
    """The oscillator with cubic terms, integrated between communication points."""

    def __init__(
        self,
        p: Parameters,
        cubic: Cubic,
        settings: Settings,
        substep: float,
        offsets: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        super().__init__(p, substep, offsets)
        self.cubic, self.settings = cubic, settings
        self.centre = frame_frequency(p)

    def _acceleration(
        self, force: float, q1: float, q2: float, v1: float, v2: float
    ) -> tuple[float, float]:
        (d11, d22, d12), (c1, c2) = self._damping, self._stiffness
        alpha1, alpha2, kappa = self.cubic
        s1, s2 = q1 * q1, q2 * q2
        return (
            self.p.g1 * force - d11 * v1 - d12 * v2 - (c1 + alpha1 * s1 + kappa * s2) * q1,
            self.p.g2 * force - d12 * v1 - d22 * v2 - (c2 + alpha2 * s2 + kappa * s1) * q2,
        )

    def _orbit(self, t: float) -> State:
        """Return the state on the periodic orbit.

        The linear one where there is no cubic term. Else the envelope's, to its error; for one
        drive frequency it is then closed over one period of these very substeps by Newton's method.
        """
        if not any(self.cubic):
            return super()._orbit(t)
        if self.b:
            raise ModelError(
                f"b = {self.b!r}: a periodic start with cubic terms is known for b = 0 only; set "
                "periodic_start to false"
            )
        envelope = EnvelopeSolver(self.p, self.cubic, self.settings, self.offsets)
        envelope.start(t, None, self.b)
        state = envelope.full_state(t)
        tones = {frequency.high for _, frequency, _ in self._tones}
        return self._closed(t, state, tones.pop()) if len(tones) == 1 else state

    def _closed(self, t: float, state: State, u: float) -> State:
        """Return the state near ``state`` at ``t`` s that comes back after a period of ``u`` Hz."""
        speed = TWO_PI * u

        def drift(x: list[float]) -> list[float]:
            self.t, self._y = t, (x[0], x[1], speed * x[2], speed * x[3])
            self.advance(t + 1.0 / u)
            q1, q2, v1, v2 = self._y
            return [q1 - x[0], q2 - x[1], v1 / speed - x[2], v2 / speed - x[3]]

        start = [state[0].real, state[1].real, state[2].real / u, state[3].real / u]
        sizes = [abs(start[i]) + abs(start[i + 2]) for i in (0, 1)]
        floor = 1e-9 * max(sizes)
        x = find_root(drift, start, [max(size, floor) for size in (*sizes, *sizes)])
        self.t = t
        if x is None:
            return state
        return complex(x[0]), complex(x[1]), complex(x[2] * u), complex(x[3] * u)

    def squares(self, t: float) -> tuple[float, float]:
        """Return the squared amplitudes of both modes, in m^2, from displacement and velocity."""
        q1, q2, v1, v2 = self._y
        omega = TWO_PI * self.centre
        return q1 * q1 + (v1 / omega) ** 2, q2 * q2 + (v2 / omega) ** 2

    def averaging_error(self, t: float, result: float) -> float:
        """Return what averaging leaves out: nothing is averaged here."""
        return 0.0

    def retuned(self, p: Parameters, t: float, cubic: Cubic | None = None) -> DuffingRungeKutta:
        """Return the solver for new parameters, with state and drive phases kept at ``t`` s."""
        before = self.p.u1, self.p.u2
        offsets = kept_phases(self.offsets, before, (p.u1, p.u2), t)
        cubic = cubic or self.cubic
        solver = DuffingRungeKutta(p, cubic, self.settings, self.requested, offsets)
        solver.take_over(self)
        return solver
