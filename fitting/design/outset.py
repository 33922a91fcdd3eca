"""Where a design sets out from: the fit nearest to the references, or the lowest in the box.

Rows are whitened by the noise, V. Where nobody stated it, it is told by what a place leaves, and
that of a place far from any fit is far too large: V is told anew at the fit that was found with it,
until the two agree. Where noise does not explain what the nearest fit leaves, points that fill the
box are ranked by sum ln(1 + row^2), and the lowest fit of those that begin at the best is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.design.candidates import Limits
from fitting.design.continued import continued_of
from fitting.design.information import Place, Series, information_of_data, scale_sigma
from fitting.design.points import LinearisedFit, WhitenedData, nearest_fit
from fitting.fit.covariance import RowCovariance
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


@dataclass(frozen=True, kw_only=True)
class MeasuredSoFar:
    """All series (the first is to be continued), their prior sigmas and difference steps (n,)."""

    series: tuple[Series, ...]
    prior: FloatArray
    steps: FloatArray
    limits: Limits

    def near(self, place: Place) -> Outset:
        """The fit nearest to a place, with the noise that it tells where nobody stated it.

        Args:
            place: where it begins.
        """
        data = self._whitened(place)
        fitted = nearest_fit(data, place)
        for _ in range(ROUNDS if self._is_estimated else 0):
            data = self._whitened(fitted.place)
            before = data.at([fitted.place])[0]
            fitted = nearest_fit(data, fitted.place)
            if before.chi_square - fitted.chi_square <= SETTLED * before.chi_square:
                break
        return Outset(data=data, fitted=fitted, inflation=self._inflation(fitted))

    def lowest(self, place: Place, seed: int) -> Outset:
        """The fit nearest to a place; of the whole box where noise does not explain that.

        Args:
            place: where it begins.
            seed: of the points of the box.
        """
        near = self.near(place)
        if near.inflation == 1.0:
            return near
        parameters = self.series[0].bound.parameters
        box = Box(parameters)
        free = int(np.count_nonzero(box.free))
        number = min(SCREENED * 2 ** max(0, free - FEW), MOST_AT_FIRST)
        points = [Place(place.alternative, x) for x in box.spread(number, seed)]
        merits = [merit(rows) for rows in near.data.rows(points)]
        best = np.argsort(merits, kind="stable")[:DESCENTS]
        fits = [near.fitted, *(nearest_fit(near.data, points[k]) for k in best)]
        lowest = min(fits, key=lambda fit: fit.chi_square)
        found = self.near(lowest.place) if lowest is not near.fitted else near
        return Outset(
            data=found.data, fitted=found.fitted, inflation=found.inflation, searched=number
        )

    @property
    def _is_estimated(self) -> bool:
        return any(not np.all(series.data.sigma > 0.0) for series in self.series)

    def _whitened(self, place: Place) -> WhitenedData:
        blocks = []
        for series in self.series:
            rows = series.rows([place], self.steps, self.limits.setting_sigmas)[0]
            covariance = information_of_data(series, rows, self.limits.setting_sigmas)[1]
            blocks.append(covariance.beside(np.full(covariance.size, scale_sigma(series.data))))
        return WhitenedData(
            series=self.series,
            covariance=RowCovariance.joined(blocks),
            prior=self.prior,
            steps=self.steps,
        )

    def _inflation(self, fitted: LinearisedFit) -> float:
        """What is left over the noise; of sweeps whose noise nobody stated, over their scatter."""
        if not self._is_estimated:
            rows = fitted.problem.rows.size
            return inflation_of(fitted.chi_square, float(rows - fitted.place.x.size))
        if self.limits.sweeps is None:
            return 1.0
        first, so_far, begin = self.series[0], continued_of(self.series[0].bound), 0
        left = first.residuals(fitted.place, self.steps)
        for m in first.data.measurements:
            mine = left[begin : begin + m.rows]
            begin += m.rows
            if so_far.is_made_of(m) and not np.any(m.sigma > 0.0):
                noise = [float(np.median(s.sigma)) / np.max(s.amplitude) for s in so_far.sweeps]
                expected = float(np.sqrt(np.mean(np.square(noise))))
                over = float(np.sqrt(np.mean(mine**2))) / expected if expected > 0.0 else 1.0
                return over if over > MUCH_LEFT else 1.0
        return 1.0
