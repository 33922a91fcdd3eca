"""Start values and bounds of what is fitted, from the lines that the data show.

A parameter in hertz is the line's frequency or width itself. Any other one is set by Newton's step
in logarithms, so that an output of the FMU in hertz, read after initialisation, is the line's:

    ln p' = ln p + (ln f - ln o(p))/s        s = d ln o/d ln p, by a small step
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from fitting.campaign.parameters import ParameterTable
from fitting.draft.model import Offer
from fitting.draft.two_modes import TwoModes
from fitting.extension.fmu import Run
from fitting.lines.record import LineValues
from fitting.lines.several import TwoLines
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.units import convert, same_kind

#: Widths of the line on both sides to which its place is bounded, and factor on its width.
REACH, FACTOR = 20.0, 20.0
#: Least bounds of the frequency of a decaying line, in shares of it.
SHARE = 0.02
#: Factor on a coupling that the sweep shows.
COUPLED = 3.0
#: Step of a logarithm for slopes, and Newton's steps.
STEP, ROUNDS = 1e-3, 4
#: Factor to either side where nothing determines the value, that of a strength's bounds, and that
#: of a parameter of a recording.
UNKNOWN, STRONGER, DECADE = 2.0, 10.0, 10.0
#: Why a start value is another than the FMU's own.
CLOSER = "closer to the record than the FMU's own start value, by runs half a decade apart"


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A line that data show: its frequency and full width, Hz, and what each of them is, in words.

    ``reach_hz`` is how far its place may be off. ``amplitude`` of a line that decays is that at the
    first sample, in any unit.
    """

    frequency_hz: float
    width_hz: float
    reach_hz: float = math.inf
    amplitude: float = 1.0
    frequency_words: str
    width_words: str


@dataclass(frozen=True, kw_only=True)
class Box(ParameterTable[float]):
    """A parameter to be fitted: bounds, start and scale in its ``unit``, and what they rest on."""

    unit: str
    scale: float
    why: str


def lines_shown(line: LineValues | None, two: TwoLines | None, where: str) -> list[Shown]:
    """The lines of a sweep, the lower one first; none where neither is known.

    Args:
        line: the single one.
        two: or both; the place of each is off by no more than half the way to the other.
        where: what shows them, in words.
    """
    result: list[tuple[str, float, float, float]] = []
    if line is not None:
        f, w = line.frequency.value, line.width.value
        result = [(f"the line in the {where}", f, w, REACH * w)]
    elif two is not None:
        half = 0.5 * (two.frequency_hz[1] - two.frequency_hz[0])
        names = (f"the {each} line in the {where}" for each in ("lower", "upper"))
        pairs = zip(names, two.frequency_hz, two.width_hz, strict=True)
        result = [(name, f, w, min(REACH * w, half)) for name, f, w in pairs]
    return [
        Shown(
            frequency_hz=f,
            width_hz=w,
            reach_hz=reach,
            frequency_words=f"frequency of {name}",
            width_words=f"width of {name}",
        )
        for name, f, w, reach in result
    ]


def boxes_of(
    offer: Offer, names: Sequence[str], lines: Mapping[str, Shown], fixed: Mapping[str, Scalar]
) -> list[Box]:
    """Bounds and start values.

    Args:
        offer: what the FMU offers.
        names: of the parameters.
        lines: the line that each of them sets, as far as it is known.
        fixed: start values of other variables.

    Raises:
        FmuFailure: the FMU failed with its own start values.
    """
    made: dict[str, Box] = {}
    values = dict(fixed)
    # the widths follow from the places in a model of masses and springs, and not the other way
    for name in sorted(names, key=lambda each: each in offer.widths):
        made[name] = _box(offer, name, lines.get(name), values)
        values[name] = made[name].start
    return [made[name] for name in names]


def _box(offer: Offer, name: str, line: Shown | None, values: Mapping[str, Scalar]) -> Box:
    """A place within widths of its line, a width within a factor; else about the own value."""
    wide, own = name in offer.widths, offer.start(name)
    what = "width" if wide else "frequency"
    start, slope, why = (
        math.nan,
        1.0,
        "nothing in the files determines it: the FMU's own start value",
    )
    if line is not None and (wide or name in offer.places):
        target = line.width_hz if wide else line.frequency_hz
        words = line.width_words if wide else line.frequency_words
        known = in_unit(target, offer.unit(name))
        output = "" if known is not None else _output(offer, name, wide, values)
        if known is not None:
            start, why = known, words
        elif not output:
            why = f"no output has the {what}: the FMU's own start value"
        else:
            start, slope = _solved(offer, name, output, target, values)
            why = f"with it {output} is the {words}"
            if not (math.isfinite(start) and start > 0.0):
                start, why = math.nan, f"{output} does not follow it: the FMU's own start value"
    if line is None or math.isnan(start):
        low, high = sorted((own / UNKNOWN, own * UNKNOWN)) if own else (-1.0, 1.0)
        return bounded(offer, name, (low, high), own, 0.25 * (high - low), why)
    if wide:
        return bounded(offer, name, (start / FACTOR, start * FACTOR), start, start, why)
    part = min(line.reach_hz / line.frequency_hz / abs(slope), 0.5)
    scale = start * line.width_hz / line.frequency_hz / abs(slope)
    return bounded(offer, name, (start * (1.0 - part), start * (1.0 + part)), start, scale, why)


def in_unit(value_hz: float, unit: str) -> float | None:
    """A frequency in a unit of frequencies or angular ones; None for another unit.

    Args:
        value_hz: in Hz.
        unit: wanted.
    """
    for base, factor in (("Hz", 1.0), ("rad/s", 2.0 * math.pi)):
        if same_kind(base, unit):
            return convert(factor * value_hz, base, unit, where="line")
    return None


def bounded(
    offer: Offer, name: str, ends: tuple[float, float], start: float, scale: float, why: str
) -> Box:
    """A box within the range that the FMU declares, numbers as short as they need to be.

    Args:
        offer: what the FMU offers.
        name: of the parameter.
        ends: lower and upper bound, in its unit.
        start: its likely value.
        scale: the change that counts as one.
        why: what these rest on.
    """
    least, most = (getattr(offer.description.variables[name], key) for key in ("min", "max"))
    lower = ends[0] if least is None else max(ends[0], least)
    upper = ends[1] if most is None else min(ends[1], most)
    digits = 2 - math.floor(math.log10(scale)) if scale > 0.0 else 12
    return Box(
        name=name,
        unit=offer.unit(name),
        lower=lower if lower == least else round(lower, digits),
        upper=upper if upper == most else round(upper, digits),
        start=round(min(max(start, lower), upper), digits + 1),
        scale=float(f"{scale:.2g}"),
        why=why,
    )


def strength_box(offer: Offer, name: str, start: float, why: str, *, positive: bool = False) -> Box:
    """A box of a strength whose sign is not known for sure.

    Args:
        offer: what the FMU offers.
        name: of the parameter.
        start: its likely value.
        why: what that rests on.
        positive: whether it is known to be above zero.
    """
    size = abs(start)
    lower = size / STRONGER if positive else -STRONGER * size
    return bounded(offer, name, (lower, STRONGER * size), start, size, why)


def coupled_boxes(
    offer: Offer, modes: TwoModes, lines: Sequence[Shown], names: Sequence[str]
) -> list[Box]:
    """Boxes of two coupled modes, whose lines are not where each would be by itself.

    Args:
        offer: what the FMU offers.
        modes: as they describe the sweep.
        lines: both lines of the sweep, the lower one first.
        names: of the coupling, and of the drive of the second mode where it is fitted.
    """
    low, high = lines
    room = max(high.frequency_hz - low.frequency_hz, low.width_hz, high.width_hz)
    ends = low.frequency_hz - room, high.frequency_hz + room
    made = []
    own = zip(offer.places, offer.widths, modes.frequency_hz, modes.width_hz, strict=False)
    for k, (place, width, f, w) in enumerate(own, 1):
        why = f"of mode {k} by itself: with the coupling both lines follow"
        made.append(bounded(offer, place, ends, f, w, f"frequency {why}"))
        made.append(bounded(offer, width, (w / FACTOR, w * FACTOR), w, w, f"width {why}"))
    coupling, *drive = names
    size = modes.coupling_hz
    scale = min(size, high.frequency_hz * low.width_hz / size)
    why = "the shape and heights of both lines, which modes without it would not have"
    made.append(bounded(offer, coupling, (0.0, COUPLED * size), size, scale, why))
    why = "the same: mode 2 is driven, too"
    return made + [strength_box(offer, name, modes.drive, why) for name in drive]


def decay_boxes(lines: Sequence[Shown], offer: Offer, most_hz: float = math.inf) -> tuple[Box, ...]:
    """Boxes of lines that decay; none where the FMU has other numbers of them, or not in hertz.

    Boxes of two frequencies meet in the middle between their lines: neither line is the other's.

    Args:
        lines: of the record, the lower one first.
        offer: what the FMU offers.
        most_hz: how far a frequency may lie from its line, Hz; zero: a width alone is fitted.
    """
    names = (*offer.places, *offer.widths)
    counts = {len(lines), len(offer.places), len(offer.widths)}
    if (
        len(counts) > 1
        or not lines
        or {*map(offer.unit, names if most_hz else offer.widths)} != {"Hz"}
    ):
        return ()
    made = []
    most = min((*(0.5 * (b.frequency_hz - a.frequency_hz) for a, b in pairwise(lines)), most_hz))
    for line, place, width in zip(lines, offer.places, offer.widths, strict=True):
        f, d = _rounded(line.frequency_hz, 9), _rounded(line.width_hz, 3)
        reach = min(most, _rounded(max(SHARE * f, REACH * line.width_hz), 2))
        ends = _rounded(max(0.5 * f, f - reach), 9), _rounded(f + reach, 9)
        if most_hz:
            made.append(_in_hertz(place, ends, f, _rounded(reach, 2), line.frequency_words))
        ends = _rounded(d / FACTOR, 3), _rounded(d * FACTOR, 3)
        made.append(_in_hertz(width, ends, d, d, line.width_words))
    return tuple(made)


def _in_hertz(name: str, ends: tuple[float, float], start: float, scale: float, why: str) -> Box:
    lower, upper = ends
    return Box(name=name, unit="Hz", lower=lower, upper=upper, start=start, scale=scale, why=why)


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")


def decade_box(offer: Offer, name: str, closer: float | None = None) -> Box:
    """A tenth to ten times a start value, within the FMU's range.

    Args:
        offer: what the FMU offers.
        name: of the parameter.
        closer: a start value that was found; None: the FMU's own.

    Raises:
        BadInput: the start value lies at the end of its range.
    """
    variable = offer.description.variables[name]
    start = offer.start(name) if closer is None else _rounded(closer, 4)
    low, high = sorted((start / DECADE, start * DECADE)) if start else (-1.0, 1.0)
    low = low if variable.min is None else max(low, variable.min)
    high = high if variable.max is None else min(high, variable.max)
    if not low < start < high:
        raise BadInput(
            f"{name}: its start value {start:g} lies at the end of its range, {low:g} to {high:g}; "
            "wanted another --fit"
        )
    digits = 3 - math.floor(math.log10(max(abs(low), abs(high))))
    return Box(
        name=name,
        unit=offer.unit(name),
        lower=low if low == variable.min else round(low, digits + 2),
        upper=high if high == variable.max else round(high, digits),
        start=start,
        scale=_rounded(0.3 * abs(start) or 0.5, 2),
        why=("the FMU's own start value" if closer is None else CLOSER)
        + "; bounds are a guess"
        + (": a tenth of it to ten times" if start else ""),
    )


def _output(offer: Offer, name: str, wide: bool, values: Mapping[str, Scalar]) -> str:
    """The output in hertz that is the frequency, or the width, and follows a parameter; or none."""
    named = [
        n for n in offer.derived if bool(re.search(r"width|damp|fwhm|gamma", n.lower())) == wide
    ]
    start = offer.start(name)
    if not named or start == 0.0:
        return ""
    here, there = _read(offer, named, name, start, values)
    slopes = [
        abs(math.log(b / a)) if a > 0.0 and b > 0.0 else 0.0
        for a, b in zip(here, there, strict=True)
    ]
    best = max(range(len(named)), key=lambda k: slopes[k])
    return named[best] if slopes[best] > 1e-3 * STEP else ""


def _solved(
    offer: Offer, name: str, output: str, target: float, values: Mapping[str, Scalar]
) -> tuple[float, float]:
    """The value with which an output has its target, and the slope of the logarithms there."""
    value, slope = offer.start(name), math.nan
    for _ in range(ROUNDS):
        [here], [there] = _read(offer, [output], name, value, values)
        if not (here > 0.0 and there > 0.0 and here != there):
            return math.nan, math.nan
        slope = math.log(there / here) / STEP
        value *= math.exp(math.log(target / here) / slope)
        if not 0.0 < value < math.inf:
            return math.nan, math.nan
    return value, slope


def _read(
    offer: Offer, outputs: Sequence[str], name: str, value: float, fixed: Mapping[str, Scalar]
) -> list[list[float]]:
    """Outputs after initialisation with a parameter's value, and with one a step of it higher."""
    runs = [
        Run(
            start_values={**fixed, name: value * math.exp(step)},
            settle_s=0.0,
            sample_step_s=1.0,
            samples=1,
            outputs=tuple(outputs),
            allow_nan=True,
        )
        for step in (0.0, STEP)
    ]
    return [[float(number) for number in result[0]] for result in offer.workers.run(runs)]
