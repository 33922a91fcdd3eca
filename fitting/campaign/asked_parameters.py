"""Parameters as a file or a program asks for them, put into the units of one FMU."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

from fitting.campaign.binder import Binder
from fitting.campaign.parameters import Parameter
from fitting.campaign.places import Places
from fitting.text.errors import BadInput
from fitting.text.units import convert, parse_quantity
from fitting.text.written import Written, in_unit


class AskedParameter(Protocol):
    """A parameter as it was asked for, in a file or in a program."""

    @property
    def name(self) -> str:
        """The FMU's variable."""

    @property
    def unit(self) -> str | None:
        """Unit of its bare numbers, None for the FMU's."""

    @property
    def scope(self) -> str:
        """One value for the "campaign", or one for every "experiment"."""

    @property
    def numbers(self) -> Mapping[str, Written]:
        """What was said of it: lower, upper, start and any of reference, scale, period, prior."""


def bind_parameters(
    asked: Sequence[AskedParameter], binder: Binder, places: Places, labels: Sequence[str]
) -> list[Parameter]:
    """Parameters in the FMU's units; of the scope "experiment" one for each of the labels.

    Args:
        asked: as the file or the program has them.
        binder: of the campaign to its FMU.
        places: what complaints name the parameters by.
        labels: of the experiments.

    Raises:
        BadInput: no such variable, or numbers that it cannot have.
    """
    made = []
    for choice in asked:
        parameter = _bind_parameter(choice, binder, places.of_parameter(choice.name))
        if choice.scope == "campaign":
            made.append(parameter)
            continue
        made += [
            replace(
                parameter, name=f"{choice.name}[{label}]", variable=choice.name, experiment=label
            )
            for label in labels
        ]
    return made


def _bind_parameter(choice: AskedParameter, binder: Binder, where: str) -> Parameter:
    if choice.name in binder.free_names:
        return _bind_coefficient(choice, where)
    variable = binder.real(choice.name, where, ("parameter",), "fitted")
    if choice.unit and variable.unit:  # else every number that has this unit complains
        convert(1.0, choice.unit, variable.unit, where=f"{where} unit")
    numbers = {}
    for key, written in _with_units(choice).items():
        if key in ("lower", "upper", "start"):
            numbers[key] = binder.number(variable, written)
        else:  # a difference or a prior: the FMU's range does not bind it
            numbers[key] = in_unit(written, variable.unit)
    made = _parameter(choice, variable.unit or choice.unit or "1", numbers, where)
    return replace(
        made,
        least=-math.inf if variable.min is None else variable.min,
        most=math.inf if variable.max is None else variable.max,
    )


def _bind_coefficient(choice: AskedParameter, where: str) -> Parameter:
    """A parameter that is no variable of the FMU but named by a law."""
    written = _with_units(choice)
    start = written["start"]
    unit = start.unit
    if isinstance(start.value, str):
        unit = choice.unit or parse_quantity(start.value, where=start.where)[1]
    if unit is None:
        raise BadInput(
            f'{where}: a coefficient of laws has no unit, wanted unit = "Hz/V", for example; a '
            'plain number has the unit "1"'
        )
    numbers = {key: in_unit(each, unit) for key, each in written.items()}
    return replace(_parameter(choice, unit, numbers, where), role="coefficient")


def _with_units(choice: AskedParameter) -> dict[str, Written]:
    """What was said of a parameter, bare numbers in the unit of the entry."""
    return {
        key: written
        if isinstance(written.value, str)
        else Written(written.value, written.unit or choice.unit, written.where)
        for key, written in choice.numbers.items()
    }


def _parameter(
    choice: AskedParameter, unit: str, numbers: Mapping[str, float], where: str
) -> Parameter:
    try:
        return Parameter(
            name=choice.name,
            unit=unit,
            lower=numbers["lower"],
            upper=numbers["upper"],
            start=numbers["start"],
            reference=numbers.get("reference", numbers["start"]),
            scale=numbers.get("scale", 0.5 * (numbers["upper"] - numbers["lower"])),
            period=numbers.get("period"),
            prior_sigma=numbers.get("prior"),
        )
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from error
