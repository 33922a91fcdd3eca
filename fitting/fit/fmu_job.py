"""A reconstruction through an FMU: the campaign's FMU driven, and told of."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitting.campaign import BoundCampaign
from fitting.campaign.joint import columns_of, series_names
from fitting.campaign.parameters import starts
from fitting.fit.job import Identity, Options
from fitting.fit.reconstruction import Hooks, reconstruct
from fitting.fit.result import Result
from fitting.fmu import FmuDescription, FmuWorkers, read_hints
from fitting.measurements.campaign_plan import measured_plan
from fitting.measurements.fmu_response import FmuResponse
from fitting.measurements.joint_response import JointResponse
from fitting.measurements.planning import Plan, plan_campaign
from fitting.measurements.response import Response
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput, FmuFailure

#: Kinds of warnings that a note tells of.
MOST_KINDS = 3
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


def identify_fmu(description: FmuDescription, command: str) -> Identity:
    """What the result says about the FMU, without the plan."""
    units = {name: v.unit or "" for name, v in description.variables.items()}
    return Identity(
        description.model_name,
        description.path.name,
        description.guid,
        description.sha256,
        command,
        units,
    )


def reconstruct_through(
    workers: FmuWorkers,
    bound: BoundCampaign,
    identity: Identity,
    options: Options,
    hooks: Hooks | None = None,
) -> Result:
    """Reconstruct a bound campaign with running FMU workers; adds the plan and the FMU's warnings.

    Only what the FMU warns of at the solution is a warning; what it said elsewhere is a note.

    Raises:
        FmuFailure: the FMU failed; with its words and the parameters.
        BadInput: the campaign cannot be planned (see `planning.plan_campaign`).
    """
    members = bound.members or (bound,)
    for member in members:
        _refuse_other_drives(member, workers)
    variables, own = workers.description.variables, read_hints(workers.description)
    plans = [measured_plan(member, workers, variables, own) for member in members]
    sentences = _sentences(bound, plans)

    def responses(alternative: Mapping[str, Scalar]) -> tuple[FmuResponse, ...]:
        pairs = zip(members, plans, strict=True)
        return tuple(FmuResponse(member, workers, plan, alternative) for member, plan in pairs)

    def respond(alternative: Mapping[str, Scalar]) -> Response:
        parts = responses(alternative)
        return JointResponse(parts, columns_of(bound)) if bound.members else parts[0]

    result = reconstruct(bound, respond, replace(identity, plan=sentences), options, hooks)
    reported = _reported(result, bound)
    columns = columns_of(bound) if bound.members else (tuple(range(reported.size)),)
    parts = responses(result.alternative)
    asked = [(part, reported[list(own)]) for part, own in zip(parts, columns, strict=True)]
    misfit = max(part.misfit(p) for part, p in asked)
    here = _said_at(asked, workers)
    warnings = [*result.warnings, *(f"The FMU says: {_in_short(alike)}" for alike in here.values())]
    if misfit > max(100.0 * bound.setup.accuracy, 1e-4):
        warnings.append(
            f"Sampled runs differ from mean and tones by {misfit:.1e} of their amplitude: "
            "a transient that has not settled, harmonics, or a coarse solver."
        )
    reuse = workers.reuse_note
    provenance = replace(
        result.provenance,
        plan=(*sentences, f"{reuse[0].upper()}{reuse[1:]}."),
        notes=_said_elsewhere(workers.warnings, here),
    )
    for plan in plans:
        warnings += plan.budget.warnings if plan.budget is not None else ()
    return replace(
        result, warnings=tuple(dict.fromkeys(warnings)), provenance=provenance, plan=plans[0].record
    )


def _sentences(bound: BoundCampaign, plans: Sequence[Plan]) -> tuple[str, ...]:
    """What the plan says, of every campaign."""
    if not bound.members:
        return tuple(plans[0].sentences)
    pairs = zip(series_names(bound.members), plans, strict=True)
    return tuple(f"{name}: {said}" for name, plan in pairs for said in plan.sentences)


def _refuse_other_drives(bound: BoundCampaign, workers: FmuWorkers) -> None:
    """A tone that the campaign does not know of falls onto those that it reads.

    Asked before the plan is measured, which would wait for such an output to settle.

    Raises:
        BadInput: the output moves with every amplitude of the campaign at zero.
    """
    draft = plan_campaign(bound)
    if not (bound.setup.steady_start or draft.settle_s > 0.0):
        return  # it may move because it has not settled
    response = FmuResponse(bound, workers, draft, bound.alternatives[0])
    try:
        share = response.undriven(starts(bound.parameters))
    except (BadInput, FmuFailure):  # an FMU that cannot be without drive cannot be asked
        return
    if share > max(100.0 * bound.setup.accuracy, 1e-4):
        raise BadInput(
            f"{bound.path}: [drive]: '{bound.setup.output}' moves by {share:.1e} of its response "
            "where every amplitude of the drive is zero: wanted what else drives the FMU set to "
            "zero in [fmu.start]"
        )


def _said_at(
    asked: Sequence[tuple[FmuResponse, FloatArray]], workers: FmuWorkers
) -> dict[str, list[str]]:
    """What the FMU warns of at the parameters of each response, by kind.

    The runs were all made before, so that none is made of other parameters to try a reset.
    """
    said: list[str] = []
    for response, p in asked:
        response.derived_many([p])
        response.misfit(p)
        said += workers.latest_warnings
        response.derived_many([p])
        said += workers.latest_warnings
    return _by_kind(list(dict.fromkeys(said)))


def _said_elsewhere(warnings: Sequence[str], here: Mapping[str, list[str]]) -> tuple[str, ...]:
    """One sentence on what the FMU warned of at starts, steps and samples only."""
    rest = [alike for kind, alike in _by_kind(warnings).items() if kind not in here]
    if not rest:
        return ()
    more = f"; and {len(rest) - MOST_KINDS} more" if len(rest) > MOST_KINDS else ""
    told = "; ".join(_in_short(alike) for alike in rest[:MOST_KINDS])
    return (f"At other parameters than the reported ones the FMU warned: {told}{more}",)


def _by_kind(warnings: Sequence[str]) -> dict[str, list[str]]:
    """Warnings that differ in their numbers only, together."""
    kinds: dict[str, list[str]] = {}
    for said in warnings:
        kinds.setdefault(NUMBER.sub("#", said), []).append(said)
    return kinds


def _in_short(alike: Sequence[str]) -> str:
    more = f" (and {len(alike) - 1} more that differ in numbers only)" if len(alike) > 1 else ""
    return alike[0] + more


def _reported(result: Result, bound: BoundCampaign) -> FloatArray:
    """The reported values in the order of the campaign, as the model takes them."""
    values = {name: p.value for name, p in result.parameters.items()}
    values |= {offset.parameter: offset.fitted for offset in result.offsets}
    return np.array([values[parameter.name] for parameter in bound.parameters])
