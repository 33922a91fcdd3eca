"""Which parameters of an FMU hold tones besides those that are named."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fitting.fmu.description import FmuVariable
from fitting.text.arrays import Scalar

TONE_NAME = re.compile(r"(.*?)(\d+)")
#: An FMU that has u2 and A2 drives with u2 unless A2 is zero.
AMPLITUDE_STEM = "A"


@dataclass(frozen=True)
class OtherTone:
    """A tone that is not named: the parameters of its frequency and of its amplitude."""

    frequency: str
    amplitude: str


def amplitude_of(name: str, variables: Mapping[str, FmuVariable]) -> FmuVariable | None:
    """The parameter of a tone's amplitude, as A2 of u2; None where there is none.

    Args:
        name: of the parameter of its frequency.
        variables: of the FMU, by name.
    """
    match = TONE_NAME.fullmatch(name)
    return variables.get(AMPLITUDE_STEM + match[2]) if match is not None else None


def other_tones(
    names: Sequence[str], values: Mapping[str, Scalar], variables: Mapping[str, FmuVariable]
) -> tuple[OtherTone, ...]:
    """Parameters named like the tones, but for their number, with amplitudes that are not zero.

    Args:
        names: parameters that hold the tones.
        values: start values, by name.
        variables: of the FMU, by name.
    """
    stems = {match[1] for name in names if (match := TONE_NAME.fullmatch(name))}
    others = []
    for name, variable in variables.items():
        match = TONE_NAME.fullmatch(name)
        if match is None or match[1] not in stems or name in names:
            continue
        amplitude = amplitude_of(name, variables)
        if amplitude is None or not variable.can_be_started:
            continue
        if values.get(amplitude.name, amplitude.start):
            others.append(OtherTone(name, amplitude.name))
    return tuple(others)
