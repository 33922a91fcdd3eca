"""What a reader has to know of a fit, as records: decided here, from what was found of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

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
from fitting.inference.consistency import contradictions, differs
from fitting.inference.joint_result import WORTH_A_WARNING, JointResult, PairTest
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.inference.mistakes import (
    SweepFindings,
    contradiction_findings,
    exchanged_findings,
    slipped_findings,
    unknown_line_findings,
)
from fitting.inference.phase_readings import phase_findings
from fitting.inference.sweep_line import line_findings
from fitting.measurements.dataset import Dataset
from fitting.measurements.sweep import Sweep
from fitting.measurements.tones import Tones
from fitting.signal.peaks import DETECTION_SIGMA
from fitting.signal.residual_tests import NOTABLE
from fitting.signal.scale import LaboratoryMaximum, laboratory_maximum
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.estimate import FittedEstimate, OffsetEstimate
from fitting.text.finding import SEVERITIES, Finding, Kind, Severity, note
from fitting.text.notation import hertz, settings_words
from fitting.text.units import convert

#: What a finding is about that is about all of them.
EVERYTHING = "measurements"
#: Starts of equal J whose parameters differ by more than this (units of x) are told apart.
APART = 0.1
#: Weak peaks that are named one by one.
MOST_WEAK = 3
#: Correlation of two errors from which it is strong.
CORRELATED = 0.95
#: Shares of a box from its end: within them a value lies on the bound, to the rounding of solvers,
#: or next to it.
ON_BOUND, NEAR_BOUND = 1e-6, 1e-3
#: Widening of the errors, or of the noise, from which it is worth a warning.
WORTH_TELLING = 1.5
#: Share of the error by noise from which that by the simulation is told.
WORTH_SAYING = 0.1
#: A drift of this share of the line width may be why a model does not describe the data: half of it
#: as a departure from a straight line moves a peak on the flank by some per cent.
SUSPECT = 0.1


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


def findings_of(
    fit: Fit,
    offsets: Sequence[OffsetEstimate],
    sweeps: SweepFindings,
    most_likely: FloatArray,
    misfit: Misfitting | None = None,
) -> tuple[Finding, ...]:
    """Findings of a fit itself, whatever is inferred from it; errors first.

    Args:
        fit: a solved problem.
        offsets: values of single experiments.
        sweeps: what they show.
        most_likely: parameters (n,), in their units.
        misfit: what is known of the residuals; None: nothing that is worth a warning.
    """
    misfit = misfit or Misfitting()
    problem, solution, causes = fit.problem, fit.solution, misfit.causes
    adequacy, structure = misfit.adequacy, solution.structure
    widening = 1.0 if structure is None else structure.widening
    series, correlated, misfits = problem.data.series, Kind.correlated_residuals, Kind.not_described
    residuals = () if adequacy is None else residual_findings(adequacy, series, widening)
    lines = () if problem.is_joint else tuple(sweeps.lines.values())
    fitted = any(m.rows for m in problem.measurements if m.is_curve)
    notes = problem.notes if problem.is_joint else ()
    unconverged: tuple[Finding, ...] = ()
    if fit.status is not Status.CONVERGED:
        kind = Kind.not_converged
        unconverged = (Finding(kind=kind, severity="error", subject=_subject(series)),)
    return in_order(
        *unconverged,
        *residuals,
        *causes,
        *(_of_excess(fit.status, misfit) if not residuals else ()),
        *(
            _of_structure(solution)
            if not {correlated, misfits} & {f.kind for f in residuals}
            else ()
        ),
        *_of_weak_peaks(problem.experiments),
        *_of_scale(tuple(problem.campaigns.values()), solution.final.scale_bias),
        *slipped_findings(problem, sweeps.lines),
        *_of_bounds(solution),
        *(_of_correlation(solution) if misfit.describes else ()),
        *_of_minima(solution, fit.outcome),
        *_of_drift(problem, offsets, sweeps, misfit.describes or bool(causes)),
        *(() if causes else outlier_findings(problem, _row_by_row(solution, most_likely))),
        *(() if causes else exchanged_findings(problem, solution)),
        *phase_findings(solution),
        *unknown_line_findings(problem.experiments),
        *(found for line in lines for found in line_findings(line, fitted=fitted)),
        *sweeps.faults,
        *sweeps.left_out,
        *contradiction_findings(sweeps.agreement),
        *(note(Kind.campaign_note, "campaign", {"text": (text,)}) for text in notes),
    )


def in_order(*findings: Finding) -> tuple[Finding, ...]:
    """The findings, errors first, then warnings.

    Args:
        findings: in any order.
    """
    return tuple(sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity)))


def residual_findings(
    adequacy: Adequacy, series: Sequence[str], widening: float
) -> tuple[Finding, ...]:
    """What the residuals of a fit say of the model and of the stated noise.

    Args:
        adequacy: whether the model describes the data.
        series: names of the series that were fitted together; empty: that of the only one.
        widening: of the errors of curves whose residuals are correlated.
    """
    about = {"chi_square": adequacy.chi_square, "freedom": adequacy.freedom}
    about |= {"p_value": adequacy.p_value, "correlated_p": adequacy.correlated_p}
    numbers = _finite(about | {"share": adequacy.share, "scale_off": adequacy.scale_off})
    subject = _subject(series, adequacy.curve if adequacy.is_correlated else "")
    if not adequacy.describes:
        kind = Kind.not_described
        return (Finding(kind=kind, severity="error", subject=subject, numbers=numbers),)
    found = []
    if adequacy.is_correlated:
        kind, more = Kind.correlated_residuals, {"widening": widening}
        urgent: Severity = "warning" if widening > NOTABLE else "note"
        found.append(Finding(kind=kind, severity=urgent, subject=subject, numbers=numbers | more))
    if adequacy.noise_factor > 1.0:
        kind, more = Kind.noise_underestimated, {"factor": adequacy.noise_factor}
        subject = _subject(series)
        found.append(
            Finding(kind=kind, severity="warning", subject=subject, numbers=numbers | more)
        )
    return tuple(found)


def _of_excess(status: Status, misfit: Misfitting) -> Iterator[Finding]:
    """Residuals beyond the noise where no other finding explains them."""
    adequacy, numbers = misfit.adequacy, {"inflation": misfit.inflation}
    if misfit.inflation <= WORTH_TELLING or (adequacy is not None and adequacy.outliers):
        return
    if status is Status.INTERRUPTED:  # what is left may be what the search had still to find
        yield Finding(
            kind=Kind.search_unfinished, severity="warning", subject="search", numbers=numbers
        )
    elif misfit.describes:
        yield Finding(
            kind=Kind.excess_residuals, severity="warning", subject=EVERYTHING, numbers=numbers
        )


def _of_structure(solution: Solution) -> Iterator[Finding]:
    """Residuals of curves that are no noise of one size."""
    structure = solution.structure
    if structure is None or structure.widening <= WORTH_TELLING:
        return
    data = solution.objective.data
    count = solution.final.residuals[data.curve_rows].size
    # a noise in proportion to the amplitude could be stated, and none is
    can_state = any(isinstance(m, Sweep) and m.fitted and not m.known for m in data.measurements)
    correlated = structure.order > 0
    yield Finding(
        kind=Kind.correlated_residuals if correlated else Kind.heteroscedastic_residuals,
        severity="warning",
        subject=_subject(data.series),
        numbers={
            "widening": structure.widening,
            "points": structure.points,
            "count": float(count),
            "can_state": float(structure.is_unequal and can_state),
        },
        names={"tests": (structure.departure,)},
    )


def _subject(series: Sequence[str], curve: str = "") -> str:
    """What a finding is about: a curve, the only series, or all measurements."""
    named_series = [name for name in series if name]
    return curve or (named_series[0] if len(named_series) == 1 else EVERYTHING)


def pair_findings(joint: JointResult | None, *, is_best: bool) -> tuple[Finding, ...]:
    """Campaigns that contradict each other, or agree poorly.

    Args:
        joint: the tests of their agreement; None: there is one.
        is_best: whether a better joint fit was looked for: else one may exist at which they agree.
    """
    if joint is None:
        return ()
    against, odd = contradictions(joint), differs(joint)
    poor = () if against else tuple(t for t in joint.tensions if t.sigmas > WORTH_A_WARNING)
    if (against or poor) and not is_best:
        kind = Kind.disagreement_unsearched
        return (Finding(kind=kind, severity="warning", subject=EVERYTHING),)
    return (
        *(_pair(Kind.contradiction, odd or f"{t.one}, {t.other}", t) for t in against),
        *(_pair(Kind.tension, f"{t.one}, {t.other}", t) for t in poor),
    )


def _pair(kind: Kind, subject: str, test: PairTest) -> Finding:
    return Finding(
        kind=kind,
        severity="warning",
        subject=subject,
        numbers={
            "sigmas": test.sigmas,
            "chi_square": test.chi_square,
            "freedom": float(test.freedom),
            "p_value": test.p_value,
        },
        names={"sets": (test.one, test.other)},
    )


def _finite(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in numbers.items() if math.isfinite(value)}


# --- values --------------------------------------------------------------------------------------


def estimator_findings(options: Options, values: Mapping[str, FittedEstimate]) -> Iterator[Finding]:
    """That the values are Algorithm 2's and the errors are not, and which of them do not agree.

    Args:
        options: of the fit.
        values: as they are reported, by name.
    """
    if options.estimator == LIKELIHOOD:
        return
    yield Finding(kind=Kind.estimator, severity="note", subject="values")
    for name, value in values.items():
        if value.status.has_value and value.is_outside:
            low, high = value.ci95
            yield Finding(
                kind=Kind.outside_interval,
                severity="warning",
                subject=name,
                numbers={"value": value.value, "low": low, "high": high},
                names={"unit": (value.unit,)},
            )


def simulation_findings(
    promised: Sequence[float], scale_off: float, values: Mapping[str, FittedEstimate]
) -> Iterator[Finding]:
    """Values whose errors hold more of what is no noise than can be left unsaid.

    Args:
        promised: relative errors of simulated amplitudes, at most.
        scale_off: factor by which a scale of peaks may be off, at most; NaN: none is in doubt.
        values: as they are reported, by name.
    """
    moved = {
        name: value
        for name, value in values.items()
        if value.status.has_value
        and value.simulation > WORTH_SAYING * (value.std - value.simulation)
    }
    if not moved:
        return
    # a doubtful scale is far more than the simulation's own error
    doubt = scale_off > 1.0
    yield Finding(
        kind=Kind.scale_doubt if doubt else Kind.simulation_error,
        severity="warning" if doubt else "note",
        subject="sweep" if doubt else "simulation",
        numbers={
            "error": scale_off - 1.0 if doubt else max(promised),
            **{name: value.simulation for name, value in moved.items()},
        },
        names={"values": tuple(moved), "units": tuple(v.unit for v in moved.values())},
    )


def _of_correlation(solution: Solution) -> Iterator[Finding]:
    """Pairs of parameters of the whole campaign whose errors are strongly correlated."""
    own = [k for k, p in enumerate(solution.parameters) if not p.experiments]
    covariance = solution.errors.covariance
    for k, i in enumerate(own):
        for j in own[:k]:
            rho = float(covariance[i, j] / np.sqrt(covariance[i, i] * covariance[j, j]))
            if abs(rho) >= CORRELATED:
                pair = (solution.parameters[j].name, solution.parameters[i].name)
                yield Finding(
                    kind=Kind.correlated_values,
                    severity="note",
                    subject=", ".join(pair),
                    numbers={"correlation": rho},
                    names={"pair": pair},
                )


def _of_bounds(solution: Solution) -> Iterator[Finding]:
    for i, parameter in enumerate(solution.parameters):
        p = float(solution.final.parameters[i])
        bound = min(parameter.lower, parameter.upper, key=lambda end: abs(p - end))
        if abs(p - bound) >= parameter.near(bound, NEAR_BOUND):
            continue
        at_bound = abs(p - bound) <= parameter.near(bound, ON_BOUND)
        yield Finding(
            kind=Kind.at_bound,
            severity="note",
            subject=parameter.name,
            numbers={"value": p, "bound": bound, "at_bound": float(at_bound)},
            names={"unit": (parameter.unit,)},
        )


# --- other solutions -----------------------------------------------------------------------------


def _of_minima(solution: Solution, outcome: Outcome) -> Iterator[Finding]:
    best, parameters = outcome.best, solution.parameters
    shared = [p for p in parameters if not p.experiments]
    about = {"values": tuple(p.name for p in shared), "units": tuple(p.unit for p in shared)}
    for chain in outcome.chains:
        if best is None or chain is best or chain.joined is not None or not chain.steps:
            continue
        end, lowest = chain.steps[-1], best.steps[-1]
        values = named(parameters, np.array(end.parameters))
        numbers = {"start": chain.start + 1.0, "objective": end.j}
        numbers |= {name: values[name] for name in about["values"]}
        apart = distance(parameters, np.array(end.x), np.array(lowest.x))
        equal = equal_j(end.j, lowest.j) and apart > APART
        if equal or chain.nu == best.nu:
            yield Finding(
                kind=Kind.equal_objective if equal else Kind.other_minimum,
                severity="note",
                subject=f"start {chain.start + 1}",
                numbers=numbers,
                names=about,
            )
    yield from search_findings(outcome)


def search_findings(outcome: Outcome) -> Iterator[Finding]:
    """What a search of the box leaves open: a minimum that noise would explain.

    Args:
        outcome: of one alternative, with its search.
    """
    search = outcome.search
    if search is None or search.explained:
        return
    low, others = search.apart_by_height()
    numbers = {
        "points": float(search.screened),
        "lowest": float(sum(minimum.descents for minimum in low)),
        "descents": float(search.descents),
        "chi_square": low[0].chi_square,
    }
    if others:
        numbers["next_chi_square"] = others[0].chi_square
    kind = Kind.search_unexplained
    yield Finding(kind=kind, severity="warning", subject="search", numbers=numbers)


def alternative_findings(alternatives: Sequence[AlternativeResult]) -> Iterator[Finding]:
    """Alternatives that reach the objective of the reported one.

    Args:
        alternatives: of a fit, the reported one among them.
    """
    for a in alternatives:
        if a.equal_to_best and not a.reported:
            words = settings_words(a.settings)
            yield Finding(kind=Kind.equal_alternative, severity="note", subject=words)


# --- drift ---------------------------------------------------------------------------------------


def _of_drift(
    problem: Problem, offsets: Sequence[OffsetEstimate], sweeps: SweepFindings, describes: bool
) -> Iterator[Finding]:
    """Of every campaign, by its name where there are several."""
    for name, bound in problem.campaigns.items():
        labels = {e.label for e in bound.experiments}
        if bound.sweep is not None:
            labels.add(bound.sweep.label)
        own = tuple(o for o in offsets if o.experiments[0] in labels)
        line = sweeps.lines.get(name)
        # of the sweep's fit, else the declared one; NaN where neither is known
        width_hz = line.width.value if line is not None and line.width.value > 0.0 else math.nan
        if math.isnan(width_hz):
            width_hz = bound.setup.line_width_hz or math.nan
        yield from drift_findings(bound, own, width_hz, describes, name)


def drift_findings(
    bound: BoundCampaign,
    offsets: Sequence[OffsetEstimate],
    width_hz: float,
    describes: bool = True,
    subject: str = "",
) -> Iterator[Finding]:
    """Where the drift over the series, or an offset from it, exceeds the line width (Hz).

    Of a model that does not describe the data a smaller drift is told too: it may be the cause.

    Args:
        bound: campaign, bound to its FMU.
        offsets: values of single experiments.
        width_hz: full line width, Hz.
        describes: whether the model describes the data.
        subject: name of the campaign where there are several.
    """
    if not width_hz > 0.0:
        return
    moved = {
        name: abs(after - before) * _in_hertz(bound.drift.units.get(name, "Hz"))
        for name, (before, after) in bound.drift.ends.items()
    }
    wide = {name: hz for name, hz in moved.items() if hz > width_hz}
    most = max(moved.values(), default=0.0)
    suspected = not (describes or offsets) and most > SUSPECT * width_hz
    if wide or suspected:
        shown = wide or moved
        yield Finding(
            kind=Kind.drift_wide if wide else Kind.drift_suspected,
            severity="note" if describes else "warning",
            subject=subject,
            numbers={"width_hz": width_hz, **shown},
            names={
                "variables": tuple(shown),
                "offsets": tuple(o.name for o in offsets),
            },
        )
    far = {
        f"{o.experiments[0]} ({', '.join(o.variables)})": abs(o.value) * _in_hertz(o.unit)
        for o in offsets
        if o.prior == o.prior and abs(o.value) * _in_hertz(o.unit) > width_hz
    }
    if far:
        yield Finding(
            kind=Kind.drift_offset_wide,
            severity="warning",
            subject=subject,
            numbers={"width_hz": width_hz, **far},
            names={"offsets": tuple(far)},
        )


def _in_hertz(unit: str) -> float:
    """Hertz per unit, zero where it is no frequency."""
    try:
        return convert(1.0, unit, "Hz", where="")
    except BadInput:
        return 0.0


# --- peaks ---------------------------------------------------------------------------------------


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


def outlier_findings(problem: Problem, fits: Sequence[Linearisation]) -> Iterator[Finding]:
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
        return
    wide = np.maximum(1.0, np.median(np.abs(found), axis=1, keepdims=True) / 0.6745)
    scores = found[np.argmin(np.abs(found / wide), axis=0), np.arange(found.shape[1])]
    least = np.min(np.abs(found / wide), axis=0)
    reduced = ("huber",) if problem.data.outliers == "huber" else ()
    for k in np.argsort(-np.abs(scores)):
        if least[k] > problem.threshold:
            label, frequency_hz, is_phase = lines[k]
            yield Finding(
                kind=Kind.outlier,
                severity="warning",
                subject=label,
                numbers={"sigmas": float(scores[k]), "frequency_hz": frequency_hz},
                names={"phase": ("phase",) if is_phase else (), "reduced": reduced},
            )


def _named_rows(data: Dataset) -> dict[int, tuple[str, float, bool]]:
    """Experiment, frequency (Hz) and whether it is a phase, of each row of tones, by its number."""
    found: dict[int, tuple[str, float, bool]] = {}
    for m, rows in zip(data.measurements, data.slices, strict=True):
        if isinstance(m, Tones):
            lines = [(e.label, float(f)) for e in m.experiments for f in e.read_hz]
            both = [(*line, is_phase) for is_phase in (False, True) for line in lines]
            found.update(zip(range(rows.start, rows.stop), both, strict=False))
    return found


def _studentised(rows: Linearisation) -> FloatArray:
    return np.asarray(rows.rows / np.sqrt(np.maximum(1.0 - rows.leverage, 0.05)))


def _of_weak_peaks(experiments: Sequence[Experiment]) -> Iterator[Finding]:
    """Ready peaks below what a reader of spectra would have refused (`fitting.signal.peaks`)."""
    weak = [
        f"{experiment.label} at {hertz(tone)}"
        for experiment in experiments
        for tone, peak, sigma in zip(
            experiment.read_hz, experiment.peaks_v, experiment.sigmas_v, strict=True
        )
        if peak < DETECTION_SIGMA * sigma
    ]
    if weak:
        yield Finding(
            kind=Kind.weak_peaks,
            severity="warning",
            subject="peaks",
            numbers={"count": float(len(weak)), "threshold": DETECTION_SIGMA},
            names={"peaks": tuple(weak[:MOST_WEAK])},
        )


# --- the scale -----------------------------------------------------------------------------------


def _of_scale(campaigns: Sequence[BoundCampaign], scale_bias: float) -> Iterator[Finding]:
    """What is wrong with the measured maximum, and the bias that the simulated one leaves."""
    sweeps = [bound.sweep for bound in campaigns if bound.sweep is not None]
    compared = any(bound.experiments for bound in campaigns)
    gains = [e.phases for b in campaigns[:1] for e in b.experiments if e.phases is not None]
    unknown = any(phases.unknown == "gain" for phases in gains)
    if len(campaigns) == 1 and not sweeps and compared and not unknown:
        yield Finding(kind=Kind.scale_none, severity="note", subject="scale")
    elif len(campaigns) == 1 and sweeps and sweeps[0].scale == "maximum":
        maximum = laboratory_maximum(sweeps[0].frequency_hz, sweeps[0].amplitude_v)
        yield from maximum_findings(maximum)
    wanted = min((bound.setup.accuracy for bound in campaigns), default=math.inf)
    if scale_bias > wanted:
        numbers = {"error": scale_bias, "accuracy": wanted}
        kind = Kind.scale_coarse
        yield Finding(kind=kind, severity="warning", subject="scale", numbers=numbers)


def maximum_findings(maximum: LaboratoryMaximum) -> Iterator[Finding]:
    """What Algorithm 1 cannot know of a sweep with such a largest point.

    Args:
        maximum: the laboratory's maximum of the sweep.
    """
    if maximum.on_edge:
        kind, numbers = Kind.scale_at_edge, {"frequency_hz": maximum.frequency_hz}
    elif math.isnan(maximum.bias):
        kind, numbers = Kind.scale_unknown, {"fall": maximum.fall}
    elif maximum.is_biased:
        kind, numbers = Kind.scale_biased, {"bias": maximum.bias}
    else:
        return
    yield Finding(kind=kind, severity="warning", subject="scale", numbers=numbers)
