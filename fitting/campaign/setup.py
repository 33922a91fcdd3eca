"""Setup: how a series of measurements drives the FMU, and what it observes, in the FMU's units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field

from fitting.campaign.file import SAMPLES_PER_PERIOD
from fitting.campaign.laws import Laws
from fitting.fmu.accuracy import AccuracyAnnotation
from fitting.text.arguments import checked
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput


@checked
@dataclass(frozen=True, kw_only=True)
class Drive:
    """How tones drive the FMU: it drives itself by parameters of its own, or we drive an input.

    Without either there are no tones, as where all that was measured are traces.

    Args:
        frequency_names: Parameters of the FMU that hold the frequencies, one per tone.
        amplitude_names: Those that hold the amplitudes, one per tone.
        input: The input that is driven instead.
        amplitude: Of every tone that drives, in the unit of ``amplitude_names`` or ``input``.
        samples_per_period: How often ``input`` is set anew in a period.
        frequency_unit: Of ``frequency_names``, where the FMU declares none; empty: the FMU's.
        highest_order: Combinations of tones up to this order may be in the response.

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
            value = getattr(self, name)
            if isinstance(value, str):
                raise BadInput(f"drive: {name} is {value!r}, wanted a sequence of names")
            object.__setattr__(self, name, tuple(value))
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
    """How a series of measurements drives the FMU and what it observes, in the FMU's units.

    Args:
        drive: How the FMU is driven.
        output: The variable that is observed.
        start_values: Start values of every run by variable, none of them a fitted one.
        steady_start: Whether the FMU begins on its periodic orbit: then nothing has to settle.
        line_width_hz: Width of the narrowest line, Hz, which determines how long settling takes.
        accuracy: Wanted relative accuracy of simulated amplitudes, above 0 and below 1; none: a
            tenth of the noise of the data, or what the FMU can give, where that is less.
        annotation: What is known of the FMU's accuracy, and of what it may leave out.
        laws: Formulas that variables of the FMU follow.
        source: What complaints name it by.
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
    source: str = ""

    @property
    def usual_accuracy(self) -> bool:
        """Whether the accuracy was not requested."""
        return isinstance(self.accuracy, UsualAccuracy)
