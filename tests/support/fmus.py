"""FMUs in tests: unpack one, and drive its instances by variable names through fmpy.

fmpy's ``simulate_fmu`` hides statuses and shortens a result when a step fails, so the instances are
driven call by call here, and every call's status is there to be looked at.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, Self

import fmpy
import mpmath as mp
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Slave,
    calloc,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
    free,
)
from fmpy.model_description import ModelDescription

from tests.support import reference

OK, WARNING, DISCARD, ERROR, FATAL = range(5)
OF_FMI_3 = {"Float64": "Real", "Int32": "Integer"}

#: A scene in which a lot happens in 0.3 ms: strong damping, both modes, both tones, from rest.
LIVELY: Mapping[str, Any] = {
    "theta": 1.9498,
    "d1": 9e3,
    "d2": 4e3,
    "eta_plus": 1.0e5,
    "eta_minus": 1.3e5,
    "u1": 0.99e5,
    "u2": 1.31e5,
    "A1": 1.5e10,
    "A2": 2.5e10,
    "phase1": 0.3,
    "phase2": -1.1,
    "g1": 1.0,
    "g2": 0.8,
}
#: Communication points that show it.
TIMES = [1e-5 * k for k in range(1, 31)]


class Refusal(NamedTuple):
    """Parameters that cannot be simulated, and what the FMU's sentence must name."""

    label: str
    values: Mapping[str, Any]
    name: str
    value: str


UNDAMPED = {"d1": 0.0, "d2": 0.0}
#: Every failure that the FMU promises to survive.
REFUSALS = (
    Refusal("not-a-number", {"theta": float("nan")}, "theta", "nan"),
    Refusal("infinite", {"A2": float("inf")}, "A2", "inf"),
    Refusal("eta-zero", {"eta_plus": 0.0}, "eta_plus", "0.0"),
    Refusal("eta-negative", {"eta_minus": -7.0e6}, "eta_minus", "-7000000.0"),
    Refusal("negative-drive", {"u1": -1.0}, "u1", "-1.0"),
    Refusal("negative-drive-2", {"u2": -6.9e6}, "u2", "-6900000.0"),
    Refusal("indefinite", {"d1": -5.0, "periodic_start": True}, "d1", "-5.0"),
    Refusal("semidefinite", {"d2": 0.0, "periodic_start": True}, "d2", "0.0"),
    Refusal("undamped-resonance", UNDAMPED | {"u1": 6940260.0}, "u1", "6940260.0"),
    Refusal("undamped-resonance-2", UNDAMPED | {"u2": 7027600.0}, "u2", "7027600.0"),
)


class Unpacked(NamedTuple):
    """An FMU, unpacked where its binary finds its resources."""

    path: Path
    folder: Path
    description: ModelDescription

    @property
    def references(self) -> dict[str, int]:
        """Return variable name -> value reference."""
        return {v.name: v.valueReference for v in self.description.modelVariables}

    def names(self, causality: str, kind: str = "Real") -> list[str]:
        """Return the names of the variables of one causality and type, by FMI 2.0's name of it."""
        return [
            v.name
            for v in self.description.modelVariables
            if v.causality == causality and kind in (v.type, OF_FMI_3.get(v.type))
        ]

    def parameters(self, **changes: Any) -> SimpleNamespace:
        """Return the parameters of a run as the reference solution takes them."""
        read: dict[str, Callable[[str], Any]] = {
            "Real": float,
            "Float64": float,
            "Integer": int,
            "Int32": int,
            "Boolean": lambda text: text == "true",
        }
        values = {
            v.name: read[v.type](v.start)
            for v in self.description.modelVariables
            if v.causality == "parameter"
        }
        return SimpleNamespace(**(values | changes))


def unpack(path: Path, folder: Path) -> Unpacked:
    """Unpack an FMU into a folder and read its modelDescription."""
    fmpy.extract(str(path), unzipdir=str(folder))
    return Unpacked(path, folder, fmpy.read_model_description(str(folder)))


class Instance:
    """One instance of an FMU; calls that fail return their status, messages are kept."""

    def __init__(self, fmu: Unpacked, name: str = "instance") -> None:
        self.messages: list[tuple[int, str]] = []
        self._variables = {v.name: v for v in fmu.description.modelVariables}
        self._outputs = fmu.names("output")
        self._callbacks = fmi2CallbackFunctions(
            logger=fmi2CallbackLoggerTYPE(self._log),
            allocateMemory=fmi2CallbackAllocateMemoryTYPE(calloc),
            freeMemory=fmi2CallbackFreeMemoryTYPE(free),
        )
        self.slave = FMU2Slave(
            guid=fmu.description.guid,
            unzipDirectory=str(fmu.folder),
            modelIdentifier=fmu.description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.slave.instantiate(callbacks=self._callbacks, loggingOn=True)

    def _log(self, _environment: Any, _name: Any, status: int, _category: Any, text: bytes) -> None:
        self.messages.append((status, text.decode()))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.slave.freeInstance()

    def start(self, t: float = 0.0, **values: Any) -> Self:
        """Set start values and initialise."""
        self.set(**values)
        self.slave.setupExperiment(startTime=t)
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()
        return self

    def set(self, **values: Any) -> None:
        """Set variables by name."""
        for name, value in values.items():
            variable = self._variables[name]
            getattr(self.slave, f"set{variable.type}")([variable.valueReference], [value])

    def get(self, *names: str) -> list[float]:
        """Return Reals by name, in one call."""
        return list(self.slave.getReal([self._variables[name].valueReference for name in names]))

    def outputs(self) -> dict[str, float]:
        """Return all Real outputs."""
        return dict(zip(self._outputs, self.get(*self._outputs), strict=True))

    def status_message(self) -> str:
        """Return the String output in which the FMU says why it failed."""
        text = self.slave.getString([self._variables["status_message"].valueReference])[0]
        return str(text.decode())

    def step(self, t: float, size: float) -> int:
        """Do one step and return its status."""
        try:
            self.slave.doStep(t, size)
        except FMICallException as error:
            return int(error.status)
        return OK

    def run(self, times: Sequence[float], *names: str) -> list[list[float]]:
        """Step from time 0 to each of the times and return the named outputs there."""
        now, rows = 0.0, []
        for time in times:
            status = self.step(now, time - now)
            if status != OK:
                raise AssertionError(f"doStep to {time} s: status {status}: {self.messages}")
            now = time
            rows.append(self.get(*names))
        return rows


def steady_state(p: Any, times: Sequence[float]) -> list[tuple[Any, Any]]:
    """Return the true periodic q~ = Re sum X(u) A exp(i(2 pi u t + phase)) at 50 digits."""
    with mp.workdps(50):
        tones = [
            (mp.mpf(a), 2 * mp.pi * mp.mpf(u), mp.mpf(phase), reference.phasors(p, u))
            for a, u, phase in ((p.A1, p.u1, p.phase1), (p.A2, p.u2, p.phase2))
        ]

        def at(t: float, mode: int) -> Any:
            turned = (a * x[mode] * mp.expj(w * mp.mpf(t) + phase) for a, w, phase, x in tones)
            return mp.re(mp.fsum(turned))

        return [(at(t, 0), at(t, 1)) for t in times]


def worst(rows: Sequence[Sequence[float]], truth: Sequence[Sequence[Any]]) -> float:
    """Return the largest error relative to the largest amplitude of the run."""
    size = max(abs(x) for row in truth for x in row)
    errors = (
        abs(a - b) for x, y in zip(rows, truth, strict=True) for a, b in zip(x, y, strict=True)
    )
    return float(max(errors) / size)


def resident_bytes() -> int:
    """Return the memory that this process holds (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
