"""A reconstruction through an FMU: the campaign's FMU driven, and told of."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitting.fit.job import Identity, Options
from fitting.fit.planned_fmu import plan_problem
from fitting.fit.problem import Problem
from fitting.fit.reconstruction import Hooks, reconstruct
from fitting.fit.result import Result
from fitting.fmu import FmuDescription, FmuWorkers
from fitting.measurements.fmu_response import FmuResponse
from fitting.simulate.words import warnings_in_words
from fitting.text.arrays import FloatArray

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
    problem: Problem,
    identity: Identity,
    options: Options,
    hooks: Hooks | None = None,
) -> Result:
    """Solve a problem with running FMU workers; adds the plan and the FMU's warnings.

    Only what the FMU warns of at the solution is a warning; what it said elsewhere is a note.

    Raises:
        FmuFailure: the FMU failed; with its words and the parameters.
        BadInput: the campaign cannot be planned.
    """
    planned = plan_problem(problem, workers)
    sentences = planned.sentences
    result = reconstruct(
        problem, planned.response, replace(identity, plan=sentences), options, hooks
    )
    response, p = planned.response(result.alternative), _reported(result, problem)
    misfit = response.misfit(p)
    here = _said_at(response, p, workers)
    warnings = [*result.warnings, *(f"The FMU says: {_in_short(alike)}" for alike in here.values())]
    if misfit > max(100.0 * problem.accuracy, 1e-4):
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
    plans = list(planned.plans.values())
    for plan in plans:
        warnings += warnings_in_words(plan.budget) if plan.budget is not None else ()
    return replace(
        result, warnings=tuple(dict.fromkeys(warnings)), provenance=provenance, plan=plans[0].record
    )


def _said_at(response: FmuResponse, p: FloatArray, workers: FmuWorkers) -> dict[str, list[str]]:
    """What the FMU warns of at these parameters, by kind.

    The runs were all made before, so that none is made of other parameters to try a reset.
    """
    response.derived_many([p])
    response.misfit(p)
    said = list(workers.latest_warnings)
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


def _reported(result: Result, problem: Problem) -> FloatArray:
    """The reported values in the order of the problem, as the model takes them."""
    values = {name: p.value for name, p in result.parameters.items()}
    values |= {offset.parameter: offset.fitted for offset in result.offsets}
    return np.array([values[parameter.name] for parameter in problem.parameters])
