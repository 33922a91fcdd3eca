"""Several campaigns of one sample: parameters shared by name, the rest each its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from fitting.campaign.bound import BoundCampaign, SweepData
from fitting.campaign.parameters import Parameter
from fitting.text.errors import BadInput


def join_parameters(bounds: Sequence[BoundCampaign]) -> tuple[tuple[Parameter, ...], list[str]]:
    """Parameters of campaigns that are fitted together, and notes where these begin elsewhere.

    Parameters of a whole campaign are shared by name and must have the same unit, box, period and
    prior; where start, reference or scale differ, those of the first campaign are taken, and a note
    says so. Drift offsets, other values of single experiments and fitted scales stay apart.

    Args:
        bounds: campaigns, each bound to its FMU.

    Raises:
        BadInput: parameters, alternatives or units that contradict each other; names both files.
    """
    for other in bounds[1:]:
        _check_alike(bounds[0], other)
    shared: dict[str, tuple[Parameter, BoundCampaign]] = {}
    own: list[Parameter] = []
    notes: list[str] = []
    for bound in bounds:
        for parameter in bound.parameters:
            if is_shared(parameter):
                known = shared.setdefault(parameter.name, (parameter, bound))
                notes += _compared(*known, parameter, bound)
            else:
                own.append(parameter)
    return (*(p for p, _ in shared.values()), *own), notes


def named_apart(bounds: Sequence[BoundCampaign]) -> tuple[tuple[str, BoundCampaign], ...]:
    """Campaigns by a short name, which labels and parameters of their own carry; one has none.

    Args:
        bounds: campaigns, each bound to its FMU.
    """
    if len(bounds) == 1:
        return (("", bounds[0]),)
    return tuple(
        (
            name,
            replace(
                bound,
                experiments=tuple(
                    replace(e, label=f"{name}/{e.label}", output=e.output or bound.setup.output)
                    for e in bound.experiments
                ),
                sweep=None if bound.sweep is None else _labelled(bound.sweep, name),
                parameters=tuple(p if is_shared(p) else _apart(p, name) for p in bound.parameters),
            ),
        )
        for name, bound in zip(series_names(bounds), bounds, strict=True)
    )


def _labelled(sweep: SweepData, series: str) -> SweepData:
    return replace(sweep, label=f"{series}/{sweep.label}") if sweep.label else sweep


def is_shared(parameter: Parameter) -> bool:
    """Whether campaigns that are fitted together share the parameter.

    Args:
        parameter: a fitted parameter.
    """
    return parameter.moves_model and not parameter.experiments


def series_names(bounds: Sequence[BoundCampaign]) -> tuple[str, ...]:
    """A short name for every campaign: its folder, or its file where folders are the same.

    Args:
        bounds: campaigns, each bound to its FMU.
    """
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
    for field in ("unit", "lower", "upper", "period", "prior"):
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
