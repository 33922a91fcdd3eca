"""The FMU ``CoupledOscillator``: two hybridised modes under a two-tone drive."""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from typing import ClassVar

from .driven_slave import PERIODIC_START, checked_substep, fixed, steady, substep_parameter
from .model_error import ModelError
from .oscillator_equations import Parameters
from .oscillator_linear import LinearSolver
from .oscillator_rk4 import RungeKuttaSolver
from .oscillator_single import FULL, LEFT_OUT, QUASI_STATIC, SingleModeSolver, error
from .two_mode_slave import DERIVED, DISPLACEMENTS, INPUT, PHYSICAL, TwoModeSlave
from .variables import START, Accuracy, Variable

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


def _errors() -> list[Variable]:
    """Return what solver and other_mode leave out, as a bound of each mode's amplitude."""
    return [
        steady(
            f"q{mode}_hybrid_error",
            None,
            f"bound of the relative error of q{mode}_hybrid's amplitude at the active tones by "
            "what solver 1 or other_mode leave out; 0 with neither; rk4's substep not included",
            1e-5,
        )
        for mode in (1, 2)
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
    fixed(
        "other_mode",
        "Integer",
        FULL,
        "the mode away from the drive, with solver 0 (without effect on others): 0 full, "
        "1 quasi-static (its off-resonant phasor, no transient, nothing on the other mode), 2 left "
        "out (0)",
        minimum=FULL,
        maximum=LEFT_OUT,
    ),
    INPUT,
    *DISPLACEMENTS,
    *_quadratures(),
    *_errors(),
    *DERIVED,
)


class CoupledOscillator(TwoModeSlave["LinearSolver | RungeKuttaSolver | SingleModeSolver"]):
    """Two coupled, damped modes of a nanomechanical string under a two-tone drive."""

    description = (
        "Two hybridised modes of a nanomechanical string, coupled by damping, under a two-tone "
        "drive and an arbitrary held input (Bartsch et al., arXiv:2412.07301)"
    )
    version = "1.0"
    license = "MIT"
    variables: ClassVar[tuple[Variable, ...]] = VARIABLES
    moving: ClassVar[tuple[str, ...]] = tuple(v.name for v in DISPLACEMENTS)
    accuracy = Accuracy(
        None,
        "rk4_substep",
        {},
        (
            ("periodic start", {"periodic_start": True}, START),
            ("far mode left out", {"other_mode": LEFT_OUT}, "{output}_error"),
            ("far mode quasi-static", {"other_mode": QUASI_STATIC}, "{output}_error"),
            ("rotating frame", {"solver": ENVELOPE}, "{output}_error", 1.0),
        ),
    )

    def steady_outputs(self) -> Sequence[float]:
        """Return quadratures, errors, coupling, uncoupled eigenfrequencies and damping matrix."""
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
        return *quadratures, *self._left_out(), *super().steady_outputs()

    def _left_out(self) -> tuple[float, float]:
        """Return the relative errors of both modes' amplitudes, the largest of the active tones."""
        solver = self.running()
        p = solver.p
        if isinstance(solver, RungeKuttaSolver) or not (p.g1 or p.g2):
            return 0.0, 0.0
        result = [
            error(p, solver.response(u), u) for u, size in ((p.u1, p.A1), (p.u2, p.A2)) if size
        ]
        return max((e[0] for e in result), default=0.0), max((e[1] for e in result), default=0.0)

    def new_solver(
        self, p: Parameters, offsets: tuple[float, float]
    ) -> LinearSolver | RungeKuttaSolver | SingleModeSolver:
        """Return the solver by its number."""
        kind, substep = self.value("solver"), self.value("rk4_substep")
        if kind not in (EXACT, ENVELOPE, RK4):
            raise ModelError(f"solver = {kind!r}: 0 (exact), 1 (envelope) or 2 (rk4) is wanted")
        checked_substep(substep)
        other = self.value("other_mode")
        if other not in (FULL, QUASI_STATIC, LEFT_OUT):
            raise ModelError(
                f"other_mode = {other!r}: 0 (full), 1 (quasi-static) or 2 (left out) is wanted"
            )
        if kind == EXACT and other != FULL:
            return SingleModeSolver(p, other, offsets)
        if kind == RK4:
            return RungeKuttaSolver(p, substep, offsets)
        return LinearSolver(p, kind == ENVELOPE, offsets)

    def retuned(
        self, solver: LinearSolver | RungeKuttaSolver | SingleModeSolver, p: Parameters, t: float
    ) -> LinearSolver | RungeKuttaSolver | SingleModeSolver:
        """Return the same kind of solver with new parameters."""
        return solver.retuned(p, t)
