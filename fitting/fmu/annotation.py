"""What an FMU says of its own accuracy: an annotation of this tool in its modelDescription.

    <VendorAnnotations><Tool name="fmu-fit"><Accuracy tolerance="..." substep="...">
      <Full><Set name="solver" value="2"/></Full>
      <Reduction name="..." bound="{output}_error" cost="0.5">
        <Set name="..." value="..."/>
      </Reduction>
    </Accuracy></Tool></VendorAnnotations>

In FMI 3.0 it is ``<Annotations><Annotation type="fmu-fit">``. An FMU without one says
nothing; where its equations are integrated here, the tolerance of that is known all the same.
"""

from __future__ import annotations

import zipfile
from xml.etree import ElementTree

from fitting.fmu.accuracy import AccuracyAnnotation, Reduction
from fitting.fmu.description import INTEGRATOR_TOLERANCE, FmuDescription
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput

TOOL = "fmu-fit"
PLACES = (
    f"VendorAnnotations/Tool[@name='{TOOL}']/Accuracy",
    f"Annotations/Annotation[@type='{TOOL}']/Accuracy",
)


def read_accuracy_annotation(description: FmuDescription) -> AccuracyAnnotation:
    """The accuracy annotation in an FMU, in its names and units.

    Args:
        description: of the FMU.

    Raises:
        BadInput: the annotation names a variable that is not there, or a value of another kind.
    """
    try:
        with zipfile.ZipFile(description.file) as archive:
            root = ElementTree.fromstring(archive.read("modelDescription.xml"))  # noqa: S314
    except (ElementTree.ParseError, ValueError, LookupError) as error:  # alphabets, too
        raise BadInput(f"{description.path}: modelDescription.xml: {error}") from error
    found = [element for place in PLACES for element in root.iterfind(place)]
    if not found:
        integrated = INTEGRATOR_TOLERANCE.name if description.exchange is not None else None
        return AccuracyAnnotation(tolerance=integrated)
    element = found[0]
    for name in (element.get("tolerance"), element.get("substep")):
        if name is not None:
            description.variable(name)
    return AccuracyAnnotation(
        tolerance=element.get("tolerance"),
        substep=element.get("substep"),
        full=_settings(element.find("Full"), description),
        reductions=tuple(_reduction(part, description) for part in element.iterfind("Reduction")),
    )


def _reduction(part: ElementTree.Element, description: FmuDescription) -> Reduction:
    name, cost = part.get("name", ""), part.get("cost", "0.5")
    try:
        counted = float(cost)
    except ValueError:
        raise BadInput(
            f"{description.path}: its annotation for {TOOL} declares cost = {cost!r} of the "
            f"reduction "
            f"{name!r}, wanted a number"
        ) from None
    return Reduction(name, _settings(part, description), bound=part.get("bound"), cost=counted)


def _settings(
    element: ElementTree.Element | None, description: FmuDescription
) -> dict[str, Scalar]:
    if element is None:
        return {}
    return {
        part.get("name", ""): _value(part.get("name", ""), part.get("value", ""), description)
        for part in element.iterfind("Set")
    }


def _value(name: str, text: str, description: FmuDescription) -> Scalar:
    variable = description.variable(name)
    try:
        if variable.kind == "Boolean":
            return {"true": True, "false": False}[text]
        if variable.kind == "Integer":
            return int(text)
        return text if variable.kind == "String" else float(text)
    except (ValueError, KeyError):
        raise BadInput(
            f"{description.path}: its annotation for {TOOL} sets {name} = {text!r}, wanted a "
            f"{variable.kind}"
        ) from None
