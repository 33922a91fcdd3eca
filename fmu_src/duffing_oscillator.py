"""The FMU ``DuffingOscillator``: the two modes of ``CoupledOscillator`` with cubic terms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from .driven_slave import PERIODIC_START, checked_substep, fixed, parameter, substep_parameter
from .duffing_envelope import EnvelopeSolver, Settings
from .duffing_equations import Cubic, check_cubic, shift
from .duffing_rk4 import DuffingRungeKutta
from .model_error import ModelError
from .oscillator_equations import Parameters
from .two_mode_slave import DERIVED, DISPLACEMENTS, INPUT, PHYSICAL, TwoModeSlave
from .variables import START, Accuracy, Variable

ENVELOPE, RK4 = 1, 2  # the numbers that they have in CoupledOscillator
LOWER, UPPER = 0, 1
TOLERANCES = 1e-13, 0.1


def _cubic(name: str, start: float, force: str) -> Variable:
    description = f"cubic coefficient: force per mass {force}; above 0 stiffens"
    return parameter(name, start, "1/(m2.s2)", description, nominal=1e32)


SHIFT = Variable(
    "nonlinear_shift",
    "Real",
    "output",
    "continuous",
    "eps, the frequency shift by the cubic terms over the drive frequency at this time, the larger "
    "one of both modes: 3/8 (|alpha1| a1^2 + |kappa| a2^2)/(2 pi c)^2 for mode 1",
    nominal=1e-5,
)

ENVELOPE_ERROR = Variable(
    "envelope_error",
    "Real",
    "output",
    "continuous",
    "bound of the relative error by averaging of any displacement's largest line, 1 at most: "
    "eps (3 eps + |u1 - u2|/c), eps = nonlinear_shift at this time; more far above a mode and "
    "where what drives a displacement nearly cancels; 0 with solver 2; not next to the end of a "
    "branch",
    nominal=1e-9,
)

VARIABLES = (
    *PHYSICAL,
    _cubic("alpha1", 1e32, "-alpha1 q~1^3 on mode 1"),
    _cubic("alpha2", 1e32, "-alpha2 q~2^3 on mode 2"),
    _cubic("kappa", 0.0, "-kappa q~1 q~2^2 on mode 1, -kappa q~1^2 q~2 on mode 2"),
    PERIODIC_START,
    fixed(
        "branch",
        "Integer",
        LOWER,
        "with periodic_start and one active tone, where several orbits exist: 0 that of the "
        "smallest amplitude, 1 that of the largest",
        minimum=LOWER,
        maximum=UPPER,
    ),
    fixed(
        "solver",
        "Integer",
        ENVELOPE,
        "1 envelope (rotating frame, averaged to second order, own steps), 2 rk4 (full equations, "
        "classical Runge-Kutta, fixed substep)",
        minimum=ENVELOPE,
        maximum=RK4,
    ),
    fixed(
        "tolerance",
        "Real",
        1e-6,
        "error allowed to the steps of solver 1, relative to each mode's amplitude",
        minimum=TOLERANCES[0],
        maximum=TOLERANCES[1],
    ),
    substep_parameter(RK4),
    INPUT,
    *DISPLACEMENTS,
    SHIFT,
    ENVELOPE_ERROR,
    *DERIVED,
)


class DuffingOscillator(TwoModeSlave["EnvelopeSolver | DuffingRungeKutta"]):
    """Two coupled, damped modes with cubic terms under a two-tone drive."""

    description = (
        "Two hybridised modes of a nanomechanical string, coupled by damping and by cubic terms, "
        "under a two-tone drive (the linear part: Bartsch et al., arXiv:2412.07301)"
    )
    version = "1.0"
    license = "MIT"
    variables: ClassVar[tuple[Variable, ...]] = VARIABLES
    moving: ClassVar[tuple[str, ...]] = tuple(
        v.name for v in (*DISPLACEMENTS, SHIFT, ENVELOPE_ERROR)
    )
    costly: ClassVar[str | None] = ENVELOPE_ERROR.name

    accuracy = Accuracy(
        "tolerance",
        "rk4_substep",
        {"solver": RK4},
        (
            ("averaged envelope", {"solver": ENVELOPE}, "envelope_error"),
            ("periodic start", {"periodic_start": True}, START),
            ("linear model", {"alpha1": 0.0, "alpha2": 0.0, "kappa": 0.0}, None),
        ),
        slow=("averaged envelope",),
    )

    def begin(self, t: float) -> None:
        """Start at rest or on a periodic orbit."""
        super().begin(t)
        if self.value("branch") == UPPER and not self.value("periodic_start"):
            self.warn("branch = 1 does not apply to a start at rest; set periodic_start to true")

    def moving_outputs(self) -> Sequence[float]:
        """Return displacements and the shift by the cubic terms; what averaging costs comes later.

        Its bound takes as long as a step, and most runs do not ask for it.
        """
        solver = self.running()
        result = shift(solver.cubic, solver.squares(self.time), solver.centre)
        return *super().moving_outputs(), result, 0.0

    def costly_output(self) -> float:
        """Return the bound of what averaging costs."""
        result: float = self.value(SHIFT.name)
        return self.running().averaging_error(self.time, result)

    def new_solver(
        self, p: Parameters, offsets: tuple[float, float]
    ) -> EnvelopeSolver | DuffingRungeKutta:
        """Return the solver by its number."""
        kind, branch = self.value("solver"), self.value("branch")
        if kind not in (ENVELOPE, RK4):
            raise ModelError(f"solver = {kind!r}: 1 (envelope) or 2 (rk4) is wanted")
        if branch not in (LOWER, UPPER):
            raise ModelError(f"branch = {branch!r}: 0 (lower) or 1 (upper) is wanted")
        tolerance = self.value("tolerance")
        if not TOLERANCES[0] <= tolerance <= TOLERANCES[1]:
            raise ModelError(
                f"tolerance = {tolerance!r}: {TOLERANCES[0]!r} to {TOLERANCES[1]!r} is wanted"
            )
        substep = checked_substep(self.value("rk4_substep"))
        settings = Settings(tolerance, branch == UPPER)
        if kind == RK4:
            return DuffingRungeKutta(p, self._coefficients(), settings, substep, offsets)
        return EnvelopeSolver(p, self._coefficients(), settings, offsets)

    def retuned(
        self, solver: EnvelopeSolver | DuffingRungeKutta, p: Parameters, t: float
    ) -> EnvelopeSolver | DuffingRungeKutta:
        """Return the same kind of solver with new parameters."""
        return solver.retuned(p, t, self._coefficients())

    def _coefficients(self) -> Cubic:
        cubic = Cubic(*(self.value(name) for name in Cubic._fields))
        check_cubic(cubic)
        return cubic
