"""modelDescription.xml of an FMU file -> checked records."""

from __future__ import annotations

import difflib
import hashlib
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from fitting.text.arrays import Scalar
from fitting.text.choices import INTERFACES
from fitting.text.errors import BadInput, shown

if TYPE_CHECKING:
    from xml.etree import ElementTree

Kind = Literal["Real", "Integer", "Boolean", "String", "other"]

_KINDS: dict[str, Kind] = {
    "Real": "Real",
    "Float64": "Real",
    "Float32": "Real",
    "Enumeration": "Integer",
    "Integer": "Integer",
    "Boolean": "Boolean",
    "String": "String",
    **{f"{sign}Int{bits}": "Integer" for sign in ("", "U") for bits in (8, 16, 32, 64)},
}

#: How a value of each kind is read from the text of an XML file; ValueError: it is none.
READERS: Mapping[str, Callable[[str], Scalar]] = {
    "Real": float,
    "Integer": int,
    "Boolean": lambda text: text.strip() in ("true", "1"),
    "String": str,
}

#: Causalities whose value an importer may set, for any FMI version.
SETTABLE = ("parameter", "structuralParameter", "input", "local")
READABLE = ("output", "local", "calculatedParameter")
#: What a report may show beside parameters that are fitted: laws may set others.
REPORTABLE = (*READABLE, "parameter")
TONE_NAME = re.compile(r"(.*?)(\d+)")
#: An FMU that has u2 and A2 drives with u2 unless A2 is zero.
AMPLITUDE_STEM = "A"

#: What a set-up is given, which may be stated otherwise than the file declares it.
EXPERIMENT = ("start_s", "stop_s", "tolerance")
#: Elements of an array (FMI 3.0) up to which each is a variable here.
MOST_ELEMENTS = 1000


@dataclass(frozen=True, kw_only=True)
class FmuVariable:
    """A variable of an FMU; ``start``, ``min`` and ``max`` are in ``unit`` (None: none declared).

    ``fmi_type`` is the type as the FMU declares it, ``kind`` what it is to us. Of an array every
    element is a variable, called as "A[1,2]", with the reference of the array: ``place`` is its own
    in it, from 0 in the order of the file, ``size`` that of the array, 0 of no array. ``is_size``:
    it is a structural parameter that arrays have their size of. ``items`` are the values of an
    enumeration by the names of its items.
    """

    name: str
    kind: Kind
    causality: str
    variability: str
    initial: str | None
    unit: str | None
    start: Scalar | None
    min: float | None
    max: float | None
    description: str
    value_reference: int
    fmi_type: str
    size: int = 0
    place: int = 0
    is_size: bool = False
    items: Mapping[str, int] = field(default_factory=dict)

    @property
    def place_of_value(self) -> tuple[str, int, int]:
        """Where its value is in the FMU: the same for variables that are aliases of one."""
        return self.fmi_type, self.value_reference, self.place

    @property
    def is_outside(self) -> bool:
        """Whether its start value is outside its own limits."""
        if self.start is None or isinstance(self.start, str):
            return False
        low, high = self.min, self.max
        return (low is not None and self.start < low) or (high is not None and self.start > high)

    @property
    def can_be_started(self) -> bool:
        """Whether the variable may be set before initialisation; a size of an array stays."""
        fixed = self.variability == "constant" or self.causality == "calculatedParameter"
        if fixed or self.is_size:
            return False
        return self.causality in ("parameter", "input", "structuralParameter") or (
            self.initial in ("exact", "approx")
        )


#: Relative tolerance of the integration of equations where nobody asks for another.
USUAL_TOLERANCE = 1e-9
#: The relative tolerance to which equations of model exchange are integrated here: no variable of
#: the FMU, but set as one, by what plans the runs.
INTEGRATOR_TOLERANCE = FmuVariable(
    name="integrator_tolerance",
    kind="Real",
    causality="parameter",
    variability="fixed",
    initial="exact",
    unit=None,
    start=USUAL_TOLERANCE,
    min=1e-13,
    max=1e-4,
    description="relative tolerance of the integration of its equations",
    value_reference=0,
    fmi_type="integrator",
)


@dataclass(frozen=True, kw_only=True)
class FmuDescription:
    """What an FMU file declares; ``variables`` by name in the order of the file.

    ``internal_step_s`` is the fixed step of its own solver (``fixedInternalStepSize`` of FMI 3.0),
    of which communication steps have to be whole multiples; ``usual_step_s`` that of its default
    experiment; None where it has none. ``any_steps``: communication steps may differ in length.
    ``offers`` are the interfaces that it has, of INTERFACES. ``exchange``: numbers of states and
    event indicators where it is run by model exchange: its equations are then integrated here;
    None: co-simulation. ``output_delay_steps`` is not declared: communication steps by which its
    outputs come late, as its user states; ``is_chosen``: whether its user chose the interface.
    ``instead_of_s``: step of co-simulation for which model exchange was taken, s; 0: it was not.
    ``library`` is its binary for this platform, in the file.
    ``start_s``, ``stop_s`` and ``tolerance`` are those of its default experiment, or as its user
    states: a run begins at the first, its set-up names the others; None: none.
    """

    path: Path
    model_name: str
    fmi_version: str
    guid: str
    model_identifier: str
    one_instance_per_process: bool
    sha256: str
    generation_tool: str
    description: str
    platforms: tuple[str, ...]
    needs_execution_tool: bool
    variables: Mapping[str, FmuVariable] = field(repr=False)
    internal_step_s: float | None = None
    usual_step_s: float | None = None
    any_steps: bool = True
    exchange: tuple[int, int] | None = None
    offers: tuple[str, ...] = INTERFACES[:1]
    output_delay_steps: int = 0
    is_chosen: bool = False
    instead_of_s: float = 0.0
    library: str = ""
    start_s: float = 0.0
    stop_s: float | None = None
    tolerance: float | None = None
    #: Where the file is, whatever folder the process works in later; ``path`` is as it was named.
    file: Path = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "file", self.path.absolute())

    @property
    def interface(self) -> str:
        """The one by which it is run, of INTERFACES."""
        return INTERFACES[0] if self.exchange is None else INTERFACES[1]

    @property
    def settable(self) -> Mapping[str, FmuVariable]:
        """Its variables, and the tolerance of the integrator where its equations are integrated."""
        if self.exchange is None:
            return self.variables
        return {INTEGRATOR_TOLERANCE.name: INTEGRATOR_TOLERANCE, **self.variables}

    @property
    def step_s(self) -> float | None:
        """The step that it was made for, s: of its own solver, else of its default experiment."""
        return self.usual_step_s if self.internal_step_s is None else self.internal_step_s

    @property
    def fixed_step(self) -> bool:
        """Whether it declares the fixed step of its own solver."""
        return self.internal_step_s is not None

    @property
    def observable(self) -> tuple[FmuVariable, ...]:
        """Outputs that are numbers; of an FMU without any, its local variables that move."""
        numbers = [v for v in self.variables.values() if v.kind in ("Real", "Integer", "Boolean")]
        outputs = tuple(v for v in numbers if v.causality == "output")
        return outputs or tuple(
            v
            for v in numbers
            if v.causality == "local" and v.variability in ("continuous", "discrete")
        )

    def xml(self) -> ElementTree.Element:
        """Its modelDescription.xml; BadInput if that cannot be read."""
        import zipfile
        from xml.etree import ElementTree

        try:
            with zipfile.ZipFile(self.file) as archive:
                return ElementTree.fromstring(archive.read("modelDescription.xml"))  # noqa: S314
        except (ElementTree.ParseError, ValueError, LookupError) as error:  # alphabets, too
            raise BadInput(f"{self.path}: modelDescription.xml: {error}") from error

    def variable(self, name: str) -> FmuVariable:
        """The variable ``name``; BadInput with the nearest names if there is none."""
        variable = self.settable.get(name)
        if variable is None:
            lower = {known.lower(): known for known in self.variables}
            near = [lower[key] for key in difflib.get_close_matches(name.lower(), lower, n=3)]
            hint = f"; did you mean {' or '.join(near)}?" if near else ""
            raise BadInput(f"{self.model_name}: no variable {name!r} in this FMU{hint}")
        return variable


def read_description(path: Path | str, interface: str | None = None) -> FmuDescription:
    """Description of an FMU that this machine can run by FMI 2.0 or 3.0.

    Args:
        path: of the file.
        interface: by which it is run, of INTERFACES; None: by co-simulation where it offers that.

    Raises BadInput if the file is no FMU, has neither or not the one that is asked for, or no
    binary for this platform.
    """
    # slow to load, and a worker process wants other names of this module alone
    import fmpy

    from fitting.fmu.archive import member_names
    from fitting.text.files import read_whole

    path = Path(path)
    content = read_whole(path, "an FMU file")
    names = member_names(path)
    try:
        # unvalidated: many FMUs in use break a rule or two and run all the same
        model = fmpy.read_model_description(str(path), validate=False)
    except Exception as error:  # fmpy has no exception of its own for a broken file
        raise BadInput(f"{path}: is not an FMU ({error})") from error
    version = model.fmiVersion
    if version != "2.0" and not version.startswith("3."):
        raise BadInput(f"{path}: is an FMU of FMI {version}, wanted FMI 2.0 or 3.0")

    both = zip(INTERFACES, (model.coSimulation, model.modelExchange), strict=True)
    offered = {name: declared for name, declared in both if declared is not None}
    if not offered:
        raise BadInput(
            f"{path}: offers neither co-simulation nor model exchange, wanted an FMU that does one "
            "of them (scheduled execution alone cannot be driven)"
        )
    chosen = interface or next(iter(offered))
    if chosen not in INTERFACES:
        raise BadInput(f"interface: found {chosen!r}, wanted {' or '.join(INTERFACES)}")
    if chosen not in offered:
        raise BadInput(
            f"{path}: offers {' and '.join(offered)} alone, wanted {chosen} as interface"
        )
    declared = offered[chosen]

    folders = [name.split("/") for name in names]
    platforms = {f[1] for f in folders if f[0] == "binaries" and len(f) > 2 and f[2]}
    platform = fmpy.platform if version == "2.0" else fmpy.platform_tuple
    suffix = fmpy.sharedLibraryExtension
    wanted = f"binaries/{platform}/{declared.modelIdentifier}{suffix}"
    binaries = [f for f in folders if f[:2] == ["binaries", platform] and f[-1].endswith(suffix)]
    if wanted not in names and len(binaries) == 1:  # by another name than FMI wants: the only one
        wanted = "/".join(binaries[0])
    if wanted not in names:
        hint = "; it has sources: fmu-fit check --compile" * any(f[0] == "sources" for f in folders)
        raise BadInput(
            f"{path}: no binary for this platform; wanted {wanted}, found binaries for: "
            f"{', '.join(sorted(platforms)) or 'none'}{hint}"
        )

    # of model exchange any step is as good as another
    steps: list[float | None] = [None, None]
    any_steps, exchange = True, None
    if chosen == INTERFACES[1]:
        exchange = int(model.numberOfContinuousStates), int(model.numberOfEventIndicators)
    else:
        steps.clear()
        for element, key, name in (
            (declared, "fixedInternalStepSize", "fixedInternalStepSize"),
            (model.defaultExperiment, "stepSize", "DefaultExperiment stepSize"),
        ):
            step_s = _number(getattr(element, key, None), f"{path}: {name}")
            steps.append(step_s if step_s is not None and 0.0 < step_s < math.inf else None)
        any_steps = bool(declared.canHandleVariableCommunicationStepSize)
    experiment: list[float | None] = []
    for key in ("startTime", "stopTime", "tolerance"):
        text = getattr(model.defaultExperiment, key, None)
        number = _number(text, f"{path}: DefaultExperiment {key}")
        experiment.append(number if number is not None and math.isfinite(number) else None)
    sizes = {id(d.variable) for v in model.modelVariables for d in v.dimensions}
    return FmuDescription(
        path=path,
        model_name=model.modelName,
        guid=model.guid,
        sha256=hashlib.sha256(content).hexdigest(),
        fmi_version=version,
        model_identifier=declared.modelIdentifier,
        generation_tool=model.generationTool or "",
        description=model.description or "",
        platforms=tuple(sorted(platforms)),
        one_instance_per_process=bool(declared.canBeInstantiatedOnlyOncePerProcess),
        needs_execution_tool=bool(declared.needsExecutionTool),
        variables={
            each.name: each
            for v in model.modelVariables
            for each in _variables(path, version, v, id(v) in sizes)
        },
        internal_step_s=steps[0],
        usual_step_s=steps[1],
        any_steps=any_steps,
        exchange=exchange,
        offers=tuple(offered),
        is_chosen=interface is not None,
        library=wanted,
        start_s=experiment[0] or 0.0,
        stop_s=experiment[1],
        tolerance=experiment[2] or None,
    )


def validation_problems(path: Path | str) -> list[str]:
    """What fmpy's validation objects to in the FMU; empty if nothing.

    Args:
        path: of the file.
    """
    from fmpy.validation import validate_fmu

    return [str(problem) for problem in validate_fmu(str(path))]


def _variables(path: Path, version: str, variable: Any, is_size: bool) -> list[FmuVariable]:
    """A variable; of an array of numbers its elements, the last index first to move."""
    where = f"{path}: variable {variable.name!r}"
    kind = _KINDS.get(variable.type, "other")
    shape = tuple(int(n) for n in variable.shape or ())
    size, array_size = math.prod(shape), 0
    elements: list[tuple[str, str | None]] = [(variable.name, variable.start)]
    if variable.shape or variable.dimensions:
        if not 0 < size <= MOST_ELEMENTS or kind in ("String", "other"):
            kind = "other"
        else:
            starts = (variable.start or "").split() or [None]
            starts = starts * size if len(starts) == 1 else starts
            if len(starts) != size:
                raise BadInput(
                    f"{where}: {len(starts)} start values, wanted {size}, one for each element"
                )
            places = product(*(range(1, n + 1) for n in shape))
            elements = [
                (f"{variable.name}[{','.join(map(str, place))}]", start)
                for place, start in zip(places, starts, strict=True)
            ]
            array_size = size
    declared = variable.declaredType

    def attribute(name: str) -> Any:
        own = getattr(variable, name)
        return getattr(declared, name, None) if own is None and declared is not None else own

    enumeration = "Integer" if version == "2.0" else "Int64"
    items = declared.items if variable.type == "Enumeration" and declared is not None else ()
    return [
        FmuVariable(
            name=name,
            kind=kind,
            causality=variable.causality or "local",
            variability=variable.variability or "continuous",
            initial=variable.initial,
            unit=attribute("unit"),
            start=_value(kind, start, where),
            min=_number(attribute("min"), where),
            max=_number(attribute("max"), where),
            description=variable.description or "",
            value_reference=int(variable.valueReference),
            fmi_type=variable.type if variable.type != "Enumeration" else enumeration,
            size=array_size,
            place=place,
            is_size=is_size,
            items={item.name: int(item.value) for item in items or ()},
        )
        for place, (name, start) in enumerate(elements)
    ]


def _number(text: str | None, where: str) -> float | None:
    if text is None:
        return None
    try:
        return float(text)
    except ValueError as error:
        raise BadInput(f"{where}: found {shown(text)}, wanted a number") from error


def _value(kind: Kind, text: str | None, where: str) -> Scalar | None:
    if text is None or kind == "other":
        return None
    try:
        return READERS[kind](text)
    except ValueError as error:
        wanted = "a number" if kind == "Real" else "a whole number"
        what = shown(text) if kind == "Real" else f"start {shown(text)}"
        raise BadInput(f"{where}: found {what}, wanted {wanted}") from error


@dataclass(frozen=True)
class OtherTone:
    """A tone that is not named: the parameters of its frequency and of its amplitude."""

    frequency: str
    amplitude: str


def amplitude_of(name: str, variables: Mapping[str, FmuVariable]) -> FmuVariable | None:
    """The parameter of a tone's amplitude, as A2 of u2; None where there is none.

    Args:
        name: of the parameter of its frequency.
        variables: of the FMU, by name.
    """
    match = TONE_NAME.fullmatch(name)
    return variables.get(AMPLITUDE_STEM + match[2]) if match is not None else None


def other_tones(
    names: Sequence[str], values: Mapping[str, Scalar], variables: Mapping[str, FmuVariable]
) -> tuple[OtherTone, ...]:
    """Parameters named like the tones, but for their number, with amplitudes that are not zero.

    Args:
        names: parameters that hold the tones.
        values: start values, by name.
        variables: of the FMU, by name.
    """
    stems = {match[1] for name in names if (match := TONE_NAME.fullmatch(name))}
    others = []
    for name, variable in variables.items():
        match = TONE_NAME.fullmatch(name)
        if match is None or match[1] not in stems or name in names:
            continue
        amplitude = amplitude_of(name, variables)
        if amplitude is None or not variable.can_be_started:
            continue
        if values.get(amplitude.name, amplitude.start):
            others.append(OtherTone(name, amplitude.name))
    return tuple(others)
