"""A drift over a series, or an offset from it, that exceeds the line width."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from fitting.campaign import BoundCampaign
from fitting.inference.solved import Solved
from fitting.text.errors import BadInput
from fitting.text.estimate import OffsetEstimate
from fitting.text.finding import Finding, Kind, note, warning
from fitting.text.units import convert

#: A drift of this share of the line width may be why a model does not describe the data: half of it
#: as a departure from a straight line moves a peak on the flank by some per cent.
SUSPECT = 0.1


def check_drift(solved: Solved) -> Iterator[Finding]:
    """The drift of every campaign against the width of its sweep's line, else the declared one."""
    describes = solved.describes or bool(solved.causes)
    for name, bound in solved.problem.campaigns.items():
        labels = {e.label for e in bound.experiments}
        labels |= set() if bound.sweep is None else {bound.sweep.label}
        offsets = tuple(o for o in solved.offsets if o.experiments[0] in labels)
        line = solved.sweeps.lines.get(name)
        width_hz = math.nan if line is None else line.width.value
        if not width_hz > 0.0:
            width_hz = bound.setup.line_width_hz or math.nan
        yield from drift_findings(bound, offsets, width_hz, describes, name)


def drift_findings(
    bound: BoundCampaign,
    offsets: Sequence[OffsetEstimate],
    width_hz: float,
    describes: bool = True,
    subject: str = "",
) -> Iterator[Finding]:
    """Where the drift over the series, or an offset from it, exceeds the line width.

    Of a model that does not describe the data a smaller drift is named too: it may be the cause.

    Args:
        bound: campaign, bound to its FMU.
        offsets: values of single experiments.
        width_hz: full line width, Hz; NaN: not known.
        describes: whether the model describes the data.
        subject: name of the campaign where there are several.
    """
    if not width_hz > 0.0:
        return
    moved = {
        name: abs(after - before) * _in_hertz(bound.drift.units.get(name, "Hz"))
        for name, (before, after) in bound.drift.ends.items()
    }
    wide = {name: hz for name, hz in moved.items() if hz > width_hz}
    suspected = not (describes or offsets) and max(moved.values(), default=0.0) > SUSPECT * width_hz
    if wide or suspected:
        kind = Kind.drift_wide if wide else Kind.drift_suspected
        shown = wide or moved
        names = {"variables": tuple(shown), "offsets": tuple(o.name for o in offsets)}
        finding = note if describes else warning
        yield finding(kind, subject, names, **{"width_hz": width_hz} | shown)
    far = {
        f"{o.experiments[0]} ({', '.join(o.variables)})": abs(o.value) * _in_hertz(o.unit)
        for o in offsets
        if not math.isnan(o.prior) and abs(o.value) * _in_hertz(o.unit) > width_hz
    }
    if far:
        names = {"offsets": tuple(far)}
        yield warning(Kind.drift_offset_wide, subject, names, **{"width_hz": width_hz} | far)


def _in_hertz(unit: str) -> float:
    """Hertz per unit, zero where it is no frequency."""
    try:
        return convert(1.0, unit, "Hz", where="")
    except BadInput:
        return 0.0
