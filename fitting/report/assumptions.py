"""Shifts by assumptions, and errors with one parameter of a pair known, in the units of values."""

from __future__ import annotations

import math

from fitting.campaign.laws import in_base
from fitting.inference.checks.assumptions import SHIFT
from fitting.inference.checks.solutions import ALONE
from fitting.result.result import Result
from fitting.text.finding import Finding
from fitting.text.rendering import with_prefix

#: Share of a standard error from which a shift is listed.
LEAST = 0.1


def shifts_of(result: Result, finding: Finding) -> list[str]:
    """Values that an assumption would shift, derived ones first: "lambda by +32 kHz".

    Args:
        result: of a reconstruction.
        finding: an assumption with its shifts in SI units.
    """
    shifts = []
    for name, value in {**result.derived, **result.parameters}.items():
        shift = finding.numbers.get(f"{SHIFT}{name}", math.nan) / in_base(value.unit, name)[0]
        if abs(shift) >= LEAST * value.std:
            shifts.append(f"{name} by {with_prefix(shift, value.unit, 2, signed=True)}")
    return shifts


def alone_of(result: Result, finding: Finding) -> list[str]:
    """Errors of parameters with the other one of a pair known: "d1 to 1.2 Hz".

    Args:
        result: of a reconstruction.
        finding: a combination with its errors in SI units.
    """
    errors = {n: finding.numbers.get(f"{ALONE}{n}") for n in result.parameters}
    return [
        f"{n} to {with_prefix(e / in_base(p.unit, n)[0], p.unit, 2)}"
        for n, p in result.parameters.items()
        if (e := errors[n]) is not None
    ]
