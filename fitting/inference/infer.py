"""From a `Fit` to an `Inference`: every value with its interval and verdict, decided once.

`CHECKS` lists the checks of a fit: each reads one record and yields findings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign.parameters import search_bounds, to_model, to_search
from fitting.fit.alternative import with_values
from fitting.fit.fit import Fit, Status, fit_from
from fitting.fit.likelihood import LikelihoodEvaluator, likelihood_of
from fitting.fit.noise import RowNoise, doubted, shared_at
from fitting.fit.objective import evaluate_many
from fitting.fit.optimum import active_bounds_at, confirmed, most_likely
from fitting.fit.options import ALGORITHM2
from fitting.inference.adequacy import adequacy_of, closer_form, ending_of, unseen
from fitting.inference.agreement import (
    consistency,
    contradicted,
    contradictions,
    pair_findings,
    without_values,
)
from fitting.inference.checks.assumptions import check_assumed_values, check_assumptions
from fitting.inference.checks.mistakes import (
    causes_of,
    check_exchanged_peaks,
    check_peaks,
    check_phases,
    without_outliers,
)
from fitting.inference.checks.solutions import (
    Solved,
    check_agreement,
    check_alternatives,
    check_bounds,
    check_combinations,
    check_correlation,
    check_drift,
    check_estimator,
    check_frequencies,
    check_frequency_bounds,
    check_levels,
    check_lines,
    check_minima,
    check_missing_lines,
    check_profiles,
    check_refusals,
    check_residuals,
    check_scale,
    check_simulation,
    check_unknown_lines,
    check_weak_peaks,
)
from fitting.inference.determine import InferenceOptions, determine, shared_values
from fitting.inference.estimates import (
    Estimates,
    derived_results,
    offset_results,
    outputs_of,
    parameter_results,
    quadratures_of,
    with_profiles,
)
from fitting.inference.likelihood.identifiability import choose_nu
from fitting.inference.likelihood.knowledge import Adequacy, Determined, Inferred, Quadratures
from fitting.inference.statuses import equal_fit, equivalent_findings
from fitting.inference.sweeps import SweepFindings, sweep_findings, values_of_line
from fitting.text.arrays import FloatArray
from fitting.text.errors import FmuFailure
from fitting.text.estimate import FittedEstimate
from fitting.text.finding import SEVERITIES, Finding, Kind
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


def infer(
    fit: Fit,
    options: InferenceOptions | None = None,
    *,
    profiles: bool = True,
    sweeps: SweepFindings | None = None,
    earlier: Inference | None = None,
) -> Inference:
    """Values, intervals and verdicts of a fit: of the profiles, else of the linearised problem.

    A failure or an interruption on the way costs the profiles, not the values: these then keep
    their linearised errors, and a warning reports it. An interrupted fit has no profiles.

    Args:
        fit: a solved problem.
        options: units, limits and names of values; what else is asked follows from the fit.
        profiles: whether they are scanned; else intervals are those of the linearised problem.
        sweeps: what those of this fit show, where it is known already.
        earlier: of the same fit, without profiles: what does not depend on these is taken from it.

    Raises:
        OutOfBudget: it was spent before the best fit was found.
        FmuFailure: the model failed at the solution.
    """
    options = options or InferenceOptions()
    if earlier is not None and earlier.fit is fit:
        sweeps = earlier.sweeps
    else:  # of another end, or of other weights
        earlier = None
    fit, sweeps = _with_doubts(fit, sweeps)
    read = _read(fit, options, sweeps, (), profiles=profiles)
    settled = _with_better_fit(fit, read)
    if settled is fit:
        return _assemble(fit, sweeps, read, options, earlier)
    # other minima that fit are known to the second search
    parameters = fit.solution.parameters
    met = () if read.determined is None else read.determined.knowledge.equivalents
    values = [other.parameters for other in met if other.origin == "start"]
    known = [to_search(parameters, np.array([v[p.name] for p in parameters])) for v in values]
    fit, sweeps = _with_doubts(settled, None)
    read = _read(fit, options, sweeps, known, profiles=profiles)
    return _assemble(fit, sweeps, read, options)


@dataclass(frozen=True)
class _Reading:
    """The most likely parameters (n,), in their units, and what was found on the way.

    `determined` is None where no profiles were scanned, `missing` is the reason; `adequacy` whether
    the model will do, None where that was not tested; `inflation` that of the stated noise;
    `at_bounds` names the parameters that the data would move beyond their bounds, where no profiles
    do; `is_lower`: chi square may be lower than at the end of the fit.
    """

    best: FloatArray
    adequacy: Adequacy | None
    inflation: float
    determined: Determined | None = None
    missing: tuple[Finding, ...] = ()
    at_bounds: tuple[str, ...] = ()
    is_lower: bool = False


def _with_doubts(fit: Fit, sweeps: SweepFindings | None) -> tuple[Fit, SweepFindings]:
    """The fit, its errors with scales that a sweep's wrong top leaves in doubt; and the sweeps."""
    solution = fit.solution
    sweeps = sweeps or sweep_findings(fit.problem, solution)
    noise = doubted(solution.noise, solution.objective.data, solution.final, sweeps.doubts)
    if noise is solution.noise:
        return fit, sweeps
    return replace(fit, solution=solution.weighed(noise)), sweeps


def _read(
    fit: Fit,
    options: InferenceOptions,
    sweeps: SweepFindings,
    known: Sequence[FloatArray],
    *,
    profiles: bool,
) -> _Reading:
    """What a fit is read as: by profiles, else at the most likely point alone.

    `known` are search vectors of minima besides those of the fit's own search. The most likely
    point is looked for from the end of the fit; an interrupted one is reported where it ended.
    """
    solution, data = fit.solution, fit.solution.objective.data
    inflation = solution.errors.inflation
    if fit.status is Status.INTERRUPTED:
        return _Reading(solution.final.parameters, None, inflation)
    # curves count by what their residuals are worth
    noise, missing = solution.noise, tuple[Finding, ...]()
    if solution.structure is not None:
        noise = noise.widened(data.curve_rows, solution.structure.widening)
    # the factor by which a scale may be off, where that is beyond the noise of its peaks: within it
    # bounded errors hold it; beyond it parameters that no peak determines bend the rest
    beyond = []
    for name, doubt in sweeps.doubts.items():
        peaks = (data.series_of_rows == data.series.index(name)) & (data.measured_rows != 0.0)
        peaks[data.curve_rows] = False
        if np.any(peaks) and doubt > float(np.median(noise.sigma[peaks])):
            beyond.append(math.exp(doubt))
    scale_off = max(beyond, default=math.nan)
    if profiles:
        try:
            determined = _profiles(fit, options, sweeps, noise, known, scale_off)
            knowledge = determined.knowledge
            best = np.array([knowledge.most_likely[p.name] for p in solution.parameters])
            adequacy, inflation = knowledge.adequacy, knowledge.inflation
            return _Reading(best, adequacy, inflation, determined, is_lower=True)
        except KeyboardInterrupt:
            why = "interrupted"
        except FmuFailure as failure:
            why = str(failure)
        missing = (Finding(kind=Kind.profiles_missing, severity="warning", subject=why),)
    evaluator = LikelihoodEvaluator(likelihood_of(solution.objective, noise))
    try:
        descent = most_likely(evaluator, [solution.final.x])
        optimum = confirmed(evaluator, descent)
    except (FmuFailure, KeyboardInterrupt):
        return _Reading(solution.final.parameters, None, inflation, missing=missing)
    closer = unseen(solution) or closer_form(solution, sweeps.fits)
    adequacy = adequacy_of(optimum, solution.structure, closer, scale_off)
    # an image by a symmetry at which every output has a value is as likely
    best = to_model(solution.parameters, with_values(replace(fit.outcome, x=optimum.expansion.x)).x)
    active = active_bounds_at(optimum.likelihood, optimum.expansion, ())
    names = tuple(solution.parameters[i].name for i in active)
    return _Reading(
        best,
        adequacy,
        optimum.likelihood.inflation,
        missing=missing,
        at_bounds=names,
        is_lower=optimum is not descent,
    )


def _profiles(
    fit: Fit,
    options: InferenceOptions,
    sweeps: SweepFindings,
    noise: RowNoise,
    known: Sequence[FloatArray],
    scale_off: float,
) -> Determined:
    """The profiles of some values, and nu as the data would choose it."""
    solution = fit.solution
    # alternatives of the model that fit as well at their most likely points
    here, alternatives = (solution.objective, [solution.final.x]), []
    for k, outcome in enumerate(fit.outcomes):
        if k != fit.reported:
            there = outcome.objective, [outcome.x]
            alternatives.append(equal_fit(there, here, fit.problem.alternatives[k], noise))
    options = replace(
        options,
        seed=fit.options.schedule.seed,
        alternatives=tuple(filter(None, alternatives)),
        structure=solution.structure,
        # what one experiment holds has a table of its own
        only=options.only or shared_values(fit.problem),
        minima=[*(minimum.x for minimum in fit.outcome.minima), *known],
        twins=fit.outcome.twins,
        closer=unseen(solution) or closer_form(solution, sweeps.fits),
        scale_off=scale_off,
    )
    determined = determine(solution.objective, solution.final.x, noise, options)
    if not fit.levels:
        return determined
    plain = likelihood_of(solution.objective, solution.noise)
    describes = determined.knowledge.adequacy.describes and fit.status is Status.CONVERGED
    nu = choose_nu(plain, fit.levels, fit.path, describes=describes)
    return replace(determined, knowledge=replace(determined.knowledge, nu=nu))


def _with_better_fit(fit: Fit, read: _Reading) -> Fit:
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
        anew = fit_from(fit, x) if read.is_lower else fit
    except FmuFailure:
        return fit
    solution = anew.solution
    noise = shared_at(solution.noise, solution.objective.data, point)
    if noise is solution.noise:
        return anew
    return replace(anew, solution=solution.weighed(noise))


def _assemble(
    fit: Fit,
    sweeps: SweepFindings,
    read: _Reading,
    options: InferenceOptions,
    earlier: Inference | None = None,
) -> Inference:
    """Values, how the fit ended, and findings, of what it was read as."""
    problem, status = fit.problem, fit.status
    adequacy, determined = read.adequacy, read.determined
    if adequacy is not None:
        # where single rows make up what looks like larger noise, these are named instead
        adequacy = without_outliers(fit, adequacy)
        adequacy = replace(adequacy, converged=status is Status.CONVERGED)
    if determined is not None and adequacy is not None:
        knowledge = replace(determined.knowledge, adequacy=adequacy)
        determined = replace(determined, knowledge=knowledge)
    # one estimator: its errors are as wide as its own residuals make them
    errors = fit.solution.errors.widened(read.inflation / fit.solution.errors.inflation)
    if read.inflation > 1.0:  # then they give the noise of all rows
        scatter = np.ones(errors.rows.size)
        errors = replace(errors, scatter=scatter, freedom=errors.degrees_of_freedom)
    solution = replace(fit.solution, errors=errors)
    residuals, data = solution.final.residuals, solution.objective.data
    outputs = outputs_of(solution)
    joint = consistency(problem, solution, outputs) if problem.is_joint else None

    # how it ended: a fit that converged may still not describe the data
    if adequacy is not None and not adequacy.describes and status is Status.CONVERGED:
        status = Status.MISFIT
    why_not = ""
    if adequacy is not None:
        why_not = "" if adequacy.gives_values else adequacy.why_not
    elif status is not Status.CONVERGED:
        why_not = phrase("status", "unconverged")
    # whether a better fit was looked for than the descent from the start
    is_searched = determined is not None or fit.outcome.search is not None
    is_best = status is Status.CONVERGED and is_searched
    ending = ending_of(
        status,
        adequacy,
        inflation=read.inflation,
        structure=solution.structure,
        data=data,
        residuals=residuals,
    )
    against = contradictions(joint) if is_best else ()
    if against:
        ending = replace(ending, kind="contradiction", contradictions=against)

    # values, without those that campaigns contradict each other about
    is_paper = fit.options.estimator == ALGORITHM2
    estimates = Estimates(read.best, fit.paper, fit.paper if is_paper else read.best)
    parameters = parameter_results(solution, estimates)
    seed = fit.options.schedule.seed
    derived = derived_results(solution, outputs, estimates, options.units, seed)
    units = {name: value.unit for name, value in (*parameters.items(), *derived.items())}
    apart = contradicted(joint, units) if is_best else {}
    if not is_best and data.unexplained(residuals):
        apart = dict.fromkeys(units, phrase("status", "undescribed"))
    profiled = {} if determined is None else determined.profiled
    parameters = with_profiles(parameters, profiled, apart, why_not, read.at_bounds)
    derived = with_profiles(derived, profiled, apart, why_not, read.at_bounds)
    offsets = with_profiles(offset_results(solution, estimates), {}, {}, why_not, ())
    named: dict[str, FittedEstimate] = {**parameters, **derived}
    is_known = any(line.values for line in sweeps.lines.values())
    contradicts = any(test.contradicts for test in sweeps.agreement)
    if not (is_known or sweeps.faults or contradicts):
        # a line that nothing speaks against states which of the values are its own
        own = values_of_line(problem, fit.solution, named, sweeps.fits)
        lines = {series: replace(line, values=own) for series, line in sweeps.lines.items()}
        sweeps = replace(sweeps, lines=lines)
    quadratures = Quadratures()
    with suppress(FmuFailure, np.linalg.LinAlgError):  # the model fails nearby: nothing is known
        stds = {name: value.std for name, value in (named | offsets).items()}
        if not why_not:
            quadratures = quadratures_of(solution, outputs, options.units, stds)
    inference = Inference(
        fit=fit,
        parameters=parameters,
        derived=derived,
        offsets=tuple(offsets.values()),
        knowledge=None if determined is None else determined.knowledge,
        joint=without_values(joint) if why_not else joint,
        status=status,
        message=phrase("status", "message", ending, fit.message),
        ending=ending,
        reported=estimates.reported,
        sweeps=sweeps,
        chi_square=math.nan if adequacy is None else adequacy.chi_square,
        dof=math.nan if adequacy is None else adequacy.freedom,
        quadratures=quadratures,
    )
    solved = Solved(
        fit=fit,
        solution=solution,
        best=read.best,
        adequacy=adequacy,
        inflation=read.inflation,
        describes=not why_not,
        is_best=is_best,
        sweeps=sweeps,
        parameters=parameters,
        derived=derived,
        offsets=inference.offsets,
        outputs=outputs,
        joint=joint,
        equivalents=() if why_not else equivalent_findings(inference),
        profiles=() if determined is None else determined.findings,
        earlier=() if earlier is None else earlier.findings,
    )
    return replace(inference, findings=in_order(*findings_of(solved), *read.missing))


# --- the checks of a fit --------------------------------------------------------------------------

Check = Callable[[Solved], Iterator[Finding]]


def check_causes(solved: Solved) -> Iterator[Finding]:
    """What one mistake of the measurement would explain; other checks read it, too."""
    yield from solved.causes


def check_campaigns(solved: Solved) -> Iterator[Finding]:
    """Notes on how campaigns were joined, and campaigns that do not agree."""
    yield from solved.problem.notes if solved.problem.is_joint else ()
    searched = solved.is_best or solved.fit.outcome.search is not None
    yield from pair_findings(solved.joint, searched=searched)


#: All checks, in the order in which findings of one severity are printed.
CHECKS: tuple[Check, ...] = (
    check_residuals,
    check_causes,
    check_weak_peaks,
    check_scale,
    check_frequency_bounds,
    check_frequencies,
    check_bounds,
    check_correlation,
    check_minima,
    check_refusals,
    check_drift,
    check_peaks,
    check_exchanged_peaks,
    check_phases,
    check_unknown_lines,
    check_missing_lines,
    check_lines,
    check_agreement,
    check_campaigns,
    check_alternatives,
    check_assumed_values,
    check_combinations,
    check_assumptions,
    check_profiles,
    check_estimator,
    check_levels,
    check_simulation,
)


def findings_of(solved: Solved) -> tuple[Finding, ...]:
    """Findings of all checks, errors first.

    Args:
        solved: a fit and what its checks examine.
    """
    solved = replace(solved, causes=causes_of(solved))
    return in_order(*(finding for check in CHECKS for finding in check(solved)))


def in_order(*findings: Finding) -> tuple[Finding, ...]:
    """The findings, errors first, then warnings.

    Args:
        findings: in any order.
    """
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))
