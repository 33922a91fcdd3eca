"""Parameters as a file or a program asks for them, put into the units of one FMU."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

from fitting.campaign.binder import Binder
from fitting.campaign.parameters import SCOPES, Parameter, ParameterTable
from fitting.campaign.places import Places
from fitting.fmu.variables import VariableLike
from fitting.text.errors import BadInput, gathered
from fitting.text.units import convert, dimension_of, parse_quantity
from fitting.text.written import Written, difference_in, in_unit

#: As a file has it, or as a program gives it.
Asked = ParameterTable[Written] | ParameterTable[float | str]
#: Numbers of a parameter that are differences of its values: 1 degC of them is 1 K.
DIFFERENCES = ("scale", "period", "prior")


def bind_parameters(asked: Sequence[Asked], binder: Binder, places: Places) -> list[Parameter]:
    """Parameters in the FMU's units, those of the scope "experiment" once.

    Args:
        asked: as the file or the program has them.
        binder: of the campaign to its FMU.
        places: what complaints name the parameters by.

    Raises:
        BadInput: no such variable, or numbers that it cannot have.
    """
    readers = (
        partial(_bound, p, binder, f"{places.top}{places.of('parameter', p.name)}") for p in asked
    )
    return gathered(readers)


def of_experiments(parameters: Iterable[Parameter], labels: Sequence[str]) -> Iterator[Parameter]:
    """The same, those of the scope "experiment" one for each of the labels.

    Args:
        parameters: in the FMU's units.
        labels: of the experiments.
    """
    for p in parameters:
        if p.scope == SCOPES[0]:
            yield p
            continue
        for label in labels:
            name = f"{p.name}[{label}]"
            yield replace(p, scope=SCOPES[0], name=name, variable=p.name, experiment=label)


def in_one_unit(name: str, numbers: Mapping[str, Written], unit: str | None) -> Parameter:
    """A parameter of numbers as written, all put into one unit.

    Args:
        name: of the parameter.
        numbers: by their keys, each with the unit that stands with it.
        unit: of the parameter; None: that of the numbers, which have none.

    Raises:
        BadInput: another unit, or numbers that no parameter has.
    """
    readers = (partial(_read, key, written, unit) for key, written in numbers.items())
    return _parameter(name, unit or "", dict(zip(numbers, gathered(readers), strict=True)))


def written_numbers(asked: Asked) -> dict[str, Written]:
    """The numbers of a parameter with their places, bare ones in the unit of the entry.

    Args:
        asked: as a file or a program has it.

    Raises:
        BadInput: what is neither a number nor a quantity with a unit.
    """
    found = {}
    for key, value in asked.numbers.items():
        if isinstance(value, Written):
            bare = not isinstance(value.value, str) and value.unit is None
            found[key] = replace(value, unit=asked.unit) if bare else value
            continue
        where = f"parameter '{asked.name}': {key}"
        if isinstance(value, str):
            number, own = parse_quantity(value, where=where, wanted=asked.unit)
            found[key] = Written(number, own or asked.unit, where)
            continue
        try:
            found[key] = Written(float(value), asked.unit, where)
        except (TypeError, ValueError):
            raise BadInput(
                f'{where}: found {value!r}, wanted a number or a text as "400 Hz"'
            ) from None
    return found


def _bound(choice: Asked, binder: Binder, where: str) -> Parameter:
    written = written_numbers(choice)
    if choice.name in binder.free_names:  # a law names it, and the FMU has no such variable
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
        made = _parameter(choice.name, unit, numbers, where)
        return replace(made, scope=choice.scope, role="coefficient")
    declared = choice.unit
    try:
        variable = binder.real(choice.name, where, ("parameter",), "fitted")
        if choice.unit and variable.unit:  # else every number that has this unit complains
            declared = variable.unit
            convert(1.0, choice.unit, variable.unit, where=f"{where} unit")
    except BadInput as error:
        raise BadInput(*error.args, *_misfits(choice, declared, where)) from None
    readers = (partial(_number, key, each, variable, binder) for key, each in written.items())
    numbers = dict(zip(written, gathered(readers), strict=True))
    return replace(
        _parameter(choice.name, variable.unit or choice.unit or "1", numbers, where),
        scope=choice.scope,
        least=-math.inf if variable.min is None else variable.min,
        most=math.inf if variable.max is None else variable.max,
    )


def _number(key: str, written: Written, variable: VariableLike, binder: Binder) -> float:
    if key in ("lower", "upper", "start"):
        return binder.number(variable, written)
    return _read(key, written, variable.unit)  # the FMU's range binds no difference and no prior


def _read(key: str, written: Written, unit: str | None) -> float:
    return (difference_in if key in DIFFERENCES else in_unit)(written, unit)


def _misfits(choice: Asked, unit: str | None, where: str) -> Sequence[str]:
    """What is to be said of its numbers with units of their own, where another thing is wrong."""
    written = written_numbers(choice).values()
    try:
        if unit:
            dimension_of(unit, where=f"{where} unit")
        gathered(partial(in_unit, each, unit) for each in written if isinstance(each.value, str))
    except BadInput as error:
        return error.args
    return ()


def _parameter(name: str, unit: str, numbers: Mapping[str, float], where: str = "") -> Parameter:
    try:
        return Parameter(
            name=name,
            unit=unit,
            lower=numbers["lower"],
            upper=numbers["upper"],
            start=numbers["start"],
            reference=numbers.get("reference", numbers["start"]),
            scale=numbers.get("scale", 0.5 * (numbers["upper"] - numbers["lower"])),
            period=numbers.get("period"),
            prior=numbers.get("prior"),
        )
    except BadInput as error:
        if not where:
            raise
        raise BadInput(f"{where}: {error}") from error
