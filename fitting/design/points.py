"""Points that fit the data as well as any: where a design has to be good, since none is known.

In variables y of unit prior variance, with rows in units of the noise, walkers set out from a fit.
Each step goes along what the data do not hold (singular values of J below one: there the prior
knows more) and is brought back to the fit by damped Gauss-Newton steps of least length,

    dy = -(J^T J + mu I)^-1 J^T r,    singular values below one left out
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

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
from fitting.signal.least_squares import damped_step
from fitting.text.arrays import FloatArray

#: Walkers per alternative, their steps, and the length of one in prior standard deviations.
WALKERS, STRIDES, STRIDE = 4, 8, 0.35
#: Gauss-Newton steps at most that lead to a fit, and those after each stride.
GAUSS_NEWTON_STEPS, CORRECTIONS = 12, 2
DAMPING = 1e-3
#: Singular values of J, in units of noise and prior, from which the data hold a direction.
DETERMINED = 1.0
#: Chi-square above the least from which a point no longer counts as an equal fit (two sigma).
EQUAL = 4.0


@dataclass(frozen=True)
class LinearisedFit:
    """A point, and the problem linearised there."""

    place: Place
    problem: Linearisation

    @property
    def chi_square(self) -> float:
        """Sum of squares of the rows."""
        return self.problem.chi_square


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
        """Rows and Jacobians at places of one alternative, in one batch.

        Args:
            places: of one alternative.
        """
        if not places:
            return []
        lower, upper = search_bounds(self.series[0].bound.parameters)
        around = [central(place.x, self.steps, lower, upper) for place in places]
        residuals: list[list[FloatArray]] = [[] for _ in places]
        slopes: list[list[FloatArray]] = [[] for _ in places]
        for series in self.series:
            objective = series.objective(places[0].alternative, self.steps)
            nodes = [[place.x, *each.nodes] for place, each in zip(places, around, strict=True)]
            points = iter(evaluate_many(objective, [x for group in nodes for x in group]))
            for k, each in enumerate(around):
                residuals[k].append(next(points).residuals)
                slopes[k].append(each.quotients([next(points).residuals for _ in each.nodes]))
        found = []
        for place, some, matrices in zip(places, residuals, slopes, strict=True):
            rows = whitened(np.concatenate(some), self.covariance)
            matrix = whitened(np.concatenate(matrices), self.covariance)
            found.append(
                LinearisedFit(place, Linearisation(rows=rows, matrix=matrix, prior=self.prior))
            )
        return found

    def rows(self, places: Sequence[Place]) -> list[FloatArray]:
        """Whitened rows (m,) at places of one alternative, in one batch for each series.

        Args:
            places: of one alternative, one at least.
        """
        found: list[list[FloatArray]] = [[] for _ in places]
        for series in self.series:
            objective = series.objective(places[0].alternative, self.steps)
            for mine, point in zip(
                found, evaluate_many(objective, [place.x for place in places]), strict=True
            ):
                mine.append(point.residuals)
        return [whitened(np.concatenate(each), self.covariance) for each in found]

    def moved(self, fitted: LinearisedFit, dy: FloatArray) -> Place:
        """The place dy prior standard deviations away, within the box.

        Args:
            fitted: where it sets out from.
            dy: step in standard deviations of the prior, shape (n,).
        """
        lower, upper = search_bounds(self.series[0].bound.parameters)
        x = np.clip(fitted.place.x + self.prior * dy, lower, upper)
        return Place(fitted.place.alternative, np.asarray(x))


def nearest_fit(data: WhitenedData, place: Place) -> LinearisedFit:
    """The nearest fit, by Levenberg-Marquardt, as long as chi-square falls by a hundredth.

    Args:
        data: measured so far.
        place: where it begins.
    """
    here = data.at([place])[0]
    damping = DAMPING
    for _ in range(GAUSS_NEWTON_STEPS):
        there = data.at([data.moved(here, _correction(here, damping))])[0]
        if not there.chi_square < here.chi_square:
            damping = 30.0 * max(damping, float(np.linalg.norm(here.problem.scaled, 2) ** 2) * 1e-3)
            continue
        done = here.chi_square - there.chi_square < 1e-2
        here, damping = there, max(damping / 30.0, DAMPING)
        if done:
            break
    return here


def equal_fits(data: WhitenedData, start: LinearisedFit, seed: int) -> list[LinearisedFit]:
    """Points of equal fit that walkers reach from one, the start not among them.

    None where the data hold every direction better than the prior does.

    Args:
        data: measured so far.
        start: a fit.
        seed: of the headings.
    """
    if not start.problem.undetermined(DETERMINED).size:
        return []
    rng = np.random.default_rng(seed)
    walkers = [start] * WALKERS
    headings = list(rng.standard_normal((WALKERS, len(data.prior))))
    reached: list[LinearisedFit] = []
    for _ in range(STRIDES):
        places = []
        for k, walker in enumerate(walkers):
            headings[k] = _along_the_fit(walker.problem, headings[k])
            places.append(data.moved(walker, STRIDE * headings[k]))
        ahead = data.at(places)
        for _ in range(CORRECTIONS):
            ahead = data.at([data.moved(f, _correction(f, DAMPING)) for f in ahead])
        for k, there in enumerate(ahead):
            stuck = np.allclose(there.place.x, walkers[k].place.x)
            if there.chi_square <= start.chi_square + EQUAL and not stuck:
                walkers[k] = there
                reached.append(there)
            else:
                headings[k] = rng.standard_normal(len(data.prior))
    return reached


def _correction(fitted: LinearisedFit, damping: float) -> FloatArray:
    """Step to the fit in units of the prior, along what the data determine only."""
    problem = fitted.problem
    return damped_step(problem.scaled, problem.rows, damping, least=DETERMINED)


def _along_the_fit(problem: Linearisation, heading: FloatArray) -> FloatArray:
    """Unit vector along the heading within what the data do not hold; zero where they hold all."""
    free = problem.undetermined(DETERMINED)
    along = free.T @ (free @ heading)
    length = float(np.linalg.norm(along))
    return np.asarray(along / length if length > 0.0 else along)


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
    chosen, left = [first], list(others)
    while left and len(chosen) < number:
        nearest = [min(_apart(parameters, a, b, prior) for b in chosen) for a in left]
        if max(nearest) <= 0.0:
            break
        chosen.append(left.pop(int(np.argmax(nearest))))
    return chosen


def _apart(parameters: Sequence[Parameter], one: Place, other: Place, prior: FloatArray) -> float:
    """Distance in prior standard deviations; another alternative counts as half of one."""
    gap = np.abs(one.x - other.x)
    for i, parameter in enumerate(parameters):
        if parameter.period is not None:
            period = parameter.period / parameter.scale
            gap[i] = min(gap[i] % period, period - gap[i] % period)
    return float(np.linalg.norm(gap / prior)) + 0.5 * (one.alternative != other.alternative)
