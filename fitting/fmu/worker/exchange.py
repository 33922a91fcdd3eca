"""FMUs of model exchange: equations without a solver, solved here.

Where they are linear, exactly (`fitting.fmu.worker.linear_equations`). Else they are integrated by
scipy, to a relative tolerance that is set as a variable of the FMU is: by DOP853 (Dormand and
Prince, order 8), and where that takes very many steps, as stiff equations make it, by LSODA
(Petzold 1983), which goes over to backward differences. A drive is no staircase here: the input is
set to the tones wherever the equations are evaluated. Integration begins anew after every event;
state events are found by bisection of the dense output, time events are ends of a stretch.
"""

from __future__ import annotations

import ctypes
import math
from typing import Any

import numpy as np
from fmpy.fmi2 import fmi2EventInfo
from scipy.integrate import DOP853, LSODA

from fitting.fmu.description import INTEGRATOR_TOLERANCE, USUAL_TOLERANCE
from fitting.fmu.runs import Group, Tone
from fitting.fmu.worker.instance import FmuInstance, FmuInstance2, FmuInstance3, VariableAccess
from fitting.fmu.worker.linear_equations import TURN, LinearEquations, linear_equations
from fitting.fmu.worker.log import CallFailed, Log
from fitting.text.arrays import FloatArray, Scalar

#: The part of a state's nominal value below which it is nothing.
NOTHING = 1e-9
#: Steps of a stretch from which equations are taken for stiff, but for so many in a period of the
#: drive: these follow it.
MANY_STEPS = 20_000
#: Evaluations of events at one time, at most, and bisections of a step in which one is.
MOST_EVENTS, BISECTIONS = 1000, 60
#: Steps in a period of the fastest oscillation, at which state events are looked for; looks in a
#: stretch, about, whether equations are as linear as they were found.
LOOKS, MOST_LOOKS = 8, 256
#: Lengths of steps for which what moves the states is kept.
MOST_KEPT = 64


class _Buffer:
    """Numbers that an FMU reads or writes, and where they are."""

    def __init__(self, size: int) -> None:
        self.pointer = (ctypes.c_double * size)()
        self.values: FloatArray = np.ctypeslib.as_array(self.pointer) if size else np.empty(0)


class ModelExchange(FmuInstance):
    """What both versions of model exchange have in common; listed before one of their classes."""

    derivatives: str

    def __init__(self, fmu: Any, log: Log) -> None:
        super().__init__(fmu, log)
        self._running = False
        self._tolerance = USUAL_TOLERANCE
        self._stiff = False
        self._input: VariableAccess | None = None

    def instantiate(self) -> None:
        """A new instance; variables are set without an event until it runs."""
        self._running = False
        super().instantiate()

    def enter_initialisation(self, start_time: float, end_time: float) -> None:
        """As in co-simulation; the time is kept, and nothing is known of the equations."""
        self._start_s, self._event_s, self._step_s = start_time, math.inf, 0.0
        self._input = None
        self._tones: tuple[Tone, ...] = ()
        self._equations: LinearEquations | None = None
        self._curved, self._stale, self._integrate_to = False, False, -math.inf
        self._propagators: dict[float, FloatArray] = {}
        super().enter_initialisation(start_time, end_time)

    def leave_initialisation(self) -> None:
        """Initial values, the first events, and the size of the states."""
        super().leave_initialisation()
        states, indicators = self.sizes
        if self.prefix == "fmi3":  # sizes of arrays may have changed those of the description
            numbers = ctypes.c_size_t(), ctypes.c_size_t()
            self.call("GetNumberOfContinuousStates", ctypes.byref(numbers[0]))
            self.call("GetNumberOfEventIndicators", ctypes.byref(numbers[1]))
            states, indicators = numbers[0].value, numbers[1].value
        self._x, self._dx, self._z = (_Buffer(n) for n in (states, states, indicators))
        self._nominal = np.ones(states)
        if states:
            self._nominal = self._read("GetNominalsOfContinuousStates", self._x)
        self._largest = NOTHING * np.abs(self._nominal)  # sizes of the states so far
        self._now_s = self._start_s
        self._update_discrete_states()
        self._running = True

    def terminate(self) -> None:
        """End the simulation."""
        self._running = False
        super().terminate()

    def access(self, verb: str, group: Group) -> VariableAccess:
        """Function and buffers of a group of variables, or of the integrator's tolerance.

        Args:
            verb: "get" or "set".
            group: value references of one type, or of one array.
        """
        if group.fmi_type != INTEGRATOR_TOLERANCE.fmi_type:
            return super().access(verb, group)

        def take(_instance: Any, _references: Any, _n: int, buffer: Any) -> int:
            self._tolerance = float(buffer[0])
            return 0

        return VariableAccess(take, "SetTolerance", (), 1, (ctypes.c_double * 1)(), ())

    def set(self, access: VariableAccess, values: tuple[Scalar, ...]) -> None:
        """Set variables; during the simulation that is an event.

        Args:
            access: variables of one kind.
            values: one per variable.
        """
        if self._running:
            self.call("EnterEventMode")
        super().set(access, values)
        if self._running:
            self._update_discrete_states()

    def follow(self, access: VariableAccess, tones: tuple[Tone, ...]) -> bool:
        """Set an input to tones wherever the equations are evaluated.

        Args:
            access: to the input.
            tones: frequency in Hz, amplitude and phase of each.
        """
        self._input, self._tones = access, tones
        super().set(access, (self._input_at(self._start_s),))
        return True

    def _phases(self, t: float) -> list[float]:
        return [TURN * ((f * t) % 1.0) + phase for f, _, phase in self._tones]

    def _input_at(self, t: float) -> float:
        tones = zip(self._tones, self._phases(t), strict=True)
        return sum(a * math.cos(phase) for (_, a, _), phase in tones)

    def step(self, at: float, step: float) -> None:
        """Integrate from ``at`` over ``step``, with the events on the way.

        Args:
            at: time at which the step begins, s.
            step: length of the step, s.
        """
        end = at + step
        while at < end:
            until = min(end, self._event_s) if self._event_s > at else end
            until = min(until, self._integrate_to) if self._integrate_to > at else until
            equations = self._linear_equations(at)
            if equations is None:
                at, event = self._integrate(at, until)
            else:
                at, event = self._propagate(equations, at, until)
            if event or at >= self._event_s:
                self.call("EnterEventMode")
                self._now_s = at
                self._update_discrete_states()

    def _integrate(self, at: float, until: float) -> tuple[float, bool]:
        """Integrate to a time or the next state event; the time, and whether there is an event."""
        if not self._x.values.size:
            self._set_time(until)
            return until, self._completed()
        x = self._read("GetContinuousStates", self._x)
        # absolute tolerances by the largest value of a state so far, or a part of a nominal one
        self._largest = np.maximum(self._largest, np.abs(x))
        within = {"rtol": self._tolerance, "atol": np.asarray(self._tolerance * self._largest)}
        solver: Any
        if self._stiff:
            solver = LSODA(self._rate, at, x, until, **within)
        else:
            # a first step of its own choice would cost more than a short stretch has steps
            first_s = min(self._step_s, until - at) or None
            solver = DOP853(self._rate, at, x, until, first_step=first_s, **within)
        steps, before = 0, self._indicators(at, x)
        while solver.status == "running":
            message, steps = solver.step(), steps + 1
            if solver.status == "failed":
                name = type(solver).__name__
                raise self.stopped(float(solver.t), until, f"{name} cannot go on: {message}")
            self._step_s = max(self._step_s, float(solver.t - solver.t_old))
            t, x = float(solver.t), np.array(solver.y)
            self._largest = np.maximum(self._largest, np.abs(x))
            after = self._indicators(t, x)
            if np.any((before > 0.0) != (after > 0.0)):
                # the time just after the first change of sign of an indicator in this step
                inside, low, t = solver.dense_output(), float(solver.t_old), float(solver.t)
                for _ in range(BISECTIONS):
                    middle = 0.5 * (low + t)
                    if not low < middle < t:
                        break
                    signs = self._indicators(middle, inside(middle)) > 0.0
                    low, t = (low, middle) if np.any(signs != (before > 0.0)) else (middle, t)
                self._put(t, inside(t))
                self._completed()
                return t, True
            self._put(t, x)
            if self._completed():
                return t, True
            before = after
            if steps == MANY_STEPS and not self._stiff:
                self._stiff = True
                return t, False
        return until, False

    def _linear_equations(self, at: float) -> LinearEquations | None:
        """The equations where they are linear, as far as is known, from this time on."""
        if at < self._integrate_to or not self._x.values.size:
            return None
        if self._equations is None and not self._curved:
            x = self._read("GetContinuousStates", self._x)

            def rate(there: FloatArray, u: float) -> FloatArray:
                self._put(at, there)
                if self._input is not None:
                    FmuInstance.set(self, self._input, (u,))
                return self._read(self.derivatives, self._dx)

            try:
                scales = np.where(self._nominal != 0.0, np.abs(self._nominal), 1.0)
                driven = self._input is not None
                self._equations = linear_equations(rate, scales, driven=driven)
            except CallFailed:  # it does not take such states
                self._equations = None
            finally:  # the FMU is left as it was
                self._put(at, x)
            self._curved, self._propagators = self._equations is None, {}
        if self._equations is not None and self._stale:
            x = self._read("GetContinuousStates", self._x)
            rates, self._stale = self._rate(at, x), False
            self._equations = self._equations.with_constant(rates, x, self._input_at(at))
        return self._equations

    def _propagate(self, equations: LinearEquations, at: float, until: float) -> tuple[float, bool]:
        """As `_integrate`, by linear equations, as far as the FMU is seen to follow them."""
        x = self._read("GetContinuousStates", self._x)
        fastest_hz = max([equations.fastest_hz, *(f for f, _, _ in self._tones)])
        count = max(1, math.ceil(LOOKS * fastest_hz * (until - at)))
        count = count if self._z.values.size else min(count, MOST_LOOKS)
        step = (until - at) / count
        # steps that differ by the rounding of the time at their ends are one
        key = float(f"{step:.13e}")
        by = self._propagators.get(key)
        if by is None:
            if len(self._propagators) == MOST_KEPT:
                self._propagators.clear()
            by = self._propagators[key] = equations.propagator(step, self._tones)
        before, each = self._indicators(at, x), max(1, count // MOST_LOOKS)
        now, followed = at, (at, x)  # how far the FMU was seen to follow
        for k in range(1, count + 1):
            then = at + k * step if k < count else until
            x, now = equations.moved(by, x, self._phases(now)), then
            self._put(now, x)
            if self._z.values.size:
                after = self._read("GetEventIndicators", self._z)
                if np.any((before > 0.0) != (after > 0.0)):
                    self._integrate_to = now
                    break
                before = after
            if k % each == 0 or k == count:
                rates = self._read(self.derivatives, self._dx)
                if not equations.describe(rates, x, self._input_at(now)):
                    self._equations, self._curved = None, True
                    break
                followed = now, x
                if self._completed():
                    return now, True
        else:
            return until, False
        self._put(*followed)  # from there on it is integrated
        return followed[0], False

    def _rate(self, t: float, x: FloatArray) -> FloatArray:
        self._put(t, x)
        return self._read(self.derivatives, self._dx)

    def _indicators(self, t: float, x: FloatArray) -> FloatArray:
        if not self._z.values.size:
            return self._z.values
        self._put(t, x)
        return self._read("GetEventIndicators", self._z)

    def _put(self, t: float, x: FloatArray) -> None:
        self._set_time(t)
        if x.size:
            self._x.values[:] = x
            self.call("SetContinuousStates", self._x.pointer, x.size)

    def _set_time(self, t: float) -> None:
        self._now_s = t
        self.call("SetTime", t + self.origin_s)
        if self._input is not None:
            super().set(self._input, (self._input_at(t),))

    def _read(self, name: str, buffer: _Buffer) -> FloatArray:
        self.call(name, buffer.pointer, buffer.values.size)
        return buffer.values.copy()

    def _update_discrete_states(self) -> None:
        """Update discrete states until none changes, and go on in continuous time."""
        at = self._now_s
        for _ in range(MOST_EVENTS):
            needed, ended, event_s = self._update()
            if ended:
                raise self.stopped(at, math.inf, "the FMU asks to end the simulation")
            if not needed:
                break
        else:
            raise CallFailed(
                self.with_log(f"has more than {MOST_EVENTS} events at t = {at!r} s in a row")
            )
        self._event_s = event_s if event_s > at else math.inf
        self._stale, self._curved = True, False  # an input has another value, or more is other
        self.call("EnterContinuousTimeMode")

    def _completed(self) -> bool:
        """Complete a step; whether the FMU wants an event there."""
        event, ended = self.boolean(), self.boolean()
        self.call("CompletedIntegratorStep", True, ctypes.byref(event), ctypes.byref(ended))
        if ended.value:
            raise self.stopped(self._now_s, math.inf, "the FMU asks to end the simulation")
        return bool(event.value)

    def _update(self) -> tuple[bool, bool, float]:
        """One update of discrete states: another is needed, an end is wanted, time of the next."""
        if self.prefix == "fmi2":
            info = fmi2EventInfo()
            self.call("NewDiscreteStates", ctypes.byref(info))
            needed, ended = info.newDiscreteStatesNeeded, info.terminateSimulation
            is_set, next_s = info.nextEventTimeDefined, info.nextEventTime
        else:
            flags, event_s = [ctypes.c_bool() for _ in range(5)], ctypes.c_double()
            pointers = [ctypes.byref(flag) for flag in flags]
            self.call("UpdateDiscreteStates", *pointers, ctypes.byref(event_s))
            needed, ended, _, _, is_set = (flag.value for flag in flags)
            next_s = event_s.value
        return bool(needed), bool(ended), float(next_s) if is_set else math.inf


class ModelExchange2(ModelExchange, FmuInstance2):
    """Model exchange of FMI 2.0."""

    derivatives = "GetDerivatives"


class ModelExchange3(ModelExchange, FmuInstance3):
    """Model exchange of FMI 3.0."""

    derivatives = "GetContinuousStateDerivatives"
