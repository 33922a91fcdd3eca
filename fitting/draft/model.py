"""What an FMU offers a measurement: tones, inputs, outputs, parameters; guessed, and printed.

Guesses go by units, causality and variability first, then by usual names and by descriptions. None
of them is trusted: each is printed, and can be chosen otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from fitting.extension.fmu import FmuDescription, FmuVariable, FmuWorkers
from fitting.text.arrays import Scalar
from fitting.text.units import same_kind

#: The models of this project that are one resonance, and two.
ONE_MODE, TWO_MODES = "CoupledModes1", "CoupledModes2"
#: The parameter that couples the two; what makes them two lines beside each other, with reasons.
COUPLING = "lambda12"
UNCOUPLED: Mapping[str, tuple[Scalar, str]] = {
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
#: Descriptions of these.
WIDTH_WORDS = re.compile(r"damping|line width|linewidth|dissipation|resistance")
PLACE_WORDS = re.compile(r"eigenfrequency|resonan|natural frequency")
STEADY = re.compile(r"periodic|steady|stationary")
QUALITY = re.compile(r"\bquality factor\b")
#: Units of a damping, and of what a resonance frequency follows from.
WIDTH_UNITS, PLACE_UNITS = ("N*s/m", "kg/s", "ohm", "S"), ("N/m", "F", "1/F")
#: Outputs beside the observed one that are reported, at most.
MOST_DERIVED = 8


@dataclass(frozen=True, kw_only=True)
class Offer:
    """The FMU of a draft, who runs it, and what it offers; the likeliest of each first.

    Attributes:
        name: of a model of this project, or path of a file.
        is_model: whether it is one of this project.
        interface: that was requested; None: none was.
        workers: processes that run it.
        description: of the FMU.
        tones: frequency and amplitude of each tone that drives, parameters.
        inputs: inputs that may be driven.
        outputs: what a detector may observe.
        places: parameters that set where the resonance is.
        widths: parameters that set how wide it is.
        steady: the switch that starts the FMU on its periodic orbit; empty: none.
        derived: outputs that are numbers of the model, as its eigenfrequency.
        qualities: outputs that are quality factors.
    """

    name: str
    is_model: bool
    interface: str | None
    workers: FmuWorkers
    description: FmuDescription
    tones: tuple[tuple[str, str], ...]
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

    @property
    def is_two_modes(self) -> bool:
        """Whether it is this project's model of two modes."""
        return self.is_model and self.name == TWO_MODES

    def unit(self, name: str) -> str:
        """Unit of a variable, "1" where it declares none.

        Args:
            name: of the variable.
        """
        return self.description.variables[name].unit or "1"

    def start(self, name: str) -> float:
        """The FMU's own start value of a variable, 0 where it has none.

        Args:
            name: of the variable.
        """
        return float(self.description.variables[name].start or 0.0)


def offer_of(name: str, workers: FmuWorkers, interface: str | None, *, is_model: bool) -> Offer:
    """Look at an FMU.

    Args:
        name: see `Offer`.
        workers: see `Offer`.
        interface: see `Offer`.
        is_model: see `Offer`.
    """
    variables = workers.description.variables
    tones = _tones(variables)
    taken = {name for tone in tones for name in tone}
    sound = [
        v
        for v in variables.values()
        if _is_parameter(v)
        and v.name not in taken
        and not (is_of_solver(v) or OTHER_NAMES.search(_parts(v.name)))
    ]
    widths = [v for v in sound if _sets(v, WIDTH, WIDTH_WORDS, WIDTH_UNITS)]
    places = [v for v in sound if v not in widths and _sets(v, PLACE, PLACE_WORDS, PLACE_UNITS)]
    real = [v for v in workers.description.observable if v.kind == "Real"]
    numbers = [v for v in real if v.unit is not None and same_kind(v.unit, "Hz")]
    observed = [v for v in real if v not in numbers and v.variability == "continuous"]
    plain = [v for v in observed if not re.search(r"_at_|error", v.name)]
    switch = [v for v in variables.values() if v.kind == "Boolean" and v.can_be_started]
    return Offer(
        name=name,
        is_model=is_model,
        interface=interface,
        workers=workers,
        description=workers.description,
        tones=tones,
        inputs=tuple(
            v.name for v in variables.values() if (v.causality, v.kind) == ("input", "Real")
        ),
        outputs=tuple(dict.fromkeys(v.name for v in (*plain, *observed))),
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


def _tones(variables: Mapping[str, FmuVariable]) -> tuple[tuple[str, str], ...]:
    """Pairs of a frequency that drives and the amplitude that is numbered alike."""
    settable = [v for v in variables.values() if v.kind == "Real" and v.can_be_started]
    frequencies = [
        v.name
        for v in settable
        if _has_unit(v, "Hz")
        and (DRIVES.search(v.description.lower()) or TONE.fullmatch(v.name.lower()))
        and not re.search(r"\bpump\b|eigen|resonan|width", _words(v))
    ]
    sizes: dict[str, str] = {}
    for v in settable:
        small = v.name.lower()
        if not _has_unit(v, "Hz", "rad") and SIZE.fullmatch(small) and not OTHER.search(small):
            sizes.setdefault(_number(v.name), v.name)
    return tuple((name, sizes[_number(name)]) for name in frequencies if _number(name) in sizes)


def _number(name: str) -> str:
    match = re.search(r"\d+$", name)
    return match[0] if match else ""


def _has_unit(variable: FmuVariable, *units: str) -> bool:
    return variable.unit is not None and any(same_kind(variable.unit, unit) for unit in units)


def _sets(
    variable: FmuVariable, name: re.Pattern[str], words: re.Pattern[str], units: tuple[str, ...]
) -> bool:
    """Whether a parameter has one of some units, or is in hertz with such a name or description."""
    called = name.fullmatch(variable.name.lower()) or words.search(variable.description.lower())
    return _has_unit(variable, *units) or (_has_unit(variable, "Hz", "rad/s") and bool(called))
