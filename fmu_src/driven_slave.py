"""What the driven FMUs share: the drive's input, the start, and the course of a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from .model_error import ModelError
from .slave import STATUS_MESSAGE, ModelSlave
from .variables import Variable

if TYPE_CHECKING:
    from typing import Protocol

    class Solver(Protocol):
        """The motion between changes of parameters."""

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

        def displacement(self, t: float) -> Sequence[float]:
            """Return the displacements of the modes at ``t`` s."""
            ...

        def with_input(self, b: float, t: float) -> None:
            """Hold the input at ``b`` from ``t`` s on."""
            ...

        def snapshot(self) -> dict[str, Any]:
            """Return what must be stored, besides parameters, to continue bit for bit."""
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


PERIODIC_START = fixed(
    "periodic_start",
    "Boolean",
    False,
    "true: start on the periodic orbit, without a transient; false: start at rest",
)

STATUS = Variable(
    STATUS_MESSAGE,
    "String",
    "output",
    "discrete",
    "why the simulation failed, empty while it has not",
)


class DrivenSlave(ModelSlave, Generic[S]):
    """Base of the FMUs: a model makes its solver from the parameters and reads it."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._solver: S | None = None

    # -- what a model provides ------------------------------------------------------------------

    def first_solver(self, t: float) -> S:
        """Return the solver, started at ``t`` s; raise ModelError where there is none."""
        raise NotImplementedError

    def next_solver(self, solver: S, t: float) -> S:
        """Return the solver that goes on from ``t`` s with new parameters, in state and phase."""
        raise NotImplementedError

    def restored_solver(self, motion: dict[str, Any]) -> S:
        """Return the solver that a snapshot was taken of, without its state."""
        raise NotImplementedError

    # -- the course of a run --------------------------------------------------------------------

    def begin(self, t: float) -> None:
        """Start at rest or on the periodic orbit."""
        self._solver = self.first_solver(t)

    def change(self, t: float) -> None:
        """Go on from the present state and drive phases with new parameters."""
        self._solver = self.next_solver(self.running(), t)

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

    def motion(self) -> dict[str, Any]:
        """Return the solver's state."""
        return self.running().snapshot()

    def resume(self, motion: dict[str, Any]) -> None:
        """Take up a solver's state."""
        solver = self.restored_solver(motion)
        solver.restore(motion)
        self._solver = solver

    def running(self) -> S:
        """Return the solver of the run."""
        if self._solver is None:
            raise ModelError("the simulation has not been initialised")
        return self._solver

    def warn_all(self, sentences: Sequence[str]) -> None:
        """Send sentences to the FMI logger without failing."""
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
