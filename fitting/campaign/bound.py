"""A campaign in the names and units of one FMU: its drift, its assumptions, and all of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fitting.campaign.file import CampaignHead
from fitting.campaign.kind import BoundMeasurement
from fitting.campaign.laws import Law
from fitting.campaign.measured import Experiment, SweepData
from fitting.campaign.noise import Noise
from fitting.campaign.parameters import Parameter
from fitting.campaign.setup import Setup
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.finding import Finding

#: Positions in a series may leave it by so much.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Drift:
    """Variables that move over a series: ``ends`` (before, after) and ``units`` by variable.

    ``positions`` (n,) of the experiments between the ends, 0 to 1; ``parameters`` correct them.

    Raises:
        BadInput: ends that are not finite, positions that are not from 0 to 1.
    """

    ends: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    positions: tuple[float, ...] = ()
    parameters: tuple[Parameter, ...] = ()

    def __post_init__(self) -> None:
        for name, (before, after) in self.ends.items():
            if not (math.isfinite(before) and math.isfinite(after)):
                raise BadInput(
                    f"drift of {name}: from {before:g} to {after:g}, wanted finite values"
                )
        if not all(-ROUNDING <= place <= 1.0 + ROUNDING for place in self.positions):
            shown = ", ".join(f"{place:g}" for place in self.positions)
            raise BadInput(f"drift: positions {shown} of the experiments, wanted them from 0 to 1")


@dataclass(frozen=True, kw_only=True)
class Assumption:
    """One assumption, bound to the FMU.

    Args:
        that: what is assumed, in words.
        otherwise: what might be instead, in words.
        setup: the campaign's with that instead; None where ``start`` states it.
        start: formulas of parameters, by name, from whose values the fit is repeated.
    """

    that: str
    otherwise: str
    setup: Setup | None = None
    start: Mapping[str, Law] = field(default_factory=dict)

    @property
    def words(self) -> str:
        """Both, as the subject of a sentence has them."""
        return f"{self.that}; {self.otherwise}"


@dataclass(frozen=True, kw_only=True)
class BoundCampaign(CampaignHead):
    """A campaign that fits one FMU: every name exists there, every number is in its unit.

    ``alternatives`` holds one mapping per combination (one empty mapping without any);
    ``amplitude_unit`` is the detector's; ``noise`` is the declared one; ``notes`` are sentences for
    the report; ``files`` all files read; ``measurements`` those of further kinds, by their tables;
    ``taken`` are start values that were not measured, with their units, ``assumptions`` what might
    be otherwise.
    """

    path: Path
    setup: Setup
    experiments: tuple[Experiment, ...]
    sweep: SweepData | None
    parameters: tuple[Parameter, ...]
    derived: tuple[str, ...]
    alternatives: tuple[Mapping[str, Scalar], ...]
    amplitude_unit: str
    notes: tuple[Finding, ...] = ()
    files: tuple[Path, ...]
    drift: Drift = field(default_factory=Drift)
    noise: Noise = field(default_factory=Noise)
    measurements: Mapping[str, BoundMeasurement] = field(default_factory=dict)
    taken: Mapping[str, str] = field(default_factory=dict)
    assumptions: tuple[Assumption, ...] = ()

    @property
    def offsets(self) -> tuple[Parameter, ...]:
        """What is added to variables in experiments, without what is in a sweep."""
        labels = {e.label for e in self.experiments}
        return tuple(p for p in self.parameters if p.adds_to and p.experiment in labels)
