"""Where a design sets out from: the fit nearest to the references, or the lowest in the box.

Rows are whitened by the noise, V. Where nobody stated it, it is told by what a place leaves, and
that of a place far from any fit is far too large: V is told anew at the fit that was found with it,
until the two agree. Where noise does not explain what the nearest fit leaves, points that fill the
box are ranked by sum ln(1 + row^2), and the lowest fit of those that begin at the best is taken.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fitting.design.candidates import Limits
from fitting.design.continued import continued_of
from fitting.design.information import Place, Series, information_of_data, scale_sigma
from fitting.design.points import LinearisedFit, WhitenedData, nearest_fit
from fitting.extension.problem import RowCovariance
from fitting.fit.likelihood.descent import inflation_of
from fitting.fit.search.box import Box
from fitting.fit.search.evolution import merit
from fitting.fit.search.minima import FEW, MOST_AT_FIRST, SCREENED
from fitting.text.arrays import FloatArray

#: Times that the noise is told anew, at most; a share of it that is no difference.
ROUNDS, SETTLED = 4, 0.02
#: Fits that are begun at the best points of a screen.
DESCENTS = 6
#: What is left, over the scatter of the points about a smooth curve, from which it is no noise.
MUCH_LEFT = 2.0


@dataclass(frozen=True, kw_only=True)
class Outset:
    """The fit that a design sets out from, with the data whitened there.

    `inflation` is what it leaves over the noise, root mean square: 1 where noise explains it.
    `searched` are the points of the box that were looked at besides.
    """

    data: WhitenedData
    fitted: LinearisedFit
    inflation: float
    searched: int = 0


def nearest_outset(
    series: tuple[Series, ...], prior: FloatArray, steps: FloatArray, limits: Limits
) -> Callable[[Place], Outset]:
    """The fit nearest to a place, with the noise estimated there where none is stated.

    Args:
        series: that were measured; the first is to be continued.
        prior: standard deviations of the prior, (n,).
        steps: of differences, (n,).
        limits: of the instrument.
    """
    is_estimated = any(not np.all(each.data.sigma > 0.0) for each in series)

    def whitened(place: Place) -> WhitenedData:
        blocks = []
        for each in series:
            rows = each.rows([place], steps, limits.setting_sigmas)[0]
            covariance = information_of_data(each, rows, limits.setting_sigmas)[1]
            blocks.append(covariance.beside(np.full(covariance.size, scale_sigma(each.data))))
        covariance = RowCovariance.joined(blocks)
        return WhitenedData(series=series, covariance=covariance, prior=prior, steps=steps)

    def near(place: Place) -> Outset:
        data = whitened(place)
        fitted = nearest_fit(data, place)
        for _ in range(ROUNDS if is_estimated else 0):
            data = whitened(fitted.place)
            before = data.at([fitted.place])[0]
            fitted = nearest_fit(data, fitted.place)
            if before.chi_square - fitted.chi_square <= SETTLED * before.chi_square:
                break
        if is_estimated:
            left = 1.0 if limits.sweeps is None else _over_scatter(series[0], fitted.place, steps)
        else:
            dof = fitted.problem.rows.size - fitted.place.x.size
            left = inflation_of(fitted.chi_square, float(dof))
        return Outset(data=data, fitted=fitted, inflation=left)

    return near


def lowest_outset(near: Callable[[Place], Outset], place: Place, seed: int) -> Outset:
    """The fit nearest to a place; of the whole box where noise does not explain that.

    Args:
        near: the fit nearest to a place.
        place: where it begins.
        seed: of the points of the box.
    """
    first = near(place)
    if first.inflation == 1.0:
        return first
    box = Box(first.data.series[0].bound.parameters)
    free = int(np.count_nonzero(box.free))
    number = min(SCREENED * 2 ** max(0, free - FEW), MOST_AT_FIRST)
    points = [Place(place.alternative, x) for x in box.spread(number, seed)]
    merits = [merit(rows) for rows in first.data.rows(points)]
    best = np.argsort(merits, kind="stable")[:DESCENTS]
    fits = [first.fitted, *(nearest_fit(first.data, points[k]) for k in best)]
    lowest = min(fits, key=lambda fit: fit.chi_square)
    found = near(lowest.place) if lowest is not first.fitted else first
    return replace(found, searched=number)


def _over_scatter(series: Series, place: Place, steps: FloatArray) -> float:
    """The residuals of sweeps without a stated noise, over the scatter of their points."""
    so_far, begin = continued_of(series.bound), 0
    left = series.residuals(place, steps)
    for m in series.data.measurements:
        mine = left[begin : begin + m.rows]
        begin += m.rows
        if so_far.is_made_of(m) and not np.any(m.sigma > 0.0):
            noise = [float(np.median(s.sigma)) / np.max(s.amplitude) for s in so_far.sweeps]
            expected = float(np.sqrt(np.mean(np.square(noise))))
            over = float(np.sqrt(np.mean(mine**2))) / expected if expected > 0.0 else 1.0
            return over if over > MUCH_LEFT else 1.0
    return 1.0
