"""Checks of a fit: residuals, other solutions, bounds, correlated errors, sweeps, drift.

`Solved` is what all checks examine, computed once.

With the covariance C of the linearised fit two parameters have the correlation

    rho = C_ij/sqrt(C_ii C_jj)

and, with the other one known, an error sqrt(1 - rho^2) times as large. Near one in magnitude the
data determine a combination of both, as the product of a gain and the sine of an angle, and neither
alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from fitting.campaign import BoundCampaign
from fitting.campaign.laws import in_base
from fitting.campaign.parameters import Parameter, to_model, to_search
from fitting.fit.alternative import Outcome
from fitting.fit.fit import Fit, Solution, Status
from fitting.fit.linearisation import DETERMINED as BY_DATA
from fitting.fit.noise import RowNoise, noise_of
from fitting.fit.objective import Point, evaluate_many
from fitting.fit.options import LIKELIHOOD
from fitting.fit.path import MINIMISED, named
from fitting.fit.problem import Problem
from fitting.fit.search import lowest
from fitting.inference.agreement import contradictions
from fitting.inference.estimates import DETERMINED, Outputs
from fitting.inference.likelihood.knowledge import Adequacy, JointResult
from fitting.inference.sweeps import BACKGROUND_KEY, SweepFindings, SweepLine, line_findings
from fitting.lines.several import FEWEST, strongest_line
from fitting.measurements.complex_sweep import ComplexSweep
from fitting.measurements.dataset import Dataset
from fitting.measurements.sweep import Sweep
from fitting.signal.combinations import mixed_hz
from fitting.signal.peaks import DETECTION_SIGMA, unknown_line
from fitting.signal.residual_tests import NOTABLE
from fitting.signal.scale import laboratory_maximum
from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput
from fitting.text.estimate import FittedEstimate, OffsetEstimate, OutputEstimate, ParameterEstimate
from fitting.text.finding import Finding, Kind, note, of_kind, warning
from fitting.text.notation import hertz, settings_words
from fitting.text.units import convert


@dataclass(frozen=True, kw_only=True)
class Solved:
    """A fit, its values, and what is known of its residuals.

    Args:
        fit: a solved problem.
        solution: its reported end, errors as wide as the residuals require.
        best: most likely parameters, in their units, shape (n,).
        adequacy: whether the model describes the data; None: not examined.
        inflation: factor on all errors for residuals beyond the noise.
        describes: whether there are values: the fit converged and the model describes the data.
        is_best: whether a better fit than the descent from the start was searched for.
        sweeps: lines, faults and scale of the sweeps.
        parameters: their values, as they are reported, by name.
        derived: outputs of the FMU that follow from them, by name.
        offsets: values of single experiments.
        outputs: derived outputs at the solution and around; None: not evaluated.
        joint: tests of campaigns that are fitted together; None: there is one.
        equivalents: findings of other solutions that profiles met.
        profiles: findings of the profiles.
        causes: what one mistake of the measurement would explain.
        earlier: findings of the same fit before its profiles were scanned.
    """

    fit: Fit
    solution: Solution
    best: FloatArray
    adequacy: Adequacy | None = None
    inflation: float = 1.0
    describes: bool = True
    is_best: bool = True
    sweeps: SweepFindings = field(default_factory=SweepFindings)
    parameters: Mapping[str, ParameterEstimate] = field(default_factory=dict)
    derived: Mapping[str, OutputEstimate] = field(default_factory=dict)
    offsets: tuple[OffsetEstimate, ...] = ()
    outputs: Outputs | None = None
    joint: JointResult | None = None
    equivalents: tuple[Finding, ...] = ()
    profiles: tuple[Finding, ...] = ()
    causes: tuple[Finding, ...] = ()
    earlier: tuple[Finding, ...] = ()

    @property
    def values(self) -> dict[str, FittedEstimate]:
        """Parameters and derived outputs, by name."""
        return {**self.parameters, **self.derived}

    @property
    def every(self) -> dict[str, FittedEstimate]:
        """The same, and values of single experiments."""
        return {**self.values, **{offset.name: offset for offset in self.offsets}}

    @property
    def problem(self) -> Problem:
        """Parameters and measurements."""
        return self.fit.problem

    @property
    def data(self) -> Dataset:
        """All measurements, as they were fitted."""
        return self.solution.objective.data

    @cached_property
    def noise(self) -> RowNoise:
        """Noise of the rows at the solution, as stated or as they scatter."""
        return noise_of(self.solution.objective, self.solution.final)

    @cached_property
    def likeliest(self) -> Point:
        """The model at the most likely parameters.

        Raises:
            FmuFailure: the model failed there.
        """
        x = to_search(self.solution.parameters, self.best)
        [point] = evaluate_many(self.solution.objective, [x])
        return point


# --- solutions ------------------------------------------------------------------------------------

#: What a finding is about that is about all measurements.
EVERYTHING = "measurements"
#: Factor on errors from which it is worth a warning.
WORTH_TELLING = 1.5
#: Standard errors from which a parameter has another value at another minimum.
SIGMAS_APART = 4.0
#: Correlation of two errors from which it is strong.
CORRELATED = 0.95
#: Shares of the bounds' distance: within them a value lies on a bound, to the rounding of solvers,
#: or next to it.
ON_BOUND, NEAR_BOUND = 1e-6, 1e-3
#: Correlation from which two values are one: with the other known an error is 22 times as small.
ONE = 0.999
#: Standard error over the value, below which a value is good enough.
POOR = 0.02
#: Share of a derived value's error by the combination, from which it follows.
FOLLOWS = 0.9
#: Prefix of the error of a parameter with the other one known, among the numbers of a finding.
ALONE = "std_alone_"


# --- residuals ------------------------------------------------------------------------------------


def check_residuals(solved: Solved) -> Iterator[Finding]:
    """No convergence, residuals beyond the noise, residuals with a structure."""
    status, adequacy, structure = solved.fit.status, solved.adequacy, solved.solution.structure
    series = solved.problem.data.series
    if status is not Status.CONVERGED:
        yield Finding(kind=Kind.not_converged, severity="error", subject=subject_of(series))
    widening = 1.0 if structure is None else structure.widening
    by_rule = () if adequacy is None else residual_findings(adequacy, series, widening)
    keys = {"keys": background_keys(solved.data)}
    for finding in by_rule:
        correlates = finding.kind is Kind.correlated_residuals
        yield replace(finding, names={**finding.names, **keys}) if correlates else finding

    # errors that are scaled although the rule names no reason
    outliers = adequacy is not None and bool(adequacy.outliers)
    if not by_rule and solved.inflation > WORTH_TELLING and not outliers:
        if status is Status.INTERRUPTED:  # the search might have reduced the residuals
            yield warning(Kind.search_unfinished, "search", inflation=solved.inflation)
        elif solved.describes:
            yield warning(Kind.excess_residuals, EVERYTHING, inflation=solved.inflation)

    named = {finding.kind for finding in by_rule} & {Kind.correlated_residuals, Kind.not_described}
    if structure is None or structure.widening <= WORTH_TELLING or named:
        return
    data = solved.data
    # a noise in proportion to the amplitude could be stated, and is not
    can_state = any(isinstance(m, Sweep) and m.fitted and not m.known for m in data.measurements)
    correlated = structure.order > 0
    yield warning(
        Kind.correlated_residuals if correlated else Kind.heteroscedastic_residuals,
        subject_of(data.series),
        {"tests": (structure.departure,)} | (keys if correlated else {}),
        widening=structure.widening,
        points=structure.points,
        count=float(solved.solution.final.residuals[data.curve_rows].size),
        can_state=float(structure.is_unequal and can_state),
    )


def background_keys(data: Dataset) -> tuple[str, ...]:
    """Keys of a campaign by which a background of its curves would be fitted, where none is.

    Args:
        data: all measurements.
    """
    keys: list[str] = []
    for m in data.measurements:
        if isinstance(m, Sweep) and m.fitted and m.added == "none":
            keys += BACKGROUND_KEY
        elif isinstance(m, ComplexSweep) and any(c.wiring.background == "none" for c in m.records):
            keys.append(f"{m.table} background")
    return tuple(dict.fromkeys(keys))


def residual_findings(
    adequacy: Adequacy, series: Sequence[str], widening: float
) -> tuple[Finding, ...]:
    """The rule of `fitting.signal.misfit` as findings.

    Args:
        adequacy: whether the model describes the data.
        series: names of the series that were fitted together; empty: that of the only one.
        widening: factor on the errors of curves whose residuals are correlated.
    """
    every = {
        "chi_square": adequacy.chi_square,
        "freedom": adequacy.freedom,
        "p_value": adequacy.p_value,
        "correlated_p": adequacy.correlated_p,
        "share": adequacy.share,
        "scale_off": adequacy.scale_off,
    }
    numbers = {name: value for name, value in every.items() if math.isfinite(value)}
    subject = subject_of(series, adequacy.curve if adequacy.is_correlated else "")
    if not adequacy.describes:
        kind = Kind.not_described
        return (Finding(kind=kind, severity="error", subject=subject, numbers=numbers),)
    findings = []
    if adequacy.is_correlated:
        finding = warning if widening > NOTABLE else note
        kind = Kind.correlated_residuals
        findings.append(finding(kind, subject, None, **numbers, widening=widening))
    factor = adequacy.noise_factor
    if factor > 1.0 and adequacy.is_correlated:  # on another curve: what is wrong may be so here
        findings.append(warning(Kind.excess_residuals, EVERYTHING, inflation=factor))
    elif factor > 1.0 and adequacy.converged:  # else residuals are not noise alone
        kind, subject = Kind.noise_underestimated, subject_of(series)
        findings.append(warning(kind, subject, None, **numbers, factor=factor))
    return tuple(findings)


def subject_of(series: Sequence[str], curve: str = "") -> str:
    """What a finding is about: a curve, the only series, or all measurements.

    Args:
        series: names of all series, the only one mostly without.
        curve: that is named first.
    """
    names = [name for name in series if name]
    return curve or (names[0] if len(names) == 1 else EVERYTHING)


# --- solutions ------------------------------------------------------------------------------------


def check_bounds(solved: Solved) -> Iterator[Finding]:
    """Parameters at the end of the fit on a bound, or next to one."""
    solution = solved.solution
    for parameter, value in zip(solution.parameters, solution.final.parameters, strict=True):
        p, low, high = float(value), parameter.lower, parameter.upper
        bound = low if abs(p - low) <= abs(p - high) else high
        if abs(p - bound) >= parameter.near(bound, NEAR_BOUND):
            continue
        at_bound = abs(p - bound) <= parameter.near(bound, ON_BOUND)
        names = {"unit": (parameter.unit,)}
        numbers = {"value": p, "bound": bound, "at_bound": float(at_bound)}
        # where the model fails as well, the bound may be why
        report = note if solved.describes or not at_bound else warning
        yield report(Kind.at_bound, parameter.name, names, **numbers)


def check_correlation(solved: Solved) -> Iterator[Finding]:
    """Pairs of parameters of the whole campaign whose errors are strongly correlated."""
    if not solved.describes:
        return
    solution = solved.fit.solution
    parameters, covariance = solution.parameters, solution.errors.covariance
    shared = [k for k, p in enumerate(parameters) if not p.experiments]
    for k, i in enumerate(shared):
        for j in shared[:k]:
            rho = float(covariance[i, j] / np.sqrt(covariance[i, i] * covariance[j, j]))
            if abs(rho) >= CORRELATED:
                pair = (parameters[j].name, parameters[i].name)
                names = {"pair": pair}
                yield note(Kind.correlated_values, ", ".join(pair), names, correlation=rho)


def check_minima(solved: Solved) -> Iterator[Finding]:
    """Minima as low as the reported one at which a value that the data determine is another.

    Images of it by the model's symmetries are none, and along an open valley none counts.
    """
    outcome, solution = solved.fit.outcome, solved.fit.solution
    parameters, errors = solution.parameters, solution.errors
    shared = [p for p in parameters if not p.experiments]
    about = {"values": tuple(p.name for p in shared), "units": tuple(p.unit for p in shared)}
    by_data = np.array([errors.of(axis)[1] >= BY_DATA for axis in np.eye(len(parameters))])
    apart = SIGMAS_APART * np.sqrt(np.diag(errors.covariance))
    known = [outcome.x]
    for twin in outcome.twins:
        image = twin.of(parameters, outcome.x)
        known += [] if image is None else [image]
    periods = np.array([(p.period or np.inf) / p.scale for p in parameters])
    for k, minimum in enumerate(lowest(outcome.minima)):
        gap = np.mod(np.abs(np.array(known) - minimum.x), periods)
        if np.all(np.any(by_data & (np.minimum(gap, periods - gap) > apart), axis=1)):
            values = named(parameters, to_model(parameters, minimum.x))
            numbers = {"chi_square": minimum.chi_square} | {p.name: values[p.name] for p in shared}
            yield note(Kind.equal_objective, f"minimum {k + 1}", about, **numbers)
    described = solved.describes and solved.adequacy is not None
    if not (described or solved.causes or contradictions(solved.joint)):
        yield from search_findings(outcome)


def check_levels(solved: Solved) -> Iterator[Finding]:
    """Levels of Algorithm 2 that are not minimised: by the solver's own word or by a second solver.

    A level that ended at its limit of iterations, where the second solver comes by nothing lower,
    is a note: J is at its minimum, and the solver's own test did not report that.
    """
    history = solved.fit.path
    levels, above, gaps, at_limit = list[str](), list[str](), list[float](), 0
    for row in history:
        if row.level >= 0 and not row.is_minimised:
            levels.append(str(row.level))
            gaps.append(row.gap)
            at_limit += row.status != "converged"
            if row.gap > MINIMISED:
                above.append(str(row.level))
    if not levels:
        return
    numbers = {
        "levels": len(history) - 1.0,
        "at_limit": float(at_limit),
        "above": float(len(above)),
        "gap": max(gaps),
    }
    report = warning if above else note
    names = {"levels": tuple(levels), "above": tuple(above)}
    yield report(Kind.level_not_minimised, "Algorithm 2", names, **numbers)


def check_refusals(solved: Solved) -> Iterator[Finding]:
    """That the model fails in a part of the box, in its own words."""
    search = solved.fit.outcome.search
    if search is not None and search.refused:
        names = {"words": (search.refusal,)}
        yield note(Kind.points_refused, "search", names, points=float(search.refused))


def search_findings(outcome: Outcome) -> Iterator[Finding]:
    """That a search within the bounds found no minimum that noise would explain.

    Args:
        outcome: of one alternative, with its search.
    """
    search = outcome.search
    if search is None or search.explained:
        return
    low = lowest(outcome.minima)
    others = outcome.minima[len(low) :]
    numbers = {
        "points": float(search.screened),
        "lowest": float(sum(minimum.descents for minimum in low)),
        "descents": float(search.descents),
        "chi_square": low[0].chi_square,
    }
    if others:
        numbers["next_chi_square"] = others[0].chi_square
    yield warning(Kind.search_unexplained, "search", None, **numbers)


def check_alternatives(solved: Solved) -> Iterator[Finding]:
    """Equivalent solutions with their values, else alternatives that reach the same chi square."""
    yield from solved.equivalents
    for a in () if solved.equivalents else solved.fit.alternatives:
        if a.equal_to_best and not a.reported:
            yield note(Kind.equal_alternative, settings_words(a.settings))


def check_profiles(solved: Solved) -> Iterator[Finding]:
    """What the profiles met, of a model that describes the data."""
    if solved.describes:
        yield from solved.profiles


# --- combinations ---------------------------------------------------------------------------------


def check_combinations(solved: Solved) -> Iterator[Finding]:
    """Pairs of parameters of which the data determine little but one combination.

    The subject names both; derived values that follow are `following`. Numbers are the
    `correlation`, and of each parameter in SI units ``std_NAME`` and ``std_alone_NAME``, with the
    other one known.
    """
    if not solved.describes:
        return
    solution, errors = solved.solution, solved.solution.errors
    parameters, deviations = solution.parameters, np.sqrt(np.diag(errors.covariance))
    poor = []  # determined, but not well
    for i, p in enumerate(parameters):
        if p.name not in solved.parameters or not p.moves_model or p.experiments:
            continue
        std, shrinkage = errors.of(p.scale * np.eye(len(parameters))[i])
        if shrinkage >= DETERMINED and std > POOR * abs(float(solution.final.parameters[i])):
            poor.append(i)
    for i, j in combinations(poor, 2):
        rho = float(errors.covariance[i, j] / (deviations[i] * deviations[j]))
        if abs(rho) < ONE:
            continue
        numbers = {"correlation": rho}
        for p, deviation in ((parameters[k], deviations[k]) for k in (i, j)):
            std = float(p.scale * deviation) * in_base(p.unit, p.name)[0]
            alone = float(np.sqrt(max(1.0 - rho**2, 0.0))) * std
            numbers |= {f"std_{p.name}": std, f"{ALONE}{p.name}": alone}
        # derived values whose errors are those of this direction, a standard error long
        along, following = errors.covariance[:, i] / deviations[i], []
        outputs = solved.outputs
        for name in outputs.values[0] if outputs else ():
            gradient = outputs.gradient(name) if outputs else np.zeros(len(along))
            std = errors.of(gradient)[0] if np.all(np.isfinite(gradient)) else 0.0
            if std > 0.0 and abs(float(gradient @ along)) >= FOLLOWS * std:
                following.append(name)
        pair = parameters[i].name, parameters[j].name
        names = {"pair": pair, "following": tuple(following)}
        yield warning(Kind.combination, ", ".join(pair), names, **numbers)


# --- sweeps ---------------------------------------------------------------------------------------

#: Factors between the amplitudes of a sweep and of peaks, and what makes them.
FACTORS = {
    math.sqrt(2.0): "rms",
    math.sqrt(0.5): "rms",
    2.0: "peak_to_peak",
    0.5: "peak_to_peak",
}
#: Factors of a unit with a wrong prefix, and the ratio of bounds that imply a frequency.
PREFIXES = (1e3, 1e-3, 1e6, 1e-6)
NARROW = 10.0
#: How far lines of one experiment may be apart, relative.
NEAR = 0.2
#: Share of a curve's squared residuals that a line explains where it is missing in the model; and
#: height of a line of the model over its largest value.
MOSTLY, MODELLED = 0.5, 0.03
#: Highest order of mixtures of tones that explain a line of a spectrum.
MIXED_ORDER = 5
#: Weak peaks that are named one by one.
MOST_WEAK = 3
#: Share of the error by noise from which that by the simulation is reported.
WORTH_SAYING = 0.1
#: A drift of this share of the line width may be why a model does not describe the data: half of it
#: as a departure from a straight line moves a peak on the flank by some per cent.
SUSPECT = 0.1


# --- sweeps ---------------------------------------------------------------------------------------


def check_lines(solved: Solved) -> Iterator[Finding]:
    """What a reader of the sweeps must know: of their lines, of points and tops that no line has.

    Of one campaign; and points of files that are not fitted.
    """
    measurements, sweeps = solved.problem.measurements, solved.sweeps
    fitted = any(m.rows for m in measurements if m.is_curve)
    for line in () if solved.problem.is_joint else sweeps.lines.values():
        yield from line_findings(line, fitted=fitted)
    yield from sweeps.faults
    given: list[tuple[str, Sequence[Finding]]] = []
    for name, bound in solved.problem.campaigns.items():
        given += [(name, e.spectrum.left_out) for e in bound.experiments if e.spectrum is not None]
        given += [(name, bound.sweep.left_out)] if bound.sweep is not None else []
    given += [(m.series, m.left_out) for m in measurements]
    every = [replace(finding, subject=name) for name, findings in given for finding in findings]
    yield from (finding for finding in every if finding.kind is not Kind.other_columns)
    # of a file that several measurements read, the columns that none of them uses
    unused: dict[tuple[str, ...], Finding] = {}
    for finding in of_kind(tuple(every), Kind.other_columns):
        key = finding.subject, *finding.names["file"]
        known = unused.setdefault(key, finding).names["columns"]
        left = tuple(name for name in known if name in finding.names["columns"])
        unused[key] = replace(finding, names={**finding.names, "columns": left})
    listed: list[object] = [()]  # spectra of one instrument have the same columns
    for finding in unused.values():
        if finding.names["columns"] not in listed:
            yield finding
        listed.append(finding.names["columns"])


def check_agreement(solved: Solved) -> Iterator[Finding]:
    """Series whose peaks contradict their sweep, and the factor that would explain it."""
    for test in solved.sweeps.agreement:
        if not test.contradicts:
            continue
        numbers: dict[str, float] = {"sigmas": test.sigmas}
        if not math.isnan(test.factor):
            numbers |= {"factor": test.factor, "factor_std": test.factor_std}
        reasons = [
            why
            for value, why in FACTORS.items()
            if abs(test.factor / value - 1.0) < max(0.02, 3.0 * test.factor_std / value)
        ]
        names = {"reason": tuple(reasons[:1])}
        yield warning(Kind.scale_contradicted, test.series, names, **numbers)


def check_frequency_bounds(solved: Solved) -> Iterator[Finding]:
    """Bounds of a frequency that are a unit's prefix off the line of the sweep."""
    for name, line in solved.sweeps.lines.items():
        sweep = solved.problem.campaigns[name].sweep
        file = "" if sweep is None else sweep.source.name
        yield from bounds_off_line(solved.problem.parameters, line, file)


def bounds_off_line(
    parameters: tuple[Parameter, ...], line: SweepLine, file: str
) -> Iterator[Finding]:
    """The first frequency whose bounds are off the line by a prefix, if all are.

    Wide bounds, as those of a width, imply no frequency and do not count.

    Args:
        parameters: of the problem.
        line: of a sweep.
        file: of the sweep.
    """
    boxes = []
    for p in parameters:
        try:
            low, high = (convert(e, p.unit, "Hz", where=p.name) for e in (p.lower, p.upper))
        except BadInput:  # no frequency
            continue
        if 0.0 < low < high < NARROW * low:
            places = (f for f in PREFIXES if low <= f * line.frequency.value <= high)
            boxes.append((p.name, low, high, next(places, 0.0)))
    if boxes and all(factor for *_, factor in boxes):
        name, low, high, factor = boxes[0]
        numbers = {"frequency_hz": line.frequency.value, "lower_hz": low, "upper_hz": high}
        names = {"file": (file,)}
        yield warning(Kind.bounds_off_line, name, names, **numbers, factor=factor)


def check_frequencies(solved: Solved) -> Iterator[Finding]:
    """Frequencies of a sweep that are a unit's prefix off those of the experiments."""
    for name, line in solved.sweeps.lines.items():
        campaign = solved.problem.campaigns[name]
        tones = [float(f) for e in campaign.experiments for f in e.tones_hz]
        if campaign.sweep is None or not tones:
            continue
        here, other = line.frequency.value, float(np.median(tones))
        if np.any(np.abs(other / (np.array(PREFIXES) * here) - 1.0) < NEAR):
            names = {"file": (campaign.sweep.source.name,)}
            numbers = {"frequency_hz": here, "other_hz": other}
            yield warning(Kind.frequencies_apart, name, names, **numbers)


def check_unknown_lines(solved: Solved) -> Iterator[Finding]:
    """The largest line in the spectra at no tone of the drive, nor at a mixture of tones."""
    unknown = []
    for e in solved.problem.experiments:
        if e.spectrum is not None:
            known = (*e.tones_hz, *e.read_hz, *mixed_hz(e.tones_hz, MIXED_ORDER))
            line = unknown_line(e.spectrum.frequency_hz, e.spectrum.amplitude_v, known)
            if line is not None:
                unknown.append((e.label, e.spectrum.unit, *line))
    if unknown:
        label, unit, place, height = max(unknown, key=lambda each: each[3])
        numbers = {"count": float(len(unknown)), "frequency_hz": place, "height": height}
        yield warning(Kind.unknown_line, label, {"unit": (unit,)}, **numbers)


def check_missing_lines(solved: Solved) -> Iterator[Finding]:
    """The line of a curve that makes most of its residuals, where the model has no line itself.

    Of correlated residuals, or a model that does not describe the data, where no mistake of the
    measurement explains them; the largest line. A sweep that sets a scale alone has no residuals:
    there it is the sweep's own line.
    """
    adequacy = solved.adequacy
    if adequacy is None or (adequacy.describes and not adequacy.is_correlated) or solved.causes:
        return
    # it loads scipy.stats, which most fits need not
    from scipy.signal import find_peaks

    data, final, lines = solved.data, solved.solution.final, []

    def lacks(f: FloatArray, model: FloatArray, place: float, width: float) -> bool:
        # residuals about a line of the model, or a dip, are those of its own place and width
        least = MODELLED * float(np.max(model))
        tops = [*find_peaks(model, prominence=least)[0], *find_peaks(-model, prominence=least)[0]]
        return bool(np.all(np.abs(f[tops] - place) > width))

    for k, (m, at) in enumerate(zip(data.measurements, data.slices, strict=True)):
        if isinstance(m, Sweep) and not m.fitted and m.series in solved.sweeps.lines:
            own = solved.sweeps.lines[m.series]
            place, width = own.frequency.value, own.width.value
            if lacks(m.frequency_hz, np.abs(final.scaled[k]), place, width):
                lines.append((1.0, m.series, place, width, math.nan))
        for curve in m.residual_curves(final.residuals[at]):
            f = curve.axis[: curve.measured.size]  # complex values have every place twice
            if f.size < FEWEST:
                continue
            left, model = curve.measured - curve.model, np.abs(curve.model)
            line = strongest_line(f, left)
            if line is None or line[0] < MOSTLY * float(np.sum(np.abs(left) ** 2)):
                continue
            gain, place, width, _ = line
            if lacks(f, model, place, width):
                name = "/".join(filter(None, (m.series, curve.name)))
                size = gain / float(np.max(np.abs(curve.measured))) ** 2
                lines.append((size, name, place, width, gain / float(np.sum(np.abs(left) ** 2))))
    if lines:
        _, name, place, width, share = max(lines)
        numbers = {"frequency_hz": place, "width_hz": width}
        numbers |= {} if math.isnan(share) else {"removed": share}
        yield warning(Kind.line_missing, name, None, **numbers)


# --- the scale, and the simulation's error --------------------------------------------------------


def check_weak_peaks(solved: Solved) -> Iterator[Finding]:
    """Given peaks below what a reader of spectra refuses (`fitting.signal.peaks`)."""
    weak = [
        f"{e.label} at {hertz(tone)}"
        for e in solved.problem.experiments
        for tone, peak, sigma in zip(e.read_hz, e.peaks_v, e.sigmas_v, strict=True)
        if peak < DETECTION_SIGMA * sigma
    ]
    if weak:
        names = {"peaks": tuple(weak[:MOST_WEAK])}
        numbers = {"count": float(len(weak)), "threshold": DETECTION_SIGMA}
        yield warning(Kind.weak_peaks, "peaks", names, **numbers)


def check_scale(solved: Solved) -> Iterator[Finding]:
    """No scale, a measured maximum that Algorithm 1 cannot trust, a bias of the simulated one."""
    campaigns = tuple(solved.problem.campaigns.values())
    if len(campaigns) == 1:
        experiments, sweep = campaigns[0].experiments, campaigns[0].sweep
        has_gain = any(e.unknown == "gain" and e.phases_rad is not None for e in experiments)
        if sweep is None and experiments and not has_gain:
            yield note(Kind.scale_none, "scale")
        elif sweep is not None and sweep.scale in ("maximum", "grid"):
            maximum = laboratory_maximum(sweep.frequency_hz, sweep.amplitude_v)
            if maximum.on_edge:
                yield warning(Kind.scale_at_edge, "scale", frequency_hz=maximum.frequency_hz)
            elif math.isnan(maximum.bias):
                yield warning(Kind.scale_unknown, "scale", fall=maximum.fall)
            elif maximum.is_biased:
                yield warning(Kind.scale_biased, "scale", bias=maximum.bias)
    wanted = min((bound.setup.accuracy for bound in campaigns), default=math.inf)
    bias = solved.solution.final.scale_bias
    if bias > wanted:
        yield warning(Kind.scale_coarse, "scale", error=bias, accuracy=wanted)


def check_estimator(solved: Solved) -> Iterator[Finding]:
    """That the values are Algorithm 2's and the errors are not; values outside their intervals."""
    if solved.fit.options.estimator == LIKELIHOOD:
        return
    yield note(Kind.estimator, "values")
    for name, value in solved.every.items():
        if value.status.has_value and value.is_outside:
            low, high = value.ci95
            names = {"unit": (value.unit,)}
            numbers = {"value": value.value, "low": low, "high": high}
            yield warning(Kind.outside_interval, name, names, **numbers)


def check_simulation(solved: Solved) -> Iterator[Finding]:
    """Values of whose errors the simulation's own, or a doubtful scale, is a notable part."""
    scale_off, notable = solved.sweeps.scale_off, dict[str, FittedEstimate]()
    shifts = dict[str, float]()
    for name, value in solved.every.items():
        noise = value.std - value.simulation
        if value.status.has_value and value.simulation > WORTH_SAYING * noise:
            notable[name] = value
            shifts |= {name: value.simulation, f"{name}_noise": noise}
    if not notable:
        return
    # a doubtful scale is far more than the simulation's own error
    names = {"values": tuple(notable), "units": tuple(each.unit for each in notable.values())}
    if scale_off > 1.0:
        yield warning(Kind.scale_doubt, "sweep", names, **{"error": scale_off - 1.0} | shifts)
    else:
        error = max(solved.solution.final.promised)
        yield note(Kind.simulation_error, "simulation", names, **{"error": error} | shifts)


# --- drift ----------------------------------------------------------------------------------------


def check_drift(solved: Solved) -> Iterator[Finding]:
    """The drift of every campaign against the width of its sweep's line, else the declared one."""
    describes = solved.describes or bool(solved.causes)
    for name, bound in solved.problem.campaigns.items():
        labels = {e.label for e in bound.experiments}
        labels |= set() if bound.sweep is None else {bound.sweep.label}
        offsets = tuple(o for o in solved.offsets if o.experiments[0] in labels)
        line = solved.sweeps.lines.get(name)
        width_hz = math.nan if line is None else line.width.value
        if not width_hz > 0.0:
            width_hz = bound.setup.line_width_hz or math.nan
        yield from drift_findings(bound, offsets, width_hz, describes, name)
        yield from window_findings(bound, width_hz, name)


def drift_findings(
    bound: BoundCampaign,
    offsets: Sequence[OffsetEstimate],
    width_hz: float,
    describes: bool = True,
    subject: str = "",
) -> Iterator[Finding]:
    """Where the drift over the series, or an offset from it, exceeds the line width.

    Of a model that does not describe the data a smaller drift is named too: it may be the cause.

    Args:
        bound: campaign, bound to its FMU.
        offsets: values of single experiments.
        width_hz: full line width, Hz; NaN: not known.
        describes: whether the model describes the data.
        subject: name of the campaign where there are several.
    """
    if not width_hz > 0.0:
        return
    moved, wide, far = dict[str, float](), dict[str, float](), dict[str, float]()
    for name, (before, after) in bound.drift.ends.items():
        moved[name] = abs(after - before) * _in_hertz(bound.drift.units.get(name, "Hz"))
        if moved[name] > width_hz:
            wide[name] = moved[name]
    suspected = not (describes or offsets) and max(moved.values(), default=0.0) > SUSPECT * width_hz
    if wide or suspected:
        kind = Kind.drift_wide if wide else Kind.drift_suspected
        shown = wide or moved
        names = {"variables": tuple(shown), "offsets": tuple(o.name for o in offsets)}
        finding = note if describes else warning
        yield finding(kind, subject, names, **{"width_hz": width_hz} | shown)
    for o in offsets:
        size = abs(o.value) * _in_hertz(o.unit)
        if not math.isnan(o.prior) and size > width_hz:
            far[f"{o.experiments[0]} ({', '.join(o.variables)})"] = size
    if far:
        names = {"offsets": tuple(far)}
        yield warning(Kind.drift_offset_wide, subject, names, **{"width_hz": width_hz} | far)


def window_findings(bound: BoundCampaign, width_hz: float, subject: str = "") -> Iterator[Finding]:
    """What a prescribed window leaves of the transient, and reads of a tone at the next one.

    Args:
        bound: campaign, bound to its FMU.
        width_hz: full line width, Hz; NaN: not known.
        subject: name of the campaign where there are several.
    """
    window = bound.setup.window
    if window is None:
        return
    left = window.transient(width_hz)
    if left > bound.setup.accuracy:  # not of a width that is not known
        numbers = {"left": left, "settle_s": window.settle, "width_hz": width_hz}
        yield warning(Kind.transient_left, subject, **numbers)
    apart = np.concatenate([np.diff(np.sort(e.read_hz)) for e in bound.experiments])
    if apart.size and np.min(apart) * window.length < 1.0:
        distance_hz = float(np.min(apart))
        numbers = {"distance_hz": distance_hz, "leakage": window.leakage(distance_hz)}
        numbers["bin_hz"] = 1.0 / window.length
        yield warning(Kind.tones_unresolved, subject, **numbers)


def _in_hertz(unit: str) -> float:
    """Hertz per unit, zero where it is no frequency."""
    try:
        return convert(1.0, unit, "Hz", where="")
    except BadInput:
        return 0.0
