"""Parameters as a file or a program asks for them, put into the units of one FMU."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Protocol

from fitting.campaign.binder import Binder
from fitting.campaign.parameters import DIFFERENCES, Parameter
from fitting.campaign.places import Places
from fitting.fmu.variables import VariableLike
from fitting.text.errors import BadInput, gathered
from fitting.text.units import convert, dimension_of, parse_quantity
from fitting.text.written import Written, difference_in, in_unit


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
    try:
        variable = binder.real(choice.name, where, ("parameter",), "fitted")
    except BadInput as error:
        raise BadInput(*error.args, *_misfits(choice, choice.unit, where)) from None
    if choice.unit and variable.unit:  # else every number that has this unit complains
        try:
            convert(1.0, choice.unit, variable.unit, where=f"{where} unit")
        except BadInput as error:
            raise BadInput(*error.args, *_misfits(choice, variable.unit, where)) from None
    written = _with_units(choice)
    readers = (partial(_number, key, each, variable, binder) for key, each in written.items())
    numbers = dict(zip(written, gathered(readers), strict=True))
    made = _parameter(choice, variable.unit or choice.unit or "1", numbers, where)
    return replace(
        made,
        least=-math.inf if variable.min is None else variable.min,
        most=math.inf if variable.max is None else variable.max,
    )


def _number(key: str, written: Written, variable: VariableLike, binder: Binder) -> float:
    if key in ("lower", "upper", "start"):
        return binder.number(variable, written)
    return _read(key, written, variable.unit)  # the FMU's range binds no difference and no prior


def _read(key: str, written: Written, unit: str | None) -> float:
    return (difference_in if key in DIFFERENCES else in_unit)(written, unit)


def _misfits(choice: AskedParameter, unit: str | None, where: str) -> Sequence[str]:
    """What is to be said of its numbers with units of their own, where another thing is wrong."""
    try:
        if unit:
            dimension_of(unit, where=f"{where} unit")
        gathered(
            partial(in_unit, written, unit)
            for written in choice.numbers.values()
            if isinstance(written.value, str)
        )
    except BadInput as error:
        return error.args
    return ()


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
    readers = (partial(_read, key, each, unit) for key, each in written.items())
    numbers = dict(zip(written, gathered(readers), strict=True))
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
