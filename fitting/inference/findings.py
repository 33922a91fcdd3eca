"""What a reader has to know of a fit, as records: decided here, from what was found of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from fitting.fit.fit import Fit, Status
from fitting.inference.consistency import contradictions, differs
from fitting.inference.joint_result import JointResult
from fitting.inference.likelihood.knowledge import Adequacy
from fitting.text.finding import Finding, Kind

#: What a finding is about that is about all of them.
EVERYTHING = "measurements"


def findings_of(
    fit: Fit, adequacy: Adequacy | None, joint: JointResult | None, causes: Sequence[Finding] = ()
) -> tuple[Finding, ...]:
    """Findings of a fit, errors first.

    Args:
        fit: a solved problem.
        adequacy: whether the model describes the data; None: nobody asked.
        joint: whether campaigns agree; None: there is one.
        causes: what may be why a model does not describe the data.
    """
    series, structure = fit.problem.data.series, fit.solution.structure
    widening = 1.0 if structure is None else structure.widening
    misfit = () if adequacy is None else residual_findings(adequacy, series, widening)
    found = [*_of_convergence(fit), *misfit, *causes, *_of_pairs(joint)]
    order = ("error", "warning", "note")
    return tuple(sorted(found, key=lambda finding: order.index(finding.severity)))


def _of_convergence(fit: Fit) -> Iterator[Finding]:
    if fit.status is not Status.CONVERGED:
        subject = _subject(fit.problem.data.series)
        yield Finding(kind=Kind.not_converged, severity="error", subject=subject)


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
        found.append(
            Finding(kind=kind, severity="warning", subject=subject, numbers=numbers | more)
        )
    if adequacy.noise_factor > 1.0:
        kind, more = Kind.noise_underestimated, {"factor": adequacy.noise_factor}
        subject = _subject(series)
        found.append(
            Finding(kind=kind, severity="warning", subject=subject, numbers=numbers | more)
        )
    return tuple(found)


def _subject(series: Sequence[str], curve: str = "") -> str:
    """What a finding is about: a curve, the only series, or all measurements."""
    named = [name for name in series if name]
    return curve or (named[0] if len(named) == 1 else EVERYTHING)


def _of_pairs(joint: JointResult | None) -> Iterator[Finding]:
    odd = differs(joint)
    for pair in contradictions(joint):
        yield Finding(
            kind=Kind.contradiction,
            severity="warning",
            subject=odd or f"{pair.one}, {pair.other}",
            numbers={"sigmas": pair.sigmas, "chi_square": pair.chi_square},
        )


def _finite(numbers: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in numbers.items() if math.isfinite(value)}
