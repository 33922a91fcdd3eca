"""The list of checks of a fit: each reads one record and yields findings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from fitting.inference.checks.assumptions import check_assumed_values, check_assumptions
from fitting.inference.checks.mistakes import (
    causes_of,
    check_exchanged_peaks,
    check_peaks,
    check_phases,
)
from fitting.inference.checks.solutions import (
    check_alternatives,
    check_bounds,
    check_combinations,
    check_correlation,
    check_levels,
    check_minima,
    check_profiles,
    check_refusals,
    check_residuals,
)
from fitting.inference.checks.sweeps import (
    check_agreement,
    check_drift,
    check_estimator,
    check_frequencies,
    check_frequency_bounds,
    check_lines,
    check_scale,
    check_simulation,
    check_unknown_lines,
    check_weak_peaks,
)
from fitting.inference.joint import pair_findings
from fitting.inference.solved import Solved
from fitting.text.finding import SEVERITIES, Finding

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
