"""Start values that a build replaces, checked against the variable table beforehand."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from .slave import ModelSlave
    from .variables import Variable

    StartValue = float | int | bool | str


class BuildError(Exception):
    """An FMU cannot be built from what was asked for; the text is one line for the user."""


def checked_start_values(
    model_class: type[ModelSlave], start_values: Mapping[str, StartValue]
) -> dict[str, StartValue]:
    """Return the start values with the types of their variables, sorted by name.

    Raises ``BuildError`` naming the variable, what was found and what is wanted.
    """
    table = {variable.name: variable for variable in model_class.variables}
    checked = {}
    for name, given in sorted(start_values.items()):
        if name not in table:
            raise BuildError(f"{model_class.__name__} has no variable {name!r}")
        variable = table[name]
        if variable.causality != "parameter":
            raise BuildError(f"{name} is not a parameter, it is {_article(variable.causality)}")
        checked[name] = _within_bounds(variable, _typed(variable, given))
    return checked


def _article(causality: str) -> str:
    return f"{'an' if causality[0] in 'aeiou' else 'a'} {causality}"


_WANTED = {
    "Real": "a finite number",
    "Integer": "a whole number of 32 bits",
    "Boolean": "true or false",
    "String": "text",
}


def _typed(variable: Variable, given: StartValue) -> StartValue:
    """Return ``given`` as a value of the variable's kind; text is read, other types must fit."""
    refusal = BuildError(
        f"{variable.name} = {given!r}: {variable.name} is {variable.kind}, "
        f"wanted is {_WANTED[variable.kind]}"
    )
    if variable.kind == "Boolean" and str(given).lower() in ("true", "false"):
        return str(given).lower() == "true"
    if variable.kind == "String" and isinstance(given, str):
        return given
    if variable.kind in ("Boolean", "String"):
        raise refusal
    if isinstance(given, bool) or (variable.kind == "Integer" and isinstance(given, float)):
        raise refusal
    try:
        value = float(given) if variable.kind == "Real" else int(given)
    except (ValueError, OverflowError) as error:
        raise refusal from error
    if not math.isfinite(value) or (variable.kind == "Integer" and not -(2**31) <= value < 2**31):
        raise refusal
    return value


def _within_bounds(variable: Variable, value: StartValue) -> StartValue:
    if isinstance(value, str | bool):
        return value
    unit = f" {variable.unit}" if variable.unit else ""
    low, high = variable.minimum, variable.maximum
    for outside, words in (
        (low is not None and value < low, f"at least {low!r}"),
        (high is not None and value > high, f"at most {high!r}"),
    ):
        if outside:
            raise BuildError(f"{variable.name} = {value!r}{unit}: wanted is {words}{unit}")
    return value
