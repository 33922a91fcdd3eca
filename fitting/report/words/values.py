"""Settings, values and verdicts in words.

Never a value with a small error where the data give none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol

from fitting.inference.verdicts import ON_BOTH_SIDES, WAS_CUT
from fitting.result.result import STATUSES, Result
from fitting.text.estimate import Estimate, Verdict
from fitting.text.notation import (
    bound,
    how_many,
    listed,
    number,
    prefixed,
    settings_words,
    span,
    unit_text,
)

#: Values, and ends of intervals over their width, that are as near are the same.
SAME, SAME_END = 1e-9, 0.02
#: That a search was cut, in the cell of a table, below which the rest is said.
IN_A_CELL = "cut for its cost"


class Valued(Protocol):
    """What has values: a result, or what was inferred of a fit."""

    @property
    def parameters(self) -> Mapping[str, Estimate]:
        """Fitted parameters by name."""

    @property
    def derived(self) -> Mapping[str, Estimate]:
        """Derived outputs by name."""

    @property
    def offsets(self) -> tuple[Estimate, ...]:
        """Values of single experiments."""


def same_values(result: Valued) -> dict[str, str]:
    """Outputs that are a parameter, or an earlier output, under another name, with that name.

    One mode's eigenfrequency is such an output, and the frequencies of two equal circuits are:
    value, error and interval are the same number.

    Args:
        result: of a reconstruction, or what was inferred of a fit.
    """
    found: dict[str, str] = {}
    first: dict[str, Estimate] = dict(result.parameters)
    for name, d in result.derived.items():
        same = [other for other, p in first.items() if d.unit == p.unit and _same(d, p)]
        if same:
            found[name] = same[-1]
        else:
            first[name] = d
    return found


def _same(one: Estimate, other: Estimate) -> bool:
    """Whether two values are one number, in all that was found of them."""
    if one.status is not other.status or one.spread > SAME * abs(one.value):
        return False
    if (
        not math.isclose(one.value, other.value, rel_tol=SAME)
        or one.active_bounds != other.active_bounds
    ):
        return False
    width = other.ci95[1] - other.ci95[0]
    ends = zip(one.ci95, other.ci95, strict=True)
    return width > 0.0 and all(abs(here - there) < SAME_END * width for here, there in ends)


def offset_name(offset: Estimate) -> str:
    """A value of single experiments: "eta_plus and eta_minus: offset in pair1".

    Args:
        offset: value of one state of the sample.
    """
    return f"{listed(offset.variables)}: offset in {listed(offset.experiments)}"


def box_words(derived: Estimate) -> str:
    """What a derived output could be without data: "63 to 781 kHz".

    Args:
        derived: a derived output.
    """
    low, high = derived.bounds
    if not (math.isfinite(low) and math.isfinite(high)):
        return "any value to any other"
    factor, unit = prefixed(max(abs(low), abs(high)), derived.unit)
    return span(low / factor, high / factor, unit)


def reported_words(found: Estimate) -> str:
    """A value with its error; where they are not of one estimator, each by its own name.

    Args:
        found: value with its verdict.
    """
    if found.is_most_likely:
        return found.likely_words
    outside = ", outside the 95 % interval of the likelihood" if found.is_outside else ""
    best = found.likely_words
    return f"{_with_prefix(found.value, found.unit)} by Algorithm 2{outside} (most likely {best})"


def period_words(found: Estimate) -> str:
    """The whole period of a value that goes round: "its whole period of 3.14 rad".

    Args:
        found: value whose interval is all of its period.
    """
    assert found.period is not None  # noqa: S101 - asked by the caller
    factor, unit = prefixed(found.period, found.unit)
    return f"its whole period of {number(found.period / factor, 3)}\u00a0{unit}".rstrip()


def verdict_words(found: Estimate) -> str:
    """What the data say of a value, in the cell of a table.

    Args:
        found: value with its verdict.
    """
    verdict = found.status
    if found.role == "offset":
        return str(verdict)
    low, high = found.ci95
    reason = found.reason.replace(f"{ON_BOTH_SIDES}{WAS_CUT}", WAS_CUT).replace(WAS_CUT, IN_A_CELL)
    if verdict in (Verdict.OPEN, Verdict.UNKNOWN) and math.isnan(low):
        return f"{verdict}{found.condition}: {reason}"
    where = found.condition
    said = {
        Verdict.DETERMINED: f"determined {found.reason}{where}",
        Verdict.BOUNDED: f"{verdict}{where}, {span(low, high)}",
        Verdict.ABOVE: f"{verdict}{where}, {bound(high, up=True)} at most",
        Verdict.BELOW: f"{verdict}{where}, {bound(low, up=False)} at least",
        Verdict.OPEN: f"{verdict}{where}: {_open_range(found)} fits",
        Verdict.LINEARISED: f"{verdict}{where}",
    }
    words = said.get(verdict, f"{verdict}{where}: {reason}")
    withdrawn = verdict is Verdict.WITHDRAWN
    if not (withdrawn or math.isnan(found.bound_passed)):
        end = f"{number(found.bound_passed)} {unit_text(found.unit)}".rstrip()
        words += f", beyond its box (ends at {end})"
    if verdict.has_value and found.is_outside:
        words += "; the value lies outside its 95 % interval"
    return words


def _open_range(found: Estimate) -> str:
    return period_words(found) if found.is_all_round else span(*found.ci95)


def _with_prefix(value: float, unit: str) -> str:
    factor, shown = prefixed(abs(value), unit)
    return f"{number(value / factor, 7)}\u00a0{shown}".strip()


def deviation_sentence(result: Result) -> str:
    """How far simulation and laboratory are apart, before and after.

    Args:
        result: of a reconstruction.
    """
    first, last = result.deviations.initial.mean, result.deviations.final.mean
    what = "The mean size of the residuals"
    if result.peaks:
        peaks = how_many(len(result.peaks), "peak")
        what = f"The mean relative deviation between simulation and laboratory over {peaks}"
    share = f" ({number(100.0 * last / first, 3)} % of it)" if first > 0.0 else ""
    return (
        f"{what} is {number(first, 3)} with the start parameters and {number(last, 3)} with the "
        f"fitted ones{share}."
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


def point_words(result: Result) -> str:
    """At which parameters the outputs of the FMU are taken that are reported.

    Args:
        result: of a reconstruction.
    """
    if result.status == STATUSES[2]:
        return "the parameters at which the search stood when it was interrupted"
    if all(d.is_most_likely for d in result.derived.values()):
        return "the most likely parameters"
    return "the parameters at which Algorithm 2 ended"
