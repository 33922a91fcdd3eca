"""What is inferred of a fit, as a result has it too: values, how the fit ended, and why."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

from fitting.fit.fit import Status
from fitting.inference.joint import JointResult
from fitting.inference.likelihood.knowledge import Knowledge, Values
from fitting.inference.quadratures import Quadratures
from fitting.text.estimate import FittedEstimate, Verdict
from fitting.text.rendering import phrase

Fitted = TypeVar("Fitted", bound=FittedEstimate)


@dataclass(frozen=True, kw_only=True)
class Inferred(Values):
    """Values of a fit, how it ended, and what was found besides."""

    status: Status
    """How the fit ended, and whether its model describes the data."""
    message: str
    """What `status` means here, a sentence."""
    knowledge: Knowledge | None = None
    """What the data determine beside values: profiles, directions, other minima."""
    joint: JointResult | None = None
    """Several series: what they say alone, together and of each other."""
    quadratures: Quadratures = field(default_factory=Quadratures)
    """What was solved inside complex sweeps, and quality factors behind a wiring."""
    chi_square: float = math.nan
    """Of the rows of known noise at the most likely point; NaN where nothing was tested."""
    dof: float = math.nan
    """Its degrees of freedom."""


def judged(
    values: Mapping[str, Fitted],
    profiled: Mapping[str, FittedEstimate],
    apart: Mapping[str, str],
    why_not: str,
) -> dict[str, Fitted]:
    """Values with status, error and intervals of their profiles, where these were scanned.

    Args:
        values: with the errors of the linearised problem, by name.
        profiled: with those of their profiles.
        apart: why single values have none, by name.
        why_not: why none has any; empty: the fit converged and the model describes the data.
    """
    made = {}
    for name, value in values.items():
        known, why = profiled.get(name), apart.get(name, why_not)
        if known is not None:
            value = replace(
                value,
                std=known.std,
                ci68=known.ci68,
                ci95=known.ci95,
                shrinkage=known.shrinkage,
                status=known.status,
                simulation=known.simulation,
                reason=known.reason,
                method=known.method,
                closed_by=known.closed_by,
                active_bounds=known.active_bounds,
            )
        made[name] = value.withdrawn(why) if why else value
    return made


def on_bounds(values: Mapping[str, Fitted], held: tuple[str, ...]) -> dict[str, Fitted]:
    """Linearised values at a most likely point that bounds hold: without errors.

    The data would move on, and how far other values go along is not known without scans.

    Args:
        values: by name.
        held: parameters that the data would move beyond their bounds.
    """
    made = dict(values)
    for name, value in values.items():
        if held and value.status is Verdict.LINEARISED:
            reason = phrase("status", "on_bound", held)
            made[name] = replace(
                value, status=Verdict.UNKNOWN, std=math.nan, reason=reason, active_bounds=held
            )
    return made
