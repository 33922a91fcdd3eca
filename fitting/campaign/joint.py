"""Several campaigns of one sample: parameters shared by name, the rest each its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from fitting.campaign.bound import BoundCampaign
from fitting.campaign.parameters import Parameter
from fitting.text.errors import BadInput
from fitting.text.finding import Finding, Kind, note


def join_parameters(bounds: Sequence[BoundCampaign]) -> tuple[tuple[Parameter, ...], list[Finding]]:
    """Parameters of campaigns that are fitted together, and notes where these begin elsewhere.

    Parameters of a whole campaign are shared by name and must have the same unit, box, period and
    prior; where start, reference or scale differ, those of the first campaign are taken, which
    a note states. Drift offsets, other values of single experiments and fitted scales stay apart.

    Args:
        bounds: campaigns, each bound to its FMU.

    Raises:
        BadInput: parameters, alternatives or units that contradict each other; names both files.
    """
    wanted = "wanted the same in campaigns that are fitted together"
    first, *others = bounds
    for other in others:
        for what, one, two in (
            ("[alternatives]", first.alternatives, other.alternatives),
            ("unit of the amplitudes", first.amplitude_unit, other.amplitude_unit),
        ):
            if one != two:
                result, known = (
                    str([dict(v) for v in value]) if isinstance(value, tuple) else str(value)
                    for value in (two, one)
                )
                raise BadInput(
                    f"{other.path}: {what}: {result}, but {first.path} has {known}; {wanted}"
                )
        if first.path.resolve() == other.path.resolve():
            raise BadInput(f"{other.path}: is named twice; wanted different campaigns")
    shared: dict[str, tuple[Parameter, BoundCampaign]] = {}
    own: list[Parameter] = []
    notes: list[Finding] = []
    for bound in bounds:
        for p in bound.parameters:
            if not is_shared(p):
                own.append(p)
                continue
            q, home = shared.setdefault(p.name, (p, bound))
            for key in ("unit", "lower", "upper", "period", "prior"):
                if getattr(q, key) != getattr(p, key):
                    raise BadInput(
                        f"{bound.path}: parameter '{p.name}': {key} = {getattr(p, key)!r}, but "
                        f"{home.path} has {getattr(q, key)!r}; {wanted}"
                    )
            keys = ("start", "reference", "scale")
            apart = tuple(key for key in keys if getattr(q, key) != getattr(p, key))
            if apart:
                numbers = {f"{key}_one": float(getattr(q, key)) for key in apart}
                numbers |= {f"{key}_other": float(getattr(p, key)) for key in apart}
                folders = home.path.parent.name, bound.path.parent.name
                names = {"keys": apart, "campaigns": folders}
                notes.append(note(Kind.starts_differ, p.name, names, **numbers))
    return (*(p for p, _ in shared.values()), *own), notes


def named_apart(bounds: Sequence[BoundCampaign]) -> tuple[tuple[str, BoundCampaign], ...]:
    """Campaigns by a short name, which labels and parameters of their own carry; one has none.

    Args:
        bounds: campaigns, each bound to its FMU.
    """
    if len(bounds) == 1:
        return (("", bounds[0]),)
    named = []
    for name, bound in zip(series_names(bounds), bounds, strict=True):
        sweep, parameters = bound.sweep, []
        if sweep is not None and sweep.label:
            sweep = replace(sweep, label=f"{name}/{sweep.label}")
        for p in bound.parameters:
            if not is_shared(p):
                # offset[pair1] of the series a is offset[a/pair1], ln_scale is ln_scale[a]
                head, bracket, label = p.name.partition("[")
                labels = [f"{name}/{each}" for each in p.experiments]
                p = replace(
                    p,
                    name=f"{head}[{name}/{label}" if bracket else f"{p.name}[{name}]",
                    variable=p.target,
                    experiment=labels[0] if labels else None,
                    further=tuple(labels[1:]),
                )
            parameters.append(p)
        experiments = tuple(
            replace(e, label=f"{name}/{e.label}", output=e.output or bound.setup.output)
            for e in bound.experiments
        )
        apart = replace(bound, experiments=experiments, sweep=sweep, parameters=tuple(parameters))
        named.append((name, apart))
    return tuple(named)


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
