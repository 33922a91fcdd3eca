"""A campaign in the names and units of one FMU: how it is driven, its drift, and all of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path

from fitting.campaign.file import SAMPLES_PER_PERIOD, CampaignHead
from fitting.campaign.kind import BoundMeasurement
from fitting.campaign.laws import Law, Laws
from fitting.campaign.measured import Experiment, SweepData
from fitting.campaign.noise import Noise
from fitting.campaign.parameters import Parameter
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.signal.prescribed import PrescribedWindow
from fitting.text.arguments import checked
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.finding import Finding


@dataclass(frozen=True)
class Drift:
    """Variables that move over a series: ``ends`` (before, after) and ``units`` by variable.

    ``positions`` (n,) of the experiments between the ends, 0 to 1; ``parameters`` correct them.
    """

    ends: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    positions: tuple[float, ...] = ()
    parameters: tuple[Parameter, ...] = ()


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


@checked
@dataclass(frozen=True, kw_only=True)
class Drive:
    """How tones drive the FMU: by parameters of its own, or through an input; else none do.

    Args:
        frequency_names: Parameters of the FMU for frequencies, one per tone.
        amplitude_names: Parameters for amplitudes, one per tone.
        input: The driven input instead.
        amplitude: Of every tone, in the unit of ``amplitude_names`` or ``input``.
        samples_per_period: Held values of ``input`` per period.
        frequency_unit: Of ``frequency_names``; empty: the FMU's.
        highest_order: Highest order of combinations of tones in the response.

    Raises:
        BadInput: both parameters and an input; numbers that no drive has.
    """

    frequency_names: tuple[str, ...] = ()
    amplitude_names: tuple[str, ...] = ()
    input: str | None = None
    amplitude: float = 1.0
    samples_per_period: int = SAMPLES_PER_PERIOD
    frequency_unit: str = ""
    highest_order: int = 1

    def __post_init__(self) -> None:
        for name in ("frequency_names", "amplitude_names"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if self.input is None and len(self.amplitude_names) != len(self.frequency_names):
            raise BadInput(
                f"drive: {len(self.amplitude_names)} amplitude_names, wanted "
                f"{len(self.frequency_names)}, one per frequency"
            )
        if self.input is not None and self.amplitude_names:
            raise BadInput(f"drive: amplitude_names have no meaning for the input '{self.input}'")
        if not 0.0 <= self.amplitude < math.inf:
            raise BadInput(f"drive: amplitude is {self.amplitude!r}, wanted an amplitude")

    @property
    def tone_unit(self) -> str:
        """Unit of ``frequency_names``; Hz where none is stated."""
        return self.frequency_unit or "Hz"

    @property
    def kind(self) -> str:
        """What makes the tones: "tones", the FMU; "input", its input is driven; "none": nothing."""
        if self.input is not None:
            return "input"
        return "tones" if self.frequency_names else "none"


class UsualAccuracy(float):
    """An accuracy that was not requested: a plan takes that for the noise of the data."""


#: Wanted relative accuracy of simulated amplitudes where none is requested and no noise is known.
USUAL_ACCURACY = UsualAccuracy(1e-6)


@checked
@dataclass(frozen=True)
class Setup:
    """How a series of measurements drives and observes the FMU, in the FMU's units.

    Args:
        drive: How the FMU is driven.
        output: The observed variable.
        start_values: Start values of every run by variable, none of them fitted.
        steady_start: Whether the FMU starts on its periodic orbit, without settling.
        line_width_hz: FWHM of the narrowest line, Hz, for settling.
        accuracy: Relative accuracy of simulated amplitudes, in (0, 1).
        annotation: The FMU's accuracy and reductions.
        laws: Formulas that variables of the FMU follow.
        window: Samples of tones from rest on, read by a Fourier transform; None: planned.
        source: Its name in errors.
    """

    drive: Drive
    output: str
    _: KW_ONLY
    start_values: Mapping[str, Scalar] = field(default_factory=dict)
    steady_start: bool = False
    line_width_hz: float | None = None
    accuracy: float = USUAL_ACCURACY
    annotation: AccuracyAnnotation = field(default_factory=AccuracyAnnotation)
    laws: Laws = field(default_factory=Laws)
    window: PrescribedWindow | None = None
    source: str = ""

    @property
    def usual_accuracy(self) -> bool:
        """Whether the accuracy was not requested."""
        return isinstance(self.accuracy, UsualAccuracy)
