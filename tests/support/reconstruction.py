"""The whole job for tests: problem, plan, fit, inference, result, with or without an FMU."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace

from fitting.fit.fit import Fit, solve_problem, with_path
from fitting.fit.options import Options
from fitting.fit.path import Hooks
from fitting.fit.problem import Problem, plan_problem
from fitting.fmu.pool import FmuWorkers
from fitting.inference.infer import Inference, InferenceRequest, infer
from fitting.measurements.measurement import Response
from fitting.result.assembly import result_of, result_through
from fitting.result.provenance import Identity, provenance_of
from fitting.result.result import Result
from fitting.text.arrays import Scalar


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
    identity: Identity,
    request: ReconstructionOptions,
) -> Result:
    """Fit a problem, infer what its data determine, and put both into one record.

    Args:
        problem: parameters and measurements.
        respond: makes the response of one alternative.
        identity: what is said of the model.
        request: how it is solved, watched, and what is inferred.

    Raises:
        FmuFailure: the model failed inside the box.
    """
    begun = request.hooks.clock()
    fit = solve_problem(problem, respond, request.options, request.hooks)
    fit = with_path(fit, request.hooks)
    inference = _inferred(fit, identity, request)
    provenance = provenance_of(problem, identity, request.options)
    result = result_of(inference.fit, inference, provenance)
    return replace(result, seconds=request.hooks.clock() - begun)


def _inferred(fit: Fit, identity: Identity, options: ReconstructionOptions) -> Inference:
    request = InferenceRequest(
        units=identity.units, profiles=options.profiles, bootstrap=options.bootstrap
    )
    return infer(fit, request)


def reconstruct_through(
    workers: FmuWorkers, problem: Problem, identity: Identity, request: ReconstructionOptions
) -> Result:
    """Solve a problem with running FMU workers; with the plan and the FMU's warnings.

    Only what the FMU warns of at the solution is a warning; what it said elsewhere is a note.

    Args:
        workers: of the FMU.
        problem: parameters and measurements.
        identity: what is said of the FMU.
        request: how the problem is solved, watched, and what is inferred.

    Raises:
        FmuFailure: the FMU failed; with its words and the parameters.
        BadInput: the campaign cannot be planned.
    """
    begun = request.hooks.clock()
    planned = plan_problem(problem, workers)
    fit = solve_problem(problem, planned.response, request.options, request.hooks)
    fit = with_path(fit, request.hooks)
    inference = _inferred(fit, identity, request)
    seconds = request.hooks.clock() - begun
    return result_through(planned, inference.fit, inference, identity, seconds)
