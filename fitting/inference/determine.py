"""What the data determine: from an objective and a solution to `Determined`.

Effort follows need. The most likely point comes first, from the end of the fit and the minima that
its search found; where the model does not describe the data nothing is scanned. Else intervals come
from the covariance where chi square confirms them, from scans of the profile where not, and nothing
is looked for beyond the bounds. Generic: rows, parameters and outputs, no oscillator. `identify` is
the same of the data of a problem, without a reconstruction or around one.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from fitting.campaign.parameters import (
    canonical,
    own_count,
    references,
    search_bounds,
    starts,
    to_model,
    to_search,
)
from fitting.fit.fit import Status, curve_structure
from fitting.fit.levenberg import Goal, expand, minimise
from fitting.fit.likelihood import (
    Exhausted,
    LikelihoodEvaluator,
    Request,
    Sample,
    Spent,
    likelihood_of,
)
from fitting.fit.noise import RowNoise, noise_of
from fitting.fit.objective import Evaluator, Objective, evaluate_many, make_objective
from fitting.fit.optimum import Optimum, most_likely, with_central_slopes
from fitting.fit.outputs import output_means
from fitting.fit.problem import Problem
from fitting.fit.search import search_box
from fitting.fit.twins import Twin, find_twins, sampling_twins, twins_but_for_priors
from fitting.inference.adequacy import adequacy_of, ending_of, is_redundant
from fitting.inference.checks.solutions import residual_findings
from fitting.inference.cost import Stage
from fitting.inference.likelihood import identifiability
from fitting.inference.likelihood.identifiability import bootstrap as bootstrap_of
from fitting.inference.likelihood.knowledge import (
    Adequacy,
    Determined,
    Effort,
    Equivalent,
    Knowledge,
    Profile,
    Scan,
)
from fitting.inference.likelihood.profile import output_ranges
from fitting.inference.likelihood.scan import scan_profiles
from fitting.inference.statuses import equal_fit, equivalent_findings, sampling_findings
from fitting.inference.statuses import profiles as profiles_of
from fitting.measurements.measurement import Response
from fitting.signal.residual_tests import Structure
from fitting.text.arrays import FloatArray, Scalar
from fitting.text.choices import usual_budget
from fitting.text.errors import BadInput, OutOfBudget
from fitting.text.estimate import ROOT_95, FittedEstimate, OutputEstimate, ParameterEstimate
from fitting.text.finding import Kind, note
from fitting.text.notation import span

_log = logging.getLogger(__name__)

#: Decrease of chi square from which inference begins anew at the better point, and how often.
BETTER, ANEW = 1.0, 3
#: Chi square above the least, in units of the 95 % threshold, up to which a minimum of the search,
#: whose noise was estimated elsewhere, is gone on from.
NEAR = 4.0


@dataclass(frozen=True, kw_only=True)
class InferenceOptions:
    """What is asked of the inference: units of outputs, seed, limits.

    `budget` is of simulation runs, None the usual one; `bootstrap` synthetic data sets are fitted
    anew; `progress` is called with how far it is, the stages those of `fitting.inference.cost`.
    `others` are search vectors to begin at besides; `minima` those that a search of the bounds
    found, None where none was made: then one is made here. `alternatives` are points of other
    models that fit as well; `twins` the model's exact symmetries, looked for if None. Without
    `data` the measurements are taken to be what the model gives at the solution. `only` names the
    values that are profiled (all, if empty). `structure` is that of the residuals of curves, by
    which their noise was taken wider. `closer` is another form of a line that leaves far less of a
    sweep than the model, `scale_off` the factor by which the scale of peaks may be off for the top
    of its sweep.
    """

    units: Mapping[str, str] = field(default_factory=dict)
    seed: int = 1
    others: Sequence[FloatArray] = ()
    minima: Sequence[FloatArray] | None = None
    twins: Sequence[Twin] | None = None
    alternatives: tuple[Equivalent, ...] = ()
    data: bool = True
    only: tuple[str, ...] = ()
    directions: bool = True
    structure: Structure | None = None
    closer: Adequacy | None = None
    scale_off: float = math.nan
    budget: int | None = None
    bootstrap: int = 0
    progress: Callable[[Spent], None] = lambda spent: None


def determine(
    objective: Objective,
    solution: FloatArray,
    noise: RowNoise,
    options: InferenceOptions | None = None,
) -> Determined:
    """Status, interval and profile for every parameter and derived output.

    Args:
        objective: response, parameters and data.
        solution: search vector where the search begins, e.g. the end of Algorithm 2.
        noise: of the rows.
        options: units, seed, limits.

    Raises:
        OutOfBudget: it was spent before the best fit was found.
        FmuFailure: the model failed at more points of the box than can be left out.
    """
    options = options or InferenceOptions()
    # symmetries of the model and of samples, and those that priors break: other minima begin there
    search = Evaluator(objective)
    exact = find_twins(search, options.seed) if options.twins is None else options.twins
    rates_hz = [rate for m in objective.data.measurements for rate in m.sampled_hz]
    sampled = sampling_twins(objective.parameters, rates_hz)
    twins = [*exact, *twins_but_for_priors(search, options.seed), *sampled]
    # the likelihood of the data, or of what the model gives at the solution
    names = tuple(output_means(objective.response, objective.parameters, [solution]))
    likelihood = likelihood_of(objective, noise, names)
    [point] = evaluate_many(objective, [solution])
    if not options.data:
        likelihood = replace(likelihood, shift=point.residuals, scatter=np.empty(0))
    limit = usual_budget(point.runs) if options.budget is None else options.budget
    evaluator = LikelihoodEvaluator(likelihood, limit, options.progress)

    evaluator.begin(Stage.MINIMA)
    optimum = most_likely(evaluator, [solution, *options.others])
    optimum, minima = _lowest_minimum(evaluator, optimum, twins, options)
    adequacy = _adequacy(optimum, options)
    if not adequacy.describes and options.minima is not None and not options.minima:
        # without a search nothing shows that it is the model, and not where the fit began
        optimum, minima = _lowest_minimum(evaluator, optimum, twins, replace(options, minima=None))
        adequacy = _adequacy(optimum, options)
    if evaluator.cuts and not optimum.converged and not adequacy.describes:
        raise OutOfBudget(
            f"budget: found {evaluator.limit}, wanted more: it was spent before the best fit was "
            "found"
        )
    _log.info(
        "profiles: most likely point at χ² = %.6g on %.6g degrees of freedom",
        optimum.chi_square,
        optimum.degrees_of_freedom,
    )
    if not adequacy.describes:
        return _assemble(evaluator, optimum, adequacy, {}, (), options)

    evaluator.begin(Stage.SCANS)
    for attempt in range(ANEW + 1):
        optimum = with_central_slopes(evaluator, optimum)
        response, x = optimum.likelihood.objective.response, optimum.expansion.x
        ranges = output_ranges(response, optimum.likelihood.parameters, options.seed, [x])
        scans = scan_profiles(evaluator, optimum, ranges, minima, options.only, exact)
        better = min(scans.shared, key=lambda each: each.delta, default=None)
        if attempt == ANEW or better is None or not better.delta < -BETTER:
            break
        # what was the most likely point remains a minimum that may fit
        options = replace(options, minima=[*(options.minima or ()), x, *(m.x for m in minima)])
        evaluator.likelihood = optimum.likelihood.stated
        optimum = most_likely(evaluator, [better.x])
        optimum, minima = _lowest_minimum(evaluator, optimum, twins, options)
    separate = identifiability.equivalents(evaluator, scans, twins)
    equivalents = (*separate, *options.alternatives)
    redundant = is_redundant(optimum)
    profiles = profiles_of(scans, equivalents, options.units, is_redundant=redundant)
    if options.only:  # an output without a value is not asked for either
        profiles = {name: p for name, p in profiles.items() if name in options.only}
    adequacy = _adequacy(optimum, options)
    return _assemble(evaluator, optimum, adequacy, profiles, equivalents, options)


def shared_values(problem: Problem) -> tuple[str, ...]:
    """Names of the values that no single experiment has of its own.

    Args:
        problem: parameters and measurements.
    """
    return (*(p.name for p in problem.parameters if not p.experiments), *problem.outputs)


def _adequacy(optimum: Optimum, options: InferenceOptions) -> Adequacy:
    """Whether the model will do."""
    return adequacy_of(optimum, options.structure, options.closer, options.scale_off)


def _lowest_minimum(
    evaluator: LikelihoodEvaluator,
    optimum: Optimum,
    twins: Sequence[Twin],
    options: InferenceOptions,
) -> tuple[Optimum, list[Sample]]:
    """The most likely point, and other minima that fit; both of the search that was made.

    Where none was made the bounds are searched once, unless the model describes assumed data. Of
    points that are as likely one is taken that has a value of every output.
    """
    known = list(options.minima or ())
    if options.minima is None and options.data:
        # no more than half of what is left: the rest is for the intervals
        with evaluator.limited(0.5 * (evaluator.spent + evaluator.limit)), suppress(Exhausted):
            known = [minimum.x for minimum in search_box(evaluator, [], options.seed, 0)[0]]
    for _ in range(ANEW):
        parameters, x = optimum.likelihood.parameters, optimum.expansion.x
        images = [image for twin in twins if (image := twin.of(parameters, x)) is not None]
        minima = _minima_that_fit(evaluator, optimum, [*images, *known])
        lower = next(iter(minima), None)
        if lower is None or not float(lower.rows @ lower.rows) < optimum.least - BETTER:
            lower, alike = None, []
            if not np.all(np.isfinite(optimum.expansion.sample.outputs)):
                alike = [m for m in minima if optimum.delta(float(m.rows @ m.rows)) < BETTER]
            try:
                xs = tuple(m.x for m in alike)
                [read] = evaluator([Request(xs, rows=False)]) if alike else [[]]
            except Exhausted:
                alike, read = [], []
            pairs = zip(alike, read, strict=True)
            lower = next((m for m, there in pairs if np.all(np.isfinite(there.outputs))), None)
        if lower is None:
            break
        evaluator.likelihood = optimum.likelihood.stated
        known = [*known, x]
        optimum = most_likely(evaluator, [lower.x])
    return optimum, minima


def _minima_that_fit(
    evaluator: LikelihoodEvaluator, optimum: Optimum, begins: Sequence[FloatArray]
) -> list[Sample]:
    """Points apart from the optimum that fit; from those that nearly do a search goes on."""
    threshold = ROOT_95**2

    def delta(sample: Sample) -> float:
        square = float(sample.rows @ sample.rows)
        return optimum.delta(square) if math.isfinite(square) else math.inf

    try:
        [samples] = evaluator([Request(tuple(begins), outputs=False)]) if begins else [[]]
        fit = [sample for sample in samples if delta(sample) <= threshold]
        near = [s.x for s in samples if threshold < delta(s) <= NEAR * threshold]
        started = expand(evaluator, near, outputs=False) if near else []
    except Exhausted:
        return []
    goal = Goal(wanted=optimum.least + threshold)
    fit += [end.end.sample for end in minimise(evaluator, started, goal=goal)]
    apart: list[Sample] = []
    for sample in sorted(fit, key=delta):
        places = [optimum.expansion.x, *(other.x for other in apart)]
        gaps = [identifiability.gap(optimum.likelihood, sample.x, place) for place in places]
        is_other = all(np.any(gap > identifiability.SAME) for gap in gaps)
        if delta(sample) <= threshold and (is_other or delta(sample) < -BETTER):
            apart.append(sample)
    return apart


def _assemble(
    evaluator: LikelihoodEvaluator,
    optimum: Optimum,
    adequacy: Adequacy,
    profiles: Mapping[str, Profile],
    equivalents: tuple[Equivalent, ...],
    options: InferenceOptions,
) -> Determined:
    """Values with their profiles, and what is found besides where the model describes the data."""
    own, derived = dict[str, ParameterEstimate](), dict[str, OutputEstimate]()
    scans, values = dict[str, Scan](), dict[str, FittedEstimate]()
    for name, (value, scan) in profiles.items():
        interval = span(*value.ci95, value.unit).replace("\u00a0", " ")
        _log.info("profile of %s: %s, %s", name, interval, value.status)
        values[name], scans[name] = value, scan
        if isinstance(value, ParameterEstimate):
            own[name] = value
        elif isinstance(value, OutputEstimate):
            derived[name] = value
    evaluator.begin(Stage.DIRECTIONS)
    wants_directions = options.directions and adequacy.describes
    directions = identifiability.directions(evaluator, optimum) if wants_directions else ()
    idle = identifiability.without_effect(evaluator, optimum, values)
    resampled = None
    if options.bootstrap > 1 and values:
        evaluator.begin(Stage.REFITS)
        drawn = (options.bootstrap, options.seed, options.progress)
        resampled = bootstrap_of(optimum, values, *drawn)
    likelihood, data = optimum.likelihood, optimum.likelihood.objective.data
    parameters = likelihood.parameters
    here = canonical(parameters, to_model(parameters, optimum.expansion.x))
    knowledge = Knowledge(
        data=options.data,
        chi_square=optimum.chi_square,
        freedom=optimum.degrees_of_freedom,
        adequacy=adequacy,
        most_likely={p.name: float(v) for p, v in zip(parameters, here, strict=True)},
        inflation=likelihood.inflation,
        scans=scans,
        directions=directions,
        without_effect=idle,
        equivalents=equivalents,
        effort=Effort(evaluator.evaluations, evaluator.derived, evaluator.runs),
        units={p.name: p.unit for p in parameters},
        of_experiments=tuple(p.name for p in parameters if p.experiments),
        bootstrap=resampled,
    )
    rates_hz = [rate for m in data.measurements for rate in m.sampled_hz]
    return Determined(
        parameters=own,
        derived=derived,
        findings=(
            *sampling_findings(rates_hz, values, equivalents),
            *identifiability.scan_findings(profiles),
        ),
        knowledge=knowledge,
        ending=ending_of(
            Status.CONVERGED if adequacy.describes else Status.MISFIT,
            adequacy,
            inflation=likelihood.inflation,
            structure=options.structure,
            data=data,
        ),
    )


# --- of a problem without a fit -------------------------------------------------------------------

#: Parameters of single experiments that are few.
FEW_OWN = 12


def identify(
    problem: Problem,
    respond: Callable[[Mapping[str, Scalar]], Response],
    options: InferenceOptions,
    values: Mapping[str, float] | None = None,
    alternative: Mapping[str, Scalar] | None = None,
) -> Determined:
    """What the data of one problem determine, with alternatives that fit as well, and findings.

    Args:
        problem: parameters and measurements.
        respond: makes the response of one alternative.
        options: units, seed and limits; whether the data are measured, or what the model gives
            where the search begins, with the campaign's noise. The rest follows from the problem.
        values: by parameter, where the search begins; None: the campaign's start and reference
            values.
        alternative: of the fit that these values are of; None: the first.

    Raises:
        BadInput: the result is another problem's.
        FmuFailure: the FMU failed.
    """

    def objective_of(settings: Mapping[str, Scalar]) -> Objective:
        return make_objective(respond(settings), problem.parameters, problem.data)

    chosen = problem.alternatives[0] if alternative is None else alternative
    objective = objective_of(chosen)
    begins = _beginnings(problem, values)
    if not options.data:
        begins = begins[:1]
    noise, structure = _noise(objective, begins[0], expected=not options.data)
    others = [a for a in problem.alternatives if dict(a) != dict(chosen) and options.data]
    pairs = ((a, (objective_of(a), begins)) for a in others)
    equal_fits = [equal_fit(there, (objective, begins), a, noise) for a, there in pairs]
    own = own_count(problem.parameters)
    options = replace(
        options,
        others=begins[1:],
        alternatives=tuple(filter(None, equal_fits)),
        only=shared_values(problem) if own > FEW_OWN else (),
        structure=structure,
    )
    determined = determine(objective, begins[0], noise, options)
    knowledge = determined.knowledge
    widening = 1.0 if structure is None else structure.widening
    findings = residual_findings(knowledge.adequacy, problem.data.series, widening)
    if knowledge.adequacy.describes:
        findings += (*equivalent_findings(determined), *determined.findings)
    if own <= FEW_OWN:
        return replace(determined, findings=findings)
    limited = note(Kind.profiles_limited, "experiments", count=float(own), most=float(FEW_OWN))
    return replace(determined, findings=(*findings, limited))


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
    objective: Objective, begin: FloatArray, *, expected: bool
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
    structure = curve_structure(objective, point, matrix, noise)
    if structure is None:
        return noise, None
    return noise.widened(curves, structure.widening), structure
