"""The modelDescription.xml of FMI 3.0, made of that of FMI 2.0: the same variables and words."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement

#: FMI 2.0's types of variables in FMI 3.0.
TYPES = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean", "String": "String"}
TIME = "time"


def to_fmi3(old: Element) -> Element:
    """Return the description in FMI 3.0; the independent variable comes after all others.

    Value references stay, so that both FMUs have the same ones.
    """
    root = Element("fmiModelDescription", {"fmiVersion": "3.0"})
    for name, value in old.attrib.items():
        if name != "fmiVersion":
            root.set({"guid": "instantiationToken"}.get(name, name), value)
    _add_interface(root, _part(old, "CoSimulation"))
    root.append(_part(old, "UnitDefinitions"))
    categories = SubElement(root, "LogCategories")
    for category in _part(old, "LogCategories"):
        given = category.get("description", "").replace("fmi2", "fmi3")
        SubElement(categories, "Category", {**category.attrib, "description": given})
    root.append(_part(old, "DefaultExperiment"))
    variables = list(_part(old, "ModelVariables"))
    _add_variables(root, variables)
    _add_structure(root, _part(old, "ModelStructure"), variables)
    annotations = old.find("VendorAnnotations")
    if annotations is not None:
        added = SubElement(root, "Annotations")
        for tool in annotations:
            SubElement(added, "Annotation", {"type": tool.get("name", "")}).extend(tool)
    return root


def _part(root: Element, name: str) -> Element:
    result = root.find(name)
    return Element(name) if result is None else result


def _add_interface(root: Element, old: Element) -> None:
    """Add what the FMU can do, under its names in FMI 3.0."""
    names = {
        "modelIdentifier": "modelIdentifier",
        "needsExecutionTool": "needsExecutionTool",
        "canBeInstantiatedOnlyOncePerProcess": "canBeInstantiatedOnlyOncePerProcess",
        "canGetAndSetFMUstate": "canGetAndSetFMUState",
        "canSerializeFMUstate": "canSerializeFMUState",
        "providesDirectionalDerivative": "providesDirectionalDerivatives",
        "canHandleVariableCommunicationStepSize": "canHandleVariableCommunicationStepSize",
    }
    given = {new: old.attrib[name] for name, new in names.items() if name in old.attrib}
    SubElement(root, "CoSimulation", given)


def _add_variables(root: Element, old: list[Element]) -> None:
    added = SubElement(root, "ModelVariables")
    for variable in old:
        [kind] = variable
        attributes = {**variable.attrib, **kind.attrib}
        if kind.tag == "String":  # its start values are elements; this one is an output
            attributes.pop("start", None)
        SubElement(added, TYPES[kind.tag], attributes)
    SubElement(
        added,
        "Float64",
        {
            "name": TIME,
            "valueReference": str(len(old)),
            "description": "simulation time",
            "causality": "independent",
            "variability": "continuous",
            "unit": "s",
        },
    )


def _add_structure(root: Element, old: Element, variables: list[Element]) -> None:
    """Add outputs and initial unknowns, which FMI 3.0 names by value reference."""
    added = SubElement(root, "ModelStructure")
    for part, name in (("Outputs", "Output"), ("InitialUnknowns", "InitialUnknown")):
        for unknown in _part(old, part):
            attributes = dict(unknown.attrib)
            variable = variables[int(attributes.pop("index")) - 1]
            reference = variable.attrib["valueReference"]
            SubElement(added, name, {"valueReference": reference, **attributes})
