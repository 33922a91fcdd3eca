"""Residuals against the stated noise, and against no structure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from fitting.fit.fit import Status
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.inference.solved import Solved
from fitting.measurements.sweep import Sweep
from fitting.signal.residual_tests import NOTABLE
from fitting.text.finding import Finding, Kind, note, warning

#: What a finding is about that is about all measurements.
EVERYTHING = "measurements"
#: Factor on errors from which it is worth a warning.
WORTH_TELLING = 1.5


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
    if adequacy.noise_factor > 1.0:
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
