"""What an FMU offers a measurement, and where its parameters start, with bounds about that.

Guesses go by units, causality and variability first, then by usual names and by descriptions. None
of them is trusted: each is printed, and can be chosen otherwise.

One rule for start values and bounds: a value whose reach is known lies within it, any other one
within a tenth of its start and ten times that, a strength of unknown sign on both sides of zero.
A frequency starts at its line and reaches widths from it, no further than to the middle between
two lines; a width starts at that of the line. A parameter that is no frequency starts where an
output of the FMU in hertz is that of the line, by Newton's step in logarithms:

    ln p' = ln p + (ln f - ln o(p))/s        s = d ln o/d ln p, by a small step
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from fitting import Fmu
from fitting.campaign.parameters import ParameterTable
from fitting.extension.fmu import FmuVariable, Run
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.units import convert, same_kind

#: The models of this project that are one resonance, and two.
ONE_MODE, TWO_MODES = "CoupledModes1", "CoupledModes2"
#: The parameter that couples the two, and the one that weighs the upper mode against the lower.
COUPLING: Final = "lambda12"
STRENGTH: Final = "g2"
#: Start values of an FMU by name, each with its reason; those that make two lines two modes.
Starts = dict[str, tuple[Scalar, str]]
UNCOUPLED: Starts = {
    COUPLING: (0.0, "each line is a mode of its own: they do not determine a coupling"),
    "readout2": (1.0, "the detector sees both modes"),
}
#: Why an output is the default, and why a parameter that is not fitted has its value.
FIRST_OUTPUT = "the first one with continuous values"
OWN = "the FMU's own start value, not measured"
#: Names and descriptions of what drives, and of what belongs to the solver or to a pump.
DRIVES = re.compile(r"\b(drive|drives|driving|tone|excitation|stimulus)\b")
TONE = re.compile(r"(u|tone|f_?drive|drive_?f|f_?exc\w*|excitation_?f\w*|omega)_?\d*")
SIZE = re.compile(r"(a|amp\w*|level|force|f0|drive_?a\w*|excitation)_?\d*")
OTHER = re.compile(r"\b(pump|solver|substep|step|tolerance|depth|phase)\b")
OTHER_NAMES = re.compile(r"\b(coupling|lambda|gain|readout|g)\b")
WIDTH = re.compile(r"(damp\w*|gamma|loss\w*|width\w*|line_?width\w*|d|c|r|kappa)_?(\d*|plus|minus)")
PLACE = re.compile(
    r"(f|f0|eta|eigen_?freq\w*|freq\w*|f_?res\w*|k|stiff\w*|spring\w*|cap\w*|omega)"
    r"_?(\d*|plus|minus)"
)
#: Descriptions of these, and names of outputs that are widths.
WIDTH_WORDS = re.compile(r"damping|line width|linewidth|dissipation|resistance")
PLACE_WORDS = re.compile(r"eigenfrequency|resonan|natural frequency")
WIDTH_OUTPUT = re.compile(r"width|damp|fwhm|gamma")
STEADY = re.compile(r"periodic|steady|stationary")
QUALITY = re.compile(r"\bquality factor\b")
#: Units of a damping, and of what a resonance frequency follows from.
WIDTH_UNITS, PLACE_UNITS = ("N*s/m", "kg/s", "ohm", "S"), ("N/m", "F", "1/F")
#: Outputs next to the observed one that are reported, at most.
MOST_DERIVED = 8
#: Factor to either side of a start value, and widths of a line to either side of its place.
DECADE, REACH = 10.0, 20.0
#: Step of a logarithm for slopes, Newton's steps, the least slope with which an output follows,
#: and the longest step of a logarithm.
STEP, ROUNDS, LEAST_SLOPE, LONGEST = 1e-3, 4, 1e-3, 100.0


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A line that data show: its frequency and full width, Hz, and what it is, in words.

    ``reach_hz`` is how far its place may be off, ``height`` its height over that of the others.
    """

    frequency_hz: float
    width_hz: float
    words: str
    reach_hz: float = math.inf
    height: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Box(ParameterTable[float]):
    """A parameter to be fitted: bounds, start and scale in its ``unit``, and what they rest on."""

    unit: str
    scale: float
    why: str


def box_of(  # noqa: PLR0913 - keywords that all have defaults
    name: str,
    unit: str,
    start: float,
    why: str,
    *,
    reach: float = 0.0,
    scale: float = 0.0,
    signed: bool = False,
    limits: tuple[float | None, float | None] = (None, None),
) -> Box:
    """A parameter with bounds by the one rule, its numbers as short as they need to be.

    Args:
        name: of the parameter.
        unit: of all its numbers.
        start: its likely value.
        why: what that rests on.
        reach: how far the value may be off; zero: by a factor of ten.
        scale: the change that counts as one; zero: a share of the start.
        signed: whether the sign is unknown.
        limits: least and largest value of the variable; None: there is none.

    Raises:
        BadInput: the start is not inside the limits.
    """
    size = abs(start)
    low, high = (
        (start - reach, start + reach) if reach else sorted((start / DECADE, start * DECADE))
    )
    if not reach and (signed or not size):
        low, high = -DECADE * (size or 1.0 / DECADE), DECADE * (size or 1.0 / DECADE)
    least, most = limits
    low = low if least is None else max(low, least)
    high = high if most is None else min(high, most)
    scale = scale or 0.3 * size or 0.5
    digits = 2 - math.floor(math.log10(scale))
    start = round(start, digits + 1)
    if not low < start < high:
        raise BadInput(
            f"{name}: its start {start:g} {unit}, {why}, is not inside the range that the FMU "
            f"declares, {low:g} to {high:g}; wanted another --fit"
        )
    return Box(
        name=name,
        unit=unit,
        lower=low if low == least else round(low, digits + 1),
        upper=high if high == most else round(high, digits + 1),
        start=start,
        scale=float(f"{scale:.2g}"),
        why=why,
    )


@dataclass(frozen=True, kw_only=True)
class Offer:
    """The FMU of a draft, who runs it, and what it offers; the likeliest of each first.

    Attributes:
        name: of a model of this project, or path of a file.
        is_model: whether it is one of this project.
        interface: that was requested; None: none was.
        fmu: opened, with a process that runs it.
        tones: frequency and amplitude of each tone that drives, parameters.
        inputs: inputs that may be driven.
        outputs: what a detector may observe.
        places: parameters that set where the resonance is.
        widths: parameters that set how wide it is.
        parameters: all that may be fitted.
        further: inputs and start values of states, which may be fitted where they are named.
        steady: the switch that starts the FMU on its periodic orbit; empty: none.
        derived: outputs that are numbers of the model, as its eigenfrequency.
        qualities: outputs that are quality factors.
    """

    name: str
    is_model: bool
    interface: str | None
    fmu: Fmu
    tones: tuple[tuple[str, str], ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    places: tuple[str, ...]
    widths: tuple[str, ...]
    parameters: tuple[str, ...]
    further: tuple[str, ...]
    steady: str
    derived: tuple[str, ...]
    qualities: tuple[str, ...]

    @property
    def variables(self) -> Mapping[str, FmuVariable]:
        """All variables of the FMU by their names."""
        return self.fmu.workers.description.variables

    @property
    def is_two_modes(self) -> bool:
        """Whether it is this project's model of two modes."""
        return self.is_model and self.name == TWO_MODES

    def unit(self, name: str) -> str:
        """Unit of a variable, "1" where it declares none.

        Args:
            name: of the variable.
        """
        return self.variables[name].unit or "1"

    def start(self, name: str) -> float:
        """The FMU's own start value of a variable, 0 where it has none.

        Args:
            name: of the variable.
        """
        return float(self.variables[name].start or 0.0)

    def box(self, name: str, start: float, why: str, **room: Any) -> Box:
        """A parameter of the FMU with bounds by the one rule, within the range that it declares.

        Args:
            name: of the parameter.
            start: its likely value.
            why: what that rests on.
            room: reach, scale and sign, see `box_of`.

        Raises:
            BadInput: the start is not inside that range.
        """
        variable = self.variables[name]
        limits = variable.min, variable.max
        return box_of(name, self.unit(name), start, why, limits=limits, **room)


@contextmanager
def opened_offer(fmu: str | Path, interface: str | None) -> Iterator[Offer]:
    """What an FMU offers, with a worker for as long as the context lasts.

    Args:
        fmu: its path, or the name of a model of this project.
        interface: that is requested; None: the FMU's own.

    Raises:
        BadInput: an FMU that cannot be used.
    """
    with Fmu(fmu, 1, interface=interface) as opened:
        is_model = isinstance(fmu, str) and fmu.isidentifier()
        yield _offer_of(str(fmu), opened, interface, is_model=is_model)


def _offer_of(name: str, fmu: Fmu, interface: str | None, *, is_model: bool) -> Offer:
    """What kinds of variables an FMU has, each found by units, causality, names and words."""
    description = fmu.workers.description
    variables = description.variables.values()

    # tones: a frequency that drives, and the amplitude that is numbered alike
    settable = [v for v in variables if v.kind == "Real" and v.can_be_started]
    sizes: dict[str, str] = {}
    for v in settable:
        small = v.name.lower()
        if not _has_unit(v, "Hz", "rad") and SIZE.fullmatch(small) and not OTHER.search(small):
            sizes.setdefault(_number(v.name), v.name)
    tones = tuple(
        (v.name, sizes[_number(v.name)])
        for v in settable
        if _has_unit(v, "Hz")
        and (DRIVES.search(v.description.lower()) or TONE.fullmatch(v.name.lower()))
        and not re.search(r"\bpump\b|eigen|resonan|width", _words(v))
        and _number(v.name) in sizes
    )

    # parameters: what sets a width and a place, then all others that have a value
    taken = {name for tone in tones for name in tone}
    real = [v for v in settable if v.causality == "parameter" and v.start is not None]
    sound = [v for v in real if not (v.name in taken or is_of_solver(v))]
    sound = [v for v in sound if not OTHER_NAMES.search(_parts(v.name))]

    def setting(name: re.Pattern[str], words: re.Pattern[str], units: Sequence[str]) -> list[str]:
        """Those with one of some units, or in hertz with such a name or description."""
        return [
            v.name
            for v in sound
            if _has_unit(v, *units)
            or (
                _has_unit(v, "Hz", "rad/s")
                and (name.fullmatch(v.name.lower()) or words.search(v.description.lower()))
            )
        ]

    widths = setting(WIDTH, WIDTH_WORDS, WIDTH_UNITS)
    places = [n for n in setting(PLACE, PLACE_WORDS, PLACE_UNITS) if n not in widths]

    # outputs: those in hertz are numbers of the model, continuous ones may be observed
    shown = [v for v in description.observable if v.kind == "Real"]
    numbers = [v.name for v in shown if _has_unit(v, "Hz")]
    continuous = [v.name for v in shown if v.variability == "continuous" and v.name not in numbers]
    continuous.sort(key=lambda each: bool(re.search(r"_at_|error", each)))
    switches = [v for v in variables if v.kind == "Boolean" and v.can_be_started]
    return Offer(
        name=name,
        is_model=is_model,
        interface=interface,
        fmu=fmu,
        tones=tones,
        inputs=tuple(v.name for v in variables if (v.causality, v.kind) == ("input", "Real")),
        outputs=tuple(continuous),
        places=tuple(places),
        widths=tuple(widths),
        parameters=tuple(dict.fromkeys([*places, *widths, *(v.name for v in real)])),
        # some tools keep coefficients in inputs
        further=tuple(
            v.name for v in settable if v.causality != "parameter" and v.start is not None
        ),
        steady=next((v.name for v in switches if STEADY.search(_words(v))), ""),
        derived=tuple(numbers)[:MOST_DERIVED],
        qualities=tuple(v.name for v in shown if QUALITY.search(v.description.lower())),
    )


def is_of_solver(variable: FmuVariable) -> bool:
    """Whether a variable belongs to the solver, to a pump or to the phase of a drive, by its words.

    Args:
        variable: of the FMU.
    """
    return bool(OTHER.search(_words(variable)))


def _words(variable: FmuVariable) -> str:
    """Name, its parts as words, and description in small letters."""
    name = variable.name.lower()
    return f"{name} {_parts(name)} {variable.description.lower()}"


def _parts(name: str) -> str:
    """The words of a name: "depth_f1" is "depth f"."""
    return re.sub(r"[^a-z]+", " ", name.lower())


def _number(name: str) -> str:
    match = re.search(r"\d+$", name)
    return match[0] if match else ""


def _has_unit(variable: FmuVariable, *units: str) -> bool:
    return variable.unit is not None and any(same_kind(variable.unit, unit) for unit in units)


def in_unit(value_hz: float, unit: str) -> float | None:
    """A frequency in a unit of frequencies or angular ones; None for another unit.

    Args:
        value_hz: in Hz.
        unit: wanted.
    """
    for base, factor in (("Hz", 1.0), ("rad/s", 2.0 * math.pi)):
        if same_kind(base, unit):
            return convert(factor * value_hz, base, unit, where="line")
    return None


def shown_lines(lines: Sequence[Shown], most_hz: float = math.inf) -> tuple[Shown, ...]:
    """Lines, the lower one first, each with how far its place may be off.

    Args:
        lines: in any order.
        most_hz: how far at most, Hz.
    """
    made = sorted(lines, key=lambda line: line.frequency_hz)
    places = np.array([line.frequency_hz for line in made])
    most_hz = min([most_hz, *(0.5 * np.diff(places))])
    return tuple(
        Shown(
            frequency_hz=line.frequency_hz,
            width_hz=line.width_hz,
            words=line.words,
            reach_hz=float(min(REACH * line.width_hz, most_hz, 0.5 * line.frequency_hz)),
            height=line.height,
        )
        for line in made
    )


def line_boxes(
    offer: Offer, names: Sequence[str], lines: Sequence[Shown], fixed: Mapping[str, Scalar]
) -> dict[str, Box]:
    """Places and widths start at their lines, all others at the FMU's own value, by their names.

    Args:
        offer: what the FMU offers.
        names: of the parameters.
        lines: the lower one first; a single one sets every place and width.
        fixed: start values of other variables.

    Raises:
        BadInput: a start value that is not inside the range of its variable.
        FmuFailure: the FMU failed with its own start values.
    """
    by_name: dict[str, Shown] = {}
    for group in (offer.places, offer.widths):
        fitted = [name for name in group if name in names]
        by_name |= zip(fitted, lines if len(lines) > 1 else [*lines] * len(fitted), strict=False)
    made: dict[str, Box] = {}
    values = dict(fixed)
    # the widths follow from the places in a model of masses and springs, and not the other way
    for name in sorted(names, key=lambda each: each in offer.widths):
        line, start, slope = by_name.get(name), offer.start(name), 0.0
        why = "nothing in the files determines it: the FMU's own start value; bounds are a guess"
        if line is not None:
            start, slope, why = _start(offer, name, line, values)
        room = {}
        if line is not None and slope and name in offer.places:
            room["reach"] = min(line.reach_hz / line.frequency_hz / abs(slope), 0.5) * start
            room["scale"] = line.width_hz / line.frequency_hz / abs(slope) * start
        made[name] = offer.box(name, start, why, **room)
        values[name] = made[name].start
    return {name: made[name] for name in names}


def _start(
    offer: Offer, name: str, line: Shown, values: Mapping[str, Scalar]
) -> tuple[float, float, str]:
    """Where a place or a width starts by its line, the slope d ln f/d ln p there, and why.

    The FMU's own value, and no slope, where no output in hertz follows the parameter.
    """
    wide, value = name in offer.widths, offer.start(name)
    what, target = ("width", line.width_hz) if wide else ("frequency", line.frequency_hz)
    known = in_unit(target, offer.unit(name))
    if known is not None:
        return known, 1.0, f"{what} of {line.words}"

    # Newton's steps of the output that follows it most, after initialisation
    outputs = [n for n in offer.derived if bool(WIDTH_OUTPUT.search(n.lower())) == wide]
    slope = 0.0
    for k in range(ROUNDS if outputs else 0):
        runs = [
            Run(
                start_values={**values, name: value * math.exp(step)},
                settle_s=0.0,
                sample_step_s=1.0,
                samples=1,
                outputs=tuple(outputs),
                allow_nan=True,
            )
            for step in (0.0, STEP)
        ]
        with np.errstate(all="ignore"):
            here, there = (np.log(np.asarray(each)[0]) for each in offer.fmu.workers.run(runs))
        slopes = np.nan_to_num((there - here) / STEP, posinf=0.0, neginf=0.0)
        best = int(np.argmax(np.abs(slopes)))
        slope = float(slopes[best])
        step = (math.log(target) - float(here[best])) / slope if slope else math.inf
        if abs(slope) <= (0.0 if k else LEAST_SLOPE) or not abs(step) < LONGEST:
            slope = 0.0
            break
        outputs, value = [outputs[best]], value * math.exp(step)
    if not slope:
        return offer.start(name), 0.0, f"no output has the {what}: {OWN}; bounds are a guess"
    return value, slope, f"with it {outputs[0]} is the {what} of {line.words}"
