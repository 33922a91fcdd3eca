"""The whole job for tests: problem, plan, fit, inference, result, with or without an FMU."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path

from fitting.fit.fit import Fit, solve_problem, with_path
from fitting.fit.options import Options
from fitting.fit.path import Hooks
from fitting.fit.problem import Problem, plan_problem
from fitting.fmu.description import FmuDescription
from fitting.fmu.pool import FmuWorkers
from fitting.inference.determine import InferenceOptions
from fitting.inference.infer import Inference, infer
from fitting.measurements.measurement import Response
from fitting.result.assembly import result_of, result_through
from fitting.result.provenance import provenance_of
from fitting.result.result import Result
from fitting.text.arrays import Scalar

#: What stands for the FMU of a result where a closed form answers.
NO_FMU = FmuDescription(
    path=Path("none.fmu"),
    model_name="closed form",
    fmi_version="",
    guid="",
    model_identifier="",
    one_instance_per_process=False,
    sha256="",
    generation_tool="",
    description="",
    platforms=(),
    needs_execution_tool=False,
    variables={},
)


@dataclass(frozen=True)
class ReconstructionOptions:
    """How a problem is solved and watched, and how much is inferred."""

    options: Options
    _: KW_ONLY
    hooks: Hooks = field(default_factory=Hooks)
    profiles: bool = True
    bootstrap: int = 0


def reconstruct(
    problem: Problem,
    respond: Callable[[Mapping[str, Scalar]], Response],
    request: ReconstructionOptions,
    units: Mapping[str, str] | None = None,
) -> Result:
    """Fit a problem, infer what its data determine, and put both into one record.

    Args:
        problem: parameters and measurements.
        respond: makes the response of one alternative.
        request: how it is solved, watched, and what is inferred.
        units: of its outputs, by name.

    Raises:
        FmuFailure: the model failed inside the box.
    """
    begun = request.hooks.clock()
    fit = solve_problem(problem, respond, request.options, request.hooks)
    fit = with_path(fit, request.hooks)
    inference = _inferred(fit, units or {}, request)
    provenance = provenance_of(problem, NO_FMU, "test", request.options)
    result = result_of(inference.fit, inference, provenance)
    return replace(result, seconds=request.hooks.clock() - begun)


def _inferred(fit: Fit, units: Mapping[str, str], options: ReconstructionOptions) -> Inference:
    request = InferenceOptions(units=units, bootstrap=options.bootstrap)
    return infer(fit, request, profiles=options.profiles)


def reconstruct_through(
    workers: FmuWorkers, problem: Problem, request: ReconstructionOptions
) -> Result:
    """Solve a problem with running FMU workers; with the plan and the FMU's warnings.

    Only what the FMU warns of at the solution is a warning; what it said elsewhere is a note.

    Args:
        workers: of the FMU.
        problem: parameters and measurements.
        request: how the problem is solved, watched, and what is inferred.

    Raises:
        FmuFailure: the FMU failed; with its words and the parameters.
        BadInput: the campaign cannot be planned.
    """
    begun = request.hooks.clock()
    planned = plan_problem(problem, workers)
    fit = solve_problem(problem, planned.response, request.options, request.hooks)
    fit = with_path(fit, request.hooks)
    units = {name: v.unit or "" for name, v in workers.description.variables.items()}
    inference = _inferred(fit, units, request)
    seconds = request.hooks.clock() - begun
    return result_through(planned, inference.fit, inference, "test", seconds)
