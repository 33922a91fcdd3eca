"""The adapter between a model of this package and FMI 2.0 co-simulation, through pythonfmu.

A model declares its variables in a table and its motion in a few methods; this module does the
rest: the modelDescription, get and set, the state of the FMU, and failure. No exception leaves it,
because pythonfmu turns one into fmi2Fatal and many hosts then crash. Instead the sentence goes to
the FMI logger and to the String output ``status_message``, every Real output becomes NaN and each
further doStep returns fmi2Discard until fmi2Reset.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar
from xml.etree.ElementTree import Element

from pythonfmu import DefaultExperiment, Fmi2Slave
from pythonfmu.enums import Fmi2Status

from .model_error import ModelError
from .variables import Accuracy, Table, Variable, make_table, unit_definitions, write_structure

STATUS_MESSAGE = "status_message"
_INSTANTIATED, _INITIALISING, _STEPPING, _FAILED = range(4)


class ModelSlave(Fmi2Slave):
    """Base of every model here; a model overrides ``begin``, ``change``, ``step`` and the outputs.

    ``variables`` is the table; its order gives the value references. Outputs named in ``moving``
    change with time, the others with the parameters only. ``costly`` names one of the former that
    is calculated only where it is asked for.
    """

    variables: ClassVar[tuple[Variable, ...]] = ()
    moving: ClassVar[tuple[str, ...]] = ()
    costly: ClassVar[str | None] = None
    start_overrides: ClassVar[Mapping[str, Any]] = {}
    #: Some seventy periods of a 7 MHz string, each well sampled: what a host runs if told nothing.
    default_experiment = DefaultExperiment(start_time=0.0, stop_time=1e-5, step_size=1e-8)
    #: What fmu-fit is told of the model's accuracy (see ``variables.Accuracy``).
    accuracy: ClassVar[Accuracy | None] = None
    guid_text: ClassVar[str] = "{00000000-0000-0000-0000-000000000000}"
    description: ClassVar[str | None] = None
    author: ClassVar[str | None] = None
    version: ClassVar[str | None] = None
    license: ClassVar[str | None] = None
    copyright: ClassVar[str | None] = None

    def __init__(self, **kwargs: Any) -> None:
        # not by way of pythonfmu, which makes a random GUID at every reset
        self.vars: OrderedDict[int, Any] = OrderedDict()
        self.instance_name = kwargs["instance_name"]
        self.resources = kwargs.get("resources")
        self.visible = kwargs.get("visible", False)
        self.log_queue: list[Any] = []
        self.guid = self.guid_text
        self.modelName = type(self).__name__
        self._table, self._steady = _table(type(self))
        self._values: list[Any] = list(self._table.starts)
        self._phase = _INSTANTIATED
        self._changed = False
        self.time = 0.0
        self._moving_stale = self._steady_stale = True
        self._costly_stale = False

    # -- what a model provides ------------------------------------------------------------------

    def begin(self, t: float) -> None:
        """Start the motion at ``t`` s from the parameters; raise ModelError if they forbid it."""
        raise NotImplementedError

    def change(self, t: float) -> None:
        """Take over tunable parameters changed at ``t`` s, keeping state and phase."""
        raise NotImplementedError

    def step(self, t: float, end: float) -> None:
        """Move from ``t`` to ``end`` s with the inputs held."""
        raise NotImplementedError

    def moving_outputs(self) -> Sequence[float]:
        """Return the values of ``moving`` at the present time."""
        raise NotImplementedError

    def costly_output(self) -> float:
        """Return the value of ``costly`` at the present time, where the others are up to date."""
        raise NotImplementedError

    def steady_outputs(self) -> Sequence[float]:
        """Return the values of the outputs that depend on the parameters only, in table order."""
        raise NotImplementedError

    def motion(self) -> dict[str, Any]:
        """Return the state beyond the variables as plain numbers, for JSON."""
        raise NotImplementedError

    def resume(self, motion: dict[str, Any]) -> None:
        """Take up what ``motion`` returned; the variables are in place already."""
        raise NotImplementedError

    # -- for models -----------------------------------------------------------------------------

    def value(self, name: str) -> Any:
        """Return the present value of a variable."""
        return self._values[self._table.references[name]]

    def first_values(self, count: int) -> list[Any]:
        """Return the present values of the first variables of the table."""
        return self._values[:count]

    def warn(self, sentence: str) -> None:
        """Send a sentence to the FMI logger without failing."""
        self.log(_loggable(sentence), Fmi2Status.warning)

    # -- FMI life cycle -------------------------------------------------------------------------

    def setup_experiment(self, start_time: float, *_: Any) -> None:
        """Take the start time."""
        self.time = start_time

    def enter_initialization_mode(self) -> None:
        """Let the start values be read as outputs from now on."""
        if self._phase == _FAILED:
            return  # only a reset mends what was refused before
        self._phase = _INITIALISING
        self._changed = True

    def exit_initialization_mode(self) -> None:
        """Start the motion, or fail with a sentence."""
        if self._phase == _INSTANTIATED:
            self._fail(ModelError("the simulation has not been initialised"))
        try:
            self._settle_parameters()
        except Exception as error:
            self._fail(error)
        if self._phase != _FAILED:
            self._phase = _STEPPING

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Move on by a step; False, which hosts see as fmi2Discard, after any failure."""
        if self._phase == _FAILED:
            return False
        try:
            if self._changed:
                self._settle_parameters()
            end = current_time + step_size
            slack = 1e-6 * step_size + 1e-9 * abs(current_time)
            if not (step_size >= 0.0 and abs(current_time - self.time) <= slack):
                raise ModelError(
                    f"doStep at {current_time!r} s by {step_size!r} s does not follow the "
                    f"communication point {self.time!r} s"
                )
            if not math.isfinite(end):
                raise ModelError(f"doStep at {current_time!r} s by {step_size!r} s has no end")
            self.step(current_time, end)
            self.time = end
            self._moving_stale = True
        except Exception as error:
            self._fail(error)
            return False
        return True

    def terminate(self) -> None:
        """Do nothing: there is nothing to release."""

    def _settle_parameters(self) -> None:
        """Bring the model in line with parameters set since the last communication point."""
        if self._changed:
            self._moving_stale = self._steady_stale = True
            if not math.isfinite(self.time):
                raise ModelError(f"the start time {self.time!r} s is not a finite number")
            if self._phase == _STEPPING:
                self.change(self.time)
            else:
                self.begin(self.time)
            self._changed = False

    # -- failure --------------------------------------------------------------------------------

    def _fail(self, error: Exception) -> None:
        """Log why, put it into ``status_message``, and let no number out any more."""
        sentence = str(error) if isinstance(error, ModelError) else f"internal error: {error!r}"
        self._phase = _FAILED
        for reference in self._table.real_outputs:
            self._values[reference] = math.nan
        self._moving_stale = self._steady_stale = self._changed = False
        self._costly_stale = False
        self._values[self._table.references[STATUS_MESSAGE]] = _loggable(sentence)
        self.log(_loggable(sentence), Fmi2Status.error)

    # -- get and set ----------------------------------------------------------------------------

    def get_real(self, vrs: list[int]) -> list[float]:
        """Return Reals; outputs are evaluated when first asked for at a communication point."""
        try:
            if self._moving_stale or self._changed:
                self._update_moving()
            if self._steady_stale and not self._steady.isdisjoint(vrs):
                self._update_steady()
            if self._costly_stale and self._table.references[self.costly or ""] in vrs:
                self._update_costly()
        except Exception as error:
            self._fail(error)
        if not self._table.kinds["Real"].issuperset(vrs):
            self._fail(ModelError(f"getReal: {vrs!r} names a variable that is not a Real"))
            return [math.nan] * len(vrs)
        values = self._values
        return [values[vr] for vr in vrs]

    def _update_moving(self) -> None:
        if self._phase == _INSTANTIATED:
            return
        if self._changed:
            self._settle_parameters()
        outputs = self.moving_outputs()
        self._values[self._table.moving] = outputs
        self._moving_stale = False
        self._costly_stale = self.costly is not None
        if not math.isfinite(sum(outputs)):
            raise ModelError(f"the motion left the range of numbers at t = {self.time!r} s")

    def _update_costly(self) -> None:
        self._values[self._table.references[self.costly or ""]] = self.costly_output()
        self._costly_stale = False

    def _update_steady(self) -> None:
        if self._phase == _INSTANTIATED:
            return
        self._settle_parameters()
        for reference, value in zip(self._table.steady, self.steady_outputs()):
            self._values[reference] = value
        self._steady_stale = False

    def get_integer(self, vrs: list[int]) -> list[int]:
        """Return Integers."""
        return self._get("Integer", vrs, 0)

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        """Return Booleans."""
        return self._get("Boolean", vrs, False)

    def get_string(self, vrs: list[int]) -> list[str]:
        """Return Strings."""
        return self._get("String", vrs, "")

    def _get(self, kind: str, vrs: list[int], otherwise: Any) -> list[Any]:
        if not self._table.kinds[kind].issuperset(vrs):
            self._fail(ModelError(f"get{kind}: {vrs!r} names a variable that is not of this type"))
            return [otherwise] * len(vrs)
        return [self._values[vr] for vr in vrs]

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Set Reals."""
        self._set("Real", vrs, values)

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        """Set Integers."""
        self._set("Integer", vrs, values)

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        """Set Booleans."""
        self._set("Boolean", vrs, values)

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        """Set Strings."""
        self._set("String", vrs, values)

    def _set(self, kind: str, vrs: list[int], values: list[Any]) -> None:
        """Store values; refuse, by failing, what FMI does not let change at this moment."""
        try:
            if not self._table.kinds[kind].issuperset(vrs):
                raise ModelError(f"set{kind}: {vrs!r} names a variable that is not of this type")
            for vr, value in zip(vrs, values):
                if self._values[vr] != value:
                    self._set_one(vr, value)
        except Exception as error:
            self._fail(error)

    def _set_one(self, vr: int, value: Any) -> None:
        variable = type(self).variables[vr]
        if variable.causality == "output":
            raise ModelError(f"{variable.name} is an output and cannot be set")
        if variable.causality == "parameter":
            if self._phase == _STEPPING and variable.variability == "fixed":
                raise ModelError(
                    f"{variable.name} is fixed after initialisation and cannot be changed from "
                    f"{self._values[vr]!r} to {value!r}"
                )
            self._changed = self._phase in (_INITIALISING, _STEPPING)
        elif self._phase == _INITIALISING:
            self._changed = True
        self._values[vr] = value

    # -- state ----------------------------------------------------------------------------------

    def _get_fmu_state(self) -> dict[str, Any]:
        """Return every variable and the motion as plain numbers."""
        try:
            if self._changed:
                self._settle_parameters()
            motion = self.motion() if self._phase in (_INITIALISING, _STEPPING) else None
        except Exception as error:
            self._fail(error)
            motion = None
        return {
            "phase": self._phase,
            "time": self.time,
            "values": list(self._values),
            "motion": motion,
            "moving_stale": self._moving_stale,
            "steady_stale": self._steady_stale,
            "costly_stale": self._costly_stale,
        }

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        try:
            self._phase, self.time = state["phase"], state["time"]
            self._values = list(state["values"])
            self._changed = False
            self._moving_stale, self._steady_stale = state["moving_stale"], state["steady_stale"]
            self._costly_stale = state["costly_stale"]
            if state["motion"] is not None:
                self.resume(state["motion"])
        except Exception as error:
            self._fail(error)

    # -- modelDescription -----------------------------------------------------------------------

    def to_xml(self, model_options: Mapping[str, str] | None = None) -> Element:
        """Return the modelDescription with units, bounds, full digits and initial unknowns."""
        root: Element = super().to_xml(dict(model_options or {}))
        root.attrib.pop("generationDateAndTime", None)
        root.set("variableNamingConvention", "flat")
        order = [child.tag for child in root]
        root.insert(order.index("CoSimulation") + 1, unit_definitions(self.variables))
        if self.accuracy is not None:
            place = [child.tag for child in root].index("ModelVariables")
            root.insert(place, self.accuracy.to_xml())
        variables, structure = root.find("ModelVariables"), root.find("ModelStructure")
        if variables is None or structure is None:
            raise ModelError("pythonfmu wrote no ModelVariables or ModelStructure")
        structure.clear()
        for reference, variable in enumerate(self.variables):
            variables.append(variable.to_xml(reference, self._values[reference]))
        write_structure(structure, self.variables)
        return root


def _loggable(sentence: str) -> str:
    """Return the sentence without percent signs, which hosts would read as printf formats."""
    return sentence.replace("%", " percent")


_TABLES: dict[type[ModelSlave], tuple[Table, frozenset[int]]] = {}


def _table(model: type[ModelSlave]) -> tuple[Table, frozenset[int]]:
    """Return the table of a model and its steady outputs as a set, made once per class."""
    if model not in _TABLES:
        table = make_table(model.variables, model.moving, model.start_overrides)
        _TABLES[model] = table, frozenset(table.steady)
    return _TABLES[model]
