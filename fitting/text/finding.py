"""What a reader has to know of a result, as a record: decided once, where the numbers are.

Sentences are made at the edge, from a template with a block for each kind (`text.rendering`). What
each kind means, and what to do about it, is what ``fmu-fit help findings`` prints.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from typing import Literal

Severity = Literal["error", "warning", "note"]
#: Severities, the most urgent first.
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")


class Kind(StrEnum):
    """Kinds of findings. An error withdraws the values; a warning asks the reader to act."""

    # how the fit ended
    not_converged = "not_converged"
    search_unfinished = "search_unfinished"
    not_described = "not_described"
    profiles_missing = "profiles_missing"
    profiles_incomplete = "profiles_incomplete"
    profiles_limited = "profiles_limited"
    # residuals and noise
    correlated_residuals = "correlated_residuals"
    heteroscedastic_residuals = "heteroscedastic_residuals"
    noise_underestimated = "noise_underestimated"
    excess_residuals = "excess_residuals"
    # what one mistake in the laboratory would explain
    outlier = "outlier"
    gain = "gain"
    offset = "offset"
    shift = "shift"
    noise_level = "noise_level"
    drift_exchanged = "drift_exchanged"
    peaks_exchanged = "peaks_exchanged"
    phases_misread = "phases_misread"
    bounds_off_line = "bounds_off_line"
    frequencies_apart = "frequencies_apart"
    weak_peaks = "weak_peaks"
    unknown_line = "unknown_line"
    line_missing = "line_missing"
    points_left_out = "points_left_out"
    # the sweep and the scale
    sweep_power = "sweep_power"
    sweep_saturated = "sweep_saturated"
    sweep_clipped = "sweep_clipped"
    sweep_outlier = "sweep_outlier"
    sweep_background = "sweep_background"
    sweep_point = "sweep_point"
    line_residuals = "line_residuals"
    line_background = "line_background"
    scale_none = "scale_none"
    scale_at_edge = "scale_at_edge"
    scale_unknown = "scale_unknown"
    scale_biased = "scale_biased"
    scale_coarse = "scale_coarse"
    scale_contradicted = "scale_contradicted"
    # drift
    drift_wide = "drift_wide"
    drift_suspected = "drift_suspected"
    drift_offset_wide = "drift_offset_wide"
    # campaigns that are fitted together
    contradiction = "contradiction"
    tension = "tension"
    disagreement_unsearched = "disagreement_unsearched"
    # other solutions
    equivalent_solution = "equivalent_solution"
    equal_alternative = "equal_alternative"
    equal_objective = "equal_objective"
    level_not_minimised = "level_not_minimised"
    search_unexplained = "search_unexplained"
    points_refused = "points_refused"
    sampling_ambiguity = "sampling_ambiguity"
    interval_at_bound = "interval_at_bound"
    # what values rest on
    assumption = "assumption"
    assumed_value = "assumed_value"
    combination = "combination"
    correlated_values = "correlated_values"
    at_bound = "at_bound"
    estimator = "estimator"
    outside_interval = "outside_interval"
    simulation_error = "simulation_error"
    scale_doubt = "scale_doubt"
    posterior_incomplete = "posterior_incomplete"
    posterior_unchecked = "posterior_unchecked"
    # how a file was read
    file_read = "file_read"
    file_remark = "file_remark"
    other_columns = "other_columns"
    values_converted = "values_converted"
    rows_sorted = "rows_sorted"
    rows_dropped = "rows_dropped"
    rows_averaged = "rows_averaged"
    part_taken = "part_taken"
    zero_frequency = "zero_frequency"
    phases_reversed = "phases_reversed"
    demodulated_at = "demodulated_at"
    point_excluded = "point_excluded"
    top_excluded = "top_excluded"
    # the FMU and the plan
    fmu_warning = "fmu_warning"
    not_periodic = "not_periodic"
    model_exchange_offered = "model_exchange_offered"
    model_exchange_taken = "model_exchange_taken"
    output_late = "output_late"
    accuracy_missed = "accuracy_missed"
    accuracy_forced = "accuracy_forced"
    transient_left = "transient_left"
    tones_unresolved = "tones_unresolved"
    # how a campaign was bound to its FMU
    unit_undeclared = "unit_undeclared"
    unit_assumed = "unit_assumed"
    amplitudes_converted = "amplitudes_converted"
    stated_exactly = "stated_exactly"
    law_followed = "law_followed"
    starts_differ = "starts_differ"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One finding.

    Args:
        kind: of finding.
        severity: "error": there are no values; "warning": the reader must act.
        subject: a measurement, parameter or file.
        numbers: of its sentence by name, in SI units or ``names`` "unit". Of an assumption
            ``shift_NAME`` and the rise ``chi_square``; of a combination ``correlation``,
            ``std_NAME`` and ``std_alone_NAME``.
        names: of its sentence: parameters, units, labels or files.
    """

    kind: Kind
    severity: Severity
    subject: str
    numbers: Mapping[str, float] = field(default_factory=dict)
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def _finding(
    severity: Severity,
    kind: Kind,
    subject: str = "",
    names: Mapping[str, tuple[str, ...]] | None = None,
    /,
    **numbers: float,
) -> Finding:
    """A finding of its kind, subject, names and numbers, as the record explains them."""
    return Finding(
        kind=kind, severity=severity, subject=subject, numbers=numbers, names=dict(names or {})
    )


#: A finding that asks nothing of the reader, and one that the reader must act on.
note, warning = partial(_finding, "note"), partial(_finding, "warning")


def left_out(file: str, count: int, *places: str, **numbers: float) -> Finding:
    """Points of a file that are not fitted: at zero frequency, or of a top that is cut off.

    Args:
        file: that they are in.
        count: how many there are.
        *places: of the first, and of the last one.
        **numbers: the ``limit`` that cut them off, ``low_hz`` and ``high_hz`` where they are.
    """
    names = {"file": (file,), "places": places}
    return warning(Kind.points_left_out, "", names, count=float(count), **numbers)


def of_kind(findings: tuple[Finding, ...], *kinds: Kind) -> tuple[Finding, ...]:
    """The findings of some kinds, in their order.

    Args:
        findings: of a result.
        kinds: that are wanted.
    """
    return tuple(finding for finding in findings if finding.kind in kinds)
