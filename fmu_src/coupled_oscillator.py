"""The FMU ``CoupledOscillator``: two hybridised modes under a two-tone drive."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from typing import Any, ClassVar

from .model_error import ModelError
from .oscillator_equations import TWO_PI, Parameters, check, coupling, damping, physical
from .oscillator_linear import LinearSolver
from .oscillator_rk4 import RungeKuttaSolver
from .slave import STATUS_MESSAGE, ModelSlave
from .variables import Variable

EXACT, ENVELOPE, RK4 = 0, 1, 2


def _parameter(name: str, start: Any, unit: str | None, description: str, **more: Any) -> Variable:
    return Variable(name, "Real", "parameter", "tunable", description, start, unit, **more)


def _fixed(name: str, kind: str, start: Any, description: str, **more: Any) -> Variable:
    return Variable(name, kind, "parameter", "fixed", description, start, **more)


def _moving(name: str, description: str) -> Variable:
    return Variable(name, "Real", "output", "continuous", description, unit="m", nominal=1e-11)


def _steady(name: str, unit: str | None, description: str, nominal: float) -> Variable:
    return Variable(name, "Real", "output", "discrete", description, unit=unit, nominal=nominal)


def _quadratures() -> list[Variable]:
    """Return the lock-in outputs: in phase (X) and quadrature (Y), mode by mode, tone by tone."""
    return [
        _steady(
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
    _parameter(
        "theta", 1.9498, "rad", "angle of the orthogonal matrix T in q_hybrid = T q", nominal=1.0
    ),
    _fixed(
        "reflection",
        "Boolean",
        False,
        "form of T: false = rotation [[c, -s], [s, c]], true = reflection [[-c, s], [s, c]]",
    ),
    _parameter("d1", 120.0, "Hz", "damping coefficient of q1 (full line width f/Q)", nominal=100.0),
    _parameter("d2", 90.0, "Hz", "damping coefficient of q2 (full line width f/Q)", nominal=100.0),
    _parameter(
        "eta_plus",
        6.94026e6,
        "Hz",
        "eigenfrequency of the hybridised mode q1_hybrid",
        minimum=0.0,
        nominal=1e6,
    ),
    _parameter(
        "eta_minus",
        7.02760e6,
        "Hz",
        "eigenfrequency of the hybridised mode q2_hybrid",
        minimum=0.0,
        nominal=1e6,
    ),
    _parameter(
        "u1",
        6.94016e6,
        "Hz",
        "frequency of drive tone 1; phase-continuous when changed",
        minimum=0.0,
        nominal=1e6,
    ),
    _parameter(
        "u2",
        6.94036e6,
        "Hz",
        "frequency of drive tone 2; phase-continuous when changed",
        minimum=0.0,
        nominal=1e6,
    ),
    _parameter("A1", 1.0, "m/s2", "amplitude of drive tone 1 (force per mass)"),
    _parameter("A2", 1.0, "m/s2", "amplitude of drive tone 2 (force per mass)"),
    _parameter("phase1", 0.0, "rad", "phase of drive tone 1 at time 0: A1 cos(2 pi u1 t + phase1)"),
    _parameter("phase2", 0.0, "rad", "phase of drive tone 2 at time 0: A2 cos(2 pi u2 t + phase2)"),
    _parameter("g1", 1.0, None, "gain of the drive on mode q1_hybrid"),
    _parameter("g2", 1.0, None, "gain of the drive on mode q2_hybrid"),
    _fixed(
        "periodic_start",
        "Boolean",
        False,
        "true: start on the periodic orbit, without a transient; false: start at rest",
    ),
    _fixed(
        "solver",
        "Integer",
        EXACT,
        "0 exact (phasors and propagator, any step), 1 envelope (rotating frame, error about "
        "1/Q), 2 rk4 (classical Runge-Kutta, fixed substep)",
        minimum=0,
        maximum=2,
    ),
    _fixed(
        "rk4_substep",
        "Real",
        0.0,
        "longest substep of solver 2; 0: a fortieth of the shortest period",
        unit="s",
        minimum=0.0,
    ),
    Variable(
        "b",
        "Real",
        "input",
        "discrete",
        "further drive on both modes (times g1, g2), held over each step",
        0.0,
        "m/s2",
    ),
    _moving("q1_hybrid", "displacement of the hybridised mode 1, q~1"),
    _moving("q2_hybrid", "displacement of the hybridised mode 2, q~2"),
    _moving("q1", "displacement q1 of the uncoupled coordinates, q = T^T q_hybrid"),
    _moving("q2", "displacement q2 of the uncoupled coordinates, q = T^T q_hybrid"),
    *_quadratures(),
    _steady(
        "lambda",
        "Hz",
        "coupling: lambda^2 = -sin(2 theta)/2 (eta_minus^2 - eta_plus^2); NaN where that is "
        "negative",
        1e6,
    ),
    _steady("f1", "Hz", "uncoupled eigenfrequency: f1^2 = c^2 eta_plus^2 + s^2 eta_minus^2", 1e6),
    _steady("f2", "Hz", "uncoupled eigenfrequency: f2^2 = s^2 eta_plus^2 + c^2 eta_minus^2", 1e6),
    _steady(
        "D11", "1/s", "hybridised damping matrix T D T^T, 2 pi times the line width of mode 1", 1e3
    ),
    _steady(
        "D22", "1/s", "hybridised damping matrix T D T^T, 2 pi times the line width of mode 2", 1e3
    ),
    _steady("D12", "1/s", "hybridised damping matrix T D T^T, damping coupling of the modes", 1e3),
    Variable(
        STATUS_MESSAGE,
        "String",
        "output",
        "discrete",
        "why the simulation failed, empty while it has not",
    ),
)


class CoupledOscillator(ModelSlave):
    """Two coupled, damped modes of a nanomechanical string under a two-tone drive."""

    description = (
        "Two hybridised modes of a nanomechanical string, coupled by damping, under a two-tone "
        "drive and an arbitrary held input (Bartsch et al., arXiv:2412.07301)"
    )
    version = "1.0"
    license = "MIT"
    variables: ClassVar[tuple[Variable, ...]] = VARIABLES
    moving: ClassVar[tuple[str, ...]] = ("q1_hybrid", "q2_hybrid", "q1", "q2")

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._solver: LinearSolver | RungeKuttaSolver | None = None

    def begin(self, t: float) -> None:
        """Start at rest or on the periodic orbit."""
        p = self._parameters()
        periodic = self.value("periodic_start")
        self._warn(p, check(p, periodic))
        solver = self._new_solver(p, (0.0, 0.0))
        solver.start(t, None if periodic else (0j, 0j, 0j, 0j), self.value("b"))
        self._solver = solver

    def change(self, t: float) -> None:
        """Go on from the present state and drive phases with new parameters."""
        p = self._parameters()
        self._warn(p, check(p, periodic_start=False))
        self._solver = self._running().retuned(p, t)

    def step(self, t: float, end: float) -> None:
        """Hold the input and move; a growing oscillation is watched."""
        solver = self._running()
        b = self.value("b")
        if b != solver.b:
            if not math.isfinite(b):
                raise ModelError(f"b = {b!r} m/s2 is not a finite number")
            solver.with_input(b, t)
        solver.advance(end)
        if solver.grows:
            self._check_range(solver, end)

    def _check_range(self, solver: LinearSolver | RungeKuttaSolver, end: float) -> None:
        """Raise ModelError where the motion at ``end`` s is no number any more."""
        try:
            total = sum(solver.displacement(end))
        except OverflowError:
            total = math.inf
        if not math.isfinite(total):
            raise ModelError(f"the growing oscillation left the range of numbers before {end!r} s")

    def moving_outputs(self) -> Sequence[float]:
        """Return the displacements in both coordinates."""
        solver = self._running()
        q1, q2 = solver.displacement(self.time)
        return q1, q2, *physical(solver.p, q1, q2)

    def steady_outputs(self) -> Sequence[float]:
        """Return quadratures, coupling, uncoupled eigenfrequencies and damping matrix."""
        solver = self._running()
        p = solver.p
        quadratures: list[float] = []
        responses = [
            [x * cmath.rect(size, phase) for x in solver.response(u)] if size else [0j, 0j]
            for u, size, phase in ((p.u1, p.A1, p.phase1), (p.u2, p.A2, p.phase2))
        ]
        for mode in (0, 1):
            for response in responses:
                quadratures += [response[mode].real, response[mode].imag]
        widths = damping(p)
        return *quadratures, *coupling(p), *(TWO_PI * w for w in widths)

    def motion(self) -> dict[str, Any]:
        """Return the solver's state."""
        return self._running().snapshot()

    def resume(self, motion: dict[str, Any]) -> None:
        """Take up a solver's state."""
        offsets = motion["offsets"]
        self._solver = self._new_solver(self._parameters(), (offsets[0], offsets[1]))
        self._solver.restore(motion)

    def _parameters(self) -> Parameters:
        return Parameters(*(self.value(name) for name in Parameters._fields))

    def _running(self) -> LinearSolver | RungeKuttaSolver:
        if self._solver is None:
            raise ModelError("the simulation has not been initialised")
        return self._solver

    def _new_solver(
        self, p: Parameters, offsets: tuple[float, float]
    ) -> LinearSolver | RungeKuttaSolver:
        kind, substep = self.value("solver"), self.value("rk4_substep")
        if kind not in (EXACT, ENVELOPE, RK4):
            raise ModelError(f"solver = {kind!r}: 0 (exact), 1 (envelope) or 2 (rk4) is wanted")
        if not (0.0 <= substep < math.inf):
            raise ModelError(f"rk4_substep = {substep!r} s: 0 or a positive time is wanted")
        if kind == RK4:
            return RungeKuttaSolver(p, substep, offsets)
        return LinearSolver(p, kind == ENVELOPE, offsets)

    def _warn(self, p: Parameters, sentences: list[str]) -> None:
        if math.isnan(coupling(p)[0]):
            sentences.append(
                f"lambda is not a real number at theta = {p.theta!r} rad (sin 2 theta > 0 with "
                f"eta_plus = {p.eta_plus!r} Hz, eta_minus = {p.eta_minus!r} Hz): it is NaN"
            )
        for sentence in sentences:
            self.warn(sentence)
