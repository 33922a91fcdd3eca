"""What a result assumes, and what its data know in combination only: a sentence each."""

from __future__ import annotations

import math

from fitting.campaign.laws import in_base
from fitting.inference.assumptions import SHIFT
from fitting.inference.combinations import ALONE
from fitting.result.result import Result
from fitting.text.finding import Finding, Kind
from fitting.text.notation import listed, number, prefixed, signed_number

#: Share of a standard error from which a shift is worth a word.
LEAST = 0.1


def assumption_sentences(result: Result) -> tuple[str, ...]:
    """A sentence for each assumption of the campaign, on the values that shift, derived ones first.

    Args:
        result: of a reconstruction.
    """
    found = (f for f in result.findings if f.kind is Kind.assumption)
    return tuple(_sentence(result, finding) for finding in found)


def combination_sentences(result: Result) -> tuple[str, ...]:
    """A sentence for each pair of parameters that the data know in one combination only.

    Args:
        result: of a reconstruction.
    """
    found = (f for f in result.findings if f.kind is Kind.combination)
    return tuple(_together(result, finding) for finding in found)


def _together(result: Result, finding: Finding) -> str:
    said = []
    for name, value in result.parameters.items():
        alone = finding.numbers.get(f"{ALONE}{name}")
        if alone is not None:
            alone /= in_base(value.unit, name).factor
            said.append(f"{name} to {shift_words(alone, value.unit).removeprefix('+')}")
    rho = number(finding.numbers["correlation"], 5)
    return (
        f"{finding.subject}: the data determine one combination (ρ = {rho}); with the other one "
        f"known they would determine {' and '.join(said)}. A measurement under other settings, in "
        "which both act otherwise, parts them."
    )


def _sentence(result: Result, finding: Finding) -> str:
    moved = []
    for name, value in {**result.derived, **result.parameters}.items():
        shift = finding.numbers.get(f"{SHIFT}{name}", math.nan)
        shift /= in_base(value.unit, name).factor
        if abs(shift) >= LEAST * value.std:
            moved.append(f"{name} by {shift_words(shift, value.unit)}")
    said = f"shift {listed(moved)}" if moved else "shift no value by a tenth of its standard error"
    rise = finding.numbers["chi_square"]
    return (
        f"{finding.subject} would {said} (χ² {'+' if rise >= 0.0 else '−'}{number(abs(rise), 2)})."
    )


def shift_words(shift: float, unit: str) -> str:
    """By how much a value would shift: "+32 kHz".

    Args:
        shift: in the unit.
        unit: of the value.
    """
    factor, shown = prefixed(abs(shift), unit)
    power = "× " if shown.startswith("10") else ""
    return f"{signed_number(shift / factor, 2)} {power}{shown}".rstrip()
