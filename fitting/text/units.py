"""Written quantities and units: "6.94016 MHz" to a number in the unit that is wanted.

What a value of a file has to be depends on the FMU: it is kept as written, with its place.

Conversion is decimal and rounds once, so "6.94016 MHz" is 6940160.0 Hz and not its neighbour.
"""

from __future__ import annotations

import contextlib
import math
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import TYPE_CHECKING, Any, Literal

from fitting.text.errors import BadInput, shown
from fitting.text.once import alone, made_once

if TYPE_CHECKING:  # what takes a while to load: a command's help needs no numpy, pint a unit
    import pint

    from fitting.text.arrays import Scalar

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*", re.DOTALL)

#: A number with a decimal comma.
_DECIMAL_COMMA = re.compile(r"\s*([+-]?\d+),(\d+)")

#: Powers of base dimensions by their names, as "[time]".
Dimension = Mapping[str, float]

#: Characters of a quantity; the patterns take their time over longer ones.
LONGEST = 400

# Names that FMI tools write and pint does not know; all else is left to pint.
_FMI_NAMES = {"-": "dimensionless", "": "dimensionless", "1": "dimensionless"}
# a root as instruments write it: "√Hz", "sqrt(Hz)", "rtHz"
_ROOT = re.compile(r"(?:√|\bsqrt|\brt)\s*(?:\(\s*([A-Za-z]+)\s*\)|([A-Za-z]+))")
_PLAIN = re.compile(r"[\w°Ωµμ%./*^() \u00b2\u00b3·-]+")


#: Common units: their prefixes and dimensions. pint knows them as well, but takes 0.7 s to load.
_PREFIXES = {"": 0, "f": -15, "p": -12, "n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3}
_PREFIXES |= {"k": 3, "M": 6, "G": 9}
_SMALL = "fpnuµμm"
_BASES: dict[str, tuple[str, Dimension]] = {
    "Hz": (_SMALL + "kMG", {"[time]": -1.0}),
    "s": (_SMALL, {"[time]": 1.0}),
    "V": (_SMALL + "k", {"[mass]": 1.0, "[length]": 2.0, "[time]": -3.0, "[current]": -1.0}),
    "A": (_SMALL, {"[current]": 1.0}),
    "m": (_SMALL, {"[length]": 1.0}),
    "W": (_SMALL, {"[mass]": 1.0, "[length]": 2.0, "[time]": -3.0}),
    "N": (_SMALL, {"[mass]": 1.0, "[length]": 1.0, "[time]": -2.0}),
    "K": ("m", {"[temperature]": 1.0}),
    "rad": ("m", {}),
    "rad/s": ("", {"[time]": -1.0}),
    "m/s2": ("", {"[length]": 1.0, "[time]": -2.0}),
    "1": ("", {}),
}
_BASES |= {
    f"{base}**2": ("", {key: 2.0 * power for key, power in _BASES[base][1].items()})
    for base in ("V", "A", "m")
}
_BASES |= {
    f"{base}/Hz": (
        "",
        # a density over Hz: one power of time more, and none where that makes zero
        {k: p for k, p in {**d, "[time]": d.get("[time]", 0.0) + 1.0}.items() if p},
    )
    for base, d in ((base, _BASES[base][1]) for base in ("W", "V**2", "A**2", "m**2"))
}
COMMON = {
    f"{prefix}{base}": (base, Decimal(1).scaleb(exponent))
    for base, (prefixes, _) in _BASES.items()
    for prefix, exponent in _PREFIXES.items()
    if prefix in prefixes
} | {"": ("1", Decimal(1)), "-": ("1", Decimal(1)), "%": ("1", Decimal("0.01"))}
COMMON["deg"] = "rad", Decimal("3.14159265358979323846264338328") / 180


@made_once
def _registry() -> pint.UnitRegistry[Any]:
    import pint

    registry: pint.UnitRegistry[Any] = pint.UnitRegistry(non_int_type=Decimal)
    registry.define("@alias ohm = Ohm")  # as SI and Modelica write it; takes prefixes
    return registry


@made_once
def _unit(text: str) -> pint.Unit | None:
    """Unit of a written name, in pint's spelling or FMI's ("kg.m2", "m/s2"); None if unknown."""
    name = _FMI_NAMES.get(text.strip(), text.strip())
    if len(name) > LONGEST:
        return None
    name = _ROOT.sub(lambda match: f"({match[1] or match[2]})**0.5", name)
    if not _PLAIN.fullmatch(name):
        return None
    spelled = re.sub(r"(?<=[A-Za-z)])(-?\d+)", r"**\1", name).replace("·", "*")
    spelled = re.sub(r"(?<=[\w)])\.(?=[A-Za-z(])", "*", spelled)
    registry = _registry()  # outside of what nonsense raises: a library that fails is no wrong unit
    for candidate in (name, spelled):
        try:
            parsed = registry.parse_units(candidate)
            _ = parsed.dimensionality  # a level over a unit, as dBm/Hz, has none
            return parsed
        except Exception:  # noqa: S112 - pint raises half a dozen types on nonsense
            continue
    return None


def parse_quantity(text: str, *, where: str, wanted: str | None = None) -> tuple[float, str | None]:
    """Number and unit of a written quantity: "6.94016 MHz" -> (6.94016, "MHz"), "3" -> (3.0, None).

    Args:
        text: as it was written.
        where: file, row or key, for complaints.
        wanted: unit that is wanted, for complaints; None: unknown.

    Raises BadInput, beginning with ``where``, if it is not a finite number followed by a unit that
    exists.
    """
    match = _NUMBER.fullmatch(text) if len(text) <= LONGEST else None
    if match is None:
        raise BadInput(
            f'{where}: found {shown(text)}, wanted a number and a unit, as "6.94016 MHz"'
        )
    value, unit = float(match[1]), match[2]
    if not math.isfinite(value):
        raise BadInput(f"{where}: found {shown(text)}, wanted a finite number")
    if not unit:
        return value, None
    if comma := _DECIMAL_COMMA.match(text):
        raise BadInput(
            f"{where}: found {shown(text)}, wanted a point, not a comma: {comma[1]}.{comma[2]}"
        )
    if unit not in COMMON and _unit(unit) is None:
        raise BadInput(
            f"{where}: found {shown(text)}, but there is no unit {shown(unit)}{_instead(wanted)}"
        )
    return value, unit


def convert(
    value: float,
    unit: str,
    wanted: str | None,
    *,
    where: str,
    zero: Literal["known", "absolute", "difference"] = "known",
) -> float:
    """``value`` from ``unit`` to ``wanted``, rounded once.

    Cycles and angles are not mixed: Hz to rad/s is refused instead of being taken for 1:1.

    Args:
        value: in ``unit``.
        unit: as it was written.
        wanted: unit; None means SI base units.
        where: file, row or key, for complaints.
        zero: what becomes of a unit with a zero of its own, as degC: "known", only where the unit
            that is wanted is known; "absolute", 1 degC is 274.15 K; "difference", as of a standard
            deviation, 1 degC is 1 K.

    Raises:
        BadInput: a unit that is unknown or logarithmic, or two that do not fit.
    """
    if unit == wanted:  # also a private unit name of the FMU, used as the FMU writes it
        return value
    if unit in COMMON and (wanted is None or wanted in COMMON):
        base, size = COMMON[unit]
        other, over = (base, Decimal(1)) if wanted is None else COMMON[wanted]
        if base != other:
            raise BadInput(
                f"{where}: found unit {unit!r}, wanted {wanted!r} or one convertible to it"
            )
        if size == over or not math.isfinite(value):
            return value
        return float(Decimal(repr(float(value))) * size / over)
    source, target = _pair(unit, wanted)
    if source is None:
        raise BadInput(f"{where}: there is no unit {unit!r}{_instead(wanted)}")
    if target is None:
        raise BadInput(f"{where}: found unit {unit!r}, wanted {wanted!r} as the FMU writes it")
    if not _fit(source, target):
        raise BadInput(f"{where}: found unit {unit!r}, wanted {wanted!r} or one convertible to it")
    if source == target or not math.isfinite(value):
        return value
    try:
        exact, factor = Decimal(repr(float(value))), _factor(source, target)
        if factor is not None:
            converted = float(exact * factor)
        elif zero == "known" and wanted is None:
            raise BadInput(
                f"{where}: found unit {unit!r}, which has a zero of its own, for a variable "
                f"without a unit; wanted {base_unit(unit)!r}, or '1' for numbers that are taken as "
                "they are"
            )
        else:
            origin = _by_pint(Decimal(0), source, target) if zero == "difference" else Decimal(0)
            converted = float(_by_pint(exact, source, target) - origin)
    except TypeError as error:  # logarithmic units (dBm) have no decimal arithmetic
        raise BadInput(f"{where}: {unit!r} to {wanted!r} is not a linear conversion") from error
    except ArithmeticError:  # powers beyond all exponents
        converted = math.inf
    if not math.isfinite(converted):
        raise BadInput(f"{where}: found {value:g} {unit}, which is no finite number in {wanted}")
    return converted


def to_base(value: float, unit: str, *, where: str) -> float:
    """``value`` from ``unit`` to SI base units, as formulas are computed: 1 degC is 274.15 K.

    Args:
        value: in ``unit``.
        unit: as it was written.
        where: file, row or key, for complaints.

    Raises:
        BadInput: there is no such unit, or it is a logarithmic one.
    """
    return convert(value, unit, None, where=where, zero="absolute")


@made_once
def _pair(unit: str, wanted: str | None) -> tuple[pint.Unit | None, pint.Unit | None]:
    """Units by their names, the SI base units of the first where no other one is wanted."""
    source = _unit(unit)
    if source is None or wanted is not None:
        return source, None if wanted is None else _unit(wanted)
    target: Any = _registry().get_base_units(source, check_nonmult=False)[1]
    return source, target


@made_once
def _fit(source: pint.Unit, target: pint.Unit) -> bool:
    """Whether two units are of one kind, angles and plain numbers distinguished."""
    return source.dimensionality == target.dimensionality and _angles(source) == _angles(target)


@made_once
def _factor(source: pint.Unit, target: pint.Unit) -> Decimal | None:
    """What values of a unit are multiplied by, as files have thousands; None where that is not all.

    Degrees Celsius have an offset besides.

    Raises:
        TypeError: a logarithmic unit, by pint itself (0.25) or for what it makes of it (0.26).
    """
    zero, one, two = (_by_pint(Decimal(value), source, target) for value in (0, 1, 2))
    if not math.isclose(two - one, one - zero, rel_tol=1e-9):
        raise TypeError(f"{source} to {target} is not a linear conversion")
    return None if zero else one


def _by_pint(value: Decimal, source: pint.Unit, target: pint.Unit) -> Decimal:
    with alone():  # the registry remembers what it has looked up
        quantity: Any = _registry().Quantity(value, source)
        return quantity.to(target).magnitude  # type: ignore[no-any-return]


def is_frequency(unit: str) -> bool:
    """Whether a column in that unit can hold frequencies, in cycles or angles per time."""
    return same_kind(unit, "Hz") or same_kind(unit, "rad/s")


def _instead(wanted: str | None) -> str:
    """What to write instead of a unit that there is not."""
    return f", wanted {wanted!r} or one convertible to it" if wanted else ""


def base_unit(unit: str) -> str:
    """SI base units of a unit that exists, as text: "mN" -> "kg·m/s²".

    Args:
        unit: of the values.
    """
    parsed = _unit(unit)
    with alone():
        return unit if parsed is None else _words(_registry().get_base_units(parsed)[1])


def _words(unit: Any) -> str:
    """A unit in symbols, with one sign of multiplication for all versions of pint."""
    return f"{unit:~P}".replace("⋅", "·")


def dimension_of(unit: str, *, where: str) -> Dimension:
    """Powers of the base dimensions of a unit: "Hz" -> {"[time]": -1}; angles are plain numbers.

    Args:
        unit: as it was written.
        where: file, row or key, for complaints.

    Raises:
        BadInput: there is no such unit.
    """
    if unit in COMMON:
        return _BASES[COMMON[unit][0]][1]
    parsed = _unit(unit)
    if parsed is None:
        raise BadInput(f"{where}: there is no unit {unit!r}")
    with alone():
        return {str(name): float(str(power)) for name, power in parsed.dimensionality.items()}


def product_words(powers: Mapping[str, float]) -> str:
    """A product of units as one unit, in the units of its factors: {"Hz": 2, "V": -1} -> "Hz²/V".

    Args:
        powers: of units that exist, by how they were written.
    """
    with alone():
        made: Any = _registry().Unit("")
        for name, power in powers.items():
            factor: Any = _unit(name)
            made = made * factor ** (int(power) if power == int(power) else Decimal(repr(power)))
        # degrees Celsius and decibels have no products with others: printed as they are
        with contextlib.suppress(Exception):
            made = _registry().Quantity(Decimal(1), made).to_reduced_units().units
        return _words(made) or "a plain number"


def same_kind(unit: str, other: str) -> bool:
    """Whether values in ``unit`` convert to ``other``."""
    try:
        convert(1.0, unit, other, where="")
    except BadInput:
        return False
    return True


def _angles(unit: Any) -> Any:
    """Power of the radian; pint counts it as a plain 1 and would take 1 Hz for 1 rad/s."""
    root = _registry().get_root_units(unit, check_nonmult=False)[1]
    return dict(_registry().Quantity(1, root).unit_items()).get("radian", 0)


def checked_accuracy(value: float, where: str) -> float:
    """The accuracy, if it is one; BadInput, beginning with ``where``, if it is none.

    Args:
        value: the number.
        where: file, row or key, for complaints.
    """
    if not (math.isfinite(value) and 0.0 < value < 1.0):
        raise BadInput(f"{where}: found {value!r}, wanted a relative accuracy above 0 and below 1")
    return value


@dataclass(frozen=True)
class Written:
    """A value as the user wrote it: number, Boolean or text, ``unit`` if it has one of its own.

    Text may still be a quantity ("6.94 MHz") or the value of a String variable; which, is known
    only with the FMU. ``where`` opens every complaint about it.
    """

    value: float | int | bool | str
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


def in_unit(written: Written, unit: str | None, *, difference: bool = False) -> float:
    """The number of a written value in ``unit``; a bare number is in ``unit`` already.

    With ``unit`` None (the unit wanted is unknown) a written unit is taken to SI base units.

    Args:
        written: number or quantity as the file has it.
        unit: of the values.
        difference: whether it is one, as a standard deviation: 1 degC is 1 K.

    Raises:
        BadInput: not a number, or a unit of another dimension.
    """
    value, own, where = written.value, written.unit, written.where
    if isinstance(value, bool):
        raise BadInput(f"{where}: found {value!r}, wanted a number")
    if isinstance(value, str):
        value, own = parse_quantity(value, where=where, wanted=unit)
    if own is None:
        return float(value)
    return convert(
        float(value), own, unit, where=where, zero="difference" if difference else "known"
    )


def above_zero(written: Written | None, unit: str | None, *, difference: bool = False) -> float:
    """The number of a written value in ``unit``; zero where nothing is written.

    Args:
        written: number or quantity as the file has it, None where it has none.
        unit: of the values.
        difference: as of `in_unit`.

    Raises:
        BadInput: not a number, a unit of another dimension, zero or less.
    """
    if written is None:
        return 0.0
    value = in_unit(written, unit, difference=difference)
    if not value > 0.0:
        raise BadInput(f"{written.where}: found {written.value}, wanted more than zero")
    return value


def sigma_in(written: Written | None, unit: str | None) -> float:
    """The standard deviation that is written, in ``unit``; zero where nothing is written.

    Args:
        written: number or quantity as the file has it, None where it has none.
        unit: of the values.

    Raises:
        BadInput: not a number, a unit of another dimension, zero or less.
    """
    return above_zero(written, unit, difference=True)


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
