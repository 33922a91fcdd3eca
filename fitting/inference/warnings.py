"""What a reader of a result must know: warnings with a kind, their sentences made here."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from fitting.campaign import BoundCampaign, Experiment
from fitting.campaign.parameters import prior_sigmas, to_search
from fitting.fit.alternative import Outcome
from fitting.fit.fit import Fit, Status
from fitting.fit.linearisation import Linearisation
from fitting.fit.noise import noise_of
from fitting.fit.objective import evaluate_many
from fitting.fit.options import LIKELIHOOD, Options
from fitting.fit.path import AlternativeResult, named
from fitting.fit.problem import Problem
from fitting.fit.solution import Solution
from fitting.fit.solver.continuation import distance, equal_j
from fitting.inference.causes import cause_sentence
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.inference.mistakes import (
    SweepFindings,
    contradiction_sentences,
    line_sentences_of,
    slipped_sentences,
    swapped_sentences,
)
from fitting.inference.phase_readings import phase_sentences
from fitting.inference.sweep_line import SweepLine, line_warnings
from fitting.inference.values import DerivedResult, OffsetResult, ParameterResult
from fitting.inference.verdict import Verdict
from fitting.measurements.dataset import Dataset
from fitting.measurements.sweep import Sweep
from fitting.measurements.tones import Tones
from fitting.signal.peaks import DETECTION_SIGMA
from fitting.signal.scale import LaboratoryMaximum, laboratory_maximum
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.finding import Finding
from fitting.text.notation import (
    freedom_words,
    hertz,
    listed,
    number,
    settings_words,
    span,
    unit_text,
)
from fitting.text.units import convert

#: Starts of equal J whose parameters differ by more than this (units of x) are told apart.
APART = 0.1
#: Weak peaks that are named one by one.
MOST_WEAK = 3
#: What the reader of residuals of unequal size may do.
STATE_NOISE = (
    "Where the noise grows with the amplitude, [noise] relative = states it, every point then "
    "counts as it should, and the errors can be smaller."
)
#: Outliers that are named one by one.
MOST_NAMED = 6
#: Shares of a box from its end: within them a value lies on the bound, to the rounding of solvers,
#: or next to it.
ON_BOUND, NEAR_BOUND = 1e-6, 1e-3


class Kind(Enum):
    """What a warning is about."""

    VERDICT = "how far the data determine a value"
    CONDITION = "what the campaign takes for true, which the data do not tell"
    ESTIMATOR = "whose values are reported"
    EXCHANGE = "equal fits elsewhere"
    AGREEMENT = "campaigns that contradict each other"
    PEAKS = "weak peaks"
    SCALE = "the scale"
    BOUND = "a value on a bound of its box"
    SLIPPED = "a box that is a thousand times off the line"
    CAUSE = "what may be why a model does not describe the data"
    INFLATION = "residuals beyond the noise"
    STRUCTURE = "residuals that are no noise of one size"
    MINIMA = "other minima"
    DRIFT = "drift beyond the line width"
    OUTLIERS = "outliers"
    ALTERNATIVES = "alternatives that fit as well"
    LINE = "the line of the sweep"
    SWEEP = "faults of the sweep"
    PHASES = "phases read another way"
    SWAPPED = "peaks that changed places"
    LINES = "lines of a spectrum that no drive explains"
    SCALE_FACTOR = "peaks and sweep that contradict each other"
    SIMULATION = "the simulation's own error in the intervals"
    NOTE = "a note of the campaign"
    PROFILES = "profiles that were not walked"
    FMU = "what the FMU says"
    SAMPLES = "samples that are not mean and tones"
    PLAN = "a promise of the plan"


@dataclass(frozen=True)
class Warned:
    """What a reader of the numbers must know: its kind, and the sentence."""

    kind: Kind
    sentence: str


@dataclass(frozen=True)
class Misfitting:
    """What is known of the residuals of a fit.

    Args:
        inflation: by how much residuals beyond the noise widen the errors.
        describes: whether there are values: the fit converged and the model describes the data.
        adequacy: by which rule; None: nobody asked.
        causes: what may be why.
    """

    inflation: float = 1.0
    describes: bool = True
    adequacy: Adequacy | None = None
    causes: tuple[Finding, ...] = ()


def warned(kind: Kind, sentences: Iterable[str]) -> list[Warned]:
    """Sentences of one kind.

    Args:
        kind: of the warnings.
        sentences: as they are shown.
    """
    return [Warned(kind, sentence) for sentence in sentences]


def fit_warnings(
    fit: Fit,
    offsets: Sequence[OffsetResult],
    sweeps: SweepFindings,
    most_likely: FloatArray,
    misfit: Misfitting | None = None,
) -> list[Warned]:
    """Everything that a fit itself warns of, whatever is inferred from it.

    Args:
        fit: the finished fit.
        offsets: values of single experiments.
        sweeps: what they show.
        most_likely: parameters (n,), in their units.
        misfit: what is known of the residuals; None: nothing that is worth a warning.
    """
    misfit = misfit or Misfitting()
    problem, solution, describes = fit.problem, fit.solution, misfit.describes
    found = bool(misfit.causes)
    lines = () if problem.is_joint else tuple(sweeps.lines.values())
    fitted = any(m.rows for m in problem.measurements if m.is_curve)
    campaigns = tuple(problem.campaigns.values())
    return [
        *warned(Kind.PEAKS, weak_peaks(problem.experiments)),
        *warned(Kind.SCALE, scale_sentences(campaigns, solution.final.scale_bias)),
        *warned(Kind.SLIPPED, slipped_sentences(problem, sweeps.lines)),
        *warned(Kind.BOUND, _on_bounds(solution)),
        *warned(Kind.CAUSE, map(cause_sentence, misfit.causes)),
        *warned(Kind.INFLATION, _inflation(fit.status, misfit)),
        *warned(Kind.STRUCTURE, _structure(solution)),
        *warned(Kind.MINIMA, _other_minima(solution, fit.outcome)),
        *warned(Kind.DRIFT, _drift(problem, offsets, sweeps, describes or found)),
        *warned(
            Kind.OUTLIERS,
            () if found else outlier_sentences(problem, _row_by_row(solution, most_likely)),
        ),
        *warned(Kind.SWAPPED, () if found else swapped_sentences(problem, solution)),
        *warned(Kind.PHASES, phase_sentences(solution)),
        *warned(Kind.LINES, line_sentences_of(problem.experiments)),
        *warned(Kind.ALTERNATIVES, _ties(fit.alternatives)),
        *(w for line in lines for w in warned(Kind.LINE, line_warnings(line, fitted=fitted))),
        *warned(Kind.SWEEP, sweeps.faults),
        *warned(Kind.SWEEP, sweeps.left_out),
        *warned(Kind.SCALE_FACTOR, contradiction_sentences(sweeps.agreement)),
    ]


#: Share of the error by noise from which that by the simulation is told.
WORTH_SAYING = 0.1
#: What is said of values that are not determined, by verdict.
SAID = {
    Verdict.BOUNDED: "Bounded on both sides by these data, but not determined: {}.",
    Verdict.ABOVE: "Bounded above only by these data: {}.",
    Verdict.BELOW: "Bounded below only by these data: {}.",
    Verdict.SEVERAL: "One of several values that fit as well: {}.",
    Verdict.OPEN: (
        "Not determined by these data: {}. Prior and start decide where these values are reported."
    ),
    Verdict.LINEARISED: (
        "Linearised only: {}. Their errors hold where the model is straight within them; profiles "
        "would say whether the data determine them."
    ),
}


def verdict_sentences(values: Mapping[str, ParameterResult | DerivedResult]) -> list[str]:
    """Which values the data do not determine, or not wholly, or of which nothing is known.

    Args:
        values: with their verdicts, by name.
    """
    said = []
    for verdict, words in SAID.items():
        names = [name for name, value in values.items() if value.identifiable is verdict]
        if names:
            said.append(words.format(", ".join(names)))
    unknown: dict[str, list[str]] = {}
    for name, value in values.items():
        if value.identifiable is Verdict.UNKNOWN:
            unknown.setdefault(value.reason, []).append(name)
    said += [f"Not known: {', '.join(names)} ({why})." for why, names in unknown.items()]
    return said


def doubt_sentences(
    promised: Sequence[float],
    scale_off: float,
    values: Mapping[str, ParameterResult | DerivedResult | OffsetResult],
) -> list[str]:
    """Values whose errors hold more of what is no noise than can be left unsaid.

    Args:
        promised: relative errors of simulated amplitudes, at most.
        scale_off: factor by which a scale of peaks may be off, at most; NaN: none is in doubt.
        values: as they are reported, by name.
    """
    told = []
    for name, value in values.items():
        noise = value.std - value.simulation
        if value.identifiable.has_value and value.simulation > WORTH_SAYING * noise:
            told.append(f"{name} by {number(value.simulation, 2)} {unit_text(value.unit)}".rstrip())
    if not told:
        return []
    if scale_off > 1.0:  # far more than the simulation's own error
        return [
            "The top of a sweep is not that of a line, so that the scale taken from it may be off "
            f"by {number(100.0 * (scale_off - 1.0), 2)} %, which may move {listed(told)}: standard "
            "deviations and intervals are wider for it."
        ]
    return [
        f"Simulated amplitudes are known to {max(promised):.1e} only, which may move "
        f"{listed(told)}: standard deviations and intervals are wider for it. Finer steps of the "
        "FMU, or a better --accuracy, would narrow them, where the plan does not say that this is "
        "the best it can give."
    ]


def estimator_sentences(
    options: Options, values: Mapping[str, ParameterResult | DerivedResult | OffsetResult]
) -> list[str]:
    """That the values are Algorithm 2's and the errors are not, and which of them do not agree.

    Args:
        options: of the fit.
        values: as they are reported, by name.
    """
    if options.estimator == LIKELIHOOD:
        return []
    said = [
        "Values are those of Algorithm 2, as asked for. Standard deviations, intervals and "
        "verdicts are those of the likelihood, about its most likely values, which stand beside."
    ]
    for name, value in values.items():
        if value.identifiable.has_value and value.is_outside:
            shown = f"{number(value.value, 7)} {unit_text(value.unit)}".rstrip()
            said.append(
                f"{name} = {shown}, of Algorithm 2, lies outside the 95 % interval of the "
                f"likelihood, {span(*value.ci95, value.unit)}."
            )
    return said


def _on_bounds(solution: Solution) -> list[str]:
    said = []
    for i, parameter in enumerate(solution.parameters):
        p = float(solution.final.parameters[i])
        bound = min(parameter.lower, parameter.upper, key=lambda end: abs(p - end))
        if abs(p - bound) >= parameter.near(bound, NEAR_BOUND):
            continue
        at = f"{bound:.9g} {unit_text(parameter.unit)}".rstrip()
        if abs(p - bound) <= parameter.near(bound, ON_BOUND):
            where = f"on a bound of its box ({at})"
        else:
            found = f"{p:.9g} {unit_text(parameter.unit)}".rstrip()
            where = f"at {found}, next to a bound of its box ({at})"
        said.append(
            f"Algorithm 2, the method as published, ended with {parameter.name} {where}; the most "
            f"likely {parameter.name} need not lie there."
        )
    return said


def _inflation(status: Status, misfit: Misfitting) -> list[str]:
    inflation, adequacy = misfit.inflation, misfit.adequacy
    if misfit.describes and adequacy is not None and adequacy.noise_factor > 1.0:
        return [
            f"The residuals are uncorrelated, but {number(adequacy.noise_factor, 3)} times as "
            f"large as the stated noise (χ² = {number(adequacy.chi_square, 3)} on "
            f"{freedom_words(number(adequacy.freedom, 3))}): it was stated too small. "
            "Errors are scaled by that factor."
        ]
    if adequacy is not None and adequacy.outliers:  # these are named, and explain it
        return []
    if inflation <= 1.5 or not (misfit.describes or status is Status.INTERRUPTED):
        return []
    if status is Status.INTERRUPTED:  # what is left may be what the search had still to find
        return [
            "The search was not finished: the residuals where it stood are "
            f"{inflation:.3g} times what the noise explains, and errors are as many times as wide. "
            "That says nothing of noise or model yet."
        ]
    return [
        f"The residuals are {inflation:.3g} times what the noise explains: it was stated too "
        f"small, or the model is not quite right; errors are {inflation:.3g} times as wide for it."
    ]


def _can_state(solution: Solution) -> bool:
    """Whether a noise in proportion to the amplitude could be stated, and none is."""
    measurements = solution.objective.data.measurements
    return any(isinstance(m, Sweep) and m.fitted and not m.known for m in measurements)


def _structure(solution: Solution) -> list[str]:
    said = []
    told = solution.structure
    count = solution.final.residuals[solution.objective.data.curve_rows].size
    if told is not None and told.widening > 1.5:
        hint = f" {STATE_NOISE}" if told.is_unequal and _can_state(solution) else ""
        said.append(
            f"The residuals of the fitted curve {told.told}: its {count} points are worth "
            f"{number(told.points, 2)} independent and equal ones, and errors are "
            f"{told.widening:.3g} times as wide for it.{hint}"
        )
    return said


def _other_minima(solution: Solution, outcome: Outcome) -> list[str]:
    best = outcome.best
    said = []
    for chain in outcome.chains:
        if best is None or chain is best or chain.joined is not None or not chain.steps:
            continue
        there = np.array(chain.steps[-1].x)
        apart = distance(solution.parameters, there, np.array(best.steps[-1].x))
        values = named(solution.parameters, np.array(chain.steps[-1].parameters))
        names = [p.name for p in solution.parameters if not p.experiments]
        shown = ", ".join(f"{name} = {values[name]:.7g}" for name in names)
        if equal_j(chain.steps[-1].j, best.steps[-1].j) and apart > APART:
            said.append(f"Start {chain.start + 1} found an equal J elsewhere: {shown}.")
        elif chain.nu == best.nu:
            own = " (Algorithm 2 from the campaign's start)" if chain.start == 0 else ""
            said.append(
                f"Start {chain.start + 1}{own} ended in another minimum, "
                f"J = {chain.steps[-1].j:.4g}: {shown}."
            )
    return said + search_sentences(outcome)


def search_sentences(outcome: Outcome) -> list[str]:
    """What a search of the box leaves open: a minimum that noise would explain.

    Args:
        outcome: of one alternative, with its search.
    """
    search = outcome.search
    if search is None or search.explained:
        return []
    low, others = search.apart_by_height()
    count = sum(minimum.descents for minimum in low)
    said = (
        f"The box was searched from {search.screened} points without finding parameters that the "
        f"noise explains: {count} of {search.descents} descents ended at the lowest minimum "
        "inside it. The χ² of the search, which weighs all points of the box alike, is "
        f"{number(low[0].chi_square, 4)} there"
    )
    if others:
        said += f", and {number(others[0].chi_square, 4)} or more where the others ended"
    return [f"{said}."]


def _drift(
    problem: Problem, offsets: Sequence[OffsetResult], sweeps: SweepFindings, describes: bool
) -> list[str]:
    """Of every campaign, by its name where there are several."""
    said = []
    for name, bound in problem.campaigns.items():
        labels = {e.label for e in bound.experiments}
        if bound.sweep is not None:
            labels.add(bound.sweep.label)
        own = tuple(o for o in offsets if o.experiments[0] in labels)
        width_hz = _width_hz(bound, sweeps.lines.get(name))
        told = drift_warnings(bound, own, width_hz, describes)
        said += [f"{name}: {text}" if name else text for text in told]
    return said


def _width_hz(bound: BoundCampaign, line: SweepLine | None) -> float:
    """Line width: of the sweep's fit, else the declared one; NaN where neither is known."""
    if line is not None and line.width_hz > 0.0:
        return line.width_hz
    return bound.setup.line_width_hz or float("nan")


#: What to do about a drift that may not be the straight line that is assumed.
ESTIMATED = '[drift] model = "offsets" or "walk" estimates it.'
#: A drift of this share of the line width may be why a model does not describe the data: half of it
#: as a departure from a straight line moves a peak on the flank by some per cent.
SUSPECT = 0.1


def drift_warnings(
    bound: BoundCampaign,
    offsets: Sequence[OffsetResult],
    width_hz: float,
    describes: bool = True,
) -> list[str]:
    """Where the drift over the series, or an offset from it, exceeds the line width (Hz).

    Of a model that does not describe the data a smaller drift is told too: it may be the cause.

    Args:
        bound: campaign, bound to its FMU.
        offsets: values of single experiments.
        width_hz: full line width, Hz.
        describes: whether the model describes the data.
    """
    if not width_hz > 0.0:
        return []
    said = []
    moved = {
        name: abs(after - before) * _in_hertz(bound.drift.units.get(name, "Hz"))
        for name, (before, after) in bound.drift.ends.items()
    }
    wide = {name: hz for name, hz in moved.items() if hz > width_hz}
    if wide:
        said.append(
            f"{_listed(wide)} over the series, more than the line width of "
            f"{hertz(width_hz, digits=4)}: a small departure from the drift that is assumed moves "
            "the peaks much." + ("" if offsets else f" {ESTIMATED}")
        )
    elif not describes and not offsets and max(moved.values(), default=0.0) > SUSPECT * width_hz:
        said.append(
            f"{_listed(moved)} over the series, where the line is {hertz(width_hz, digits=4)} "
            "wide, and a straight line is assumed between: a departure from it may be why the "
            f"model does not describe the data. {ESTIMATED}"
        )
    far = {
        f"{o.experiments[0]} ({', '.join(o.variables)})": abs(o.value) * _in_hertz(o.unit)
        for o in offsets
        if o.prior == o.prior and abs(o.value) * _in_hertz(o.unit) > width_hz
    }
    if far:
        said.append(
            "Offsets from the interpolated drift beyond the line width of "
            f"{hertz(width_hz, digits=4)}: "
            + ", ".join(f"{name} {hertz(hz, digits=4)}" for name, hz in far.items())
            + "."
        )
    return said


def _listed(moved: Mapping[str, float]) -> str:
    return " and ".join(f"{name} drifts by {hertz(hz, digits=4)}" for name, hz in moved.items())


def _in_hertz(unit: str) -> float:
    """Hertz per unit, zero where it is no frequency."""
    try:
        return convert(1.0, unit, "Hz", where="")
    except BadInput:
        return 0.0


def _row_by_row(solution: Solution, most_likely: FloatArray) -> tuple[Linearisation, ...]:
    """Rows over their own noise, without what they share: of the solution, at the likeliest point.

    Algorithm 2 counts relative deviations alike, whatever their noise, and misses the exact ones;
    least squares are drawn to what is far off. An outlier is one in both.
    """
    sigma = noise_of(solution.objective, solution.final).sigma
    [likely] = evaluate_many(solution.objective, [to_search(solution.parameters, most_likely)])
    return tuple(
        Linearisation(
            rows=point.residuals / sigma,
            matrix=solution.matrix / sigma[:, np.newaxis],
            prior=prior_sigmas(solution.parameters, solution.nu),
        )
        for point in (solution.final, likely)
    )


def outlier_sentences(problem: Problem, fits: Sequence[Linearisation]) -> list[str]:
    """Peaks whose residual is beyond the threshold of its own standard deviation, in every fit.

    Studentised, r/(sigma sqrt(1 - h)), h the leverage of the row; against the scatter of all where
    that is wider than the noise.

    Args:
        problem: its experiments name the peaks, its threshold says what is far.
        fits: rows, each over its own standard deviation.
    """
    by_row = _named_rows(problem.data)
    lines = list(by_row.values())
    found = np.array([_studentised(rows)[list(by_row)] for rows in fits])
    if found.shape[1] < 4:
        return []
    wide = np.maximum(1.0, np.median(np.abs(found), axis=1, keepdims=True) / 0.6745)
    scores = found[np.argmin(np.abs(found / wide), axis=0), np.arange(found.shape[1])]
    least = np.min(np.abs(found / wide), axis=0)
    far = [int(k) for k in np.argsort(-np.abs(scores)) if least[k] > problem.threshold]
    if not far:
        return []
    named = ", ".join(f"{lines[k]} ({scores[k]:+.3g})" for k in far[:MOST_NAMED])
    more = f" and {len(far) - MOST_NAMED} more" if len(far) > MOST_NAMED else ""
    tamed = ' They count less (outliers = "huber").' if problem.data.outliers == "huber" else ""
    return [f"Outliers, in standard deviations of their residual: {named}{more}.{tamed}"]


def _named_rows(data: Dataset) -> dict[int, str]:
    """What each row of tones is called, by its number; the second half may be phases."""
    found: dict[int, str] = {}
    for m, rows in zip(data.measurements, data.slices, strict=True):
        if isinstance(m, Tones):
            lines = [f"{e.label} at {hertz(f)}" for e in m.experiments for f in e.read_hz]
            names = [*lines, *(f"the phase of {line}" for line in lines)]
            found.update(zip(range(rows.start, rows.stop), names, strict=False))
    return found


def _studentised(rows: Linearisation) -> FloatArray:
    return np.asarray(rows.rows / np.sqrt(np.maximum(1.0 - rows.leverage, 0.05)))


def weak_peaks(experiments: Sequence[Experiment]) -> list[str]:
    """Ready peaks below what a reader of spectra would have refused (`fitting.signal.peaks`).

    Args:
        experiments: with peaks and floors, V.
    """
    weak = [
        f"{experiment.label} at {hertz(tone)}"
        for experiment in experiments
        for tone, peak, sigma in zip(
            experiment.read_hz, experiment.peaks_v, experiment.sigmas_v, strict=True
        )
        if peak < DETECTION_SIGMA * sigma
    ]
    if not weak:
        return []
    more = f" and {len(weak) - MOST_WEAK} more" if len(weak) > MOST_WEAK else ""
    return [
        f"Peaks less than {DETECTION_SIGMA:.0f} standard deviations high: "
        f"{', '.join(weak[:MOST_WEAK])}{more}. Noise alone makes such peaks, and makes small ones "
        "larger than they are."
    ]


def scale_sentences(campaigns: Sequence[BoundCampaign], scale_bias: float) -> list[str]:
    """Sentences on the measured maximum, and on the bias that the simulated one leaves.

    Args:
        campaigns: those that were fitted together.
        scale_bias: relative error that simulated grids leave in the scale, at most.
    """
    said: list[str] = []
    sweeps = [bound.sweep for bound in campaigns if bound.sweep is not None]
    compared = any(bound.experiments for bound in campaigns)
    gains = [e.phases for b in campaigns[:1] for e in b.experiments if e.phases is not None]
    unknown = any(phases.unknown == "gain" for phases in gains)
    if len(campaigns) == 1 and not sweeps and compared and not unknown:
        said.append("No sweep: simulated amplitudes are compared as they are, in the FMU's unit.")
    elif len(campaigns) == 1 and sweeps and sweeps[0].scale == "maximum":
        said += maximum_warnings(laboratory_maximum(sweeps[0].frequency_hz, sweeps[0].amplitude_v))
    wanted = min((bound.setup.accuracy for bound in campaigns), default=math.inf)
    if scale_bias > wanted:
        found = f"{scale_bias:.1e}"
        said.append(f"The simulated maximum is known to {found} only, wanted {wanted:.1e}.")
    return said


def maximum_warnings(maximum: LaboratoryMaximum) -> list[str]:
    """What Algorithm 1 cannot know of a sweep with such a largest point.

    Args:
        maximum: the laboratory's maximum of the sweep.
    """
    if maximum.on_edge:
        return [
            f"The largest point of the sweep, at {hertz(maximum.frequency_hz)}, is at its end: its "
            'maximum may lie outside, and the scale may be wrong (scale = "fit" needs no maximum).'
        ]
    if math.isnan(maximum.bias):
        return [
            "The sweep shows no top that could be fitted, it falls by "
            f"{100 * maximum.fall:.0f} % beside its largest point: noise, or a grid coarser than "
            'the line, biases the scale by an unknown amount (scale = "fit" avoids it).'
        ]
    if not maximum.is_biased:
        return []
    return [
        f"The largest point of the sweep is {100 * maximum.bias:+.2f} % from the fitted top of it: "
        'noise or a coarse grid biases the scale by as much (scale = "fit" avoids it).'
    ]


def _ties(alternatives: tuple[AlternativeResult, ...]) -> list[str]:
    equal = [a for a in alternatives if a.equal_to_best and not a.reported]
    return [
        "The data do not tell the alternatives apart: "
        + f"{settings_words(a.settings)} reaches the same J."
        for a in equal
    ]
