"""The solvers ``exact`` and ``envelope`` of N modes: periodic part by sidebands, plus a transient.

Without a pump the transient and the turning of the drive are carried in 50 digits, so that the sum
of a large orbit and a transient that nearly cancels it, as at the start from rest, keeps the digits
of a double. With a pump the transient is a series in doubles, good to rounding of the orbit.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from decimal import Decimal
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

from .model_error import ModelError
from .modes_equations import Parameters, matrices
from .modes_motion import PeriodTable, Propagator, PumpedPropagator, generator
from .modes_stability import MOST_PERIODS, check_stable
from .modes_steady import Frame, Wanted, steady_state
from .oscillator_phase import Frequency, kept_phase
from .oscillator_precise import Precise, in_precise_arithmetic

if TYPE_CHECKING:  # subscripted here, these would need a host with Python 3.9 or later
    from .modes_equations import Matrices
    from .modes_steady import Steady

    #: Displacements, then velocities over 2 pi (envelope: imaginary parts of analytic signals).
    State = tuple[Decimal, ...]
    #: Cycles added to tone 1, tone 2 and pump by retuning.
    Offsets = tuple[float, float, float]

TWO_PI = 2.0 * math.pi
FOUR_PI_SQUARED = TWO_PI * TWO_PI
NO_OFFSETS = (0.0, 0.0, 0.0)
#: A transient that has fallen to this part of its start is lost beside any number.
DECAYED = Decimal("1e-43")
#: The parameters on which the propagators of the full equations depend.
MOVES = ("f", "d", "coupling", "depth_f", "depth_coupling", "pump_hz")
#: Sets of modes and pump whose matrices are in store.
MOST_STABLE = 16
#: Sidebands below this part of the largest one are left out of the sum.
NO_LINE = 1e-19
ZERO = Decimal(0)


def at_rest(n: int) -> State:
    """Return the state of n modes at rest."""
    return (ZERO,) * (2 * n)


class Pumped(NamedTuple):
    """A tone's periodic motion: frequency, offset, and (k, (z_k, z_k'/2 pi)) of its sidebands."""

    u: Frequency
    offset: float
    lines: list[tuple[int, list[complex]]]


class Flows:
    """What moves transients: it depends on modes, pump and frame, so new tones share it."""

    def __init__(self, frame: Frame, fastest_hz: float) -> None:
        self.made = generator(frame)
        self.exact = Propagator(self.made.still)
        fastest = fastest_hz if frame.centre is None else max(fastest_hz, 2.0 * frame.centre)
        self._size = 2 * len(frame.matrices.eta)
        self._pump_hz, self._fastest_hz = frame.pump_hz, fastest
        self._table: PeriodTable | None = None

    @property
    def by_period(self) -> bool:
        """Whether a table of a pump period takes less time than it saves."""
        return self._fastest_hz <= MOST_PERIODS * self._pump_hz

    def pumped(self) -> PumpedPropagator:
        """Return the propagator under the pump."""
        return PumpedPropagator(self.made, self._pump_hz, self._fastest_hz)

    def table(self) -> PeriodTable:
        """Return the table of a pump period, made when first asked for."""
        if self._table is None:
            self._table = PeriodTable(self.pumped(), self._size)
        return self._table


@lru_cache(maxsize=MOST_STABLE)
def _stable(p: Parameters) -> Matrices:
    """Return the matrices of modes and pump; raise ModelError where the motion grows by the pump.

    Kept from run to run, as the next one often has other tones alone.
    """
    m = matrices(p)
    # the full equations are those that grow
    check_stable(Frame(m, None, p.pump_hz), _fastest_hz(m))
    return m


def _fastest_hz(m: Matrices) -> float:
    return max(m.eta[-1], *map(abs, m.damping_values))


class ModesSolver:
    """N modes between changes of their parameters, exactly or in a rotating frame."""

    def __init__(self, p: Parameters, envelope: bool, offsets: Offsets = NO_OFFSETS) -> None:
        """Check stability; responses and propagators are made when first needed."""
        self.p, self.envelope, self.offsets = p, envelope, offsets
        self.n = len(p.f)
        self.matrices = _stable(p.moves)
        self.wanted = Wanted(p.tolerance, p.readout)
        self.frame = Frame(self.matrices, centre_of(p) if envelope else None, p.pump_hz)
        self._responses: dict[float, Steady] = {}
        self._periodic: list[Pumped] = []
        self._motion: _ExactMotion | _PumpedMotion | None = None
        self._flows: Flows | None = None
        self.b = 0.0

    @property
    def fastest_hz(self) -> float:
        """The highest frequency of the system's own."""
        return _fastest_hz(self.matrices)

    @property
    def flows(self) -> Flows:
        """What moves transients, made when first needed."""
        if self._flows is None:
            self._flows = Flows(self.frame, self.fastest_hz)
        return self._flows

    def response(self, u: float) -> Steady:
        """Return the response to cos(2 pi u t), over (2 pi)^2, in s^2."""
        if u not in self._responses:
            self._responses[u] = steady_state(self.frame, self.p.g, u, self.wanted)
        return self._responses[u]

    def full_response(self, u: float) -> Steady:
        """Return what ``response`` does, of the full equations."""
        if not self.envelope:
            return self.response(u)
        return steady_state(self.frame._replace(centre=None), self.p.g, u, self.wanted)

    # -- the course of a run --------------------------------------------------------------------

    def start(self, t: float, state: State | None, b: float) -> None:
        """Begin at ``t`` s from a state (None: on the periodic orbit) with input ``b``."""
        if b and self.envelope:
            raise ModelError(
                f"b = {b!r}: the rotating frame of solver 1 (envelope) cannot carry an arbitrary "
                "input; use solver 0 (exact) or 2 (rk4)"
            )
        self.b = b
        self._motion = None
        for u, size, _ in self.p.tones:
            if size:
                self.response(u)  # refused now rather than when it is read
        if state is not None:
            self._motion = self._new_motion(t)
            self._motion.begin(state)

    def _new_motion(self, t: float) -> _ExactMotion | _PumpedMotion:
        return _PumpedMotion(self, t) if self.p.pumped else _ExactMotion(self, t)

    @property
    def grows(self) -> bool:
        """Whether a transient can leave the range of a double."""
        return min(self.p.d) < 0.0

    def advance(self, t: float) -> None:
        """Carry the transient on to ``t`` s."""
        if self._motion is not None:
            self._motion.advance(t)
            if self._motion.decayed():
                self._motion = None

    def displacement(self, t: float) -> list[float]:
        """Return the displacements at ``t`` s."""
        if self._motion is None:
            return [z.real for z in self.orbit(t, self.b)[: self.n]]
        return [float(x) for x in self._motion.total()[: self.n]]

    def full_state(self, t: float) -> State:
        """Return displacements and velocities over 2 pi (envelope: analytic signals)."""
        if self._motion is not None:
            return tuple(self._motion.total())
        z = self.orbit(t, self.b)
        if self.envelope:
            z = [*z[: self.n], *(-1j * x for x in z[: self.n])]
        return tuple(Decimal(x.real) for x in z)

    def with_input(self, b: float, t: float) -> None:
        """Hold the input at ``b`` from ``t`` s on."""
        if self.envelope:
            self.start(t, self.full_state(t), b)  # refuses
        if self._motion is None:
            self._motion = self._new_motion(t)
        self._motion.change_input(b)
        self.b = b

    def retuned(self, p: Parameters, t: float) -> ModesSolver:
        """Return the solver for new parameters, with state and drive phases kept at ``t`` s."""
        solver = ModesSolver(p, self.envelope, kept_offsets(self.offsets, self.p, p, t))
        if all(getattr(p, name) == getattr(self.p, name) for name in MOVES) and not self.envelope:
            solver._flows = self._flows
        solver.start(t, self.full_state(t), self.b)
        return solver

    def snapshot(self) -> dict[str, Any]:
        """Return what must be stored, besides parameters, to continue bit for bit."""
        motion = None if self._motion is None else self._motion.snapshot()
        return {"motion": motion, "b": self.b, "offsets": list(self.offsets)}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Take up a snapshot of a solver with the same parameters and offsets."""
        self.start(0.0, None, snapshot["b"])
        if snapshot["motion"] is not None:
            self._motion = self._new_motion(snapshot["motion"]["t"])
            self._motion.restore(snapshot["motion"])

    # -- the periodic part ----------------------------------------------------------------------

    def orbit(self, t: float, b: float) -> list[complex]:
        """Return z and z'/(2 pi) of the analytic signals whose real parts are the periodic part."""
        total = [0j] * (2 * self.n)
        pump = self.pump_cycles(t)
        for tone in self._drives(b):
            base = tone.u.cycles(t) + tone.offset
            for k, y in tone.lines:
                turn = cmath.rect(1.0, TWO_PI * ((base + k * pump) % 1.0))
                total = [x + a * turn for x, a in zip(total, y)]
        return total

    def pump_cycles(self, t: float) -> float:
        """Return the pump's phase at ``t`` s in cycles."""
        p = self.p
        return Frequency(p.pump_hz).cycles(t) + self.offsets[2] + p.pump_phase / TWO_PI

    def _drives(self, b: float) -> list[Pumped]:
        """Return the motion under the active tones and the held input, a tone of 0 Hz."""
        if not self._periodic:
            self._periodic = [
                self._lines(u, cmath.rect(size, phase), offset)
                for (u, size, phase), offset in self.driven
            ]
        return [*self._periodic, self._lines(0.0, complex(b), 0.0)] if b else self._periodic

    @property
    def driven(self) -> list[tuple[tuple[float, float, float], float]]:
        """Active tones (frequency, amplitude, phase) with their offsets."""
        return [(tone, o) for tone, o in zip(self.p.tones, self.offsets) if tone[1]]

    def _lines(self, u: float, amplitude: complex, offset: float) -> Pumped:
        """Return the motion under a tone of complex amplitude, without lines that are rounding."""
        result = self.response(u)
        lines = []
        for k in range(-result.below, len(result.sidebands) - result.below):
            z = [amplitude * x / FOUR_PI_SQUARED for x in result.sideband(k)]
            speed = 1j * (u + k * self.p.pump_hz)
            lines.append((k, [*z, *(speed * x for x in z)]))
        sizes = [max(map(abs, y[: self.n])) for _, y in lines]
        least = NO_LINE * max(sizes)
        return Pumped(Frequency(u), offset, [x for x, s in zip(lines, sizes) if s >= least])


def centre_of(p: Parameters) -> float:
    """Return the frequency of the rotating frame: the mean of the active tones, or of the modes."""
    active = [u for u, size, _ in p.tones if size]
    return sum(active) / len(active) if active else sum(p.f) / len(p.f)


def kept_offsets(offsets: Offsets, before: Parameters, after: Parameters, t: float) -> Offsets:
    """Return the cycles with which tones and pump of new frequencies continue their phases."""
    return (
        kept_phase(offsets[0], before.u1, after.u1, t),
        kept_phase(offsets[1], before.u2, after.u2, t),
        kept_phase(offsets[2], before.pump_hz, after.pump_hz, t),
    )


class _Turning(NamedTuple):
    """A tone in 50 digits: its response times its amplitude, frequency and turning."""

    response: list[Precise]
    u: Decimal
    turning: Propagator


class _ExactMotion:
    """The transient of the unpumped modes next to the turning drive, in 50 digits."""

    def __init__(self, solver: ModesSolver, t: float) -> None:
        self.t, self.b = t, solver.b
        self._made, self._flow = solver.flows.made, solver.flows.exact
        self._n = solver.n
        with in_precise_arithmetic():
            self._tones: list[_Turning] = []
            self._turns: list[Precise] = []
            for (u, size, phase), offset in solver.driven:
                amplitude = _precise(cmath.rect(size, phase) / FOUR_PI_SQUARED)
                response = [amplitude * x for x in solver.response(u).exact]
                exact = Decimal(u)
                turning = Propagator([[ZERO, -exact], [exact, ZERO]])
                self._tones.append(_Turning(response, exact, turning))
                cycles = Frequency(u).cycles(t) + offset
                self._turns.append(_precise(cmath.rect(1.0, TWO_PI * cycles)))
            self._still = self._static(solver)
        self._free: list[Decimal] = [ZERO] * (2 * self._n)
        self._first = ZERO

    def _static(self, solver: ModesSolver) -> list[Decimal]:
        """Return the displacements that a unit input holds."""
        if solver.envelope:
            return [ZERO] * (2 * self._n)
        still = solver.response(0.0).exact
        return [*(x.re / Decimal(FOUR_PI_SQUARED) for x in still), *([ZERO] * self._n)]

    def begin(self, state: State) -> None:
        """Start from displacements and velocities over 2 pi."""
        with in_precise_arithmetic():
            orbit = self._orbit()
            self._set([a - b for a, b in zip(self._scaled(state), orbit)])

    def _set(self, free: list[Decimal]) -> None:
        self._free = free
        self._first = max(abs(x) for x in free)

    def _scaled(self, state: Sequence[Decimal]) -> list[Decimal]:
        """Return the state as the generator has it: velocities over its scale."""
        scale = self._made.scale
        if not scale:
            return list(state)
        return [*state[: self._n], *(w / scale for w in state[self._n :])]

    def _orbit(self) -> list[Decimal]:
        """Return the periodic part as the generator has it."""
        scale = self._made.scale
        b = Decimal(self.b)
        total = [b * x for x in self._still]
        for tone, turn in zip(self._tones, self._turns):
            for i, x in enumerate(tone.response):
                z = x * turn
                total[i] += z.re
                total[self._n + i] += -z.im * tone.u / scale if scale else z.im
        return total

    def advance(self, t: float) -> None:
        """Move on to ``t`` s."""
        with in_precise_arithmetic():
            dt = Decimal(t) - Decimal(self.t)
            if dt:
                self._free = self._flow.moved(self._free, dt)
                for i, tone in enumerate(self._tones):
                    turn = self._turns[i]
                    self._turns[i] = Precise(*tone.turning.moved((turn.re, turn.im), dt))
        self.t = t

    def decayed(self) -> bool:
        """Return whether nothing is left."""
        return max(map(abs, self._free)) <= DECAYED * self._first

    def total(self) -> list[Decimal]:
        """Return displacements and velocities over 2 pi."""
        with in_precise_arithmetic():
            y = [a + b for a, b in zip(self._free, self._orbit())]
            scale = self._made.scale
            return [*y[: self._n], *(w * scale for w in y[self._n :])] if scale else y

    def change_input(self, b: float) -> None:
        """Hold another input, from the same displacements."""
        with in_precise_arithmetic():
            less = Decimal(self.b) - Decimal(b)
            self._set([x + less * s for x, s in zip(self._free, self._still)])
        self.b = b

    def snapshot(self) -> dict[str, Any]:
        """Return the state in all digits, as text."""
        return {
            "t": self.t,
            "free": [str(x) for x in self._free],
            "first": str(self._first),
            "turns": [[str(z.re), str(z.im)] for z in self._turns],
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Take up a snapshot."""
        self._free = [Decimal(x) for x in snapshot["free"]]
        self._first = Decimal(snapshot["first"])
        self._turns = [Precise(Decimal(a), Decimal(b)) for a, b in snapshot["turns"]]


class _PumpedMotion:
    """The transient of pumped modes, in doubles.

    It is followed to the next beginning of a pump period and from there carried by the table of
    that period, unless the period is so long that the table would take more time than it saves.
    """

    def __init__(self, solver: ModesSolver, t: float) -> None:
        self.t, self._solver = t, solver
        self.b = solver.b
        self._scale = float(solver.flows.made.scale)
        self._flow = solver.flows.pumped()
        #: the transient as the generator has it: now, and where a period began
        self._free = [0.0] * (2 * solver.n)
        self._started: tuple[float, list[float]] | None = None
        self._first = 0.0

    def begin(self, state: State) -> None:
        """Start from displacements and velocities over 2 pi."""
        orbit = self._orbit(self.b)
        self._set(self._times([float(a) - b for a, b in zip(state, orbit)], 1.0 / self._factor))

    def _set(self, free: list[float]) -> None:
        self._free, self._started = free, None
        self._first = max(map(abs, free))

    @property
    def _factor(self) -> float:
        return self._scale or 1.0

    def _times(self, y: list[float], factor: float) -> list[float]:
        """Return y with its second half, the velocities, times a factor."""
        n = self._solver.n
        return [*y[:n], *(w * factor for w in y[n:])]

    def _orbit(self, b: float) -> list[float]:
        """Return displacements and velocities over 2 pi of the periodic part."""
        n = self._solver.n
        z = self._solver.orbit(self.t, b)
        if self._solver.envelope:
            return [*(x.real for x in z[:n]), *(x.imag for x in z[:n])]
        return [x.real for x in z]

    def advance(self, t: float) -> None:
        """Move on to ``t`` s."""
        if t > self.t:
            if self._started is None:
                self._follow(t)
            if self._started is not None:
                self._from_table(t, *self._started)
        self.t = t

    def _follow(self, t: float) -> None:
        """Integrate to ``t`` s, or to where a period begins before."""
        cycles = self._solver.pump_cycles(self.t) % 1.0
        rest = (1.0 - cycles) / self._solver.p.pump_hz
        span = t - self.t
        if self._solver.flows.by_period and rest <= span:
            self._started = self.t + rest, self._flow.moved(self._free, rest, TWO_PI * cycles)
        else:
            self._free = self._flow.moved(self._free, span, TWO_PI * cycles)

    def _from_table(self, t: float, started: float, y: list[float]) -> None:
        # the pump's own phase says where in the period t is; the count only needs to be near
        fraction = self._solver.pump_cycles(t) % 1.0
        periods = round((t - started) * self._solver.p.pump_hz - fraction)
        self._free = self._solver.flows.table().after(
            y, max(periods, 0), fraction if periods >= 0 else 0.0
        )

    def decayed(self) -> bool:
        """Return whether nothing is left."""
        return max(map(abs, self._free)) <= float(DECAYED) * self._first

    def total(self) -> list[Decimal]:
        """Return displacements and velocities over 2 pi."""
        free = self._times(self._free, self._factor)
        return [Decimal(a + b) for a, b in zip(free, self._orbit(self.b))]

    def change_input(self, b: float) -> None:
        """Hold another input, from the same displacements and velocities."""
        change = [old - new for old, new in zip(self._orbit(self.b), self._orbit(b))]
        self._set([x + y for x, y in zip(self._free, self._times(change, 1.0 / self._factor))])
        self.b = b

    def snapshot(self) -> dict[str, Any]:
        """Return the state."""
        started = None if self._started is None else [self._started[0], list(self._started[1])]
        return {"t": self.t, "free": list(self._free), "first": self._first, "started": started}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Take up a snapshot."""
        self._free, self._first = list(snapshot["free"]), snapshot["first"]
        started = snapshot["started"]
        self._started = None if started is None else (started[0], list(started[1]))


def _precise(z: complex) -> Precise:
    return Precise(z.real, z.imag)
