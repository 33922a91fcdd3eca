"""A modeller's own FMU: a mass on a hardening spring, by Runge and Kutta's steps of 1 ms."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class MassSpring(Fmi2Slave):
    """m x'' = F - c x' - k x - k3 x^3."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.c, self.k, self.k3 = 0.8, 40.0, 200.0
        self.F = self.x = self.v = 0.0
        for name in ("c", "k", "k3"):
            self.register_variable(
                Real(
                    name,
                    causality=Fmi2Causality.parameter,
                    variability=Fmi2Variability.tunable,
                )
            )
        self.register_variable(Real("F", causality=Fmi2Causality.input))
        self.register_variable(Real("x", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        n = max(1, round(step_size / 1e-3))
        h = step_size / n

        def slope(x, v):
            return v, (self.F - self.c * v - self.k * x - self.k3 * x**3) / 0.5

        for _ in range(n):
            x, v = self.x, self.v
            a = slope(x, v)
            b = slope(x + 0.5 * h * a[0], v + 0.5 * h * a[1])
            c = slope(x + 0.5 * h * b[0], v + 0.5 * h * b[1])
            d = slope(x + h * c[0], v + h * c[1])
            self.x = x + h / 6.0 * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0])
            self.v = v + h / 6.0 * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1])
        return True
