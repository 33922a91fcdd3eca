"""From a `Fit` to an `Inference`: every value with its interval and verdict, decided once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.campaign.parameters import search_bounds, to_model, to_search
from fitting.fit.fit import Fit, Status, fit_from
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import RowNoise, doubted, shared_at
from fitting.fit.objective import evaluate_many
from fitting.fit.optimum import active_bounds_at, most_likely
from fitting.fit.outputs import output_means
from fitting.fit.solution import Solution
from fitting.inference.adequacy import adequacy_of, ending_of, unseen
from fitting.inference.checks.mistakes import without_outliers
from fitting.inference.closer_form import closer_form
from fitting.inference.determine import InferenceOptions, Limits, determine
from fitting.inference.equivalent_fits import equal_fit, equivalent_findings
from fitting.inference.estimates import (
    Estimates,
    Outputs,
    derived_results,
    offset_results,
    outputs_of,
    parameter_results,
)
from fitting.inference.findings import findings_of, in_order
from fitting.inference.inferred import Inferred, judged, on_bounds
from fitting.inference.joint import consistency, contradicted, contradictions, without_values
from fitting.inference.likelihood.knowledge import Adequacy, Determined, Equivalent
from fitting.inference.likelihood.nu_choice import choose_nu
from fitting.inference.quadratures import Quadratures, quadratures_of
from fitting.inference.solved import Solved
from fitting.inference.sweep_line import values_of_line
from fitting.inference.sweeps import SweepFindings, sweep_findings
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure
from fitting.text.estimate import FittedEstimate
from fitting.text.finding import Finding, Kind
from fitting.text.rendering import phrase


@dataclass(frozen=True, kw_only=True)
class Inference(Inferred):
    """What the data of a fit determine.

    `reported` (n,) are all parameters as they are reported; `sweeps` what the sweeps show. `fit` is
    the one that all of it is about: not the one that was given, where a lower J was found on the
    way.
    """

    fit: Fit
    reported: FloatArray
    sweeps: SweepFindings


@dataclass(frozen=True, kw_only=True)
class InferenceRequest(Limits):
    """How much is asked of the data.

    `units` are those of the derived outputs; without `profiles` intervals are those of the
    linearised problem; `only` names the values whose profiles are walked (all, if empty); `sweeps`
    what those of this fit show, where it was found before.
    """

    units: Mapping[str, str] = field(default_factory=dict)
    profiles: bool = True
    only: tuple[str, ...] = ()
    sweeps: SweepFindings | None = None


def infer(fit: Fit, request: InferenceRequest | None = None) -> Inference:
    """Values, intervals and verdicts of a fit: of the profiles, else of the linearised problem.

    A failure or an interruption on the way costs the profiles, not the values: these then keep
    their linearised errors, and a warning says so. An interrupted fit has no profiles.

    Args:
        fit: a solved problem.
        request: units, and how much is asked.

    Raises:
        OutOfBudget: it was spent before the best fit was found.
        FmuFailure: the model failed at the solution.
    """
    request = request or InferenceRequest()
    fit, sweeps = _with_doubts(fit, request.sweeps)
    read = _read(fit, request, sweeps)
    settled = _settled(fit, read)
    if settled is not fit:
        fit, sweeps = _with_doubts(settled, None)
        read = _read(fit, request, sweeps, _separate(fit, read.determined))
    return _inferred(fit, sweeps, read.ended(fit), request)


def _inferred(
    fit: Fit, sweeps: SweepFindings, read: _Reading, request: InferenceRequest
) -> Inference:
    """Values, how the fit ended, and findings, of what it was read as."""
    problem, search = fit.problem, fit.outcome.search
    best, adequacy, determined = read.best, read.adequacy, read.determined
    # one estimator: its errors are as wide as its own residuals make them
    errors = fit.solution.errors.widened(read.inflation / fit.solution.errors.inflation)
    if read.inflation > 1.0:  # then they tell the noise of all rows
        m = errors.rows.size
        errors = replace(errors, scatter=np.ones(m), freedom=errors.degrees_of_freedom)
    solution = replace(fit.solution, errors=errors)
    estimates = Estimates(best, fit.paper, fit.options.estimator)
    parameters = parameter_results(solution, estimates)
    outputs, seed = outputs_of(solution), fit.options.schedule.seed
    derived = derived_results(solution, outputs, estimates, request.units, seed)
    joint = consistency(problem, solution, outputs) if problem.is_joint else None

    # how it ended: a fit that converged may still not describe the data
    status = fit.status
    if adequacy is not None and not adequacy.describes and status is Status.CONVERGED:
        status = Status.MISFIT
    # whether a better fit was looked for than the descent from the start
    is_best = status is Status.CONVERGED and (determined is not None or search is not None)
    why_not = ""
    if adequacy is not None:
        why_not = "" if adequacy.gives_values else adequacy.why_not
    elif fit.status is not Status.CONVERGED:
        why_not = phrase("status", "unconverged")
    describes = not why_not
    residuals = solution.final.residuals
    data = solution.objective.data
    units = {name: value.unit for name, value in (*parameters.items(), *derived.items())}
    apart = contradicted(joint, units) if is_best else {}
    if not is_best and data.unexplained(residuals):
        apart = dict.fromkeys(units, phrase("status", "undescribed"))
    profiled = {} if determined is None else determined.profiled
    parameters = on_bounds(judged(parameters, profiled, apart, why_not), read.at_bounds)
    derived = on_bounds(judged(derived, profiled, apart, why_not), read.at_bounds)
    offsets = judged(offset_results(solution, estimates), {}, {}, why_not)
    named: dict[str, FittedEstimate] = {**parameters, **derived, **offsets}
    ending = ending_of(
        status,
        adequacy,
        inflation=read.inflation,
        structure=solution.structure,
        data=data,
        residuals=residuals,
    )
    if is_best and contradictions(joint):
        ending = replace(ending, kind="contradiction", contradictions=contradictions(joint))
    inference = Inference(
        fit=fit,
        parameters=parameters,
        derived=derived,
        offsets=tuple(offsets.values()),
        knowledge=None if determined is None else determined.knowledge,
        joint=joint if describes else without_values(joint),
        status=status,
        message=phrase("status", "message", ending, fit.message),
        ending=ending,
        reported=estimates.reported,
        sweeps=_with_names(sweeps, fit, {**parameters, **derived}),
        chi_square=math.nan if adequacy is None else adequacy.chi_square,
        dof=math.nan if adequacy is None else adequacy.freedom,
        quadratures=_quadratures(solution, outputs, request, named) if describes else Quadratures(),
    )
    solved = Solved(
        fit=fit,
        solution=solution,
        best=best,
        adequacy=adequacy,
        inflation=read.inflation,
        describes=describes,
        is_best=is_best,
        sweeps=inference.sweeps,
        parameters=parameters,
        derived=derived,
        offsets=inference.offsets,
        outputs=outputs,
        joint=joint,
        equivalents=equivalent_findings(inference) if describes else (),
        profiles=() if determined is None else determined.findings,
    )
    return replace(inference, findings=in_order(*findings_of(solved), *read.missing))


def _with_doubts(fit: Fit, sweeps: SweepFindings | None) -> tuple[Fit, SweepFindings]:
    """The fit, its errors with scales that a sweep's wrong top leaves in doubt; and the sweeps."""
    solution = fit.solution
    found = sweeps or sweep_findings(fit.problem, solution)
    noise = doubted(solution.noise, solution.objective.data, solution.final, found.doubts)
    if noise is solution.noise:
        return fit, found
    return replace(fit, solution=solution.weighed(noise)), found


def _scale_off(solution: Solution, sweeps: SweepFindings) -> float:
    """Factor by which a scale may be off beyond the noise of its peaks; NaN where none is.

    Within that noise bounded errors hold it; beyond it parameters that no peak tells bend the rest.
    """
    data, sigma = solution.objective.data, noise_at(solution).sigma
    beyond = []
    for name, doubt in sweeps.doubts.items():
        mine = (data.series_of_rows == data.series.index(name)) & (data.measured_rows != 0.0)
        mine[data.curve_rows] = False
        if np.any(mine) and doubt > float(np.median(sigma[mine])):
            beyond.append(math.exp(doubt))
    return max(beyond, default=math.nan)


def _with_names(
    sweeps: SweepFindings, fit: Fit, values: Mapping[str, FittedEstimate]
) -> SweepFindings:
    """The sweeps; a line that nothing speaks against says which of the values are its own."""
    if sweeps.faults or any(test.contradicts for test in sweeps.agreement):
        return sweeps
    names = values_of_line(fit.problem, fit.solution, values, sweeps.fits)
    lines = {series: replace(line, values=names) for series, line in sweeps.lines.items()}
    return replace(sweeps, lines=lines)


def _quadratures(
    solution: Solution,
    outputs: Outputs,
    request: InferenceRequest,
    named: Mapping[str, FittedEstimate],
) -> Quadratures:
    """What complex values tell, of values that there are; nothing where the model fails nearby."""
    try:
        stds = {name: value.std for name, value in named.items()}
        return quadratures_of(solution, outputs, request.units, stds)
    except (FmuFailure, np.linalg.LinAlgError):
        return Quadratures()


@dataclass(frozen=True)
class _Reading:
    """The most likely parameters (n,), in their units, and what was found on the way.

    `determined` is None where no profiles were walked, `missing` says why; `adequacy` whether the
    model will do, None where nobody asked; `inflation` that of the stated noise; `at_bounds` names
    the parameters that the data would move beyond their bounds, where no profiles do.
    """

    best: FloatArray
    adequacy: Adequacy | None
    inflation: float
    determined: Determined | None = None
    missing: tuple[Finding, ...] = ()
    at_bounds: tuple[str, ...] = ()

    def ended(self, fit: Fit) -> _Reading:
        """The same of a fit that ended so: without convergence it gives no values.

        Where single rows make up what looks like larger noise, these are named instead.

        Args:
            fit: a solved problem.
        """
        if self.adequacy is None:
            return self
        adequacy = without_outliers(fit, self.adequacy)
        if fit.status is not Status.CONVERGED:
            adequacy = replace(adequacy, converged=False)
        if adequacy is self.adequacy:
            return self
        determined = self.determined
        if determined is not None:
            knowledge = replace(determined.knowledge, adequacy=adequacy)
            determined = replace(determined, knowledge=knowledge)
        return replace(self, adequacy=adequacy, determined=determined)


def _read(
    fit: Fit,
    request: InferenceRequest,
    sweeps: SweepFindings,
    known: Sequence[FloatArray] = (),
) -> _Reading:
    """What a fit is read as: by profiles, else at the most likely point alone.

    `known` are search vectors of minima besides those of the fit's own search.
    """
    determined, missing = _determined(fit, request, sweeps, known)
    if determined is None:
        return replace(_best(fit, sweeps), missing=missing)
    knowledge = determined.knowledge
    best = np.array([knowledge.most_likely[p.name] for p in fit.solution.parameters])
    return _Reading(best, knowledge.adequacy, knowledge.inflation, determined, missing)


def _separate(fit: Fit, determined: Determined | None) -> list[FloatArray]:
    """Search vectors of the other minima that were found to fit."""
    parameters = fit.solution.parameters
    found = () if determined is None else determined.knowledge.equivalents
    values = [other.parameters for other in found if other.origin == "start"]
    return [to_search(parameters, np.array([v[p.name] for p in parameters])) for v in values]


def _settled(fit: Fit, read: _Reading) -> Fit:
    """The fit, made anew where its most likely point shows that it has to be; else itself.

    Profiles come by other minima, too: where chi square is lower than its own, that is reported.
    And what rows share is weighed where they fit.
    """
    if read.adequacy is None:
        return fit
    solution = fit.solution
    lower, upper = search_bounds(solution.parameters)
    x = np.clip(to_search(solution.parameters, read.best), lower, upper)
    try:
        [point] = evaluate_many(solution.objective, [x])
        anew = fit
        if read.determined is not None:
            anew = fit_from(fit, x)
    except FmuFailure:
        return fit
    solution = anew.solution
    noise = shared_at(solution.noise, solution.objective.data, point)
    if noise is solution.noise:
        return anew
    return replace(anew, solution=solution.weighed(noise))


def _determined(
    fit: Fit, request: InferenceRequest, sweeps: SweepFindings, known: Sequence[FloatArray]
) -> tuple[Determined | None, tuple[Finding, ...]]:
    """The profiles of some values; or none, and why."""
    if not request.profiles or fit.status is Status.INTERRUPTED:
        return None, ()
    solution = fit.solution
    noise = noise_at(solution)
    # what one experiment holds has a table of its own
    everything = (*(p.name for p in solution.parameters if not p.experiments), *fit.problem.outputs)
    try:
        options = InferenceOptions(
            units=request.units,
            seed=fit.options.schedule.seed,
            budget=request.budget,
            alternatives=_alternatives(fit, noise),
            bootstrap=request.bootstrap,
            structure=solution.structure,
            only=request.only or everything,
            minima=[*(minimum.x for minimum in fit.outcome.minima), *known],
            twins=fit.outcome.twins,
            closer=unseen(solution) or closer_form(solution, sweeps.fits),
            scale_off=_scale_off(solution, sweeps),
            progress=request.progress,
        )
        found = determine(solution.objective, solution.final.x, noise, options)
        plain = likelihood_of(solution.objective, solution.noise)
        describes = found.knowledge.adequacy.describes and fit.status is Status.CONVERGED
        nu = choose_nu(plain, fit.levels, fit.path, describes=describes) if fit.levels else None
        return replace(found, knowledge=replace(found.knowledge, nu=nu)), ()
    except KeyboardInterrupt:
        why = "interrupted"
    except FmuFailure as failure:
        why = str(failure)
    return None, (Finding(kind=Kind.profiles_missing, severity="warning", subject=why),)


def _best(fit: Fit, sweeps: SweepFindings) -> _Reading:
    """The most likely point without profiles.

    It is looked for from the end of the fit; an interrupted one is reported where it stood.
    """
    solution = fit.solution
    stood = _Reading(solution.final.parameters, None, solution.errors.inflation)
    if fit.status is Status.INTERRUPTED:
        return stood
    evaluator = LikelihoodEvaluator(likelihood_of(solution.objective, noise_at(solution)))
    try:
        optimum = most_likely(evaluator, [solution.final.x])
    except (FmuFailure, KeyboardInterrupt):
        return stood
    closer = unseen(solution) or closer_form(solution, sweeps.fits)
    scale_off = _scale_off(solution, sweeps)
    adequacy = adequacy_of(optimum, solution.structure, closer, scale_off)
    best = to_model(solution.parameters, _with_every_output(fit, optimum.expansion.x))
    held = active_bounds_at(optimum.likelihood, optimum.expansion, ())
    names = tuple(solution.parameters[i].name for i in held)
    return _Reading(best, adequacy, optimum.likelihood.inflation, at_bounds=names)


def _with_every_output(fit: Fit, x: FloatArray) -> FloatArray:
    """The search vector, or an image of it by an exact symmetry at which every output exists."""
    objective, parameters = fit.solution.objective, fit.solution.parameters
    images = [image for twin in fit.outcome.twins if (image := twin.of(parameters, x)) is not None]
    places = [x, *images]
    means = output_means(objective.response, parameters, places)
    table = np.array(list(means.values())).reshape(len(means), len(places))
    return next((places[k] for k in np.flatnonzero(np.all(np.isfinite(table), axis=0))), x)


def noise_at(solution: Solution) -> RowNoise:
    """Noise of the rows at a solution; curves count by what their residuals are worth.

    Args:
        solution: end of the fit.
    """
    noise = solution.noise
    if solution.structure is None:
        return noise
    return noise.widened(solution.objective.data.curve_rows, solution.structure.widening)


def _alternatives(fit: Fit, noise: RowNoise) -> tuple[Equivalent, ...]:
    """Alternatives of the model that fit as well at their most likely points."""
    here = fit.solution.objective, [fit.solution.final.x]
    found = []
    for k, outcome in enumerate(fit.outcomes):
        if k == fit.reported:
            continue
        there = outcome.objective, [outcome.x]
        found.append(equal_fit(there, here, fit.problem.alternatives[k], noise))
    return tuple(equal for equal in found if equal is not None)
