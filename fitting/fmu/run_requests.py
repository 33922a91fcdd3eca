"""Run requests: runs, as people name things, in the value references that a worker needs.

A layout is what many runs share: which variables are set and read. A variable that any layout sets
is set by all of them (to its declared start value where the run does not name it), so that nothing
depends on what an FMU does to its parameters on reset.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fitting.fmu.runs import Handling, Run, SampledSignal, Segment, Tone
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, shown
from fitting.text.notation import listed

if TYPE_CHECKING:
    from fitting.fmu.description import FmuDescription, FmuVariable

#: The causality of what FMI 3.0 sets in a mode of its own, before all other variables.
STRUCTURAL = "structuralParameter"
#: Least and largest number of every type of whole numbers; Integer is that of FMI 2.0.
_RANGES = {
    "Integer": (-(2**31), 2**31 - 1),
    **{f"Int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}
#: What fits a variable, by its kind.
_FITTING: Mapping[str, tuple[type, ...]] = {
    "Real": (int, float, np.integer),
    "Integer": (int, np.integer),
    "Boolean": (bool,),
    "String": (str,),
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


class RunRequest(NamedTuple):
    """One run: ``values`` for each group of the layout's ``sets``.

    ``handled``: the run that goes before on the same instance, and whether that is freed at the
    end; see `Handling`.
    """

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
    sampled: SampledSignal | None = None
    handled: tuple[RunRequest | None, bool] | None = None
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
        self._elements: dict[str, Scalar] = {}  # of the others in an array with one of them
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
        signal, handling = run.input_signal, run.handling
        inputs = signal.names if signal else ()
        key = (tuple(run.start_values), run.outputs, inputs, run.moved, handling is not None)
        number = self._numbers.get(key)
        if number is None:
            number = self._add(key, run.start_values)
        given = {**self._elements, **self._defaults, **run.start_values}
        groups = self.layouts[number].sets
        values = tuple([tuple(map(given.__getitem__, group.names)) for group in groups])
        for group, numbers in zip(groups, values, strict=True):
            # nearly all runs of a fit set whole numbers alike
            if group.fmi_type in _RANGES and (group.fmi_type, numbers) not in self._fitting:
                # what does not fit into the bytes of a type would be set to something else
                low, high = _RANGES[group.fmi_type]
                for name, value in zip(group.names, numbers, strict=True):
                    if not low <= int(value) <= high:
                        wanted = f"wanted {low} to {high}, as {group.fmi_type} has it"
                        raise self._bad(f"{name} = {shown(value)}, {wanted}")
                self._fitting.add((group.fmi_type, numbers))
        handled = None
        if handling is not None:
            before = None
            if handling.before is not None:
                first = replace(run, start_values=handling.before, handling=Handling())
                before = self.take(first)
            handled = before, handling.freed
        return RunRequest(
            layout=number,
            values=values,
            settle_s=run.settle_s,
            sample_step_s=run.sample_step_s,
            samples=run.samples,
            start_time_s=run.start_time_s,
            allow_nan=run.allow_nan,
            tones=() if signal is None or isinstance(signal, SampledSignal) else signal.tones,
            step_s=signal.step_s if signal else 0.0,
            segments=run.segments,
            sampled=signal if isinstance(signal, SampledSignal) else None,
            handled=handled,
            longest_step_s=run.longest_step_s,
        )

    def _add(self, key: _Key, start_values: Mapping[str, Scalar]) -> int:
        """A new layout; from now on all layouts set what it sets."""
        names, outputs, inputs, moved, bare = key
        for name in (*names, *inputs):
            if bare or name not in self._defaults:
                start = self._settable(name).start
                if not bare and start is not None:  # else nothing is known that it could be set to
                    self._defaults[name] = start
                    self._numbers.clear()
                    self._grown = True
        for name, value in start_values.items():
            kind = self._known[name].kind
            fits = isinstance(value, _FITTING[kind])
            if not fits or (isinstance(value, bool) and kind != "Boolean"):
                raise self._bad(f"{name} = {value!r}, wanted a {kind}")

        read = [self._description.variable(name) for name in outputs]
        for variable in read:
            if variable.kind not in ("Real", "Integer", "Boolean"):
                what = f"{variable.name!r} is of type {variable.fmi_type}"
                raise self._bad(f"{what}, wanted a number to read")
        gets = _grouped(read)
        self.layouts.append(
            Layout(
                sets=_grouped(self._whole_arrays(names if bare else (*names, *self._defaults))),
                gets=gets,
                columns=tuple(tuple(outputs.index(name) for name in g.names) for g in gets),
                outputs=outputs,
                input=self._inputs(inputs) if inputs else None,
                moved=self._moved(moved) if moved else None,
            )
        )
        self._numbers[key] = len(self.layouts) - 1
        return self._numbers[key]

    def _settable(self, name: str) -> FmuVariable:
        variable = self._description.variable(name)
        if variable.kind == "other":
            raise self._bad(
                f"{name!r} is of type {variable.fmi_type}, or a large array or one of texts; "
                "wanted a Real, Integer, Boolean or String"
            )
        if not variable.can_be_started:
            why = " as arrays have its size" if variable.is_size else ""
            raise self._bad(
                f"{name!r} is a {variable.variability} {variable.causality} that cannot be set"
                f"{why}, wanted a parameter or an input"
            )
        return variable

    def _whole_arrays(self, names: Iterable[str]) -> list[FmuVariable]:
        """Variables, each once, with all elements of an array that one of them is in."""
        given = [self._known[name] for name in dict.fromkeys(names)]
        arrays = {v.value_reference for v in given if v.size}
        elements = [v for v in self._known.values() if v.size and v.value_reference in arrays]
        for element in elements:
            if element.start is not None:
                self._elements[element.name] = element.start
            elif element not in given:
                what = f"{element.name!r} has no start value, wanted one"
                raise self._bad(f"{what}: an array is set as a whole")
        return [*(v for v in given if not v.size), *elements]

    def _inputs(self, names: Sequence[str]) -> Group:
        variables = [self._description.variable(name) for name in names]
        for variable in variables:
            if variable.causality != "input" or variable.kind != "Real":
                raise self._bad(
                    f"{variable.name!r} is a {variable.kind} {variable.causality}, wanted a Real "
                    "input for the drive"
                )
        groups = _grouped(variables)
        for group in groups:
            if group.places != tuple(range(group.size)):
                raise self._bad(
                    f"{listed(group.names)} are not all elements of the array in their order, "
                    "wanted all as inputs: an array is set as a whole"
                )
        if len(groups) > 1:
            raise self._bad(
                f"inputs {', '.join(names)} are of the types "
                f"{', '.join(g.fmi_type for g in groups)}; wanted one type"
            )
        return groups[0]

    def _moved(self, name: str) -> Group:
        variable = self._description.variable(name)
        free = variable.causality == "input" or variable.variability == "tunable"
        if variable.kind != "Real" or not free:
            raise self._bad(
                f"{name!r} is a {variable.variability} {variable.kind} {variable.causality}, "
                "wanted a tunable Real parameter to move during a run"
            )
        if variable.size > 1:
            raise self._bad(
                f"{name!r} is an element of an array, which is set as a whole; wanted a single "
                "variable to move during a run"
            )
        return _grouped([variable])[0]

    def _bad(self, what: str) -> BadInput:
        return BadInput(f"{self._description.path}: {what}")


def _grouped(variables: Sequence[FmuVariable]) -> tuple[Group, ...]:
    """Single variables by their types, structural ones first, then each array by itself."""
    alike: dict[tuple[bool, int, str], list[FmuVariable]] = {}
    for v in variables:
        if not v.size:
            key = v.causality != STRUCTURAL, -1, v.fmi_type
        else:
            key = True, v.value_reference, ""
        alike.setdefault(key, []).append(v)
    return tuple(
        Group(
            fmi_type=group[0].fmi_type,
            names=tuple(v.name for v in group),
            references=tuple(v.value_reference for v in group[:1] if v.size)
            or tuple(v.value_reference for v in group),
            size=group[0].size,
            places=tuple(v.place for v in group if v.size),
            structural=not later,
        )
        for (later, reference, _), group in sorted(
            alike.items(), key=lambda each: (each[0][0], each[0][1] >= 0)
        )
    )
