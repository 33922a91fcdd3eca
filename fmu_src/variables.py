"""Variable tables of models, and what the modelDescription has of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import Element, SubElement

#: Unit -> (SI exponents of the base unit, display units with their factor per unit).
UNITS: Mapping[str, tuple[Mapping[str, str], Mapping[str, str]]] = {
    "Hz": ({"s": "-1"}, {"kHz": "0.001", "MHz": "1e-06"}),
    "rad": ({"rad": "1"}, {"deg": "57.29577951308232"}),
    "s": ({"s": "1"}, {"us": "1000000", "ms": "1000"}),
    "1/s": ({"s": "-1"}, {}),
    "m": ({"m": "1"}, {"pm": "1000000000000"}),
    "m/s2": ({"m": "1", "s": "-2"}, {}),
    "1/(m2.s2)": ({"m": "-2", "s": "-2"}, {}),
}


@dataclass(frozen=True)
class Variable:
    """One row of a model's variable table, in FMI's own terms."""

    name: str
    kind: str  # Real, Integer, Boolean or String
    causality: str
    variability: str
    description: str
    start: Any = None
    unit: str | None = None
    minimum: float | None = None
    maximum: float | None = None
    nominal: float | None = None

    @property
    def initial(self) -> str | None:
        """Return exact for parameters, calculated for outputs, none for inputs."""
        return {"parameter": "exact", "output": "calculated"}.get(self.causality)

    def to_xml(self, reference: int, start: Any) -> Element:
        """Return the ScalarVariable element; Reals with the digits that give the same double."""
        attributes = {
            "name": self.name,
            "valueReference": str(reference),
            "description": self.description,
            "causality": self.causality,
            "variability": self.variability,
        }
        if self.initial:
            attributes["initial"] = self.initial
        element = Element("ScalarVariable", attributes)
        details = {
            "unit": self.unit,
            "min": _short(self.minimum),
            "max": _short(self.maximum),
            "nominal": _short(self.nominal),
            "start": None if self.causality == "output" else start,
        }
        SubElement(
            element, self.kind, {key: _text(v) for key, v in details.items() if v is not None}
        )
        return element


def _short(value: float | None) -> str | None:
    return None if value is None else f"{value:g}"


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.17g}" if isinstance(value, float) else str(value)


def unit_definitions(variables: Iterable[Variable]) -> Element:
    """Return the UnitDefinitions element for the units that the variables use."""
    definitions = Element("UnitDefinitions")
    for name in sorted({v.unit for v in variables if v.unit}):
        base, displays = UNITS[name]
        unit = SubElement(definitions, "Unit", {"name": name})
        SubElement(unit, "BaseUnit", dict(base))
        for display, factor in displays.items():
            SubElement(unit, "DisplayUnit", {"name": display, "factor": factor})
    return definitions


def write_structure(structure: Element, variables: Sequence[Variable]) -> None:
    """Fill the ModelStructure element: every output, and that none feels an input directly."""
    outputs = [i + 1 for i, v in enumerate(variables) if v.causality == "output"]
    direct, initial = SubElement(structure, "Outputs"), SubElement(structure, "InitialUnknowns")
    for index in outputs:
        # an input is felt from the next communication point on
        SubElement(direct, "Unknown", {"index": str(index), "dependencies": ""})
        SubElement(initial, "Unknown", {"index": str(index)})


START = "start"


@dataclass(frozen=True)
class Accuracy:
    """What the tool fmu-fit may know of a model's accuracy, for its annotation in the XML.

    ``tolerance`` and ``substep`` are parameters; ``full`` start values of the whole model;
    ``reductions`` rows (name, start values that make it cheaper, what bounds its error: an output,
    START where the start state alone is set and the model is whole, None where nothing is known;
    and the part of a run's work that is left at equal steps, where that is known beforehand);
    ``slow`` those with which steps of the solver follow the beats of the tones alone.
    """

    tolerance: str | None
    substep: str | None
    full: Mapping[str, Any]
    reductions: Sequence[tuple[Any, ...]]
    slow: Sequence[str] = ()

    def to_xml(self) -> Element:
        """Return the VendorAnnotations element."""
        root = Element("VendorAnnotations")
        names = {"tolerance": self.tolerance, "substep": self.substep}
        element = SubElement(
            SubElement(root, "Tool", {"name": "fmu-fit"}),
            "Accuracy",
            {key: name for key, name in names.items() if name},
        )
        if self.full:
            _add_settings(SubElement(element, "Full"), self.full)
        for name, settings, bound, *cost in self.reductions:
            attributes = {"name": name}
            if bound is not None:
                attributes.update({"start": "true"} if bound == START else {"bound": bound})
            if cost:
                attributes["cost"] = str(cost[0])
            if name in self.slow:
                attributes["slow"] = "true"
            _add_settings(SubElement(element, "Reduction", attributes), settings)
        return root


def _add_settings(element: Element, settings: Mapping[str, Any]) -> None:
    for name, value in settings.items():
        SubElement(element, "Set", {"name": name, "value": _text(value)})


@dataclass(frozen=True)
class Table:
    """A model's variable table in the forms that get and set need."""

    references: Mapping[str, int]
    starts: tuple[Any, ...]
    kinds: Mapping[str, frozenset[int]]
    moving: slice
    steady: tuple[int, ...]
    real_outputs: tuple[int, ...]


def make_table(
    variables: Sequence[Variable], moving: Sequence[str], overrides: Mapping[str, Any]
) -> Table:
    """Return the table: the place in ``variables`` is the value reference."""
    references = {v.name: i for i, v in enumerate(variables)}
    defaults = {"Real": math.nan, "String": "", "Integer": 0, "Boolean": False}
    real_outputs = tuple(
        i for i, v in enumerate(variables) if v.causality == "output" and v.kind == "Real"
    )
    # they stand side by side, so that all are stored at once
    first = references[moving[0]] if moving else 0
    moving_references = range(first, first + len(moving))
    if [v.name for v in variables[first : first + len(moving)]] != list(moving):
        raise ValueError(f"{moving!r} do not follow each other in the table")
    return Table(
        references,
        tuple(
            overrides.get(v.name, defaults[v.kind] if v.start is None else v.start)
            for v in variables
        ),
        {
            kind: frozenset(i for i, v in enumerate(variables) if v.kind == kind)
            for kind in defaults
        },
        slice(first, first + len(moving)),
        tuple(i for i in real_outputs if i not in moving_references),
        real_outputs,
    )
