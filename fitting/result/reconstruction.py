"""The result of a fit through an FMU, with its plan and what the FMU warned of."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from fitting.campaign.parameters import canonical
from fitting.fit.fit import Fit
from fitting.fit.problem import PlannedFmu
from fitting.fmu.description import FmuDescription
from fitting.fmu.pool import DROPPED, FmuWorkers
from fitting.inference.infer import Inference
from fitting.measurements.fmu_response import FmuResponse
from fitting.measurements.plan import Plan
from fitting.result.assembly import result_of
from fitting.result.provenance import Identity, provenance_of
from fitting.result.result import Result
from fitting.text.arrays import FloatArray
from fitting.text.choices import INTERFACES
from fitting.text.finding import Finding, Kind, note
from fitting.text.rendering import phrase

#: Kinds of warnings that a note tells of.
MOST_KINDS = 3
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


def identify_fmu(description: FmuDescription, command: str) -> Identity:
    """What the result states about the FMU, without the plan.

    Args:
        description: of the FMU.
        command: command line that made it, for the record.
    """
    units = {name: v.unit or "" for name, v in description.variables.items()}
    return Identity(
        name=description.model_name,
        file=description.path.name,
        guid=description.guid,
        sha256=description.sha256,
        command=command,
        units=units,
    )


def result_through(
    planned: PlannedFmu, fit: Fit, inference: Inference, identity: Identity, seconds: float
) -> Result:
    """The result of a fit through an FMU, with the plan and the FMU's warnings.

    Only what the FMU warns of at the solution is a warning; what it logged elsewhere is a note.

    Args:
        planned: the FMU, and how it was driven.
        fit: the solved problem.
        inference: what its data determine.
        identity: of the FMU.
        seconds: what planning, fit and inference took, s.

    Raises:
        FmuFailure: the FMU failed at the solution.
    """
    workers, problem = planned.workers, planned.problem
    response = planned.response(fit.alternative)
    p = canonical(problem.parameters, inference.reported)  # as the model takes them
    here = _said_at(response, p, workers)
    # what the FMU warned of at starts, steps and samples only
    kinds = _by_kind(workers.warnings).items()
    rest = [alike for kind, alike in kinds if kind not in here]
    notes: tuple[str, ...] = ()
    if rest:
        dropped = DROPPED in workers.warnings
        notes = (phrase("findings", "fmu_elsewhere", rest, MOST_KINDS, dropped),)
    reuse = workers.verdict.note
    provenance = replace(
        provenance_of(problem, identity, fit.options),
        plan=(*planned.sentences, f"{reuse[0].upper()}{reuse[1:]}."),
        notes=notes,
    )
    plans = list(planned.plans.values())
    # warnings of the FMU that differ in numbers together
    further = [
        Finding(
            kind=Kind.fmu_warning,
            severity="warning",
            subject="FMU",
            numbers={"count": float(len(alike))},
            names={"text": (alike[0],)},
        )
        for alike in here.values()
    ]
    misfit = response.misfit(p)
    if misfit > max(100.0 * problem.accuracy, 1e-4):
        numbers, kind = {"error": misfit}, Kind.not_periodic
        further.append(Finding(kind=kind, severity="warning", subject="samples", numbers=numbers))
    further += _of_plans(plans)
    # the equations of the FMU could be integrated here, where its own solver does not do
    other, description = INTERFACES[1], workers.description
    short = any(plan.budget is not None and not plan.budget.kept for plan in plans)
    if short and description.interface != other and other in description.offers:
        further.append(note(Kind.model_exchange_offered, other))
    result = result_of(fit, inference, provenance, further, plans[0].record)
    return replace(result, seconds=seconds)


def _of_plans(plans: Sequence[Plan]) -> Iterator[Finding]:
    """An accuracy that cannot be promised, and reductions that are forced beyond their bound."""
    for budget in (plan.budget for plan in plans if plan.budget is not None):
        missed = () if budget.kept else (max(budget.decisions, key=lambda d: d.cost),)
        forced = (d for d in budget.decisions if d.taken and d.forced and d.bound > budget.wanted)
        goal = {"promised": budget.promised, "wanted": budget.wanted}
        for kind, decisions in ((Kind.accuracy_missed, missed), (Kind.accuracy_forced, forced)):
            for decision in decisions:
                yield Finding(
                    kind=kind,
                    severity="warning",
                    subject=phrase("plan", "subject", decision),
                    numbers={**goal, "bound": decision.bound},
                    names={"choice": (phrase("plan", "choice", decision),)},
                )


def _said_at(response: FmuResponse, p: FloatArray, workers: FmuWorkers) -> dict[str, list[str]]:
    """What the FMU warns of at these parameters, by kind.

    The runs were all made before, so that none is made of other parameters to try a reset; what was
    read before is read again.
    """
    replace(response).derived_many([p])
    response.misfit(p)
    stated = list(workers.latest_warnings)
    replace(response).derived_many([p])
    stated += workers.latest_warnings
    return _by_kind(list(dict.fromkeys(stated)))


def _by_kind(warnings: Sequence[str]) -> dict[str, list[str]]:
    """Warnings that differ in their numbers only, together."""
    kinds: dict[str, list[str]] = {}
    for stated in (text for text in warnings if text != DROPPED):
        kinds.setdefault(NUMBER.sub("#", stated), []).append(stated)
    return kinds
