"""Settings, values and verdicts in words.

Never a value with a small error where the data give none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from fitting.fit.linearisation import IDENTIFIABLE
from fitting.inference.values import DerivedResult, OffsetResult, ParameterResult
from fitting.result.result import Result
from fitting.text.arrays import Scalar
from fitting.text.notation import listed, number, plain, prefixed, quantity, span

#: Correlations from which two errors are named as tied to each other.
TIED = 0.95


def settings_words(settings: Mapping[str, Scalar]) -> str:
    """Settings as "name = value, ...".

    Args:
        settings: values of FMU variables, by name.
    """
    return ", ".join(f"{name} = {scalar_words(value)}" for name, value in settings.items())


def scalar_words(value: Scalar) -> str:
    """A setting as a campaign file writes it.

    Args:
        value: the value.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    return number(value, 12) if isinstance(value, float) else str(value)


def box_words(derived: DerivedResult) -> str:
    """What a derived output could be without data: "63 to 781 kHz".

    Args:
        derived: a derived output.
    """
    low, high = derived.box
    if not (math.isfinite(low) and math.isfinite(high)):
        return "any value to any other"
    factor, unit = prefixed(max(abs(low), abs(high)), derived.unit)
    return span(low / factor, high / factor, unit)


def verdict_words(
    found: ParameterResult | DerivedResult | OffsetResult, box: tuple[float, float], value: str
) -> str:
    """What the data say of a value, in the cell of a table.

    Where they leave it open: the range `box` that it has without them, and the `value` (as written)
    at which the optimiser stopped.

    Args:
        found: value with its verdict.
        box: lower and upper end without data.
        value: the value.
    """
    said = f"{found.identifiable} ({found.shrinkage:.2f})"
    if isinstance(found, OffsetResult) or found.identifiable != IDENTIFIABLE[2]:
        return said
    if math.isnan(box[0]):
        return "has no value at any parameters tried"
    stopped = f", stopped at {value}" if math.isfinite(found.value) else ""
    return f"{said}: {number(box[0])} to {number(box[1])}{stopped}"


def value_sentence(name: str, value: ParameterResult | DerivedResult) -> str:
    """One value: how well it is known, or that it is not, and what it could be.

    Args:
        name: of the value.
        value: the value.
    """
    shown = quantity(value.value, value.std, value.unit)
    if value.identifiable == IDENTIFIABLE[0]:
        return f"{plain(name)} is determined by these data: {shown}."
    if value.identifiable == IDENTIFIABLE[1]:
        return (
            f"{plain(name)} is partly determined: {shown}, of whose variance the data answer for "
            f"{number(100.0 * value.shrinkage, 2)} % and prior and box for the rest."
        )
    bare = _with_prefix(value.value, value.unit)
    return (
        f"{plain(name)} is not determined by these data: {bare} is where prior (reference "
        f"{_with_prefix(value.reference, value.unit)}) and start left it. {_could_be(value)}"
    )


def _could_be(value: ParameterResult | DerivedResult) -> str:
    if isinstance(value, ParameterResult):
        low, high = value.ci95
        words = "Data, box and prior together leave"
    else:
        low, high = value.box
        words = "Within the box of the parameters it could be anything from"
    if not (math.isfinite(low) and math.isfinite(high)):
        return "Within the box of the parameters it could be anything."
    factor, unit = prefixed(max(abs(low), abs(high)), value.unit)
    return f"{words} {span(low / factor, high / factor, unit)}."


def _with_prefix(value: float, unit: str) -> str:
    factor, shown = prefixed(abs(value), unit)
    return f"{number(value / factor, 7)}\u00a0{shown}".strip()


def tied_sentences(result: Result) -> list[str]:
    """Pairs of parameters whose errors hang together, a sentence each.

    Args:
        result: of a reconstruction.
    """
    names = list(result.parameters)
    return [
        f"The errors of {plain(names[j])} and {plain(names[i])} are tied (correlation "
        f"{number(line[j], 3)}): the data hold a combination of the two, not each."
        for i, line in enumerate(result.correlation)
        for j in range(i)
        if abs(line[j]) >= TIED
    ]


def deviation_sentence(result: Result) -> str:
    """How far simulation and laboratory are apart, before and after.

    Args:
        result: of a reconstruction.
    """
    first, last = result.deviations.initial.mean, result.deviations.final.mean
    what = f"{len(result.peaks)} peaks" if result.peaks else "the sweep"
    share = f" ({number(100.0 * last / first, 3)} % of it)" if first > 0.0 else ""
    return (
        f"The mean relative deviation between simulation and laboratory over {what} is "
        f"{number(first, 3)} with the start parameters and {number(last, 3)} with the fitted "
        f"ones{share}."
    )


def equal_alternatives_sentence(result: Result) -> str:
    """Alternatives that fit as well as the reported one; empty without any.

    Args:
        result: of a reconstruction.
    """
    equal = [a for a in result.alternatives if a.equal_to_best and not a.reported]
    if not equal:
        return ""
    others = listed(settings_words(a.settings) for a in equal)
    return f"The data do not tell the alternatives apart: {others} reaches the same J."
