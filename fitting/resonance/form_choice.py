"""Which of the forms fitted to a trace is taken: Akaike's criterion, and what is doubtful.

Forms are compared by the criterion for small samples, with correlated points counted as the
independent ones that they are worth,

    c = N/v ln(sum r^2/N) + 2 k + 2 k (k + 1)/(N/v - k - 1)

N residuals, k unknowns, v the square of the widening (`residual_structure`) under the form that
leaves least. Source: H. Akaike, IEEE Trans. Autom. Control 19 (1974) 716; K. Burnham and
D. Anderson, Model Selection and Multimodel Inference, section 2.5, for the inflation of counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fitting.resonance.form import SLOPED, TRANSMISSION, FittedForm
from fitting.signal.peaks import FLOOR, OFFSET, RICE, SINGLE, TAIL
from fitting.signal.residual_tests import SMALLEST_RESIDUAL
from fitting.text.arrays import FloatArray

#: Akaike's criterion by which a form with a delay must be better than all without one.
PLAINLY = 10.0
#: Akaike's criterion below which a form is as good as another one.
AS_GOOD = 2.0
#: And by which a slope beside amplitudes must be better than all that is simpler: noise alone makes
#: one in a hundred sweeps of it.
SLOPE_SEEN = 5.0


def criteria_of(found: Sequence[FittedForm], rows: int) -> FloatArray:
    """Akaike's criterion of every form, c.

    Args:
        found: the forms.
        rows: residuals of each, their number.
    """
    closest = min(found, key=lambda form: form.likely_squares)
    count = rows / closest.structure.widening**2
    made = []
    for form in found:
        k = form.unknowns
        squares = max(form.likely_squares, rows * SMALLEST_RESIDUAL**2)
        small = 2.0 * k * (k + 1) / (count - k - 1) if count > k + 1 else math.inf
        made.append(count * math.log(squares / rows) + 2.0 * k + small)
    return np.array(made) if np.any(np.isfinite(made)) else np.arange(len(made), dtype=float)


def without_doubtful_delay(
    found: Sequence[FittedForm], criteria: FloatArray, order: list[int], requested: str
) -> list[int]:
    """The order in which forms are taken: a delay that is not plainly seen is none.

    A delay is the phase of the line itself over a sweep of some widths, so that noise invents one.

    Args:
        found: the forms.
        criteria: `criteria_of`, one for each.
        order: so far, indices of the forms.
        requested: name of the form that is wanted; empty: any.
    """
    plain = [k for k in order if found[k].delay is None and requested in ("", found[k].name)]
    if not plain or criteria[plain[0]] - criteria[order[0]] >= PLAINLY:
        return order
    return [plain[0], *(k for k in order if k != plain[0])]


def without_doubtful_constant(
    found: Sequence[FittedForm], criteria: FloatArray, order: list[int]
) -> list[int]:
    """The order in which forms are taken: what noise of single readings makes is nothing else.

    Such noise lifts a faint line as a constant does, or noise that was averaged, and has no unknown
    for it; and where it is small, nobody sees that it is Rice's.

    Args:
        found: the forms.
        criteria: `criteria_of`, one for each.
        order: so far, indices of the forms.
    """
    of_name = {found[k].name: k for k in order}
    near = [
        of_name[name]
        for name in (TRANSMISSION, SINGLE)
        if name in of_name and criteria[of_name[name]] - criteria[order[0]] < AS_GOOD
    ]
    doubtful = found[order[0]].name in (SINGLE, OFFSET, FLOOR, RICE)
    if not doubtful or of_name.get(SINGLE) not in near:
        return order
    return [near[0], *(k for k in order if k != near[0])]


def without_doubtful_slope(
    found: Sequence[FittedForm], criteria: FloatArray, order: list[int]
) -> list[int]:
    """The order in which forms of amplitudes are taken: a slope that is not plainly seen is none.

    Every sweep of a clean line has one to fit; errors hold for it where it is nearly as good.

    Args:
        found: the forms.
        criteria: `criteria_of`, one for each.
        order: so far, indices of the forms.
    """
    others = [k for k in order if found[k].name != SLOPED]
    if not others or criteria[others[0]] - criteria[order[0]] >= SLOPE_SEEN:
        return order
    return [others[0], *(k for k in order if k != others[0])]


def with_tail(found: Sequence[FittedForm], criteria: FloatArray, order: list[int]) -> list[int]:
    """The order in which forms are taken where another line is seen: with its tail.

    It is known to be there: a form without it is as good where noise hides it, and then moves the
    line by up to some standard errors of its own.

    Args:
        found: the forms.
        criteria: `criteria_of`, one for each.
        order: so far, indices of the forms.
    """
    tail = [k for k in order if found[k].name == TAIL]
    worse = any(criteria[k] - criteria[order[0]] >= PLAINLY for k in tail)
    if not tail or (worse and found[tail[0]].structure.order > 0):
        return order
    return [*tail, *(k for k in order if k not in tail)]
