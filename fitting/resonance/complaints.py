"""What speaks against one resonance in a trace: none, two of them, or one that its ends cut off."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import fdtrc

from fitting.resonance.form import TRANSMISSION, FittedForm
from fitting.resonance.further_lines import Flank, FurtherLine, beyond_ends, flank
from fitting.resonance.trace import Trace
from fitting.resonance.two_lines import TwoLines, TwoResonances, overlapping
from fitting.signal.peaks import AMONG, TAIL, UNKNOWNS
from fitting.signal.residual_tests import SMALLEST_RESIDUAL, TOGETHER
from fitting.signal.sweep_faults import Fault, SweepFault, sweep_faults
from fitting.text.errors import BadInput
from fitting.text.notation import hertz, number, with_error

#: A resonance is there if noise alone were to look like one less often than this.
SEEN_P = 1e-3
#: Squares by which a curve is off from any that only rises or only falls, over those of the noise,
#: from which no flank describes the points.
TURNS = 10.0
#: Points at an end of which one is the largest where the end cuts off a line.
AT_END = 3
#: Error over the width of a line from which its numbers are not told.
TOLD_SHARE = 0.5


def check_one(
    trace: Trace,
    best: FittedForm,
    further: Sequence[FurtherLine],
    failed: Mapping[str, str],
) -> None:
    """Complain of no line, and of one that the ends of the sweep cut off.

    Args:
        trace: what was measured.
        best: the form that is taken.
        further: lines outside that are seen.
        failed: what the forms complained of that could not be fitted, by their names.

    Raises:
        BadInput: one of these.
    """
    f = trace.frequency_hz
    ends = hertz(f[0], f[-1], digits=8, joined=" and ")
    if _chance(trace, best, 1.0) > SEEN_P:
        raise BadInput(
            f"{trace.source}: shows no resonance between {ends}: a straight line describes its "
            "points as well"
        )
    if not _turns(best):
        complain_of_flank(trace, further, best.squares, best.unknowns)
    if _chance(trace, best, best.structure.together) > SEEN_P:
        complain_of_ends(trace)
        if AMONG in failed.get(TAIL, ""):
            raise BadInput(f"{failed[TAIL]}; wanted a range that holds one, --from and --to")
        worth = max(1.0, f.size / best.structure.together**2)
        raise BadInput(
            f"{trace.source}: no form of a line describes its points between {ends}: the residuals "
            f"of the best one, {best.name}, at {hertz(best.frequency.value, digits=8)}, "
            f"{TOGETHER}, so that the {f.size} points are worth {number(worth, 2)} independent ones"
        )
    left, right = best.frequency.value - f[0], f[-1] - best.frequency.value
    if min(left, right) < 0.5 * best.width.value:
        end, where = ("first", f[0]) if left < right else ("last", f[-1])
        raise BadInput(
            f"{trace.source}: its resonance at {hertz(best.frequency.value, digits=8)}, "
            f"{hertz(best.width.value, digits=3)} wide, is cut off by the {end} point of the sweep "
            f"at {hertz(where, digits=8)}; wanted half a width on both sides at least"
        )


def not_one(trace: Trace, two: TwoLines) -> TwoResonances:
    """The complaint of two lines of which none is far lower.

    Args:
        trace: what was measured.
        two: the lines.
    """
    places = hertz(*two.frequency_hz, digits=5)
    widths = hertz(*two.width_hz, digits=3)
    way = (
        "a campaign whose model has two modes fits both, as fmu-fit init drafts it"
        if two.overlap
        else "wanted one, as --from and --to choose it; fmu-fit init drafts a campaign of both"
    )
    return TwoResonances(
        f"{trace.source}: shows two resonances, at {places} ({widths} wide); {way}",
        lines=two,
        phases_reversed=trace.phases_reversed,
    )


def check_overlap(trace: Trace, best: FittedForm, found: Sequence[FittedForm]) -> None:
    """Complain of two lines with one top, where nothing else explains what one line leaves.

    Args:
        trace: what was measured.
        best: the form that is taken.
        found: all forms.

    Raises:
        TwoResonances: there are two.
    """
    two = None if faults_of(trace, best) else overlapping(trace, found)
    if two is not None:
        raise TwoResonances(
            f"{trace.source}: two lines that overlap describe its points, and one line does not: "
            f"the best form of one, {best.name}, leaves {number(two.times, 2)} times as much (in "
            f"squares). {_overlapping(two)} A campaign whose model has two modes fits both, as "
            "fmu-fit init drafts it",
            lines=two,
            phases_reversed=trace.phases_reversed,
        )


def complain_of_flank(
    trace: Trace, further: Sequence[FurtherLine], squares: float, unknowns: int = 0
) -> None:
    """Complain where the flank of a line beyond the ends describes amplitudes as well.

    Args:
        trace: what was measured.
        further: lines outside that are seen.
        squares: what the form that is taken leaves; infinite: there is none.
        unknowns: of that form.

    Raises:
        BadInput: it does.
    """
    if trace.is_complex:
        return
    found = flank(trace, outside(trace, further))
    straight, rows = _straight(trace), trace.rows
    if found is None or not found.squares > 0.0 or rows <= UNKNOWNS["none"] + 1:
        return
    gain = (straight - found.squares) * (rows - UNKNOWNS["none"]) / found.squares
    if fdtrc(1, rows - UNKNOWNS["none"], max(0.0, gain)) > SEEN_P / rows:
        return
    more = unknowns - UNKNOWNS["none"]
    if more > 0:
        better = (found.squares - squares) / more * (rows - unknowns) / squares
        if rows * fdtrc(more, rows - unknowns, max(0.0, better)) <= SEEN_P:
            return
    raise _cut_off(trace, found, further)


def complain_of_ends(trace: Trace) -> None:
    """Complain of amplitudes of which an end holds the largest, where no form describes them.

    Args:
        trace: what was measured.

    Raises:
        BadInput: an end does.
    """
    f, top = trace.frequency_hz, int(np.argmax(trace.amplitude))
    if trace.is_complex or AT_END <= top < f.size - AT_END:
        return
    end, where = ("first", f[0]) if 2 * top < f.size - 1 else ("last", f[-1])
    raise BadInput(
        f"{trace.source}: is largest at its {end} point, {hertz(where, digits=8)}, which cuts off "
        "a line; wanted half a width on both sides at least"
    )


def faults_of(trace: Trace, best: FittedForm) -> tuple[SweepFault, ...]:
    """What makes amplitudes no damped line, where the best form leaves something of them.

    Args:
        trace: what was measured.
        best: the form that is taken.
    """
    if trace.is_complex or (best.name != TRANSMISSION and best.structure.order == 0):
        return ()
    if best.second is not None:
        return ()
    found = sweep_faults(trace.frequency_hz, trace.amplitude)
    return tuple(f for f in found if f.fault is not Fault.BACKGROUND)


def outside(trace: Trace, further: Sequence[FurtherLine]) -> Sequence[FurtherLine]:
    """Lines that are seen outside, or where they may be.

    Args:
        trace: what was measured.
        further: lines outside that are seen.
    """
    return further or beyond_ends(trace.frequency_hz, 0.1 * float(np.ptp(trace.frequency_hz)))


def _overlapping(two: TwoLines) -> str:
    """Where two lines are and how wide, in words, as far as the points tell."""
    values = zip((*two.frequency_hz, *two.width_hz), two.std_hz, two.width_hz * 2, strict=True)
    if any(std > TOLD_SHARE * width for _, std, width in values):
        return "The points do not determine where each of them is."
    low, up, *widths = (
        with_error(value, std, "Hz")
        for value, std in zip((*two.frequency_hz, *two.width_hz), two.std_hz, strict=True)
    )
    return f"They are at {low}, {widths[0]} wide, and at {up}, {widths[1]} wide."


def _turns(best: FittedForm) -> bool:
    """Whether a form that leaves noise alone rises and falls by far more than that noise.

    The flank of one line beyond the ends does only one of both, and is then not looked for.
    """
    if best.structure.order > 0:
        return False
    curve = np.abs(best.curve) / float(np.max(np.abs(best.curve)))
    reversals = [
        np.maximum.accumulate(each) - np.minimum.accumulate(each[::-1])[::-1]
        for each in (curve, curve[::-1])
    ]
    off = min(float(np.sum((0.5 * gap) ** 2)) for gap in reversals)
    return off > TURNS * best.squares


def _cut_off(trace: Trace, line: Flank, further: Sequence[FurtherLine]) -> BadInput:
    """The complaint of a line beyond an end; where it is, points outside tell."""
    f = trace.frequency_hz
    below = line.frequency_hz < f[0]
    end, where = ("first", f[0]) if below else ("last", f[-1])
    there = [each.frequency_hz for each in further if (each.frequency_hz < f[0]) is below]
    place = f", near {hertz(there[0], digits=6)}" if there else ""
    return BadInput(
        f"{trace.source}: its {end} point at {hertz(where, digits=8)} cuts off a line: the points "
        f"are the flank of one beyond it{place}; wanted half a width on both sides at least"
    )


def _straight(trace: Trace, delay_s: float = math.nan) -> float:
    """What a straight line leaves of a trace, its delay taken out: squares over the largest."""
    f = trace.frequency_hz
    y = trace.values / float(np.max(trace.amplitude))
    if not math.isnan(delay_s):
        y = y * np.exp(2j * np.pi * (f - float(np.mean(f))) * delay_s)
    x = (f - float(np.mean(f))) / float(np.ptp(f))
    columns = np.column_stack([np.ones_like(x), x])
    return float(np.sum(np.abs(y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]) ** 2))


def _chance(trace: Trace, best: FittedForm, widening: float) -> float:
    """Probability that noise gains as much by a line over a straight one, at any of its points.

    The noise is white with `widening` 1, else it hangs together as that says.

    Source: N. Draper and H. Smith, Applied Regression Analysis (extra sum of squares), with
    Bonferroni's bound.
    """
    before = _straight(trace, math.nan if best.delay is None else best.delay.value)
    rows = trace.rows
    if best.squares <= rows * SMALLEST_RESIDUAL**2:
        return 0.0 if before > best.squares else 1.0
    more = max(1, best.unknowns - (4 if trace.is_complex else 2))
    freedom = max(1.0, (rows - best.unknowns) / widening**2)
    gain = max(0.0, (before - best.squares) / more * freedom / best.squares)
    return min(1.0, trace.frequency_hz.size * float(fdtrc(more, freedom, gain)))
