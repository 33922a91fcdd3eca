"""What an FMU offers a measurement: tones, inputs, outputs, parameters; guessed and said.

Guesses go by units, causality and variability first, then by usual names and by what descriptions
say. None of them is trusted: each is told, and can be chosen otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from fitting.fmu import FmuDescription, FmuVariable
from fitting.text.units import same_kind

#: The models of this project that are one resonance, and two.
ONE_MODE, TWO_MODES = "CoupledModes1", "CoupledModes2"
#: The parameter that couples the two; what makes them two lines beside each other, with reasons.
COUPLING = "lambda12"
UNCOUPLED: Mapping[str, tuple[float, str]] = {
    COUPLING: (0.0, "each line is a mode of its own: they do not tell a coupling"),
    "readout2": (1.0, "the detector sees both modes"),
}
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
STEADY = re.compile(r"periodic|steady|stationary")
QUALITY = re.compile(r"\bquality factor\b")
#: Units that tell a damping, and what a resonance frequency follows from.
WIDTH_UNITS, PLACE_UNITS = ("N*s/m", "kg/s", "ohm", "S"), ("N/m", "F", "1/F")
#: Outputs beside the observed one that are reported, at most.
MOST_DERIVED = 8


@dataclass(frozen=True)
class Tone:
    """A tone of an FMU: the parameters of its frequency and of its amplitude."""

    frequency: str
    amplitude: str


@dataclass(frozen=True, kw_only=True)
class Offer:
    """What an FMU offers; the likeliest of each first.

    Attributes:
        description: of the FMU.
        tones: pairs of parameters that drive.
        inputs: inputs that may be driven.
        outputs: what a detector may see.
        places: parameters that set where the resonance is.
        widths: parameters that set how wide it is.
        steady: the switch that starts the FMU on its periodic orbit; empty: none.
        derived: outputs that are numbers of the model, as its eigenfrequency.
        qualities: outputs that are quality factors.
    """

    description: FmuDescription
    tones: tuple[Tone, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    places: tuple[str, ...]
    widths: tuple[str, ...]
    steady: str
    derived: tuple[str, ...]
    qualities: tuple[str, ...]

    @property
    def parameters(self) -> tuple[str, ...]:
        """All that may be fitted, the likeliest first."""
        real = [v.name for v in self.description.variables.values() if _is_parameter(v)]
        return tuple(dict.fromkeys([*self.places, *self.widths, *real]))

    def unit(self, name: str) -> str:
        """Unit of a variable, "1" where it declares none.

        Args:
            name: of the variable.
        """
        return self.description.variables[name].unit or "1"


def offer_of(description: FmuDescription) -> Offer:
    """Look at an FMU.

    Args:
        description: of the FMU.
    """
    variables = description.variables
    tones = _tones(variables)
    taken = {name for tone in tones for name in (tone.frequency, tone.amplitude)}
    free = [v for v in variables.values() if _is_parameter(v) and v.name not in taken]
    sound = [v for v in free if not (is_of_solver(v) or OTHER_NAMES.search(_parts(v.name)))]
    widths = [v for v in sound if _is_width(v)]
    places = [v for v in sound if v not in widths and _is_place(v)]
    real = [v for v in description.seen if v.kind == "Real"]
    numbers = [v for v in real if v.unit is not None and same_kind(v.unit, "Hz")]
    seen = [v for v in real if v not in numbers and v.variability == "continuous"]
    plain = [v for v in seen if not re.search(r"_at_|error", v.name)]
    switch = [v for v in variables.values() if v.kind == "Boolean" and v.can_be_started]
    return Offer(
        description=description,
        tones=tones,
        inputs=tuple(
            v.name for v in variables.values() if (v.causality, v.kind) == ("input", "Real")
        ),
        outputs=tuple(dict.fromkeys(v.name for v in (*plain, *seen))),
        places=tuple(v.name for v in places),
        widths=tuple(v.name for v in widths),
        steady=next((v.name for v in switch if STEADY.search(_words(v))), ""),
        derived=tuple(v.name for v in numbers)[:MOST_DERIVED],
        qualities=tuple(v.name for v in real if QUALITY.search(v.description.lower())),
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


def _is_parameter(variable: FmuVariable) -> bool:
    return (
        variable.kind == "Real"
        and variable.causality == "parameter"
        and variable.can_be_started
        and variable.start is not None
    )


def _tones(variables: Mapping[str, FmuVariable]) -> tuple[Tone, ...]:
    """Pairs of a frequency that drives and the amplitude that is numbered alike."""
    settable = [v for v in variables.values() if v.kind == "Real" and v.can_be_started]
    frequencies = [
        v
        for v in settable
        if v.unit is not None
        and same_kind(v.unit, "Hz")
        and (DRIVES.search(v.description.lower()) or TONE.fullmatch(v.name.lower()))
        and not re.search(r"\bpump\b|eigen|resonan|width", _words(v))
    ]
    sizes = [
        v
        for v in settable
        if not (v.unit is not None and (same_kind(v.unit, "Hz") or same_kind(v.unit, "rad")))
        and SIZE.fullmatch(v.name.lower())
        and not OTHER.search(v.name.lower())
    ]
    pairs = []
    for frequency in frequencies:
        partner = [v for v in sizes if _number(v.name) == _number(frequency.name)]
        if partner:
            pairs.append(Tone(frequency.name, partner[0].name))
    return tuple(pairs)


def _number(name: str) -> str:
    found = re.search(r"\d+$", name)
    return found[0] if found else ""


def _has_unit(variable: FmuVariable, units: tuple[str, ...]) -> bool:
    return variable.unit is not None and any(same_kind(variable.unit, unit) for unit in units)


def _is_width(variable: FmuVariable) -> bool:
    words = variable.description.lower()
    told = bool(re.search(r"damping|line width|linewidth|dissipation|resistance", words))
    hertz = _has_unit(variable, ("Hz", "rad/s"))
    named = bool(WIDTH.fullmatch(variable.name.lower()))
    return _has_unit(variable, WIDTH_UNITS) or (hertz and (told or named))


def _is_place(variable: FmuVariable) -> bool:
    words = variable.description.lower()
    told = bool(re.search(r"eigenfrequency|resonan|natural frequency", words))
    named = bool(PLACE.fullmatch(variable.name.lower()))
    hertz = _has_unit(variable, ("Hz", "rad/s"))
    return _has_unit(variable, PLACE_UNITS) or (hertz and (told or named))
