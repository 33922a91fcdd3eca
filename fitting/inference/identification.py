"""What the data of a problem determine, without a reconstruction or around one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import own_count, references, search_bounds, starts, to_search
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import RowNoise, noise_of
from fitting.fit.objective import Objective, evaluate_many, make_objective
from fitting.fit.optimum import most_likely
from fitting.fit.problem import Problem
from fitting.fit.solution import curve_structure
from fitting.inference.checks.solutions import residual_findings
from fitting.inference.determine import InferenceOptions, Limits, determine, shared_values
from fitting.inference.equivalent_fits import equal_fit, equivalent_findings
from fitting.inference.likelihood.knowledge import Determined
from fitting.measurements.measurement import Response
from fitting.signal.residual_tests import Structure
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.finding import Kind, note

#: Parameters of single experiments that are few.
FEW_OWN = 12


@dataclass(frozen=True, kw_only=True)
class IdentificationOptions(Limits):
    """What is asked: values to set out from, expected data instead of measured ones, limits.

    Without `values` (by parameter, of a fit of one `alternative`) the search sets out from the
    campaign's start and reference values. With `expected` the data are taken to be what the model
    says there, with the campaign's noise.
    """

    values: Mapping[str, float] | None = None
    alternative: Mapping[str, Scalar] | None = None
    expected: bool = False
    seed: int = 1


def identify(
    problem: Problem,
    respond: Callable[[Mapping[str, Scalar]], Response],
    units: Mapping[str, str],
    request: IdentificationOptions,
) -> Determined:
    """What the data of one problem determine, with alternatives that fit as well, and findings.

    Args:
        problem: parameters and measurements.
        respond: makes the response of one alternative.
        units: of the derived outputs, by name.
        request: where to set out from, and limits.

    Raises:
        BadInput: the result is another problem's.
        FmuFailure: the FMU failed.
    """

    def objective_of(alternative: Mapping[str, Scalar]) -> Objective:
        return make_objective(respond(alternative), problem.parameters, problem.data)

    chosen = request.alternative if request.alternative is not None else problem.alternatives[0]
    objective = objective_of(chosen)
    begins = _beginnings(problem, request.values)
    if request.expected:
        begins = begins[:1]
    noise, structure = _noise(objective, begins[0], request.expected)
    others = [a for a in problem.alternatives if dict(a) != dict(chosen) and not request.expected]
    pairs = ((a, (objective_of(a), begins)) for a in others)
    equal_fits = [equal_fit(there, (objective, begins), a, noise) for a, there in pairs]
    own = own_count(problem.parameters)
    options = InferenceOptions(
        units=units,
        seed=request.seed,
        budget=request.budget,
        others=begins[1:],
        alternatives=tuple(equal for equal in equal_fits if equal is not None),
        data=not request.expected,
        bootstrap=request.bootstrap,
        progress=request.progress,
        only=shared_values(problem) if own > FEW_OWN else (),
        structure=structure,
    )
    found = determine(objective, begins[0], noise, options)
    knowledge = found.knowledge
    widening = 1.0 if structure is None else structure.widening
    findings = residual_findings(knowledge.adequacy, problem.data.series, widening)
    if knowledge.adequacy.describes:
        findings += (*equivalent_findings(found), *found.findings)
    if own <= FEW_OWN:
        return replace(found, findings=findings)
    limited = note(Kind.profiles_limited, "experiments", count=float(own), most=float(FEW_OWN))
    return replace(found, findings=(*findings, limited))


def own_profiled(problem: Problem) -> int:
    """How many values of single experiments `identify` walks a profile of.

    Args:
        problem: parameters and measurements.
    """
    own = own_count(problem.parameters)
    return own if own <= FEW_OWN else 0


def _beginnings(problem: Problem, values: Mapping[str, float] | None) -> list[FloatArray]:
    """Search vectors to set out from: a result's values, or the campaign's starts and references.

    Raises:
        BadInput: the result has other parameters.
    """
    parameters = problem.parameters
    lower, upper = search_bounds(parameters)
    if values is None:
        own = [to_search(parameters, p) for p in (starts(parameters), references(parameters))]
        return [np.clip(x, lower, upper) for x in own]
    missing = [p.name for p in parameters if p.name not in values]
    if missing:
        source = ", ".join(str(bound.path) for bound in problem.campaigns.values())
        raise BadInput(
            f"--at: the result has no value for {', '.join(missing)}; wanted a result of {source}"
        )
    x = to_search(parameters, np.array([values[p.name] for p in parameters]))
    for i, parameter in enumerate(parameters):
        if parameter.period is not None:  # reported in [0, period), wherever the box lies
            period = parameter.period / parameter.scale
            x[i] -= period * np.ceil((x[i] - upper[i]) / period) if x[i] > upper[i] else 0.0
            x[i] += period * np.ceil((lower[i] - x[i]) / period) if x[i] < lower[i] else 0.0
    return [np.clip(x, lower, upper)]


def _noise(
    objective: Objective, begin: FloatArray, expected: bool
) -> tuple[RowNoise, Structure | None]:
    """Noise of the rows near the data, and the structure of the residuals of curves there.

    Near is the most likely point. Rows of unknown noise take theirs from what is left there; of
    curves whose residuals are correlated fewer points count, whoever knows their noise.
    """
    [point] = evaluate_many(objective, [begin])
    noise = noise_of(objective, point)
    curves = objective.data.curve_rows
    is_known = bool(np.all(objective.data.sigma > 0.0))
    if expected or (is_known and not point.residuals[curves].size):
        return noise, None
    evaluator = LikelihoodEvaluator(likelihood_of(objective, noise))
    optimum = most_likely(evaluator, [begin])
    [point] = evaluate_many(objective, [evaluator.likelihood.folded(optimum.expansion.x)])
    noise = noise_of(objective, point)
    if not point.residuals[curves].size:
        return noise, None
    matrix = evaluator.likelihood.residuals(optimum.expansion.matrix[: noise.sigma.size])
    found = curve_structure(objective, point, matrix, noise)
    return (noise, None) if found is None else (noise.widened(curves, found.widening), found)
