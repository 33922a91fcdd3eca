"""Grid of a trace: evenly spaced times, and whether the values are whole."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.text.arrays import FloatArray
from fitting.text.errors import BadInput

#: Samples of a trace, at least.
LEAST_SAMPLES = 8
#: Share of a spacing by which a time may be off the even grid: files round their times.
ROUNDED = 0.02
#: A spacing this many times the usual one is a gap.
GAP = 1.5
#: Stretches of equal extreme values, samples in each, and jump into them, in quanta: clipped. A
#: parabola that is within one quantum over three samples comes there by four quanta at most.
STRETCHES, FLAT, JUMP = 2, 3, 6.0
#: Samples of a stretch that is clipped though it is the only one.
ALONE = 8


def spacing_s(time_s: FloatArray, source: str, places: Sequence[str] = ()) -> float:
    """Spacing of evenly spaced times (n,).

    Args:
        time_s: as recorded, s.
        source: what complaints name the trace by.
        places: where each time stands, as "row 12"; empty: its number.

    Raises:
        BadInput: too few times, times that do not rise, a gap, uneven ones.
    """

    def place(k: int) -> str:
        return f"{source}: {places[k]}" if places else f"{source}: sample {k}"

    if time_s.ndim != 1 or time_s.size < LEAST_SAMPLES:
        raise BadInput(f"{source}: {time_s.size} samples, wanted at least {LEAST_SAMPLES}")
    steps = np.diff(time_s)
    for k in np.flatnonzero(steps <= 0.0)[:1]:
        raise BadInput(
            f"{place(k + 1)}: time {time_s[k + 1]:.9g} s after {time_s[k]:.9g} s; wanted times "
            "that rise"
        )
    usual = float(np.median(steps))
    for k in np.flatnonzero(steps > GAP * usual)[:1]:
        raise BadInput(
            f"{place(k + 1)}: {steps[k]:.4g} s after the one before, the others are {usual:.4g} s "
            "apart; wanted a trace without a gap, or each part as a trace of its own"
        )
    step = float((time_s[-1] - time_s[0]) / (time_s.size - 1))
    off = np.abs(time_s - time_s[0] - step * np.arange(time_s.size))
    worst = int(np.argmax(off))
    if off[worst] > ROUNDED * step + 4.0 * float(np.spacing(np.max(np.abs(time_s)))):
        raise BadInput(
            f"{place(worst)}: time {time_s[worst]:.9g} s is {off[worst]:.2g} s off an even spacing "
            f"of {step:.6g} s; wanted evenly spaced samples"
        )
    return step


def refuse_clipped(values: FloatArray, source: str) -> None:
    """Complain of values (n,) that are cut off: they jump into flat stretches at an extreme.

    One stretch does where noise is next to it, which does not repeat an extreme by chance. A signal
    of few bits is flat at its top as well, but comes there by few quanta.

    Args:
        values: of a trace, in any unit.
        source: what complaints name the trace by.

    Raises:
        BadInput: clipped.
    """
    levels = np.unique(values)
    if levels.size < 2 * JUMP:
        return
    quantum = float(np.min(np.diff(levels)))
    for extreme in (levels[0], levels[-1]):
        flat = np.concatenate([[False], values == extreme, [False]])
        edges = np.flatnonzero(np.diff(flat.astype(int)))
        begins, ends = edges[::2], edges[1::2]
        lengths = np.where(begins > 0, ends - begins, 0)
        long = lengths >= FLAT
        count = np.count_nonzero(long)
        alone = bool(np.any(lengths >= ALONE)) and _rough(values[values != extreme])
        if not count or (count < STRETCHES and not alone):
            continue
        jumps = np.abs(values[begins[long]] - values[begins[long] - 1])
        if float(np.median(jumps)) > JUMP * quantum:
            noun = "stretch" if count == 1 else "stretches"
            raise BadInput(
                f"{source}: clipped at {extreme:.6g}, in {count} {noun} of "
                f"{FLAT} samples or more; wanted a trace that is whole"
            )


def _rough(values: FloatArray) -> bool:
    """Whether noise is most of what neighbours differ by: differences grow with their order."""
    second, third = (np.median(np.abs(np.diff(values, order))) for order in (2, 3))
    return bool(third > second)
