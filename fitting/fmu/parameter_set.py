"""Parameter sets (.ssv) and system structures (.ssp) for other tools, by the SSP standard 1.0.

Source: Modelica Association, System Structure and Parameterization 1.0; fmpy brings its schemas.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from fitting.fmu.description import READERS, FmuDescription
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.files import read_whole
from fitting.text.units import dimension_of, to_base

STRUCTURE = "SystemStructure.ssd"
SET_TYPE = "application/x-ssp-parameter-set"
FMU_TYPE = "application/x-fmu-sharedlibrary"
#: Of the annotation that holds errors and verdicts.
TOOL = "fmu-fit"
#: How a value of each kind is written.
WRITERS: Mapping[str, Callable[[Scalar], str]] = {
    "Real": lambda value: repr(float(value)),
    "Integer": lambda value: str(int(value)),
    "Boolean": lambda value: str(bool(value)).lower(),
    "String": str,
}
_STANDARD = "http://ssp-standard.org/SSP1/SystemStructure"
_NAMES = {
    "ssc": f"{_STANDARD}Common",
    "ssd": f"{_STANDARD}Description",
    "ssv": f"{_STANDARD}ParameterValues",
}
_BASE_UNITS = {
    "[mass]": "kg",
    "[length]": "m",
    "[time]": "s",
    "[current]": "A",
    "[temperature]": "K",
    "[substance]": "mol",
    "[luminosity]": "cd",
}
#: The earliest date that an archive can hold: the same content gives the same bytes.
_DATE = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True, kw_only=True)
class SetValue:
    """A value of a parameter set, in ``unit``; ``notes`` by name go into its annotation."""

    name: str
    value: Scalar
    unit: str | None = None
    notes: Mapping[str, str] = field(default_factory=dict)


def parameter_set(title: str, values: Sequence[SetValue], description: FmuDescription) -> str:
    """A parameter set as the text of an .ssv file.

    Args:
        title: name of the set.
        values: of parameters of the FMU, in its units.
        description: of the FMU, which defines the units.
    """
    root = _element("ssv:ParameterSet", version="1.0", name=title, generationTool=TOOL)
    table = _element("ssv:Parameters", root)
    used: list[str] = []
    for value in values:
        parameter = _element("ssv:Parameter", table, name=value.name)
        kind: str = description.variable(value.name).kind
        kind = kind if kind in WRITERS else "String"
        attributes = {"value": WRITERS[kind](value.value)}
        if kind == "Real" and value.unit:
            attributes["unit"] = value.unit
            used.append(value.unit)
        _element(f"ssv:{kind}", parameter, **attributes)
        if value.notes:
            note = _element("ssc:Annotation", _element("ssv:Annotations", parameter), type=TOOL)
            ElementTree.SubElement(note, "Known", dict(value.notes))
    _define(root, "ssv:Units", used, description)
    return _text(root)


def _define(
    root: ElementTree.Element, tag: str, used: Sequence[str], description: FmuDescription
) -> None:
    """Define units in a file, as the standard wants it: by the FMU's definitions, else by ours."""
    defined = {str(u.get("name")): u for u in description.xml().findall("UnitDefinitions/Unit")}
    units = _element(tag, root) if used else None
    for name in dict.fromkeys(used):
        place = _element("ssc:Unit", units, name=name)
        if name in defined:  # the base units of SSP are those of FMI
            base = defined[name].find("BaseUnit")
            _element("ssc:BaseUnit", place, **({} if base is None else base.attrib))
            continue
        powers: dict[str, str] = {}
        with suppress(BadInput):  # a unit that is unknown here has a name alone
            for dimension, power in dimension_of(name, where=name).items():
                powers[_BASE_UNITS[dimension]] = f"{power:g}"
            powers["factor"] = repr(to_base(1.0, name, where=name) - to_base(0.0, name, where=name))
        _element("ssc:BaseUnit", place, **powers)


def system_structure(fmu: Path, values: str, description: FmuDescription) -> bytes:
    """An .ssp archive of one component: the FMU and its parameter set.

    Args:
        fmu: path of the FMU that goes in.
        values: text of the parameter set.
        description: of the FMU.
    """
    name = description.model_name
    root = _element("ssd:SystemStructureDescription", version="1.0", name=name)
    elements = _element("ssd:Elements", _element("ssd:System", root, name=name))
    source, bound = f"resources/{fmu.name}", f"resources/{fmu.stem}.ssv"
    component = _element("ssd:Component", elements, name=name, source=source, type=FMU_TYPE)
    connectors = _element("ssd:Connectors", component)
    used: list[str] = []
    for variable in description.variables.values():
        if variable.causality in ("input", "output", "parameter") and variable.kind != "other":
            ends = {"name": variable.name, "kind": variable.causality}
            has_unit = variable.kind == "Real" and variable.unit
            unit = {"unit": str(variable.unit)} if has_unit else {}
            used += unit.values()
            place = _element("ssd:Connector", connectors, **ends)
            _element(f"ssc:{variable.kind}", place, **unit)
    bindings = _element("ssd:ParameterBindings", component)
    _element("ssd:ParameterBinding", bindings, type=SET_TYPE, source=bound)
    _define(root, "ssd:Units", used, description)
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for member, content in (
            (STRUCTURE, _text(root).encode()),
            (source, fmu.read_bytes()),
            (bound, values.encode()),
        ):
            archive.writestr(zipfile.ZipInfo(member, _DATE), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()


def read_parameter_set(path: Path) -> list[SetValue]:
    """The values of an .ssv file.

    Args:
        path: of the file.

    Raises:
        BadInput: no such file, or none that the standard's schema allows.
    """
    from fmpy.ssp.ssd import read_ssv  # slow to load

    content = read_whole(path, "a parameter set (.ssv)")
    try:
        parameters = read_ssv(io.BytesIO(content)).parameters
    except Exception as error:  # of fmpy, without a class of its own
        why = " ".join(str(error).replace("SystemStructure.ssd", "the file").split())
        raise BadInput(f"{path}: is no parameter set (.ssv): {why}") from error
    for p in parameters:
        if p.type not in READERS:
            raise BadInput(
                f"{path}: {p.name}: found a value of type {p.type}, wanted a number, a Boolean or "
                "a text"
            )
    return [SetValue(name=p.name, value=READERS[p.type](p.value), unit=p.unit) for p in parameters]


def _element(
    tag: str, parent: ElementTree.Element | None = None, **attributes: str
) -> ElementTree.Element:
    prefix, _, name = tag.partition(":")
    full = f"{{{_NAMES[prefix]}}}{name}"
    if parent is None:
        return ElementTree.Element(full, attributes)
    return ElementTree.SubElement(parent, full, attributes)


def _text(root: ElementTree.Element) -> str:
    for prefix, name in _NAMES.items():
        ElementTree.register_namespace(prefix, name)
    ElementTree.indent(root)
    body = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'
