"""What a reader has to know of a result, as a record: decided once, where the numbers are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

Severity = Literal["error", "warning", "note"]


class Kind(StrEnum):
    """Kinds of findings. An error withdraws the values; a warning asks the reader to act."""

    not_described = "not_described"
    correlated_residuals = "correlated_residuals"
    noise_underestimated = "noise_underestimated"
    not_converged = "not_converged"
    outlier = "outlier"
    contradiction = "contradiction"
    gain = "gain"
    offset = "offset"
    shift = "shift"
    noise_level = "noise_level"
    drift_exchanged = "drift_exchanged"
    equivalent_solution = "equivalent_solution"
    posterior_incomplete = "posterior_incomplete"
    posterior_unchecked = "posterior_unchecked"
    assumption = "assumption"
    combination = "combination"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One finding.

    Args:
        kind: what was found.
        severity: "error" where values cannot be given, "warning" where the reader must act.
        subject: the measurement, parameter or file that it is about.
        numbers: what a sentence about it needs, by name, in SI units. Of an assumption
            ``shift_NAME``, by which the value NAME would shift, and ``chi_square``, its rise; of a
            combination the ``correlation``, ``std_NAME`` and ``std_alone_NAME``, with the other
            parameter known.
    """

    kind: Kind
    severity: Severity
    subject: str
    numbers: Mapping[str, float] = field(default_factory=dict)
