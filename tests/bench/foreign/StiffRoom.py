"""A modeller's own FMU: air and walls of a room, by implicit steps of Euler's method of 20 s."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class StiffRoom(Fmi2Slave):
    """Ca Ta' = (Tw - Ta)/R + P, Cw Tw' = (Ta - Tw)/R - Tw/Ro: air in a minute, walls in a day."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.R, self.Ro, self.Cw, self.Ca = 1e-3, 1e-2, 1e7, 6e4
        self.P = self.T = self.wall = 0.0
        for name in ("R", "Ro", "Cw"):
            self.register_variable(
                Real(
                    name,
                    causality=Fmi2Causality.parameter,
                    variability=Fmi2Variability.tunable,
                )
            )
        self.register_variable(Real("P", causality=Fmi2Causality.input))
        self.register_variable(Real("T", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        n = max(1, round(step_size / 20.0))
        h = step_size / n
        inner, outer = h / self.R, h / self.Ro
        a, d = self.Ca + inner, self.Cw + inner + outer
        for _ in range(n):
            air, wall = self.Ca * self.T + h * self.P, self.Cw * self.wall
            both = a * d - inner * inner
            self.T, self.wall = (d * air + inner * wall) / both, (inner * air + a * wall) / both
        return True
