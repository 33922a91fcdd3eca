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
    found = [*_of_convergence(fit), *_of_residuals(fit, adequacy), *causes, *_of_pairs(joint)]
    order = ("error", "warning", "note")
    return tuple(sorted(found, key=lambda finding: order.index(finding.severity)))


def subject_of(fit: Fit, curve: str = "") -> str:
    """What a finding is about: a curve, the only series, or all measurements.

    Args:
        fit: a solved problem.
        curve: its name; empty: that of no single one.
    """
    series = [name for name in fit.problem.data.series if name]
    return curve or (series[0] if len(series) == 1 else EVERYTHING)


def _of_convergence(fit: Fit) -> Iterator[Finding]:
    if fit.status is not Status.CONVERGED:
        yield Finding(kind=Kind.not_converged, severity="error", subject=subject_of(fit))


def _of_residuals(fit: Fit, adequacy: Adequacy | None) -> Iterator[Finding]:
    if adequacy is None:
        return
    about = {"chi_square": adequacy.chi_square, "freedom": adequacy.freedom}
    about |= {"p_value": adequacy.p_value, "correlated_p": adequacy.correlated_p}
    numbers = _finite(about | {"share": adequacy.share, "scale_off": adequacy.scale_off})
    subject = subject_of(fit, adequacy.curve if adequacy.is_correlated else "")
    if not adequacy.describes:
        yield Finding(kind=Kind.not_described, severity="error", subject=subject, numbers=numbers)
        return
    if adequacy.is_correlated:
        wider = 1.0 if fit.solution.structure is None else fit.solution.structure.widening
        yield Finding(
            kind=Kind.correlated_residuals,
            severity="warning",
            subject=subject,
            numbers=numbers | {"widening": wider},
        )
    if adequacy.noise_factor > 1.0:
        yield Finding(
            kind=Kind.noise_underestimated,
            severity="warning",
            subject=subject_of(fit),
            numbers=numbers | {"factor": adequacy.noise_factor},
        )


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
