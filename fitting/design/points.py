"""Points that fit the data as well as any: where a design has to be good, since none is known.

In variables y of unit prior variance, with rows in units of the noise, walkers set out from a fit.
Each step goes along what the data do not determine (singular values of J below one: there the prior
knows more) and is brought back to the fit by damped Gauss-Newton steps of least length,

    dy = -(J^T J + mu I)^-1 J^T r,    singular values below one left out

The fit is the one nearest to the references. Noise that is not stated is estimated from what a
place leaves, anew at the fit that results, until the two agree. Where noise does not explain what
the nearest fit leaves, points that fill the box are ranked by sum ln(1 + row^2), and the lowest fit
of those from the best is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.design.information import Place, Series
from fitting.extension.problem import (
    Linearisation,
    Parameter,
    RowCovariance,
    central,
    evaluate_many,
    search_bounds,
    whitened,
)
from fitting.measurements.complex.sweep import ComplexSweep
from fitting.signal.chi_square import tail
from fitting.signal.least_squares import damped_step
from fitting.text.arrays import FloatArray

#: Walkers per alternative, their steps, and the length of one in prior standard deviations.
WALKERS, STRIDES, STRIDE = 4, 8, 0.35
#: Gauss-Newton steps at most that lead to a fit, those after each stride, and their least damping.
GAUSS_NEWTON_STEPS, CORRECTIONS, DAMPING = 12, 2, 1e-3
#: Singular values of J, in units of noise and prior, from which the data determine a direction.
DETERMINED = 1.0
#: Chi-square above the least from which a point no longer counts as an equal fit (two sigma).
EQUAL = 4.0
#: Times that the noise is estimated anew, at most; a share of chi-square that is no difference.
ROUNDS, SETTLED = 4, 0.02
#: Points of the box that are ranked, and fits that begin at the best of them.
SCREENED, DESCENTS = 512, 6
#: Probability of a chi-square below which noise does not explain it; of sweeps without a stated
#: noise what remains, over the scatter of the points about a smooth curve.
TOO_LARGE_P, MUCH_LEFT = 1e-4, 2.0


@dataclass(frozen=True)
class LinearisedFit:
    """A point, and the problem linearised there."""

    place: Place
    problem: Linearisation

    @property
    def chi_square(self) -> float:
        """Sum of squares of the rows."""
        return self.problem.chi_square

    def step(self, damping: float) -> FloatArray:
        """Step to the fit in units of the prior, along what the data determine only."""
        return damped_step(self.problem.scaled, self.problem.rows, damping, least=DETERMINED)


@dataclass(frozen=True, kw_only=True)
class WhitenedData:
    """Data so far: series, covariance of all their rows, prior sigmas and steps (n,).

    All series have the parameters of the first.
    """

    series: tuple[Series, ...]
    covariance: RowCovariance
    prior: FloatArray
    steps: FloatArray

    def at(self, places: Sequence[Place]) -> list[LinearisedFit]:
        """Rows and Jacobians at places of one alternative, in one batch for each series."""
        bounds = search_bounds(self.series[0].bound.parameters)
        around = [central(place.x, self.steps, *bounds) for place in places]
        xs = [x for p, each in zip(places, around, strict=True) for x in (p.x, *each.nodes)]
        rows = iter(self.rows([Place(places[0].alternative, x) for x in xs]) if places else ())
        fits = []
        for place, each in zip(places, around, strict=True):
            here, matrix = next(rows), each.quotients([next(rows) for _ in each.nodes])
            problem = Linearisation(rows=here, matrix=matrix, prior=self.prior)
            fits.append(LinearisedFit(place, problem))
        return fits

    def rows(self, places: Sequence[Place]) -> list[FloatArray]:
        """Whitened rows (m,) at places of one alternative, in one batch for each series."""
        residuals: list[list[FloatArray]] = [[] for _ in places]
        for series in self.series:
            objective = series.objective(places[0].alternative, self.steps)
            points = evaluate_many(objective, [place.x for place in places])
            for mine, point in zip(residuals, points, strict=True):
                mine.append(point.residuals)
        return [whitened(np.concatenate(each), self.covariance) for each in residuals]

    def moved(self, fitted: LinearisedFit, dy: FloatArray) -> Place:
        """The place dy (n,) prior standard deviations away, within the box."""
        lower, upper = search_bounds(self.series[0].bound.parameters)
        x = np.clip(fitted.place.x + self.prior * dy, lower, upper)
        return Place(fitted.place.alternative, np.asarray(x))

    def nearest_fit(self, place: Place) -> LinearisedFit:
        """The fit nearest to a place, by Levenberg-Marquardt."""
        [here], damping = self.at([place]), DAMPING
        for _ in range(GAUSS_NEWTON_STEPS):
            [there] = self.at([self.moved(here, here.step(damping))])
            if not there.chi_square < here.chi_square:
                steepest = float(np.linalg.norm(here.problem.scaled, 2) ** 2)
                damping = 30.0 * max(damping, 1e-3 * steepest)
                continue
            gain = here.chi_square - there.chi_square
            here, damping = there, max(damping / 30.0, DAMPING)
            if gain < 1e-2:
                break
        return here


@dataclass(frozen=True, kw_only=True)
class StartFit:
    """The fit that a design sets out from, with the data whitened there.

    `inflation` is what it leaves over the noise, root mean square: 1 where noise explains it.
    `searched` are the points of the box that were ranked besides.
    """

    data: WhitenedData
    fitted: LinearisedFit
    inflation: float
    searched: int = 0


def start_fit(
    series: tuple[Series, ...],
    start: Place,
    prior: FloatArray,
    setting_sigmas: dict[str, float],
    seed: int | None,
) -> StartFit:
    """The fit nearest to a place; the lowest of the box where noise does not explain that.

    Args:
        series: that were measured; the first is to be continued.
        start: where it begins.
        prior: standard deviations in x, shape (n,).
        setting_sigmas: errors of settings that drift, in the FMU's units.
        seed: of the points of the box; None: the fit nearest to the place is kept in any case.
    """
    steps = series[0].steps()
    is_estimated = any(not np.all(each.data.sigma > 0.0) for each in series)

    def data_at(place: Place) -> WhitenedData:
        blocks = []
        for each in series:
            covariance = each.linearised(place, steps, setting_sigmas).covariance
            blocks.append(covariance.beside(np.full(covariance.size, each.scale_sigma)))
        covariance = RowCovariance.joined(blocks)
        return WhitenedData(series=series, covariance=covariance, prior=prior, steps=steps)

    def nearest(place: Place) -> StartFit:
        data = data_at(place)
        fitted = data.nearest_fit(place)
        for _ in range(ROUNDS if is_estimated else 0):
            data = data_at(fitted.place)
            [before], fitted = data.at([fitted.place]), data.nearest_fit(fitted.place)
            if before.chi_square - fitted.chi_square <= SETTLED * before.chi_square:
                break
        if is_estimated:
            return StartFit(data=data, fitted=fitted, inflation=_over_scatter(data, fitted.place))
        dof = max(1, fitted.problem.rows.size - start.x.size)
        is_noise = tail(fitted.chi_square, float(dof)) >= TOO_LARGE_P
        inflation = 1.0 if is_noise else max(1.0, float(np.sqrt(fitted.chi_square / dof)))
        return StartFit(data=data, fitted=fitted, inflation=inflation)

    first = nearest(start)
    if first.inflation == 1.0 or seed is None:
        return first
    lower, upper = search_bounds(series[0].bound.parameters)
    box = np.random.default_rng(seed).uniform(lower, upper, (SCREENED, lower.size))
    points = [Place(start.alternative, x) for x in box]
    # sum ln(1 + row^2): where half of the rows fit is worth more than where none is far off
    merits = [float(np.sum(np.log1p(rows**2))) for rows in first.data.rows(points)]
    best = np.argsort(merits, kind="stable")[:DESCENTS]
    fits = [first.fitted, *(first.data.nearest_fit(points[k]) for k in best)]
    lowest = min(fits, key=lambda fit: fit.chi_square)
    last = first if lowest is first.fitted else nearest(lowest.place)
    return replace(last, searched=SCREENED)


def _over_scatter(data: WhitenedData, place: Place) -> float:
    """Residuals of complex sweeps without a stated noise, over the scatter of their points."""
    series = data.series[0]
    rows = series.linearised(place, data.steps, {}).residuals
    for m, mine in zip(series.data.measurements, series.data.slices, strict=True):
        if isinstance(m, ComplexSweep) and not np.any(m.sigma > 0.0):
            scatter = [c.scatter() / c.largest for c in m.records]
            expected = float(np.sqrt(np.mean(np.square(scatter))))
            over = float(np.sqrt(np.mean(rows[mine] ** 2))) / expected if expected else 1.0
            return over if over > MUCH_LEFT else 1.0
    return 1.0


def equal_fits(data: WhitenedData, start: LinearisedFit, seed: int) -> list[LinearisedFit]:
    """Points of equal fit that walkers reach from one, the start not among them.

    None where the data determine every direction better than the prior does.

    Args:
        data: measured so far.
        start: a fit.
        seed: of the headings.
    """
    if not start.problem.undetermined(DETERMINED).size:
        return []
    rng = np.random.default_rng(seed)
    walkers, reached = [start] * WALKERS, list[LinearisedFit]()
    headings = list(rng.standard_normal((WALKERS, len(data.prior))))
    for _ in range(STRIDES):
        places = []
        for k, walker in enumerate(walkers):
            # a unit vector along the heading, within what the data leave open
            free = walker.problem.undetermined(DETERMINED)
            along = free.T @ (free @ headings[k])
            headings[k] = along / (float(np.linalg.norm(along)) or 1.0)
            places.append(data.moved(walker, STRIDE * headings[k]))
        ahead = data.at(places)
        for _ in range(CORRECTIONS):
            ahead = data.at([data.moved(f, f.step(DAMPING)) for f in ahead])
        for k, there in enumerate(ahead):
            stuck = np.allclose(there.place.x, walkers[k].place.x)
            if there.chi_square <= start.chi_square + EQUAL and not stuck:
                walkers[k] = there
                reached.append(there)
            else:
                headings[k] = rng.standard_normal(len(data.prior))
    return reached


def spread_out(
    parameters: Sequence[Parameter],
    first: Place,
    others: Sequence[Place],
    number: int,
    prior: FloatArray,
) -> list[Place]:
    """The first and up to `number` - 1 others that lie far from each other.

    Args:
        parameters: for their periods.
        first: point that is kept in any case.
        others: to choose from.
        number: of points, at most.
        prior: standard deviations in x, shape (n,).
    """
    periods = np.array([np.inf if p.period is None else p.period / p.scale for p in parameters])

    def distance(one: Place, other: Place) -> float:
        """In prior standard deviations; another alternative counts as half of one."""
        gap = np.abs(one.x - other.x)
        gap = np.minimum(gap % periods, periods - gap % periods)
        return float(np.linalg.norm(gap / prior)) + 0.5 * (one.alternative != other.alternative)

    chosen, remaining = [first], list(others)
    while remaining and len(chosen) < number:
        nearest = [min(distance(a, b) for b in chosen) for a in remaining]
        if max(nearest) <= 0.0:
            break
        chosen.append(remaining.pop(int(np.argmax(nearest))))
    return chosen
