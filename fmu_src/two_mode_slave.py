"""What the FMUs of two hybridised modes share: their variable table and the course of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from .model_error import ModelError
from .oscillator_equations import AT_REST, TWO_PI, Parameters, check, coupling, damping, physical
from .slave import STATUS_MESSAGE, ModelSlave
from .variables import Variable

if TYPE_CHECKING:
    from typing import Protocol

    class Solver(Protocol):
        """The motion between changes of parameters."""

        p: Parameters
        b: float

        @property
        def grows(self) -> bool:
            """Whether the motion must be watched for leaving the range of numbers."""
            ...

        def start(self, t: float, state: Any, b: float) -> None:
            """Begin at ``t`` s from a state (None: on the periodic orbit) with input ``b``."""
            ...

        def advance(self, t: float) -> None:
            """Move on to ``t`` s."""
            ...

        def displacement(self, t: float) -> tuple[float, float]:
            """Return q~1, q~2 at ``t`` s."""
            ...

        def with_input(self, b: float, t: float) -> None:
            """Hold the input at ``b`` from ``t`` s on."""
            ...

        def snapshot(self) -> dict[str, Any]:
            """Return what must be stored, beside the parameters, to continue bit for bit."""
            ...

        def restore(self, snapshot: dict[str, Any]) -> None:
            """Take up a snapshot of a solver with the same parameters and offsets."""
            ...


S = TypeVar("S", bound="Solver")


def parameter(name: str, start: Any, unit: str | None, description: str, **more: Any) -> Variable:
    """Return a Real parameter that may be changed between steps."""
    return Variable(name, "Real", "parameter", "tunable", description, start, unit, **more)


def fixed(name: str, kind: str, start: Any, description: str, **more: Any) -> Variable:
    """Return a parameter that is settled at initialisation."""
    return Variable(name, kind, "parameter", "fixed", description, start, **more)


def moving(name: str, description: str) -> Variable:
    """Return a displacement."""
    return Variable(name, "Real", "output", "continuous", description, unit="m", nominal=1e-11)


def steady(name: str, unit: str | None, description: str, nominal: float) -> Variable:
    """Return an output that depends on the parameters only."""
    return Variable(name, "Real", "output", "discrete", description, unit=unit, nominal=nominal)


#: The physical parameters, in the order of ``Parameters``.
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

PERIODIC_START = fixed(
    "periodic_start",
    "Boolean",
    False,
    "true: start on the periodic orbit, without a transient; false: start at rest",
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
    Variable(
        STATUS_MESSAGE,
        "String",
        "output",
        "discrete",
        "why the simulation failed, empty while it has not",
    ),
)


class TwoModeSlave(ModelSlave, Generic[S]):
    """Base of the FMUs: a model says how its solver is made and how it takes new parameters."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._solver: S | None = None

    # -- what a model provides ------------------------------------------------------------------

    def new_solver(self, p: Parameters, offsets: tuple[float, float]) -> S:
        """Return the solver that the parameters ask for; raise ModelError where there is none."""
        raise NotImplementedError

    def retuned(self, solver: S, p: Parameters, t: float) -> S:
        """Return the solver that goes on from ``t`` s with new parameters, in state and phase."""
        raise NotImplementedError

    # -- the course of a run --------------------------------------------------------------------

    def begin(self, t: float) -> None:
        """Start at rest or on the periodic orbit."""
        p = self._parameters()
        periodic = self.value("periodic_start")
        self._warn(check(p, periodic))
        solver = self.new_solver(p, (0.0, 0.0))
        solver.start(t, None if periodic else AT_REST, self.value("b"))
        self._solver = solver

    def change(self, t: float) -> None:
        """Go on from the present state and drive phases with new parameters."""
        p = self._parameters()
        self._warn(check(p, periodic_start=False))
        self._solver = self.retuned(self.running(), p, t)

    def step(self, t: float, end: float) -> None:
        """Hold the input and move; a growing oscillation is watched."""
        solver = self.running()
        b = self.value("b")
        if b != solver.b:
            if not math.isfinite(b):
                raise ModelError(f"b = {b!r} m/s2 is not a finite number")
            solver.with_input(b, t)
        solver.advance(end)
        if solver.grows:
            self._check_range(solver, end)

    def _check_range(self, solver: S, end: float) -> None:
        """Raise ModelError where the motion at ``end`` s is no number any more."""
        try:
            total = sum(solver.displacement(end))
        except OverflowError:
            total = math.inf
        if not math.isfinite(total):
            raise ModelError(f"the growing oscillation left the range of numbers before {end!r} s")

    def moving_outputs(self) -> Sequence[float]:
        """Return the displacements in both coordinates."""
        solver = self.running()
        q1, q2 = solver.displacement(self.time)
        return q1, q2, *physical(solver.p, q1, q2)

    def steady_outputs(self) -> Sequence[float]:
        """Return coupling, uncoupled eigenfrequencies, damping matrix, line widths and Qs.

        Why lambda may be NaN is told here, to those who read it: a fit initialises a thousand times
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

    def motion(self) -> dict[str, Any]:
        """Return the solver's state."""
        return self.running().snapshot()

    def resume(self, motion: dict[str, Any]) -> None:
        """Take up a solver's state."""
        offsets = motion["offsets"]
        self._solver = self.new_solver(self._parameters(), (offsets[0], offsets[1]))
        self._solver.restore(motion)

    def running(self) -> S:
        """Return the solver of the run."""
        if self._solver is None:
            raise ModelError("the simulation has not been initialised")
        return self._solver

    def _parameters(self) -> Parameters:
        return Parameters(*(self.value(name) for name in Parameters._fields))

    def _warn(self, sentences: list[str]) -> None:
        for sentence in sentences:
            self.warn(sentence)


def substep_parameter(number: int) -> Variable:
    """Return the parameter of the solver ``rk4``, which has this number."""
    return fixed(
        "rk4_substep",
        "Real",
        0.0,
        f"longest substep of solver {number}; 0: a fortieth of the shortest period",
        unit="s",
        minimum=0.0,
    )


def checked_substep(substep: float) -> float:
    """Return the substep of ``rk4`` in s; raise ModelError if it is no time."""
    if not (0.0 <= substep < math.inf):
        raise ModelError(f"rk4_substep = {substep!r} s: 0 or a positive time is wanted")
    return substep
