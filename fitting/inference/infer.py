"""From a `Fit` to an `Inference`: every value with its interval and verdict, decided once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

from fitting.fit.fit import Fit, Status
from fitting.fit.likelihood.likelihood import likelihood_of
from fitting.fit.linearisation import IDENTIFIABLE
from fitting.fit.noise import RowNoise, noise_of
from fitting.fit.solution import Solution
from fitting.inference.consistency import consistency, warnings_of
from fitting.inference.determine import BUDGET, InferenceOptions, determine
from fitting.inference.equivalent_fits import (
    exchange_reasons,
    is_reason,
    reason_sentences,
    with_lower_verdicts,
)
from fitting.inference.estimates import derived_results, offset_results, parameter_results
from fitting.inference.joint_result import JointResult
from fitting.inference.likelihood.knowledge import Equivalent, Knowledge, Profile
from fitting.inference.likelihood.nu_choice import choose_nu
from fitting.inference.likelihood.profiles import ROOT_95
from fitting.inference.values import DerivedResult, OffsetResult, ParameterResult
from fitting.inference.warnings import Kind, Warned, fit_warnings, verdict_sentences, warned
from fitting.text.errors import FmuFailure

Valued = TypeVar("Valued", ParameterResult, DerivedResult)


@dataclass(frozen=True, kw_only=True)
class Inference:
    """What the data of a fit determine.

    `parameters` and `derived` hold every value with its interval and verdict, `offsets` what
    belongs to single experiments; `knowledge` the profiles, None where they were not walked;
    `joint` whether campaigns that were fitted together agree; `warnings` what a reader must know.
    """

    parameters: Mapping[str, ParameterResult]
    derived: Mapping[str, DerivedResult]
    offsets: tuple[OffsetResult, ...]
    knowledge: Knowledge | None
    joint: JointResult | None
    warnings: tuple[Warned, ...]


@dataclass(frozen=True, kw_only=True)
class InferenceRequest:
    """How much is asked of the data.

    `units` are those of the derived outputs; without `profiles` intervals are those of the
    linearised problem; `only` names the values whose profiles are walked (all, if empty); `budget`
    is of evaluations; `bootstrap` synthetic data sets are fitted anew.
    """

    units: Mapping[str, str] = field(default_factory=dict)
    profiles: bool = True
    budget: int = BUDGET
    bootstrap: int = 0
    only: tuple[str, ...] = ()


def infer(fit: Fit, request: InferenceRequest | None = None) -> Inference:
    """Values, intervals and verdicts of a fit: of the profiles, else of the linearised problem.

    A failure or an interruption on the way costs the profiles, not the values: these then keep
    their linearised errors, and a warning says so. An interrupted fit has no profiles.

    Args:
        fit: a solved problem.
        request: units, and how much is asked.

    Raises:
        FmuFailure: the model failed at the solution.
    """
    request = request or InferenceRequest()
    solution, problem = fit.solution, fit.problem
    parameters = parameter_results(solution)
    derived = derived_results(solution, request.units, fit.options.schedule.seed)
    offsets = offset_results(solution)
    joint = consistency(problem, solution) if problem.is_joint else None
    only = request.only or (*parameters, *derived)  # what one experiment holds has a table
    knowledge, missing = _knowledge(fit, request, only)
    profiles = knowledge.profiles if knowledge is not None else {}
    parameters = {name: _of_profile(v, profiles.get(name)) for name, v in parameters.items()}
    derived = {name: _of_profile(v, profiles.get(name)) for name, v in derived.items()}
    reasons = {n: p.reason for n, p in profiles.items() if is_reason(p.reason)}
    missed = exchange_reasons({**parameters, **derived}, problem.parameters, fit.alternatives)
    parameters, derived = with_lower_verdicts(parameters, derived, missed)
    return Inference(
        parameters=parameters,
        derived=derived,
        offsets=offsets,
        knowledge=knowledge,
        joint=joint,
        warnings=(
            *warned(Kind.VERDICT, verdict_sentences({**parameters, **derived})),
            *warned(Kind.EXCHANGE, reason_sentences({**reasons, **missed})),
            *warned(Kind.AGREEMENT, warnings_of(joint) if joint is not None else []),
            *fit_warnings(fit, offsets),
            *warned(Kind.NOTE, problem.notes if problem.is_joint else ()),
            *warned(Kind.PROFILES, missing),
        ),
    )


def _knowledge(
    fit: Fit, request: InferenceRequest, only: tuple[str, ...]
) -> tuple[Knowledge | None, list[str]]:
    """The profiles of some values; or none, and why."""
    if not request.profiles or fit.status is Status.INTERRUPTED:
        return None, []
    solution = fit.solution
    noise = noise_at(solution)
    options = InferenceOptions(
        units=request.units,
        seed=fit.options.schedule.seed,
        budget=request.budget,
        alternatives=_alternatives(fit),
        bootstrap=request.bootstrap,
        widening=1.0 if solution.structure is None else solution.structure.widening,
        only=only,
    )
    try:
        knowledge = determine(solution.objective, solution.final.x, noise, options)
        plain = likelihood_of(solution.objective, noise.sigma, noise.common)
        return replace(knowledge, nu=choose_nu(plain, fit.outcome.chains[0].steps, fit.path)), []
    except KeyboardInterrupt:
        why = "Interrupted before the profiles were done"
    except FmuFailure as failure:
        why = f"The FMU failed while profiles were walked ({failure})"
    return None, [f"{why}: intervals and verdicts are those of the linearised problem."]


def noise_at(solution: Solution) -> RowNoise:
    """Noise of the rows at a solution; a sweep whose residuals hang together weighs less.

    Args:
        solution: end of the fit.
    """
    noise = noise_of(solution.objective, solution.final)
    if solution.structure is None:
        return noise
    return noise.widened(solution.objective.data.curve_rows, solution.structure.widening)


def _alternatives(fit: Fit) -> tuple[Equivalent, ...]:
    """Alternatives of the model that reach the same J."""
    found = []
    for other in fit.alternatives:
        if other.reported or not other.equal_to_best:
            continue
        settings = ", ".join(f"{name} = {value}" for name, value in other.settings.items())
        values = ", ".join(f"{name} = {value:.5g}" for name, value in other.parameters.items())
        found.append(
            Equivalent(
                parameters=other.parameters,
                derived=other.derived,
                delta=float("nan"),
                origin="alternative",
                sentence=f"{settings} with {values} reaches the same J",
                where=settings,
            )
        )
    return tuple(found)


def _of_profile(value: Valued, profile: Profile | None) -> Valued:
    """A value with the verdict, shrinkage and interval of its profile."""
    if profile is None:
        return value
    low, high = profile.interval95
    open_ = profile.verdict == IDENTIFIABLE[2]
    std = value.std if math.isfinite(value.std) else (high - low) / (2.0 * ROOT_95)
    return replace(
        value,
        std=math.nan if open_ else std,
        ci95=(low, high),
        shrinkage=profile.shrinkage,
        identifiable=profile.verdict,
    )
