"""A value from another experiment, held against the result: distance in standard deviations."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from fitting.inference.likelihood.knowledge import ExternalTest
from fitting.result.result import Result
from fitting.text.errors import BadInput, did_you_mean
from fitting.text.estimate import FittedEstimate
from fitting.text.units import convert, parse_quantity

#: A value and its standard deviation: "0.8604 MHz +- 1 kHz", "0.8604 MHz ± 0.001 MHz".
BOTH = re.compile(r"\s*(?P<value>.*?)\s*(?:±|\+-|\+/-)\s*(?P<std>.*?)\s*")


def with_external(result: Result, given: Sequence[str]) -> Result:
    """The result with one test per NAME=VALUE; VALUE has a unit and may have "+- STD" behind it.

    Args:
        result: what is tested.
        given: as "lambda=0.8604 MHz +- 1 kHz".

    Raises:
        BadInput: no such parameter or derived output, no number, or a unit of another dimension.
    """
    if not given:
        return result
    return replace(result, external=tuple(_test(result, text) for text in given))


def check_external(given: Sequence[str], known: Mapping[str, str] | None = None) -> None:
    """Complain of what `with_external` would refuse, before anything is computed.

    Args:
        given: as "lambda=0.8604 MHz +- 1 kHz".
        known: units of the values that there will be, by name; None: not known yet.

    Raises:
        BadInput: not NAME=VALUE with a number, none of the known names, or another dimension.
    """
    for text in given:
        name, _, value = text.partition("=")
        if not name or not value:
            raise BadInput(f"--external: found {text!r}, wanted NAME=VALUE as in lambda=0.8604MHz")
        for part in _parts(value):
            parse_quantity(part, where=f"--external {name}")
        if known is None:
            continue
        if name not in known:
            raise _no_such(name, list(known))
        for part in _parts(value):
            _in(part, known[name], name)


def _parts(text: str) -> list[str]:
    both = BOTH.fullmatch(text)
    return [both["value"], both["std"]] if both else [text]


def _test(result: Result, text: str) -> ExternalTest:
    name, _, written = text.partition("=")
    values: dict[str, FittedEstimate] = {**result.parameters, **result.derived}
    if name not in values:
        raise _no_such(name, list(values))
    fitted = values[name]
    numbers = [_in(part, fitted.unit, name) for part in _parts(written)]
    value, std = numbers[0], numbers[1] if len(numbers) > 1 else 0.0
    made = ExternalTest(
        name=name,
        value=value,
        std=std,
        unit=fitted.unit,
        found=fitted.value,
        found_std=math.nan,
        sigmas=math.nan,
    )
    if not fitted.status.has_value or not math.isfinite(fitted.std):
        return made
    own, best = _towards(fitted, value), fitted.likely  # whose error it is
    sigmas = (best - value) / math.hypot(own, std)
    return replace(made, found=best, found_std=own, sigmas=sigmas)


def _no_such(name: str, known: Sequence[str]) -> BadInput:
    return BadInput(f"--external: the result has no '{name}'{did_you_mean(name, sorted(known))}")


def _towards(result: FittedEstimate, value: float) -> float:
    """Standard deviation on the side of the external value: intervals may be asymmetric."""
    low, high = result.ci95
    best = result.value if result.is_most_likely else result.most_likely
    side = (best - low if value < best else high - best) / 1.96
    return side if math.isfinite(side) and side > 0.0 else result.std


def _in(text: str, unit: str, name: str) -> float:
    number, written = parse_quantity(text, where=f"--external {name}")
    if written is None:
        return number
    return convert(number, written, unit or None, where=f"--external {name}")
