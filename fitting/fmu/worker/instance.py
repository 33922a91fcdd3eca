"""The functions of one FMU instance, FMI 2.0 or 3.0; lives in a worker process only.

fmpy loads the library and declares its functions. Its own methods make new arrays in every call,
which costs more than the calls themselves, so here the functions are called with buffers made once.
Those that are called for every sample are called undeclared, with all arguments as C wants them:
to look whether and how they fit costs as much as the call.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import fmpy
from fmpy.fmi2 import (
    FMU2Model,
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.fmi3 import FMU3Model, FMU3Slave

from fitting.fmu.description import FmuDescription
from fitting.fmu.runs import Group, Tone
from fitting.fmu.worker.log import CallFailed, Log, label
from fitting.text.arrays import Scalar

WARNING, DISCARD = 1, 2
LAST_SUCCESSFUL_TIME = 2  # of fmi2StatusKind
WITHIN = 1e-9  # of a step: how exactly a step has to arrive

_CTYPES: dict[str, Any] = {
    "Real": ctypes.c_double,
    "Float64": ctypes.c_double,
    "Float32": ctypes.c_float,
    "Integer": ctypes.c_int,
    "String": ctypes.c_char_p,
    **{f"Int{bits}": getattr(ctypes, f"c_int{bits}") for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": getattr(ctypes, f"c_uint{bits}") for bits in (8, 16, 32, 64)},
}


class VariableAccess(NamedTuple):
    """A get or set function for a group of variables: function(instance, references, n, buffer).

    ``tail`` are the arguments that FMI 3.0 wants behind these. All are numbers and arrays of C, as
    the function is undeclared.
    """

    function: Callable[..., int]
    name: str
    references: Any
    n: Any
    buffer: Any
    tail: tuple[Any, ...]


class FmuInstance:
    """An FMU instance; the subclasses know what differs between FMI 2.0 and 3.0.

    Every method raises CallFailed for a status that is neither OK nor a warning.
    """

    prefix: str
    boolean: Any
    values_counted: bool  # FMI 3.0 passes the number of values behind the buffer
    sizes: tuple[int, int] = 0, 0  # of model exchange: states and event indicators
    #: Time of the FMU at which runs begin, s; its stop time and tolerance, None: not stated.
    origin_s: float = 0.0
    stop_s: float | None = None
    tolerance: float | None = None

    def __init__(self, fmu: Any, log: Log) -> None:
        self.fmu = fmu
        self.log = log
        self.instance: Any = None
        self._functions: dict[str, Callable[..., int]] = {}
        # an FMU of model exchange has none
        has_steps = hasattr(fmu.dll, f"{self.prefix}DoStep")
        self._do_step: Any = self._undeclared("DoStep") if has_steps else None
        self._at, self._step = ctypes.c_double(), ctypes.c_double()
        self._keeps_no_state = self.boolean(True)

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function of the FMU, by the argument types that fmpy has declared.

        Args:
            name: of the FMI function, without its prefix.
            *arguments: behind the instance.
        """
        function = self._functions.get(name)
        if function is None:
            function = self._functions[name] = getattr(self.fmu.dll, self.prefix + name)
        if (status := function(self.instance, *arguments)) > WARNING:
            self.check(status, name)

    def instantiate(self) -> None:
        """A new instance in place of the old one."""
        self.free()
        try:
            self._instantiate()
        except Exception as error:  # fmpy raises a bare Exception
            raise CallFailed(self.with_log(f"cannot be instantiated: {error}")) from error
        self.instance = ctypes.c_void_p(self.fmu.component)

    def free(self) -> None:
        """Free the instance, if there is one."""
        if self.instance is not None:
            instance, self.instance = self.instance, None
            getattr(self.fmu.dll, f"{self.prefix}FreeInstance")(instance)

    def terminate(self) -> None:
        """End the simulation; results can still be read, and the instance reset."""
        self.call("Terminate")

    def leave_initialisation(self) -> None:
        """Initial values are computed here."""
        self.call("ExitInitializationMode")

    def access(self, verb: str, group: Group) -> VariableAccess:
        """Function and buffers to get or set ("Get", "Set") a group of variables.

        Args:
            verb: "get" or "set".
            group: value references of one type, or of one array.
        """
        n = len(group.references)
        element = self.boolean if group.fmi_type == "Boolean" else _CTYPES[group.fmi_type]
        return VariableAccess(
            function=self._undeclared(verb + group.fmi_type),
            name=verb + group.fmi_type,
            references=(ctypes.c_uint * n)(*group.references),
            n=ctypes.c_size_t(n),
            buffer=(element * (group.size or n))(),
            tail=(ctypes.c_size_t(group.size or n),) if self.values_counted else (),
        )

    def set(self, access: VariableAccess, values: tuple[Scalar, ...]) -> None:
        """Set the variables of a group.

        Args:
            access: variables of one kind.
            values: one per variable.
        """
        if access.name == "SetString":
            access.buffer[:] = [str(text).encode() for text in values]
        else:
            access.buffer[:] = values
        function, name, references, n, buffer, tail = access
        status = function(self.instance, references, n, buffer, *tail)
        if status > WARNING:
            self.check(status, name)

    def follow(self, access: VariableAccess, tones: tuple[Tone, ...]) -> bool:
        """Whether the input follows tones by itself from now on: what is held over steps does not.

        Args:
            access: to the input.
            tones: frequency in Hz, amplitude and phase of each.
        """
        return False

    def check(self, status: int, function: str) -> None:
        """Raise CallFailed unless the status is OK or a warning.

        Args:
            status: FMI status of a call.
            function: name of the FMI call.
        """
        if status > WARNING:
            text = f"{self.prefix}{function} returned '{label(status)}'"
            raise CallFailed(self.with_log(text), status)

    def with_log(self, text: str) -> str:
        """What the FMU logged, and behind it a text on what it did.

        Args:
            text: as it was written.
        """
        logged = self.log.sentences()
        return f"{logged}; {text}" if logged else f"{text}, and the FMU logged nothing"

    def stopped(self, reached: float, wanted: float, why: str) -> CallFailed:
        """The failure of a step that did not arrive.

        Args:
            reached: time that was reached, s; NaN: it is not known.
            wanted: time that was wanted, s.
            why: as the FMU gave it.
        """
        known = math.isfinite(reached)
        at = f"at t = {reached!r} s" if known else "at a time that it does not report"
        return CallFailed(self.with_log(f"stopped early {at}, wanted {wanted!r} s ({why})"))

    def _undeclared(self, name: str) -> Callable[..., Any]:
        # a function object of its own, which gives a whole number and takes what it is given
        function: Callable[..., Any] = self.fmu.dll[self.prefix + name]
        return function

    def _instantiate(self) -> None:
        raise NotImplementedError

    def enter_initialisation(self, start_time: float, end_time: float) -> None:
        """Set up the experiment and go to initialisation mode.

        Args:
            start_time: of the run, s.
            end_time: of the run, s; a stop time that is stated is no earlier.
        """
        raise NotImplementedError

    def _experiment(self, start_time: float, end_time: float) -> tuple[float | bool, ...]:
        """Whether there is a tolerance, which; start; whether there is a stop time, which."""
        stop = None if self.stop_s is None else max(self.stop_s, self.origin_s + end_time)
        has_tolerance, has_stop = self.tolerance is not None, stop is not None
        start = self.origin_s + start_time
        return has_tolerance, self.tolerance or 0.0, start, has_stop, stop or 0.0

    def step(self, at: float, step: float) -> None:
        """One communication step from ``at``; raises CallFailed as well if it ends early.

        Args:
            at: time at which the step begins, s.
            step: length of the step, s.
        """
        raise NotImplementedError


class FmuInstance2(FmuInstance):
    """FMI 2.0."""

    prefix = "fmi2"
    boolean = ctypes.c_int
    values_counted = False

    def __init__(self, fmu: Any, log: Log) -> None:
        super().__init__(fmu, log)
        self._callbacks = fmi2CallbackFunctions()
        self._callbacks.logger = fmi2CallbackLoggerTYPE(
            lambda _environment, _name, status, _category, message: log.receive(status, message)
        )
        self._callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        self._callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(fmpy.free)
        try:
            # native code that fills in the arguments of a printf-like message
            from fmpy.logging import addLoggerProxy
        except OSError:  # no such library for this platform: messages come unfilled
            return
        addLoggerProxy(ctypes.byref(self._callbacks))

    def _instantiate(self) -> None:
        self.fmu.instantiate(callbacks=self._callbacks, loggingOn=True)

    def enter_initialisation(self, start_time: float, end_time: float) -> None:
        """SetupExperiment and EnterInitializationMode."""
        self.call("SetupExperiment", *self._experiment(start_time, end_time))
        self.call("EnterInitializationMode")

    def step(self, at: float, step: float) -> None:
        """DoStep; the FMU reports by 'discard' that it stopped early."""
        at += self.origin_s
        self._at.value, self._step.value = at, step
        status = self._do_step(self.instance, self._at, self._step, self._keeps_no_state)
        if status <= WARNING:
            return
        if status == DISCARD:
            reached = ctypes.c_double(math.nan)
            ask = self.fmu.dll.fmi2GetRealStatus
            known = ask(self.instance, LAST_SUCCESSFUL_TIME, ctypes.byref(reached)) <= WARNING
            last = reached.value if known else math.nan
            raise self.stopped(last, at + step, "fmi2DoStep returned 'discard'")
        text = f"fmi2DoStep from t = {at!r} s by {step!r} s returned '{label(status)}'"
        raise CallFailed(self.with_log(text), status)


class FmuInstance3(FmuInstance):
    """FMI 3.0, without event mode and early return."""

    prefix = "fmi3"
    boolean = ctypes.c_bool
    values_counted = True

    def __init__(self, fmu: Any, log: Log) -> None:
        super().__init__(fmu, log)
        self._events, self._terminated, self._early = (ctypes.c_bool() for _ in range(3))
        self._reached = ctypes.c_double()
        flags = (self._events, self._terminated, self._early, self._reached)
        self._flags = tuple(ctypes.byref(flag) for flag in flags)

    def _instantiate(self) -> None:
        receive = self.log.receive
        self.fmu.instantiate(
            loggingOn=True,
            logMessage=lambda _environment, status, _category, message: receive(status, message),
        )

    def enter_initialisation(self, start_time: float, end_time: float) -> None:
        """EnterInitializationMode with the experiment."""
        self.call("EnterInitializationMode", *self._experiment(start_time, end_time))

    def step(self, at: float, step: float) -> None:
        """DoStep; the FMU reports by flags and the time reached that it stopped early."""
        at += self.origin_s
        self._terminated.value = self._early.value = False
        self._reached.value = wanted = at + step  # for FMUs that do not write it
        self._at.value, self._step.value = at, step
        status = self._do_step(
            self.instance, self._at, self._step, self._keeps_no_state, *self._flags
        )
        if status > WARNING:
            text = f"fmi3DoStep from t = {at!r} s by {step!r} s returned '{label(status)}'"
            raise CallFailed(self.with_log(text), status)
        reached = self._reached.value
        if self._terminated.value:
            raise self.stopped(reached, wanted, "the FMU asks to end the simulation")
        if self._early.value or not abs(reached - wanted) <= WITHIN * step:
            raise self.stopped(reached, wanted, "fmi3DoStep returned early")


def load(description: FmuDescription, folder: str, log: Log) -> FmuInstance:
    """The library of an unpacked FMU, loaded; no instance yet.

    Args:
        description: of the FMU.
        folder: that holds its files.
        log: of the FMU.

    Raises CallFailed if it cannot be loaded or lacks a function.
    """
    is_2, exchange = description.fmi_version == "2.0", description.exchange
    library: Any = FMU2Slave if is_2 else FMU3Slave
    interface: type[FmuInstance] = FmuInstance2 if is_2 else FmuInstance3
    if exchange is not None:
        # scipy, which others need not load
        from fitting.fmu.worker.exchange import ModelExchange2, ModelExchange3

        library = FMU2Model if is_2 else FMU3Model
        interface = ModelExchange2 if is_2 else ModelExchange3
    try:
        fmu = library(
            guid=description.guid,
            modelIdentifier=description.model_identifier,
            unzipDirectory=folder,
            instanceName=description.model_identifier,
            libraryPath=str(Path(folder, description.library)),
        )
    except Exception as error:  # fmpy raises a bare Exception
        raise CallFailed(f"its library cannot be loaded: {error}") from error
    instance = interface(fmu, log)
    instance.origin_s, instance.stop_s = description.start_s, description.stop_s
    instance.tolerance = description.tolerance
    if exchange is not None:
        instance.sizes = exchange
    return instance
