"""A modeller's own FMU with the commonest mistake: its output is that of the step's beginning."""

import cmath
import math

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class LateOutput(Fmi2Slave):
    """x'' + 2 g x' + w^2 x = F, exact over every step; `late` = 1: x is one step late."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.f0, self.d, self.late = 10.0, 0.5, 1.0
        self.force = self.x = 0.0
        self._state = (0.0, 0.0)
        for name in ("f0", "d", "late"):
            self.register_variable(
                Real(
                    name,
                    causality=Fmi2Causality.parameter,
                    variability=Fmi2Variability.tunable,
                )
            )
        self.register_variable(Real("force", causality=Fmi2Causality.input))
        self.register_variable(Real("x", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        before, (x, v) = self._state[0], self._state
        w, g = 2.0 * math.pi * self.f0, math.pi * self.d
        pole = complex(-g, math.sqrt(w * w - g * g))
        rest = self.force / w**2
        # x - rest = Re[c e^(s t)], x' = Re[c s e^(s t)]
        c = complex(x - rest, ((x - rest) * pole.real - v) / pole.imag)
        moved = c * cmath.exp(pole * step_size)
        self._state = rest + moved.real, (moved * pole).real
        self.x = before if self.late > 0.5 else self._state[0]
        return True
