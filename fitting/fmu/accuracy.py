"""The accuracy annotation of an FMU: how it is made accurate, and what may be left out.

    <VendorAnnotations><Tool name="fmu-fit"><Accuracy tolerance="..." substep="...">
      <Full><Set name="solver" value="2"/></Full>
      <Reduction name="..." bound="{output}_error" cost="0.5">
        <Set name="..." value="..."/>
      </Reduction>
      <Reduction name="..." bound="..." slow="true"><Set name="..." value="..."/></Reduction>
      <Reduction name="..." start="true"><Set name="..." value="..."/></Reduction>
    </Accuracy></Tool></VendorAnnotations>

In FMI 3.0 it is ``<Annotations><Annotation type="fmu-fit">``. Without one nothing is known of an
FMU but, where its equations are integrated here, the tolerance of that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Generic, TypeVar

from fitting.fmu.description import INTEGRATOR_TOLERANCE, READERS, FmuDescription
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.schema import Keys, OneOf, Positive, Refused, Switch, Text, Texts

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

TOOL = "fmu-fit"
#: What a step of the FMU's own between whose ends it stands still is taken for.
ERROR, MODEL = OWN_STEPS = ("error", "model")
#: A start value as it is written, or as the FMU takes it.
Setting = TypeVar("Setting", covariant=True)
PLACES = (
    f"VendorAnnotations/Tool[@name='{TOOL}']/Accuracy",
    f"Annotations/Annotation[@type='{TOOL}']/Accuracy",
)


@dataclass(frozen=True)
class Reduction(Keys, Generic[Setting]):
    """Start values that make the FMU cheaper, and the output that bounds what that leaves out."""

    # without a bound the error is measured; with start nothing is left out where the orbit closes

    name: Text
    """How it is called in the plan."""
    set: Mapping[str, Setting]
    """Start values that make the FMU cheaper."""
    _: KW_ONLY
    bound: Text | None = None
    """FMU output that bounds what is left out; {output} is the observed one."""
    start: Switch = False
    """Whether it only sets the start state of the whole model."""
    slow: Switch = False
    """Whether steps of the solver follow beats of the tones instead of periods."""
    cost: Positive = 0.5
    """Remaining share of a run's work, if unknown."""

    def __post_init__(self) -> None:
        if not self.set:
            raise Refused("is empty, wanted start values of the FMU", "set")


@dataclass(frozen=True, kw_only=True)
class AccuracyNames(Keys):
    """Parameters of an FMU that set its accuracy, and reductions by their names."""

    tolerance: Text | None = None
    """FMU parameter: bound of its solver's relative error."""
    substep: Text | None = None
    """FMU parameter: longest substep, s."""
    force: Texts = ()
    """Names of reductions to take, whatever they cost."""
    forbid: Texts = ()
    """Names of reductions not to take."""
    own_step: Annotated[Text, OneOf(OWN_STEPS)] = ERROR
    """(trace) What a step of the FMU's own adds to errors: that of Euler's method ("error"), or
    nothing, as the FMU with its step is the "model"."""


@dataclass(frozen=True, kw_only=True)
class AccuracyAnnotation(AccuracyNames):
    """What is known of an FMU: how it is made accurate, and what makes it cheaper.

    `tolerance` and `substep` name the parameters that bound its solver's relative error and its
    substep (s); `full` are start values of the model with nothing left out; `force` and `forbid`
    name reductions; `own_step`, of OWN_STEPS, is what a step of its own is taken for.

    Raises:
        BadInput: a name in `force` or `forbid` that is none of the reductions (where there are
            any: an FMU may have its own), or is in both.
    """

    full: Mapping[str, Scalar] = field(default_factory=dict)
    reductions: tuple[Reduction[Scalar], ...] = ()

    def __post_init__(self) -> None:
        names = [r.name for r in self.reductions]
        if len(set(names)) < len(names):
            raise BadInput(f"reductions {', '.join(names)}: two have one name")
        if self.reductions:
            self._check_names()
        both = sorted(set(self.force) & set(self.forbid))
        if both:
            raise BadInput(f"'{both[0]}' is both in force and in forbid")

    def _check_names(self) -> None:
        """BadInput for a name in `force` or `forbid` that is none of the reductions."""
        names = [r.name for r in self.reductions]
        for key in ("force", "forbid"):
            for name in getattr(self, key):
                if name not in names:
                    known = ", ".join(names) or "none"
                    raise BadInput(f"{key}: no reduction '{name}', wanted one of: {known}")

    def over(self, own: AccuracyAnnotation) -> AccuracyAnnotation:
        """The annotation, completed by an FMU's `own` one.

        Raises:
            BadInput: `force` or `forbid` name none of the reductions.
        """
        merged = replace(
            self,
            tolerance=self.tolerance or own.tolerance,
            substep=self.substep or own.substep,
            full=self.full or own.full,
            reductions=self.reductions or own.reductions,
        )
        merged._check_names()
        return merged


def read_accuracy_annotation(description: FmuDescription) -> AccuracyAnnotation:
    """The accuracy annotation in an FMU, in its names and units.

    Args:
        description: of the FMU.

    Raises:
        BadInput: the annotation names a variable that is not there, or a value of another kind.
    """
    root = description.xml()
    element = next((e for place in PLACES for e in root.iterfind(place)), None)
    if element is None:
        integrated = INTEGRATOR_TOLERANCE.name if description.exchange is not None else None
        return AccuracyAnnotation(tolerance=integrated)
    for name in (element.get("tolerance"), element.get("substep")):
        if name is not None:
            description.variable(name)
    where = f"{description.path}: its annotation for {TOOL}"

    def settings(part: Element | None) -> dict[str, Scalar]:
        values: dict[str, Scalar] = {}
        for each in part.iterfind("Set") if part is not None else ():
            name, text = each.get("name", ""), each.get("value", "")
            kind = description.variable(name).kind
            try:
                if kind == "Boolean" and text not in ("true", "false"):
                    raise ValueError
                values[name] = READERS[kind](text)
            except (ValueError, KeyError):
                raise BadInput(f"{where} sets {name} = {text!r}, wanted a {kind}") from None
        return values

    reductions = []
    for part in element.iterfind("Reduction"):
        name, cost = part.get("name", ""), part.get("cost", "0.5")
        try:
            share = float(cost)
        except ValueError:
            raise BadInput(
                f"{where} declares cost = {cost!r} of the reduction {name!r}, wanted a number"
            ) from None
        values = settings(part)
        if not (name and values):
            raise BadInput(f"reduction {name!r}: wanted a name and values to set")
        if not 0.0 < share < math.inf:
            raise BadInput(f"reduction {name!r}: its cost is {share!r}, wanted a positive number")
        reductions.append(
            Reduction(
                name,
                values,
                bound=part.get("bound"),
                cost=share,
                start=part.get("start") == "true",
                slow=part.get("slow") == "true",
            )
        )
    return AccuracyAnnotation(
        tolerance=element.get("tolerance"),
        substep=element.get("substep"),
        full=settings(element.find("Full")),
        reductions=tuple(reductions),
    )
