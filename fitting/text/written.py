"""A value as a user wrote it, with its place: what it has to be depends on the FMU."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput, shown
from fitting.text.units import convert, convert_difference, parse_quantity


@dataclass(frozen=True)
class Written:
    """A value as the user wrote it: number, Boolean or text, ``unit`` if it has one of its own.

    Text may still be a quantity ("6.94 MHz") or the value of a String variable; which, is known
    only with the FMU. ``where`` opens every complaint about it.
    """

    value: Scalar
    unit: str | None
    where: str


def as_written(value: Any, where: str) -> Written:
    """Check that a TOML value is a scalar: finite number, Boolean or text.

    Args:
        value: the value.
        where: file, row or key, for complaints.
    """
    if isinstance(value, float) and not math.isfinite(value):
        raise BadInput(f"{where}: found {value!r}, wanted a finite number")
    if not isinstance(value, bool | int | float | str):
        raise BadInput(f"{where}: found {shown(value)}, wanted a number, true/false or a text")
    if isinstance(value, int) and abs(value) > sys.float_info.max:
        raise BadInput(f"{where}: found {shown(value)}, wanted a number below 1e308")
    return Written(value, None, where)


def written_values(values: Mapping[str, Scalar], where: str) -> dict[str, Written]:
    """Plain values by name as if they were written at ``where``.

    Args:
        values: numbers and words, by name.
        where: file, row or key, for complaints.

    Raises:
        BadInput: a value that is no finite number, Boolean or text.
    """
    return {name: as_written(value, f"{where}: {name}") for name, value in values.items()}


def in_unit(written: Written, unit: str | None) -> float:
    """The number of a written value in ``unit``; a bare number is in ``unit`` already.

    With ``unit`` None (the unit wanted is unknown) a written unit is taken to SI base units.

    Args:
        written: number or quantity as the file has it.
        unit: of the values.

    Raises:
        BadInput: not a number, or a unit of another dimension.
    """
    return _in(written, unit, convert)


def _in(written: Written, unit: str | None, conversion: Callable[..., float]) -> float:
    value, own = written.value, written.unit
    if isinstance(value, bool):
        raise BadInput(f"{written.where}: found {value!r}, wanted a number")
    if isinstance(value, str):
        value, own = parse_quantity(value, where=written.where, wanted=unit)
    return float(value) if own is None else conversion(float(value), own, unit, where=written.where)


def difference_in(written: Written, unit: str | None) -> float:
    """The number of a written difference in ``unit``, as of a standard deviation: 1 degC is 1 K.

    Args:
        written: number or quantity as the file has it.
        unit: of the values; None: a written unit is taken to SI base units.

    Raises:
        BadInput: as `in_unit`.
    """
    return _in(written, unit, convert_difference)


def sigma_in(written: Written | None, unit: str | None) -> float:
    """The standard deviation that is written, in ``unit``; zero where nothing is written.

    Args:
        written: number or quantity as the file has it, None where it has none.
        unit: of the values.

    Raises:
        BadInput: not a number, a unit of another dimension, zero or less.
    """
    return _positive(written, unit, difference_in)


def above_zero(written: Written | None, unit: str | None) -> float:
    """The number of a written value in ``unit``; zero where nothing is written.

    Args:
        written: number or quantity as the file has it, None where it has none.
        unit: of the values.

    Raises:
        BadInput: not a number, a unit of another dimension, zero or less.
    """
    return _positive(written, unit, in_unit)


def _positive(
    written: Written | None, unit: str | None, read: Callable[[Written, str | None], float]
) -> float:
    if written is None:
        return 0.0
    value = read(written, unit)
    if not value > 0.0:
        raise BadInput(f"{written.where}: found {written.value}, wanted more than zero")
    return value


def positive_in(written: Written, unit: str) -> float:
    """A quantity above zero with its unit, as "100 Hz", converted to ``unit``.

    Args:
        written: number or quantity as the file has it.
        unit: of the values.

    Raises:
        BadInput: a bare number, another dimension, zero or less.
    """
    if not isinstance(written.value, str):
        raise BadInput(
            f"{written.where}: {written.value!r} has no unit, wanted a text as in "
            f'"{written.value} {unit}"'
        )
    value = in_unit(written, unit)
    if value <= 0.0:
        raise BadInput(f"{written.where}: found '{written.value}', wanted more than zero")
    return value
