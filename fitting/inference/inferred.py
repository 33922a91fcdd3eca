"""What is inferred of a fit, as a result has it too: values, how the fit ended, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from fitting.fit.fit import Status
from fitting.inference.joint import JointResult
from fitting.inference.likelihood.knowledge import Knowledge, Values
from fitting.inference.quadratures import Quadratures


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
