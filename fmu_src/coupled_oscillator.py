"""The FMU ``CoupledOscillator``: two hybridised modes under a two-tone drive."""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from typing import ClassVar

from .model_error import ModelError
from .oscillator_equations import Parameters
from .oscillator_linear import LinearSolver
from .oscillator_rk4 import RungeKuttaSolver
from .two_mode_slave import (
    DERIVED,
    DISPLACEMENTS,
    INPUT,
    PERIODIC_START,
    PHYSICAL,
    TwoModeSlave,
    checked_substep,
    fixed,
    steady,
    substep_parameter,
)
from .variables import Variable

EXACT, ENVELOPE, RK4 = 0, 1, 2


def _quadratures() -> list[Variable]:
    """Return the lock-in outputs: in phase (X) and quadrature (Y), mode by mode, tone by tone."""
    return [
        steady(
            f"q{mode}_hybrid_{part}_u{tone}",
            "m",
            f"lock-in {word} of q{mode}_hybrid at u{tone}: {trig} part of the periodic response to "
            f"tone {tone}, reference cos(2 pi u{tone} t), transient excluded",
            1e-11,
        )
        for mode in (1, 2)
        for tone in (1, 2)
        for part, word, trig in (("X", "in-phase", "cosine"), ("Y", "quadrature", "minus sine"))
    ]


VARIABLES = (
    *PHYSICAL,
    PERIODIC_START,
    fixed(
        "solver",
        "Integer",
        EXACT,
        "0 exact (phasors and propagator, any step), 1 envelope (rotating frame, error about "
        "1/Q), 2 rk4 (classical Runge-Kutta, fixed substep)",
        minimum=0,
        maximum=2,
    ),
    substep_parameter(RK4),
    INPUT,
    *DISPLACEMENTS,
    *_quadratures(),
    *DERIVED,
)


class CoupledOscillator(TwoModeSlave["LinearSolver | RungeKuttaSolver"]):
    """Two coupled, damped modes of a nanomechanical string under a two-tone drive."""

    description = (
        "Two hybridised modes of a nanomechanical string, coupled by damping, under a two-tone "
        "drive and an arbitrary held input (Bartsch et al., arXiv:2412.07301)"
    )
    version = "1.0"
    license = "MIT"
    variables: ClassVar[tuple[Variable, ...]] = VARIABLES
    moving: ClassVar[tuple[str, ...]] = tuple(v.name for v in DISPLACEMENTS)

    def steady_outputs(self) -> Sequence[float]:
        """Return quadratures, coupling, uncoupled eigenfrequencies and damping matrix."""
        solver = self.running()
        p = solver.p
        quadratures: list[float] = []
        responses = [
            [x * cmath.rect(size, phase) for x in solver.response(u)] if size else [0j, 0j]
            for u, size, phase in ((p.u1, p.A1, p.phase1), (p.u2, p.A2, p.phase2))
        ]
        for mode in (0, 1):
            for response in responses:
                quadratures += [response[mode].real, response[mode].imag]
        return *quadratures, *super().steady_outputs()

    def new_solver(
        self, p: Parameters, offsets: tuple[float, float]
    ) -> LinearSolver | RungeKuttaSolver:
        """Return the solver by its number."""
        kind, substep = self.value("solver"), self.value("rk4_substep")
        if kind not in (EXACT, ENVELOPE, RK4):
            raise ModelError(f"solver = {kind!r}: 0 (exact), 1 (envelope) or 2 (rk4) is wanted")
        checked_substep(substep)
        if kind == RK4:
            return RungeKuttaSolver(p, substep, offsets)
        return LinearSolver(p, kind == ENVELOPE, offsets)

    def retuned(
        self, solver: LinearSolver | RungeKuttaSolver, p: Parameters, t: float
    ) -> LinearSolver | RungeKuttaSolver:
        """Return the same kind of solver with new parameters."""
        return solver.retuned(p, t)
