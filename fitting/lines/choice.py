"""Which of several models of one sweep is taken, and how far the others move its numbers.

Models are compared by Akaike's criterion for small samples, with correlated points counted as the
independent ones that they are worth,

    c = N/v ln(sum r^2/N) + 2 k + 2 k (k + 1)/(N/v - k - 1)

N residuals, k unknowns, v the square of what correlation alone widens errors by, under the model
that leaves least (`residual_structure`). Where points are too few for it, models are ordered by
their residuals. The simplest model within `SIMPLER` of the lowest is taken. Noise makes another
form that is no special case of it the better one by `EQUAL` in one of twenty sweeps (chi square of
one unknown): the errors of its numbers reach as far as those of all models that are so near,

    s = max_i (s_i + |t_i - t|/r)

t and s value and error of the model that is taken, r s half of its interval of 95 %.

Source: H. Akaike, IEEE Trans. Autom. Control 19 (1974) 716; K. Burnham and D. Anderson, Model
Selection and Multimodel Inference, section 2.5 for the inflation of counts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import fdtrc

from fitting.lines.form import LineFit
from fitting.lines.names import SQUARED
from fitting.lines.record import FormFit, LineNumber
from fitting.signal.residual_tests import SMALLEST_RESIDUAL, Structure
from fitting.signal.student import ratio95
from fitting.text.arrays import FloatArray

#: Probability of noise alone up to which a line, or a decay, is there, and below which noise does
#: not explain what a larger model gains.
PRESENT_P, BY_CHANCE = 1e-3, 1e-4
#: Akaike's criterion by which what was not expected has to be better.
PLAINLY = 10.0
#: Criterion within which a simpler model is taken, and within which models count as equal.
SIMPLER, EQUAL = 6.0, 4.0
#: Squares over those of the taken model from which another one is not its equal, whatever c.
FAR_MORE = 25.0
#: Error of the height of a line over that from which a model determines no line.
DETERMINED = 0.2
#: By how much the criterion has to be lower: noise of single readings looks like none where small,
#: and a column of amplitudes that is a power is not expected.
DOUBT = {"single": 2.0, **dict.fromkeys(SQUARED, PLAINLY)}


def criteria_of(fits: Sequence[FormFit], rows: int) -> FloatArray:
    """Akaike's criterion of every model over the lowest one; NaN where there are too few points.

    Args:
        fits: the models.
        rows: residuals of each, their number.
    """
    closest = min(fits, key=lambda fit: fit.likely_squares)
    count = rows / closest.structure.together**2
    made = []
    for fit in fits:
        k = fit.unknowns
        squares = max(fit.likely_squares, rows * SMALLEST_RESIDUAL**2)
        small = 2.0 * k * (k + 1) / (count - k - 1) if count > k + 1 else math.nan
        made.append(count * math.log(squares / rows) + 2.0 * k + small)
    return np.array(made) - np.nanmin(made) if not np.all(np.isnan(made)) else np.array(made)


def order_of(fits: Sequence[FormFit], criteria: FloatArray) -> list[int]:
    """Numbers of the models, the one that is taken first, the others by their criterion.

    Args:
        fits: the models.
        criteria: see `criteria_of`.
    """
    squares = np.array([fit.likely_squares for fit in fits])
    if np.all(np.isnan(criteria)):
        return [int(k) for k in np.argsort(squares, kind="stable")]
    doubt = np.array([DOUBT.get(fit.name, 0.0) for fit in fits])
    order = [int(k) for k in np.argsort(criteria + doubt, kind="stable")]  # NaN comes last
    equal = squares <= FAR_MORE * np.min(squares)
    order.sort(key=lambda k: not equal[k])
    lowest = criteria[order[0]] + doubt[order[0]]
    near = [k for k in order if equal[k] and criteria[k] + doubt[k] - lowest <= SIMPLER]
    simple = min(near, key=lambda k: fits[k].unknowns, default=order[0])
    return [simple, *(k for k in order if k != simple)]


def chance(
    squares: float, unknowns: int, better: float, more: int, structure: Structure, rows: int
) -> float:
    """Probability that noise gains as much from one model to a larger one at one place.

    Args:
        squares: that the smaller model leaves.
        unknowns: of it.
        better: squares that the larger model leaves.
        more: unknowns of the larger one.
        structure: of the residuals of the larger one, whose correlation lowers the count of rows.
        rows: number of residuals.

    Source: N. Draper and H. Smith, Applied Regression Analysis (extra sum of squares).
    """
    left = max(better, rows * SMALLEST_RESIDUAL**2)
    dof = max(1.0, (rows - more) / structure.together**2)
    return gain_p(squares, left, max(1, more - unknowns), dof)


def gain_p(before: float, after: float, more: float, dof: float) -> float:
    """Probability that noise alone lets ``more`` numbers lower a sum of squares so far (F test).

    Args:
        before: squares of the smaller model.
        after: squares of the larger one.
        more: unknowns that it has more.
        dof: its degrees of freedom.
    """
    if not after > 0.0:
        return 0.0
    return float(fdtrc(more, dof, max(0.0, (before - after) / more * dof / after)))


def with_rivals(fits: Sequence[LineFit], criteria: FloatArray, taken: int) -> LineFit:
    """The model that is taken, with the errors of all that describe the values as well.

    Args:
        fits: models of the same number of lines.
        criteria: see `criteria_of`.
        taken: number of the one that is taken.
    """
    best = fits[taken]
    if np.isnan(criteria[taken]):
        return best
    # what has the taken model as a special case and is no better contradicts nothing
    near = [
        fit
        for k, fit in enumerate(fits)
        if k != taken
        and criteria[k] - criteria[taken] < EQUAL
        and fit.likely_squares < FAR_MORE * best.likely_squares
        and fit.amplitude.std < DETERMINED * fit.amplitude.value
        and not (best.form.terms < fit.form.terms and criteria[k] >= criteria[taken])
        and not (best.form.pull and fit.form.background)  # a slope is about what a tail is
    ]
    widened: dict[str, Any] = {
        name: wider(getattr(best, name), [getattr(fit, name) for fit in near], best.dof)
        for name in ("frequency", "width", "q")
    }
    # of two amplitudes with the same curve the one nearer to that of the model that is taken
    size = best.amplitude.value
    heights = [
        min(
            (height for height in (fit.amplitude, fit.mirrored) if height is not None),
            key=lambda height: abs(height.value - size),
        )
        for fit in near
    ]
    fit = replace(best, **widened, amplitude=wider(best.amplitude, heights, best.dof))
    factor = max(fit.frequency.std / best.frequency.std, fit.width.std / best.width.std)
    names = tuple(dict.fromkeys(fit.name for fit in near))
    return replace(fit, rivals=names, rivals_widening=factor)


def wider(number: LineNumber, others: Sequence[LineNumber], dof: float) -> LineNumber:
    """A number whose interval reaches as far as those of other models do.

    Args:
        number: of the model that is taken.
        others: the same number of its rivals.
        dof: degrees of freedom of the noise.
    """
    half, value = ratio95(dof), number.value
    std = max([number.std, *(each.std + abs(each.value - value) / half for each in others)])
    return replace(number, std=std, ci95=(value - half * std, value + half * std))
