"""What the FMUs of two hybridised modes share: their variable table and their parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from .driven_slave import STATUS, DrivenSlave, fixed, moving, parameter, steady
from .oscillator_equations import (
    AT_REST,
    TWO_PI,
    Parameters,
    check,
    coupling,
    damping,
    physical,
    transformation,
)
from .variables import Variable

if TYPE_CHECKING:
    from typing import Protocol

    from .driven_slave import Solver

    class TwoModeSolver(Solver, Protocol):
        """The motion of two modes between changes of parameters."""

        p: Parameters

        def displacement(self, t: float) -> tuple[float, float]:
            """Return q~1, q~2 at ``t`` s."""
            ...


S = TypeVar("S", bound="TwoModeSolver")


#: The physical parameters, in the order of ``Parameters``: every table begins with them.
PHYSICAL = (
    parameter(
        "theta", 1.9498, "rad", "angle of the orthogonal matrix T in q_hybrid = T q", nominal=1.0
    ),
    fixed(
        "reflection",
        "Boolean",
        False,
        "form of T: false = rotation [[c, -s], [s, c]], true = reflection [[-c, s], [s, c]]",
    ),
    parameter("d1", 120.0, "Hz", "damping coefficient of q1 (full line width f/Q)", nominal=100.0),
    parameter("d2", 90.0, "Hz", "damping coefficient of q2 (full line width f/Q)", nominal=100.0),
    parameter(
        "eta_plus",
        6.94026e6,
        "Hz",
        "eigenfrequency of the hybridised mode q1_hybrid",
        minimum=1e-12,
        nominal=1e6,
    ),
    parameter(
        "eta_minus",
        7.02760e6,
        "Hz",
        "eigenfrequency of the hybridised mode q2_hybrid",
        minimum=1e-12,
        nominal=1e6,
    ),
    parameter(
        "u1",
        6.94016e6,
        "Hz",
        "frequency of drive tone 1; phase-continuous when changed",
        minimum=0.0,
        nominal=1e6,
    ),
    parameter(
        "u2",
        6.94036e6,
        "Hz",
        "frequency of drive tone 2; phase-continuous when changed",
        minimum=0.0,
        nominal=1e6,
    ),
    parameter("A1", 1.0, "m/s2", "amplitude of drive tone 1 (force per mass)"),
    parameter("A2", 1.0, "m/s2", "amplitude of drive tone 2 (force per mass)"),
    parameter("phase1", 0.0, "rad", "phase of drive tone 1 at time 0: A1 cos(2 pi u1 t + phase1)"),
    parameter("phase2", 0.0, "rad", "phase of drive tone 2 at time 0: A2 cos(2 pi u2 t + phase2)"),
    parameter("g1", 1.0, None, "gain of the drive on mode q1_hybrid"),
    parameter("g2", 1.0, None, "gain of the drive on mode q2_hybrid"),
)

INPUT = Variable(
    "b",
    "Real",
    "input",
    "discrete",
    "further drive on both modes (times g1, g2), held over each step",
    0.0,
    "m/s2",
)

DISPLACEMENTS = (
    moving("q1_hybrid", "displacement of the hybridised mode 1, q~1"),
    moving("q2_hybrid", "displacement of the hybridised mode 2, q~2"),
    moving("q1", "displacement q1 of the uncoupled coordinates, q = T^T q_hybrid"),
    moving("q2", "displacement q2 of the uncoupled coordinates, q = T^T q_hybrid"),
)

#: What the parameters say of the linear system, and the sentence of a failure.
DERIVED = (
    steady(
        "lambda",
        "Hz",
        "coupling: lambda^2 = -sin(2 theta)/2 (eta_minus^2 - eta_plus^2); NaN where that is "
        "negative",
        1e6,
    ),
    steady("f1", "Hz", "uncoupled eigenfrequency: f1^2 = c^2 eta_plus^2 + s^2 eta_minus^2", 1e6),
    steady("f2", "Hz", "uncoupled eigenfrequency: f2^2 = s^2 eta_plus^2 + c^2 eta_minus^2", 1e6),
    steady(
        "D11", "1/s", "hybridised damping matrix T D T^T, 2 pi times the line width of mode 1", 1e3
    ),
    steady(
        "D22", "1/s", "hybridised damping matrix T D T^T, 2 pi times the line width of mode 2", 1e3
    ),
    steady("D12", "1/s", "hybridised damping matrix T D T^T, damping coupling of the modes", 1e3),
    steady("width_plus", "Hz", "line width of mode 1, full width of |q~1|^2: D11/(2 pi)", 100.0),
    steady("width_minus", "Hz", "line width of mode 2, full width of |q~2|^2: D22/(2 pi)", 100.0),
    steady("Q_plus", None, "quality factor eta_plus/width_plus; NaN without damping", 1e5),
    steady("Q_minus", None, "quality factor eta_minus/width_minus; NaN without damping", 1e5),
    STATUS,
)


class TwoModeSlave(DrivenSlave[S], Generic[S]):
    """Base of the FMUs: a model defines how its solver is made and how it takes new parameters."""

    # -- what a model provides ------------------------------------------------------------------

    def new_solver(self, p: Parameters, offsets: tuple[float, float]) -> S:
        """Return the solver that the parameters ask for; raise ModelError where there is none."""
        raise NotImplementedError

    def retuned(self, solver: S, p: Parameters, t: float) -> S:
        """Return the solver that goes on from ``t`` s with new parameters, in state and phase."""
        raise NotImplementedError

    # -- the course of a run --------------------------------------------------------------------

    def first_solver(self, t: float) -> S:
        """Return the solver, started at rest or on the periodic orbit."""
        p = self._take_parameters()
        periodic = self.value("periodic_start")
        self.warn_all(check(p, periodic))
        solver = self.new_solver(p, (0.0, 0.0))
        solver.start(t, None if periodic else AT_REST, self.value("b"))
        return solver

    def next_solver(self, solver: S, t: float) -> S:
        """Return the solver that goes on from ``t`` s with new parameters, in state and phase."""
        p = self._take_parameters()
        self.warn_all(check(p, periodic_start=False))
        return self.retuned(solver, p, t)

    def restored_solver(self, motion: dict[str, Any]) -> S:
        """Return the solver that a snapshot was taken of, without its state."""
        offsets = motion["offsets"]
        return self.new_solver(self._take_parameters(), (offsets[0], offsets[1]))

    def moving_outputs(self) -> Sequence[float]:
        """Return the displacements in both coordinates."""
        q1, q2 = self.running().displacement(self.time)
        return q1, q2, *physical(self._transformation, q1, q2)

    def steady_outputs(self) -> Sequence[float]:
        """Return coupling, uncoupled eigenfrequencies, damping matrix, line widths and Qs.

        Why lambda may be NaN is logged here, where it is read: a fit initialises a thousand times
        without reading it, and each message costs time and, in pythonfmu's binary, 290 bytes.
        """
        p = self.running().p
        uncoupled = coupling(p)
        if math.isnan(uncoupled[0]):
            self.warn(
                f"lambda is not a real number at theta = {p.theta!r} rad (sin 2 theta > 0 with "
                f"eta_plus = {p.eta_plus!r} Hz, eta_minus = {p.eta_minus!r} Hz): it is NaN"
            )
        matrix = damping(p)
        widths = matrix[0], matrix[1]
        factors = (
            eta / width if width > 0.0 else math.nan
            for eta, width in zip((p.eta_plus, p.eta_minus), widths)
        )
        return *uncoupled, *(TWO_PI * w for w in matrix), *widths, *factors

    def _take_parameters(self) -> Parameters:
        """Return the physical parameters; T, which each look at the outputs needs, is kept."""
        p = Parameters._make(self.first_values(len(PHYSICAL)))
        self._transformation = transformation(p.theta, p.reflection)
        return p
