"""Residuals of a solution, other solutions, values at bounds, and errors that are correlated.

With the covariance C of the linearised fit two parameters have the correlation

    rho = C_ij/sqrt(C_ii C_jj)

and, with the other one known, an error sqrt(1 - rho^2) times as large. Near one in magnitude the
data determine a combination of both, as the product of a gain and the sine of an angle, and neither
alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from fitting.campaign.laws import in_base
from fitting.campaign.parameters import to_model
from fitting.fit.alternative import Outcome
from fitting.fit.fit import Status
from fitting.fit.linearisation import DETERMINED as HELD
from fitting.fit.path import MINIMISED, named
from fitting.fit.search import lowest
from fitting.inference.estimates import DETERMINED
from fitting.inference.joint import contradictions
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.inference.solved import Solved
from fitting.measurements.sweep import Sweep
from fitting.signal.residual_tests import NOTABLE
from fitting.text.finding import Finding, Kind, note, warning
from fitting.text.notation import settings_words

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
    yield from by_rule

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
        {"tests": (structure.departure,)},
        widening=structure.widening,
        points=structure.points,
        count=float(solved.solution.final.residuals[data.curve_rows].size),
        can_state=float(structure.is_unequal and can_state),
    )


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
    if adequacy.noise_factor > 1.0 and adequacy.converged:  # else residuals are not noise alone
        kind, subject = Kind.noise_underestimated, subject_of(series)
        findings.append(warning(kind, subject, None, **numbers, factor=adequacy.noise_factor))
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
        p = float(value)
        bound = min(parameter.lower, parameter.upper, key=lambda end: abs(p - end))
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
    """Minima as low as the reported one at which a value that the data hold is another.

    Images of it by the model's symmetries are none, and along an open valley nothing is held.
    """
    outcome, solution = solved.fit.outcome, solved.fit.solution
    parameters, errors = solution.parameters, solution.errors
    shared = [p for p in parameters if not p.experiments]
    about = {"values": tuple(p.name for p in shared), "units": tuple(p.unit for p in shared)}
    held = np.array([errors.of(axis)[1] >= HELD for axis in np.eye(len(parameters))])
    apart = SIGMAS_APART * np.sqrt(np.diag(errors.covariance))
    images = [twin.of(parameters, outcome.x) for twin in outcome.twins]
    known = np.array([outcome.x, *(image for image in images if image is not None)])
    periods = np.array([(p.period or np.inf) / p.scale for p in parameters])
    for k, minimum in enumerate(lowest(outcome.minima)):
        gap = np.mod(np.abs(known - minimum.x), periods)
        if np.all(np.any(held & (np.minimum(gap, periods - gap) > apart), axis=1)):
            values = named(parameters, to_model(parameters, minimum.x))
            numbers = {"chi_square": minimum.chi_square} | {p.name: values[p.name] for p in shared}
            yield note(Kind.equal_objective, f"minimum {k + 1}", about, **numbers)
    described = solved.describes and solved.adequacy is not None
    if not (described or solved.causes or contradictions(solved.joint)):
        yield from search_findings(outcome)


def check_levels(solved: Solved) -> Iterator[Finding]:
    """Levels of Algorithm 2 that are not minimised: by the solver's own word or by a second solver.

    A level that ended at its limit of iterations, where the second solver comes by nothing lower,
    is a note: J is at its minimum, and the solver's own test has not said so.
    """
    history = solved.fit.path
    levels = [row for row in history if row.level >= 0 and not row.is_minimised]
    if not levels:
        return
    above = [row for row in levels if row.gap > MINIMISED]
    numbers = {
        "levels": len(history) - 1.0,
        "at_limit": float(sum(row.status != "converged" for row in levels)),
        "above": float(len(above)),
        "gap": max(row.gap for row in levels),
    }
    names = {
        "levels": tuple(str(row.level) for row in levels),
        "above": tuple(str(row.level) for row in above),
    }
    said = warning if above else note
    yield said(Kind.level_not_minimised, "Algorithm 2", names, **numbers)


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
