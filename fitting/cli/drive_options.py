"""What an FMU is driven with, from words on the command line: start values, outputs, tones."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from fitting.cli.options import quantity
from fitting.fmu import FmuDescription, FmuVariable
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput

TONE_NAME = re.compile(r"(.*?)(\d+)")
#: An FMU that has u2 and A2 drives with u2 unless A2 is zero.
AMPLITUDE_STEM = "A"


def start_values(assignments: Sequence[str], description: FmuDescription) -> dict[str, Scalar]:
    """Start values from texts "NAME=VALUE" with written units, in the FMU's units.

    Args:
        assignments: words NAME=VALUE of the command line.
        description: of the FMU.
    """
    values: dict[str, Scalar] = {}
    for text in assignments:
        name, found, value = text.partition("=")
        name = name.strip()
        if not (name and found):
            raise BadInput(f"--set {text}: wanted NAME=VALUE")
        values[name] = _value(value.strip(), description.variable(name))
    return values


def _value(text: str, variable: FmuVariable) -> Scalar:
    where = f"--set {variable.name}"
    if variable.kind == "String":
        return text
    if variable.kind == "Boolean":
        if text.lower() not in ("true", "false", "1", "0"):
            raise BadInput(f"{where}: found {text!r}, wanted true or false")
        return text.lower() in ("true", "1")
    if variable.kind == "Integer":
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not number.is_integer():
            raise BadInput(f"{where}: found {text!r}, wanted a whole number")
        return int(number)
    return quantity(text, variable.unit or "1", where=where)


def first_output(description: FmuDescription) -> tuple[str, ...]:
    """The first output that moves, to be looked at where none is named.

    Args:
        description: of the FMU.
    """
    for variable in description.variables.values():
        if (variable.causality, variable.kind) == ("output", "Real") and (
            variable.variability == "continuous"
        ):
            return (variable.name,)
    raise BadInput(f"{description.path}: has no continuous Real output, wanted --outputs")


def other_tones(
    names: tuple[str, ...], values: Mapping[str, Scalar], description: FmuDescription
) -> list[tuple[str, str]]:
    """Parameters named like the tones, but for their number, with amplitudes that are not zero.

    Args:
        names: as they are declared, in their order.
        values: start values, by name.
        description: of the FMU.
    """
    stems = {match[1] for name in names if (match := TONE_NAME.fullmatch(name))}
    found = []
    for name, variable in description.variables.items():
        match = TONE_NAME.fullmatch(name)
        if match is None or match[1] not in stems or name in names:
            continue
        amplitude = description.variables.get(AMPLITUDE_STEM + match[2])
        if amplitude is None or not variable.can_be_started:
            continue
        if values.get(amplitude.name, amplitude.start):
            found.append((name, amplitude.name))
    return found
