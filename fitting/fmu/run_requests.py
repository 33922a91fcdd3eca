"""Run requests: runs, as people name things, in the value references that a worker needs.

A layout is what many runs share: which variables are set and read. A variable that any layout sets
is set by all of them (to its declared start value where the run does not name it), so that nothing
hangs on what an FMU does to its parameters on reset.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fitting.fmu.runs import Handling, HeldSignal, Run, Segment, Tone
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, shown
from fitting.text.notation import listed

if TYPE_CHECKING:
    from fitting.fmu.description import Element, FmuDescription, FmuVariable

#: The causality of what FMI 3.0 sets in a mode of its own, before all other variables.
STRUCTURAL = "structuralParameter"
#: Least and largest number of every type of whole numbers; Integer is that of FMI 2.0.
_RANGES = {
    "Integer": (-(2**31), 2**31 - 1),
    **{f"Int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}


class Group(NamedTuple):
    """Variables of one FMI type; or elements of one array, which is set and read as a whole.

    ``size`` is that of the array, 0 for single variables; ``places`` those of the elements in it.
    ``structural``: they are set in configuration mode.
    """

    fmi_type: str
    names: tuple[str, ...]
    references: tuple[int, ...]
    size: int = 0
    places: tuple[int, ...] = ()
    structural: bool = False


class Layout(NamedTuple):
    """``sets`` before initialisation; ``gets`` at each sample, into ``columns`` of the result."""

    sets: tuple[Group, ...]
    gets: tuple[Group, ...]
    columns: tuple[tuple[int, ...], ...]
    outputs: tuple[str, ...]
    input: Group | None
    moved: Group | None = None


class Handled(NamedTuple):
    """How the instance of a run is handled: see `Handling`."""

    before: RunRequest | None
    freed: bool


class RunRequest(NamedTuple):
    """One run: ``values`` for each group of the layout's ``sets``."""

    layout: int
    values: tuple[tuple[Scalar, ...], ...]
    settle_s: float
    sample_step_s: float
    samples: int
    start_time_s: float
    allow_nan: bool
    tones: tuple[Tone, ...] = ()
    step_s: float = 0.0
    segments: tuple[Segment, ...] = ()
    held: HeldSignal | None = None
    handled: Handled | None = None
    longest_step_s: float = 0.0

    @property
    def rows(self) -> int:
        """Samples in all."""
        return self.samples + sum(segment.samples for segment in self.segments)


_Key = tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...], str, bool]


class RunRequests:
    """Turns runs into requests; keeps the layouts, numbered in the order of their making."""

    def __init__(self, description: FmuDescription) -> None:
        self.layouts: list[Layout] = []
        self._grown = False
        self._description = description
        self._known = description.settable
        self._numbers: dict[_Key, int] = {}
        self._defaults: dict[str, Scalar] = {}  # of every variable that any run has set
        self._beside: dict[str, Scalar] = {}  # of elements beside them in an array
        self._fitting: set[tuple[str, tuple[Scalar, ...]]] = set()  # whole numbers, by type

    def take_all(self, runs: Sequence[Run]) -> list[RunRequest]:
        """The requests for a batch; raises BadInput as `take` does.

        Args:
            runs: to be simulated.
        """
        self._grown = False
        requests = [self.take(run) for run in runs]
        # a variable that a later run was the first to set is missing in the requests before it
        return [self.take(run) for run in runs] if self._grown else requests

    def take(self, run: Run) -> RunRequest:
        """The request for one run.

        Args:
            run: to be simulated.

        Raises BadInput for a name that the FMU does not have, a variable that cannot be set or
        read, and a value of the wrong type.
        """
        signal = run.input_signal
        inputs = signal.names if signal else ()
        bare = run.handling is not None
        key = (tuple(run.start_values), run.outputs, inputs, run.moved, bare)
        number = self._numbers.get(key)
        if number is None:
            number = self._add(key, run.start_values)
        held = signal if isinstance(signal, HeldSignal) else None
        tones = () if signal is None or isinstance(signal, HeldSignal) else signal.tones
        given = {**self._beside, **self._defaults, **run.start_values}
        groups = self.layouts[number].sets
        values = tuple([tuple(map(given.__getitem__, group.names)) for group in groups])
        for group, numbers in zip(groups, values, strict=True):
            # nearly all runs of a fit set whole numbers alike
            if group.fmi_type in _RANGES and (group.fmi_type, numbers) not in self._fitting:
                self._require_range(group, numbers)
                self._fitting.add((group.fmi_type, numbers))
        return RunRequest(
            layout=number,
            values=values,
            settle_s=run.settle_s,
            sample_step_s=run.sample_step_s,
            samples=run.samples,
            start_time_s=run.start_time_s,
            allow_nan=run.allow_nan,
            tones=tones,
            step_s=signal.step_s if signal else 0.0,
            segments=run.segments,
            held=held,
            handled=self._handled(run),
            longest_step_s=run.longest_step_s,
        )

    def _handled(self, run: Run) -> Handled | None:
        handling = run.handling
        if handling is None:
            return None
        if handling.before is None:
            return Handled(None, handling.freed)
        first = replace(run, start_values=handling.before, handling=Handling())
        return Handled(self.take(first), handling.freed)

    def _add(self, key: _Key, start_values: Mapping[str, Scalar]) -> int:
        names, outputs, inputs, moved, bare = key
        for name in (*names, *inputs):
            if bare:
                self._variable_to_set(name)
            elif name not in self._defaults and self._remember(self._variable_to_set(name)):
                self._numbers.clear()  # from now on every layout sets this one as well
                self._grown = True
        for name, value in start_values.items():
            self._require_type(self._known[name], value)
        covered = self._whole_arrays(names if bare else (*names, *self._defaults))
        gets = self._grouped([self._variable_to_read(name) for name in outputs])
        self.layouts.append(
            Layout(
                sets=self._grouped(covered),
                gets=gets,
                columns=tuple(tuple(outputs.index(name) for name in g.names) for g in gets),
                outputs=outputs,
                input=self._inputs(inputs) if inputs else None,
                moved=self._moved(moved) if moved else None,
            )
        )
        self._numbers[key] = len(self.layouts) - 1
        return self._numbers[key]

    def _whole_arrays(self, names: Iterable[str]) -> list[FmuVariable]:
        """Variables, each once, and what stands beside an element in its array."""
        asked = [self._known[name] for name in dict.fromkeys(names)]
        arrays = {v.value_reference for v in asked if v.element is not None}
        found = [v for v in asked if v.element is None]
        if not arrays:
            return found
        elements = [v for v in self._known.values() if v.element and v.value_reference in arrays]
        for element in elements:
            if element.start is None and element.name not in names:
                raise BadInput(
                    f"{self._description.path}: {element.name!r} has no start value, wanted one: "
                    "an array is set as a whole"
                )
        self._beside |= {v.name: v.start for v in elements if v.start is not None}
        return [*found, *elements]

    def _remember(self, variable: FmuVariable) -> bool:
        if variable.start is None:
            return False  # nothing is known that it could be set to
        self._defaults[variable.name] = variable.start
        return True

    def _inputs(self, names: Sequence[str]) -> Group:
        variables = [self._description.variable(name) for name in names]
        for variable in variables:
            if variable.causality != "input" or variable.kind != "Real":
                raise BadInput(
                    f"{self._description.path}: {variable.name!r} is a {variable.kind} "
                    f"{variable.causality}, wanted a Real input for the drive"
                )
        groups = self._grouped(variables)
        for group in groups:
            if group.places != tuple(range(group.size)):
                raise BadInput(
                    f"{self._description.path}: {listed(group.names)} are not all elements of the "
                    "array in their order, wanted all as inputs: an array is set as a whole"
                )
        if len(groups) > 1:
            raise BadInput(
                f"{self._description.path}: inputs {', '.join(names)} are of the types "
                f"{', '.join(g.fmi_type for g in groups)}; wanted one type"
            )
        return groups[0]

    def _moved(self, name: str) -> Group:
        variable = self._description.variable(name)
        free = variable.causality == "input" or variable.variability == "tunable"
        if variable.kind != "Real" or not free:
            raise BadInput(
                f"{self._description.path}: {name!r} is a {variable.variability} {variable.kind} "
                f"{variable.causality}, wanted a tunable Real parameter to move during a run"
            )
        if variable.element is not None and variable.element.size > 1:
            raise BadInput(
                f"{self._description.path}: {name!r} is an element of an array, which is set as a "
                "whole; wanted a single variable to move during a run"
            )
        [group] = self._grouped([variable])
        return group

    def _variable_to_set(self, name: str) -> FmuVariable:
        variable = self._description.variable(name)
        if variable.kind == "other":
            raise BadInput(
                f"{self._description.path}: {name!r} is of type {variable.fmi_type}, or a large "
                "array or one of texts; wanted a Real, Integer, Boolean or String"
            )
        if not variable.can_be_started:
            why = " as arrays have its size" if variable.is_size else ""
            raise BadInput(
                f"{self._description.path}: {name!r} is a {variable.variability} "
                f"{variable.causality} that cannot be set{why}, "
                "wanted a parameter or an input"
            )
        return variable

    def _variable_to_read(self, name: str) -> FmuVariable:
        variable = self._description.variable(name)
        if variable.kind not in ("Real", "Integer", "Boolean"):
            raise BadInput(
                f"{self._description.path}: {name!r} is of type {variable.fmi_type}, wanted a "
                "number to read"
            )
        return variable

    def _require_type(self, variable: FmuVariable, value: object) -> None:
        fits = {
            "Real": isinstance(value, int | float | np.integer) and not isinstance(value, bool),
            "Integer": isinstance(value, int | np.integer) and not isinstance(value, bool),
            "Boolean": isinstance(value, bool),
            "String": isinstance(value, str),
        }[variable.kind]
        if not fits:
            raise BadInput(
                f"{self._description.path}: {variable.name} = {value!r}, wanted a {variable.kind}"
            )

    def _require_range(self, group: Group, numbers: tuple[Scalar, ...]) -> None:
        """What does not fit into the bytes of a type would be set to something else."""
        lowest, highest = _RANGES[group.fmi_type]
        for name, number in zip(group.names, numbers, strict=True):
            if not lowest <= int(number) <= highest:
                raise BadInput(
                    f"{self._description.path}: {name} = {shown(number)}, wanted {lowest} to "
                    f"{highest}, as {group.fmi_type} has it"
                )

    @staticmethod
    def _grouped(variables: list[FmuVariable]) -> tuple[Group, ...]:
        """Single variables by their types, structural ones first, then each array by itself."""
        single: dict[tuple[bool, str], list[FmuVariable]] = {}
        for v in variables:
            if v.element is None:
                single.setdefault((v.causality != STRUCTURAL, v.fmi_type), []).append(v)
        groups = [
            Group(
                fmi_type,
                tuple(v.name for v in alike),
                tuple(v.value_reference for v in alike),
                structural=not later,
            )
            for (later, fmi_type), alike in sorted(single.items(), key=lambda each: each[0][0])
        ]
        arrays: dict[int, list[tuple[FmuVariable, Element]]] = {}
        for v in variables:
            if v.element is not None:
                arrays.setdefault(v.value_reference, []).append((v, v.element))
        groups += [
            Group(
                fmi_type=array[0][0].fmi_type,
                names=tuple(v.name for v, _ in array),
                references=(reference,),
                size=array[0][1].size,
                places=tuple(element.place for _, element in array),
            )
            for reference, array in arrays.items()
        ]
        return tuple(groups)
