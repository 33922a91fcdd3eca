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
from fitting.text.arrays import Scalar
from fitting.text.errors import BadInput
from fitting.text.units import convert, same_kind

#: Widths of the line on both sides to which its place is bounded, and factor on its width.
REACH, FACTOR = 20.0, 20.0
#: Least bounds of the frequency of a decaying line, in shares of it.
SHARE = 0.02
#: Factor on a coupling that the sweep shows.
COUPLED = 3.0
#: Step of a logarithm for slopes, Newton's steps, and the least slope with which an output follows.
STEP, ROUNDS, LEAST_SLOPE = 1e-3, 4, 1e-3
#: Names of outputs that are widths.
WIDTH_OUTPUT = re.compile(r"width|damp|fwhm|gamma")
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


def boxes_of(
    offer: Offer, names: Sequence[str], lines: Mapping[str, Shown], fixed: Mapping[str, Scalar]
) -> list[Box]:
    """Bounds and start values: a place within widths of its line, a width within a factor of it.

    What no line sets is bounded about the FMU's own value.

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
        wide, line = name in offer.widths, lines.get(name)
        start, slope = math.nan, 1.0
        why = "nothing in the files determines it: the FMU's own start value"
        if line is not None and (wide or name in offer.places):
            start, slope, why = _start(offer, name, line, values)
        if line is None or math.isnan(start):
            own = offer.start(name)
            low, high = sorted((own / UNKNOWN, own * UNKNOWN)) if own else (-1.0, 1.0)
            ends, start, scale = (low, high), own, 0.25 * (high - low)
        elif wide:
            ends, scale = (start / FACTOR, start * FACTOR), start
        else:
            part = min(line.reach_hz / line.frequency_hz / abs(slope), 0.5)
            ends = start * (1.0 - part), start * (1.0 + part)
            scale = start * line.width_hz / line.frequency_hz / abs(slope)
        made[name] = bounded(offer, name, ends, start, scale, why)
        values[name] = made[name].start
    return [made[name] for name in names]


def _start(
    offer: Offer, name: str, line: Shown, values: Mapping[str, Scalar]
) -> tuple[float, float, str]:
    """Where a place or a width starts by its line, the slope d ln f/d ln p there, and why.

    NaN where no output in hertz follows the parameter.
    """
    wide, value = name in offer.widths, offer.start(name)
    target = line.width_hz if wide else line.frequency_hz
    words = line.width_words if wide else line.frequency_words
    known = in_unit(target, offer.unit(name))
    if known is not None:
        return known, 1.0, words

    def read(outputs: Sequence[str], value: float) -> list[tuple[float, float]]:
        """Outputs after initialisation with a value, each with that of a value a step higher."""
        runs = [
            Run(
                start_values={**values, name: value * math.exp(step)},
                settle_s=0.0,
                sample_step_s=1.0,
                samples=1,
                outputs=tuple(outputs),
                allow_nan=True,
            )
            for step in (0.0, STEP)
        ]
        here, there = offer.workers.run(runs)
        return [(float(a), float(b)) for a, b in zip(here[0], there[0], strict=True)]

    # the output that follows it most
    named = [n for n in offer.derived if bool(WIDTH_OUTPUT.search(n.lower())) == wide]
    pairs = read(named, value) if named and value != 0.0 else []
    moves = [abs(math.log(b / a)) if a > 0.0 and b > 0.0 else 0.0 for a, b in pairs]
    if not max(moves, default=0.0) > LEAST_SLOPE * STEP:
        what = "width" if wide else "frequency"
        return math.nan, 1.0, f"no output has the {what}: the FMU's own start value"
    output, slope = named[moves.index(max(moves))], math.nan
    for _ in range(ROUNDS):
        [(here, there)] = read([output], value)
        if not (here > 0.0 and there > 0.0 and here != there):
            value = math.nan
            break
        slope = math.log(there / here) / STEP
        value *= math.exp(math.log(target / here) / slope)
        if not 0.0 < value < math.inf:
            break
    if not 0.0 < value < math.inf:
        return math.nan, 1.0, f"{output} does not follow it: the FMU's own start value"
    return value, slope, f"with it {output} is the {words}"


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
        rows = [
            (place, max(0.5 * f, f - reach), f + reach, f, 9, _rounded(reach, 2)),
            (width, d / FACTOR, d * FACTOR, d, 3, d),
        ]
        for name, low, high, start, digits, scale in rows if most_hz else rows[1:]:
            made.append(
                Box(
                    name=name,
                    unit="Hz",
                    lower=_rounded(low, digits),
                    upper=_rounded(high, digits),
                    start=start,
                    scale=scale,
                    why=line.width_words if name == width else line.frequency_words,
                )
            )
    return tuple(made)


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
