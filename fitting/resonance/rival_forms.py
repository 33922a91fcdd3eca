"""Errors that hold whichever of several forms is the true one, where the points hardly tell them.

Forms that are no special cases of each other may have nearly the same curve with another line.
Noise makes the criterion of the true form worse than that of another by `ALLOWED` in one of twenty
sweeps (chi square of one unknown); the interval of 95 % of the form that was taken then reaches as
far as those of all that are so near:

    s = max_i (s_i + |t_i - t|/r)

t and s value and error of the form that was taken, t_i and s_i of the others, r s half of the
interval of 95 %.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from fitting.resonance.form import SLOPED, TRANSMISSION, FittedForm
from fitting.signal.peaks import OFFSET, TAIL
from fitting.signal.student import ratio95
from fitting.text.arrays import FloatArray

#: Akaike's criterion below which noise alone may make another form the better one.
ALLOWED = 4.0


@dataclass(frozen=True)
class Covered:
    """A form with errors that hold for its rivals, too; their names, and the factor on errors.

    ``factor`` is the larger one of those on frequency and width.
    """

    form: FittedForm
    rivals: tuple[str, ...]
    factor: float


def covered(found: Sequence[FittedForm], criteria: FloatArray, taken: int) -> Covered:
    """The form that was taken, with errors that hold for the others, too.

    The line alone is a special case of all others: it is no rival, and has none. A constant is one
    of a slope, and a slope about what a tail is: it is their rival only where it is the better one.

    Args:
        found: forms of amplitudes, as they were fitted.
        criteria: Akaike's, one for each.
        taken: number of the form that was taken.
    """
    best = found[taken]
    rivals = [
        form
        for k, form in enumerate(found)
        if k != taken
        and form.name != TRANSMISSION
        and criteria[k] - criteria[taken] < _allowed(best.name, form.name)
    ]
    if best.name == TRANSMISSION or not rivals:
        return Covered(best, (), 1.0)
    half = ratio95(best.freedom)

    def error(pairs: Sequence[tuple[float, float]]) -> float:
        """Of values and errors, those of the form that was taken first."""
        return max(std + abs(value - pairs[0][0]) / half for value, std in pairs)

    forms = (best, *rivals)
    wider = replace(
        best,
        frequency_std_hz=error([(f.frequency_hz, f.frequency_std_hz) for f in forms]),
        width_std_hz=error([(f.width_hz, f.width_std_hz) for f in forms]),
        q_std=error([(f.q, f.q_std) for f in forms]),
        amplitude_std=error([_nearest(f, best) for f in forms]),
    )
    factor = max(
        wider.frequency_std_hz / best.frequency_std_hz, wider.width_std_hz / best.width_std_hz
    )
    return Covered(wider, tuple(form.name for form in rivals), factor)


def _allowed(taken: str, other: str) -> float:
    """Akaike's criterion over that of the form that was taken below which another is a rival."""
    if other == SLOPED and taken == OFFSET:
        return 0.0
    # of as good a curve a slope, with two unknowns less, is better by as much
    return -ALLOWED if other == SLOPED and taken == TAIL else ALLOWED


def _nearest(form: FittedForm, best: FittedForm) -> tuple[float, float]:
    """The one of both amplitudes of a form that is nearer to that taken, and its error."""
    both = [(form.amplitude, form.amplitude_std)]
    if not math.isnan(form.mirrored):
        both.append((form.mirrored, form.mirrored_std))
    return min(both, key=lambda each: abs(each[0] - best.amplitude))
