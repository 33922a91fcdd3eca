"""Several campaigns of one sample as one: shared parameters by name, the rest each its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from fitting.campaign.binding import BoundCampaign, Drift
from fitting.campaign.parameters import Parameter
from fitting.text.errors import BadInput


def join_campaigns(bounds: Sequence[BoundCampaign]) -> BoundCampaign:
    """One campaign with the experiments of all; ``members`` are those that it is made of.

    Parameters of a whole campaign are shared by name and must have the same unit, box, period and
    prior; where start, reference or scale differ, those of the first campaign are taken, and a note
    says so. Drift offsets, other values of single experiments and fitted scales stay apart. Names
    and labels are told apart by the campaigns' folders.

    Raises:
        BadInput: parameters, alternatives or units that contradict each other; names both files.
    """
    first = bounds[0]
    for other in bounds[1:]:
        _check_alike(first, other)
    shared: dict[str, tuple[Parameter, BoundCampaign]] = {}
    notes: list[str] = []
    for bound in bounds:
        for parameter in bound.parameters:
            if is_shared(parameter):
                known = shared.setdefault(parameter.name, (parameter, bound))
                notes += _compared(*known, parameter, bound)
    names = series_names(bounds)
    own = [
        _apart(p, name)
        for bound, name in zip(bounds, names, strict=True)
        for p in bound.parameters
        if not is_shared(p)
    ]
    return replace(
        first,
        title=" + ".join(bound.title for bound in bounds),
        synthetic=any(bound.synthetic for bound in bounds),
        experiments=tuple(
            replace(e, label=f"{name}/{e.label}", output=e.output or bound.setup.output)
            for bound, name in zip(bounds, names, strict=True)
            for e in bound.experiments
        ),
        sweep=None,
        parameters=(*(p for p, _ in shared.values()), *own),
        derived=tuple(dict.fromkeys(name for bound in bounds for name in bound.derived)),
        drift=Drift(),
        notes=(*notes, *dict.fromkeys(note for bound in bounds for note in bound.notes)),
        files=tuple(dict.fromkeys(f for bound in bounds for f in (bound.path, *bound.files))),
        members=tuple(bounds),
    )


def is_shared(parameter: Parameter) -> bool:
    """Whether campaigns that are fitted together share the parameter."""
    return parameter.role == "model" and not parameter.experiments


def columns_of(joint: BoundCampaign) -> tuple[tuple[int, ...], ...]:
    """Positions of every member's parameters among those of the joint campaign."""
    place = {p.name: i for i, p in enumerate(joint.parameters)}
    return tuple(
        tuple(place[p.name if is_shared(p) else _suffixed(p.name, name)] for p in bound.parameters)
        for bound, name in zip(joint.members, series_names(joint.members), strict=True)
    )


def series_names(bounds: Sequence[BoundCampaign]) -> tuple[str, ...]:
    """A short name for every campaign: its folder, or its file where folders are the same."""
    folders = [bound.path.resolve().parent.name for bound in bounds]
    stems = [bound.path.stem for bound in bounds]
    for names in (folders, stems):
        if len(set(names)) == len(names):
            return tuple(names)
    return tuple(f"{name}{k}" for k, name in enumerate(folders, start=1))


def _suffixed(name: str, series: str) -> str:
    """``offset[pair1]`` of the series a is ``offset[a/pair1]``, ``ln_scale`` is ``ln_scale[a]``."""
    head, bracket, label = name.partition("[")
    return f"{head}[{series}/{label}" if bracket else f"{name}[{series}]"


def _apart(parameter: Parameter, series: str) -> Parameter:
    labels = [f"{series}/{label}" for label in parameter.experiments]
    return replace(
        parameter,
        name=_suffixed(parameter.name, series),
        variable=parameter.target,
        experiment=labels[0] if labels else None,
        further=tuple(labels[1:]),
    )


def _compared(
    known: Parameter, home: BoundCampaign, parameter: Parameter, bound: BoundCampaign
) -> list[str]:
    """A note where two campaigns begin a shared parameter elsewhere."""
    for field in ("unit", "lower", "upper", "period", "prior_sigma"):
        one, two = getattr(known, field), getattr(parameter, field)
        if one != two:
            raise BadInput(
                f"{bound.path}: parameter '{parameter.name}': {field} = {two!r}, but "
                f"{home.path} has {one!r}; wanted the same in campaigns that are fitted together"
            )
    apart = [
        f"{field} {getattr(known, field):.8g} and {getattr(parameter, field):.8g}"
        for field in ("start", "reference", "scale")
        if getattr(known, field) != getattr(parameter, field)
    ]
    if not apart:
        return []
    return [
        f"'{parameter.name}' has {', '.join(apart)} in {home.path.parent.name} and "
        f"{bound.path.parent.name}: those of {home.path.parent.name} are taken for both."
    ]


def _check_alike(one: BoundCampaign, two: BoundCampaign) -> None:
    for what, a, b in (
        ("[alternatives]", one.alternatives, two.alternatives),
        ("unit of the amplitudes", one.amplitude_unit, two.amplitude_unit),
    ):
        if a != b:
            raise BadInput(
                f"{two.path}: {what}: {_words(b)}, but {one.path} has {_words(a)}; wanted the "
                "same in campaigns that are fitted together"
            )
    if one.path.resolve() == two.path.resolve():
        raise BadInput(f"{two.path}: is named twice; wanted different campaigns")


def _words(value: object) -> str:
    return str([dict(v) for v in value]) if isinstance(value, tuple) else str(value)
