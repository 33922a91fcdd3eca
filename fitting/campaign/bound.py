"""A campaign in the names and units of one FMU: experiments, sweep, drift, and all of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from fitting.campaign.file import CampaignHead
from fitting.campaign.kind import BoundMeasurement
from fitting.campaign.laws import Law
from fitting.campaign.measured import MeasuredSweep, Peaks
from fitting.campaign.noise import Noise
from fitting.campaign.parameters import Parameter
from fitting.campaign.setup import Setup
from fitting.signal.single_points import single_points
from fitting.text.arrays import FloatArray, Scalar


@dataclass(frozen=True, kw_only=True)
class Experiment(Peaks):
    """One experiment, ``settings`` in the FMU's units (tones and interpolated drift included).

    ``output`` is the FMU output that is observed (the campaign's, where empty).
    """

    settings: Mapping[str, Scalar]
    output: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class SweepData(MeasuredSweep):
    """The FRF sweep, ``settings`` in the FMU's units; what it serves in ``use``, ``scale``.

    ``setting_sigma`` are declared errors of settings; ``label`` is what values of its own are named
    by, empty where it has none.
    """

    settings: Mapping[str, Scalar]
    use: str
    scale: str
    background: str = "none"
    setting_sigma: Mapping[str, float] = field(default_factory=dict)
    label: str = ""

    @cached_property
    def far_off(self) -> tuple[tuple[int, float], ...]:
        """Single points that no line of its grid makes: number, and what would be likely there."""
        found = single_points(self.frequency_hz, self.amplitude_v)
        return tuple((k, abs(there)) for k, there in found)

    @cached_property
    def of_line(self) -> tuple[FloatArray, FloatArray]:
        """Frequencies, Hz, and amplitudes, of ``unit``, of the points that may be its line's."""
        away = [k for k, _ in self.far_off]
        return np.delete(self.frequency_hz, away), np.delete(self.amplitude_v, away)


@dataclass(frozen=True)
class Drift:
    """Variables that move over a series: ``ends`` (before, after) and ``units`` by variable."""

    ends: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Assumption:
    """One assumption, bound to the FMU.

    Args:
        that: what is assumed, in words.
        otherwise: what might be instead, in words.
        setup: the campaign's with that instead; None where ``start`` says it.
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
    ``taken`` are start values that nobody measured, with their units, ``assumptions`` what might be
    otherwise.
    """

    path: Path
    setup: Setup
    experiments: tuple[Experiment, ...]
    sweep: SweepData | None
    parameters: tuple[Parameter, ...]
    derived: tuple[str, ...]
    alternatives: tuple[Mapping[str, Scalar], ...]
    amplitude_unit: str
    notes: tuple[str, ...]
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
