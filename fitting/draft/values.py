"""Start values and boxes of what is fitted, from the line that a sweep shows.

A parameter in hertz is the line's frequency or width itself. Any other one is set by Newton's step
in logarithms, so that an output of the FMU in hertz, read after initialisation, tells the line:

    ln p' = ln p + (ln f - ln o(p))/s        s = d ln o/d ln p, by a small step
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from fitting.campaign.parameters import ParameterTable
from fitting.draft.model import Offer
from fitting.draft.two_modes import TwoModes
from fitting.fmu import FmuWorkers, Run
from fitting.resonance.two_lines import TwoLines
from fitting.signal.line_record import LineValues
from fitting.text.arrays import Scalar
from fitting.text.units import convert, same_kind

#: Widths of the line on both sides to which its place is bounded, and factor on its width.
REACH, FACTOR = 20.0, 20.0
#: Factor on a coupling that the sweep shows.
COUPLED = 3.0
#: Step of a logarithm for slopes, and Newton's steps.
STEP, ROUNDS = 1e-3, 4
#: Factor to either side where nothing tells the value, and that of a strength's box.
UNKNOWN, STRONGER = 2.0, 10.0


@dataclass(frozen=True, kw_only=True)
class Seen:
    """A line that a sweep shows: frequency, full width, Hz, and its name.

    ``reach_hz`` is how far its place may be off: its own widths, and no further than half the way
    to the next line.
    """

    frequency_hz: float
    width_hz: float
    reach_hz: float
    words: str = "the line in the sweep"


@dataclass(frozen=True, kw_only=True)
class Box(ParameterTable[float]):
    """A parameter to be fitted: bounds, start and scale in its ``unit``, and what they rest on."""

    unit: str
    scale: float
    why: str


def boxes_of(
    workers: FmuWorkers,
    offer: Offer,
    names: Sequence[str],
    seen: Mapping[str, Seen],
    fixed: Mapping[str, Scalar],
) -> list[Box]:
    """Bounds and start values.

    Args:
        workers: processes that run the FMU.
        offer: what it offers.
        names: of the parameters.
        seen: the line that each of them sets, as far as it is known.
        fixed: start values of other variables.

    Raises:
        FmuFailure: the FMU failed with its own start values.
    """
    made: dict[str, Box] = {}
    values = dict(fixed)
    # the widths follow from the places in a model of masses and springs, and not the other way
    for name in sorted(names, key=lambda each: each in offer.widths):
        box = _box(workers, offer, name, seen.get(name), values)
        values[name] = box.start
        made[name] = box
    return [made[name] for name in names]


def seen_of(line: LineValues | None, two: TwoLines | None, where: str = "sweep") -> list[Seen]:
    """The lines of a sweep, the lower one first; none where neither is known.

    Args:
        line: the single one.
        two: or both.
        where: what shows them, in words.
    """
    if line is not None:
        return [
            Seen(
                frequency_hz=line.frequency.value,
                width_hz=line.width.value,
                reach_hz=REACH * line.width.value,
                words=f"the line in the {where}",
            )
        ]
    if two is None:
        return []
    half = 0.5 * (two.frequency_hz[1] - two.frequency_hz[0])
    names = (f"the {each} line in the {where}" for each in ("lower", "upper"))
    pairs = zip(two.frequency_hz, two.width_hz, names, strict=True)
    return [
        Seen(frequency_hz=f, width_hz=w, reach_hz=min(REACH * w, half), words=words)
        for f, w, words in pairs
    ]


def _box(
    workers: FmuWorkers, offer: Offer, name: str, line: Seen | None, values: Mapping[str, Scalar]
) -> Box:
    unit = offer.unit(name)
    wide = name in offer.widths
    if line is None or not (wide or name in offer.places):
        return _unknown(offer, name, "nothing in the files tells it: the FMU's own start value")
    target = line.width_hz if wide else line.frequency_hz
    what = "width" if wide else "frequency"
    value = in_unit(target, unit)
    if value is not None:
        why = f"{what} of {line.words}"
        return _about(offer, name, value, 1.0, line, why)
    output = _output(workers, offer, name, wide, values)
    if output is None:
        return _unknown(offer, name, f"no output tells the {what}: the FMU's own start value")
    start, slope = _solved(workers, name, output, target, values, _start(offer, name))
    if not (math.isfinite(start) and start > 0.0):
        return _unknown(offer, name, f"{output} does not follow it: the FMU's own start value")
    why = f"with it {output} is the {what} of {line.words}"
    return _about(offer, name, start, slope, line, why)


def in_unit(value_hz: float, unit: str) -> float | None:
    """A frequency in a unit of frequencies or angular ones; None for another unit.

    Args:
        value_hz: in Hz.
        unit: wanted.
    """
    if same_kind("Hz", unit):
        return convert(value_hz, "Hz", unit, where="line")
    if same_kind("rad/s", unit):
        return convert(2.0 * math.pi * value_hz, "rad/s", unit, where="line")
    return None


def _about(offer: Offer, name: str, start: float, slope: float, line: Seen, why: str) -> Box:
    """A box about a value: a place within widths of the line, a width within a factor."""
    if name in offer.widths:
        lower, upper, scale = start / FACTOR, start * FACTOR, start
    else:
        part = min(line.reach_hz / line.frequency_hz / abs(slope), 0.5)
        lower, upper = start * (1.0 - part), start * (1.0 + part)
        scale = start * line.width_hz / line.frequency_hz / abs(slope)
    return _bounded(
        offer,
        name,
        Box(
            name=name,
            unit=offer.unit(name),
            lower=lower,
            upper=upper,
            start=start,
            scale=scale,
            why=why,
        ),
    )


def _unknown(offer: Offer, name: str, why: str) -> Box:
    start = _start(offer, name)
    low, high = sorted((start / UNKNOWN, start * UNKNOWN)) if start else (-1.0, 1.0)
    scale = 0.25 * (high - low)
    return _bounded(
        offer,
        name,
        Box(
            name=name,
            unit=offer.unit(name),
            lower=low,
            upper=high,
            start=start,
            scale=scale,
            why=why,
        ),
    )


def _bounded(offer: Offer, name: str, box: Box) -> Box:
    """The box within the range that the FMU declares, numbers as short as they need to be."""
    variable = offer.description.variables[name]
    lower = box.lower if variable.min is None else max(box.lower, variable.min)
    upper = box.upper if variable.max is None else min(box.upper, variable.max)
    start = min(max(box.start, lower), upper)
    digits = 2 - math.floor(math.log10(box.scale)) if box.scale > 0.0 else 12
    return replace(
        box,
        lower=lower if lower == variable.min else round(lower, digits),
        upper=upper if upper == variable.max else round(upper, digits),
        start=round(start, digits + 1),
        scale=float(f"{box.scale:.2g}"),
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
    box = Box(
        name=name,
        unit=offer.unit(name),
        lower=size / STRONGER if positive else -STRONGER * size,
        upper=STRONGER * size,
        start=start,
        scale=size,
        why=why,
    )
    return _bounded(offer, name, box)


def coupled_boxes(
    offer: Offer, modes: TwoModes, seen: Sequence[Seen], names: Sequence[str]
) -> list[Box]:
    """Boxes of two coupled modes, whose lines are not where each would be by itself.

    Args:
        offer: what the FMU offers.
        modes: as they describe the sweep.
        seen: both lines of the sweep, the lower one first.
        names: of the coupling, and of the drive of the second mode where it is fitted.
    """
    low, high = seen
    room = max(high.frequency_hz - low.frequency_hz, low.width_hz, high.width_hz)
    ends = low.frequency_hz - room, high.frequency_hz + room
    made = []
    for k, (place, width) in enumerate(zip(offer.places, offer.widths, strict=False)):
        if k < len(modes.frequency_hz):
            f, w = modes.frequency_hz[k], modes.width_hz[k]
            why = f"of mode {k + 1} by itself: with the coupling both lines follow"
            made.append(_box_between(offer, place, f, ends, w, f"frequency {why}"))
            made.append(_box_between(offer, width, w, (w / FACTOR, w * FACTOR), w, f"width {why}"))
    coupling, *drive = names
    size = modes.coupling_hz
    scale = min(size, high.frequency_hz * low.width_hz / size)
    why = "the shape and heights of both lines, which modes without it would not have"
    made.append(_box_between(offer, coupling, size, (0.0, COUPLED * size), scale, why))
    why = "the same: mode 2 is driven, too"
    made += [strength_box(offer, name, modes.drive, why) for name in drive]
    return made


def _box_between(
    offer: Offer,
    name: str,
    start: float,
    ends: tuple[float, float],
    scale: float,
    why: str,
) -> Box:
    """A box in Hz with given ends."""
    return _bounded(
        offer,
        name,
        Box(
            name=name,
            unit=offer.unit(name),
            lower=ends[0],
            upper=ends[1],
            start=start,
            scale=scale,
            why=why,
        ),
    )


def _start(offer: Offer, name: str) -> float:
    start = offer.description.variables[name].start
    return 0.0 if start is None else float(start)


def _output(
    workers: FmuWorkers, offer: Offer, name: str, wide: bool, values: Mapping[str, Scalar]
) -> str | None:
    """The output in hertz that tells the frequency, or the width, and follows a parameter."""
    named = [
        n for n in offer.derived if bool(re.search(r"width|damp|fwhm|gamma", n.lower())) == wide
    ]
    start = _start(offer, name)
    if not named or start == 0.0:
        return None
    here, there = _read(
        workers, named, [{**values, name: start}, {**values, name: start * math.exp(STEP)}]
    )
    slopes = [
        abs(math.log(b / a)) if a > 0.0 and b > 0.0 else 0.0
        for a, b in zip(here, there, strict=True)
    ]
    best = max(range(len(named)), key=lambda k: slopes[k])
    return named[best] if slopes[best] > 1e-3 * STEP else None


def _solved(
    workers: FmuWorkers,
    name: str,
    output: str,
    target: float,
    values: Mapping[str, Scalar],
    start: float,
) -> tuple[float, float]:
    """The value with which an output has its target, and the slope of the logarithms there."""
    value, slope = start, math.nan
    for _ in range(ROUNDS):
        tried = [{**values, name: value * math.exp(step)} for step in (0.0, STEP)]
        [here], [there] = _read(workers, [output], tried)
        if not (here > 0.0 and there > 0.0 and here != there):
            return math.nan, math.nan
        slope = math.log(there / here) / STEP
        value *= math.exp(math.log(target / here) / slope)
        if not 0.0 < value < math.inf:
            return math.nan, math.nan
    return value, slope


def _read(
    workers: FmuWorkers, outputs: Sequence[str], starts: Sequence[Mapping[str, Scalar]]
) -> list[list[float]]:
    """Outputs after initialisation with start values, a row each."""
    runs = [
        Run(
            start_values=start,
            settle_s=0.0,
            sample_step_s=1.0,
            samples=1,
            outputs=tuple(outputs),
            allow_nan=True,
        )
        for start in starts
    ]
    return [[float(value) for value in found[0]] for found in workers.run(runs)]
