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

from collections.abc import Sequence
from dataclasses import dataclass, replace

from fitting.resonance.form import SLOPED, TRANSMISSION, FittedForm
from fitting.signal.line_record import LineNumber
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
    half, forms = ratio95(best.dof), (best, *rivals)

    def wider(here: LineNumber, others: Sequence[LineNumber]) -> LineNumber:
        """The number of the form that was taken, with an error that holds for the others'."""
        std = max(e.std + abs(e.value - here.value) / half for e in (here, *others))
        return replace(here, std=std, ci95=(here.value - half * std, here.value + half * std))

    covering = replace(
        best,
        frequency=wider(best.frequency, [form.frequency for form in rivals]),
        width=wider(best.width, [form.width for form in rivals]),
        q=wider(best.q, [form.q for form in rivals]),
        amplitude=wider(best.amplitude, [_nearest(form, best) for form in forms]),
    )
    factor = max(covering.frequency.std / best.frequency.std, covering.width.std / best.width.std)
    return Covered(covering, tuple(form.name for form in rivals), factor)


def _allowed(taken: str, other: str) -> float:
    """Akaike's criterion over that of the form that was taken below which another is a rival."""
    if other == SLOPED and taken == OFFSET:
        return 0.0
    # of as good a curve a slope, with two unknowns less, is better by as much
    return -ALLOWED if other == SLOPED and taken == TAIL else ALLOWED


def _nearest(form: FittedForm, best: FittedForm) -> LineNumber:
    """The one of both amplitudes of a form that is nearer to that taken."""
    both = [each for each in (form.amplitude, form.mirrored) if each is not None]
    return min(both, key=lambda each: abs(each.value - best.amplitude.value))
