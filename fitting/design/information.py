"""The information of measurements through the FMU, and points that fit the data as well as any.

A candidate is a measurement that is added to the problem. Its values S follow from the model with
what is solved inside (scales, gains, backgrounds, free responses: unknowns c) as the data so far
have it; its rows at a place p of the parameters are linear in all that is unknown,

    dS = dS/dp dp + dS/dc dc + dS/dw dw          V = diag(sigma^2)

Each candidate's own c is eliminated: nothing is known of it. Errors w of what drifts, new in every
experiment, have a standard deviation. What several candidates share (the scale of the data, a
reference phase, a common gain) stays a variable after the parameters. Information is J^T V^-1 J.

A design has to be good at every point of equal fit, since none is known to be the true one. In
variables y of unit prior variance, with rows in units of the noise, walkers set out from a fit.
Each step goes along what the data do not determine (singular values of J below one: there the prior
knows more) and is brought back to the fit by damped Gauss-Newton steps of least length,

    dy = -(J^T J + mu I)^-1 J^T r,    singular values below one left out

The fit is the one nearest to the references. Noise that is not stated is estimated from what a
place leaves, anew at the fit that results, until the two agree. Where noise does not explain what
the nearest fit leaves, points that fill the box are ranked by sum ln(1 + row^2), and the lowest fit
of those from the best is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.extension.problem import (
    SMALLEST_SIGMA,
    UNIFORM_WIDTH,
    Linearisation,
    Objective,
    Parameter,
    Point,
    RowCovariance,
    Stencil,
    central,
    evaluate_many,
    information,
    make_objective,
    planning_points,
    problem_of,
    row_sigmas,
    search_bounds,
    to_model,
    whitened,
)
from fitting.extension.records import BoundCampaign, Measurement
from fitting.measurements.complex_sweep import ComplexSweep
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.fmu_response import FmuResponse
from fitting.measurements.planning import plan_series
from fitting.measurements.tones import Tones
from fitting.signal.least_squares import damped_step
from fitting.signal.roughness import rician
from fitting.signal.student import tail
from fitting.simulate.batch import Workers
from fitting.text.arrays import ComplexArray, FloatArray, Scalar, both_parts

#: Settings are moved by this share of their error for a difference quotient.
SHIFT = 0.2
#: Standard deviation, in units of the noise, of an unknown of which nothing is known.
UNKNOWN = 1e8
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
class Place:
    """A point of the parameter space: one of the alternatives, and a search vector (n,)."""

    alternative: Mapping[str, Scalar]
    x: FloatArray


@dataclass(frozen=True, kw_only=True)
class Linearised:
    """Residual rows (m,) of data at a place, their derivatives and covariance.

    `columns` (m, n + 1) by the search vector and by the logarithm of the scale.
    """

    residuals: FloatArray
    columns: FloatArray
    covariance: RowCovariance

    @property
    def information(self) -> FloatArray:
        """J^T V^-1 J, (n + 1, n + 1)."""
        return information(self.columns, self.covariance)


class Series:
    """Measurements of a campaign, and the FMU that answers for them.

    Args:
        bound: campaign, bound to its FMU.
        workers: of the FMU.
        refined: plan few runs for every curve whose response is measured to be rational.
        steps: difference steps in x, (n,); None: those that suit it, measured once.
    """

    def __init__(
        self,
        bound: BoundCampaign,
        workers: Workers,
        *,
        refined: bool = False,
        steps: FloatArray | None = None,
    ) -> None:
        self.bound, self.workers, self.refined = bound, workers, refined
        problem = problem_of([bound])
        self.data = problem.data
        self.plan = plan_series(problem.planned_together(""))
        for measurement in self.data.measurements if refined else ():
            model, points = self.model(bound.alternatives[0]), planning_points(bound.parameters)
            self.plan = measurement.refined(model, points, workers)
        self._steps = steps

    def model(self, alternative: Mapping[str, Scalar]) -> DrivenModel:
        """How the FMU is driven in one alternative."""
        return DrivenModel(
            setup=self.bound.setup,
            parameters=self.bound.parameters,
            plan=self.plan,
            alternative=alternative,
        )

    def response(self, alternative: Mapping[str, Scalar]) -> FmuResponse:
        """The FMU as the response of one alternative."""
        return FmuResponse(
            workers=self.workers,
            parameters=self.bound.parameters,
            measurements=self.data.measurements,
            models={"": self.model(alternative)},
            derived={"": self.bound.derived},
        )

    @property
    def steps(self) -> FloatArray:
        """Difference steps in x, (n,)."""
        if self._steps is None:
            response = self.response(self.bound.alternatives[0])
            self._steps = make_objective(response, self.bound.parameters, self.data).steps
        return self._steps

    def around(self, place: Place) -> Stencil:
        """Points for difference quotients at a place, within the box."""
        return central(place.x, self.steps, *search_bounds(self.bound.parameters))

    def parameters(self, xs: Sequence[FloatArray]) -> FloatArray:
        """Parameters in their units at search vectors, (k, n)."""
        return np.array([to_model(self.bound.parameters, x) for x in xs])

    def objective(self, alternative: Mapping[str, Scalar]) -> Objective:
        """The objective of one alternative."""
        return Objective(
            response=self.response(alternative),
            parameters=self.bound.parameters,
            data=self.data,
            steps=self.steps,
        )

    @property
    def scale_sigma(self) -> float:
        """Relative standard deviation of the scale; zero without one, and where it is fitted."""
        return max(self.data.scale_sigmas, default=0.0)

    def linearised(self, place: Place, setting_sigmas: Mapping[str, float]) -> Linearised:
        """Residuals, derivatives and covariance of what was measured, at a place.

        Args:
            place: of the parameters.
            setting_sigmas: errors of settings that drift, in the FMU's units, common to the rows of
                an experiment. Settings that the campaign fits an offset to carry none.
        """
        around = self.around(place)
        here, *nodes = evaluate_many(self.objective(place.alternative), [place.x, *around.nodes])
        rows, data = here.residuals, self.data
        by_x = around.quotients([node.residuals for node in nodes])
        fitted = {name for parameter in self.bound.offsets for name in parameter.adds_to}
        moved = [
            (above.residuals - below.residuals) / (2.0 * SHIFT)
            for name, sigma in setting_sigmas.items()
            if name not in fitted
            for above, below in [self.moved(place, name, SHIFT * sigma)]
        ]
        pairs = list(zip(data.measurements, data.slices, strict=True))
        common: list[FloatArray] = []
        for m, mine in pairs:
            lines = [len(e.read_hz) for e in m.experiments] if isinstance(m, Tones) else []
            owners = np.repeat(np.arange(len(lines)), lines)
            for k in range(len(lines)):  # two rows of a line that has a phase
                own = np.zeros(rows.size)
                own[mine] = np.tile(owners == k, m.rows // owners.size)
                common += [own * each for each in moved]
        covariance = RowCovariance(
            np.concatenate([row_sigmas(m.sigma, rows[mine]) for m, mine in pairs]),
            np.stack(common, axis=1) if common else np.empty((rows.size, 0)),
        )
        columns = np.column_stack([by_x, rows + data.measured_rows])
        return Linearised(residuals=rows, columns=columns, covariance=covariance)

    def moved(self, place: Place, name: str, shift: float) -> tuple[Point, Point]:
        """Points at a place with a setting of all experiments above and below its value."""
        objective, ends = self.objective(place.alternative), []
        for signed in (shift, -shift):
            measurements = tuple(_moved(m, name, signed) for m in self.data.measurements)
            response = replace(self.response(place.alternative), measurements=measurements)
            ends.append(evaluate_many(replace(objective, response=response), [place.x])[0])
        return ends[0], ends[1]


def _moved(measurement: Measurement, name: str, shift: float) -> Measurement:
    """The measurement with a setting of every experiment moved; a sweep stays."""
    if not isinstance(measurement, Tones):
        return measurement
    experiments = []
    for experiment in measurement.experiments:
        value = experiment.settings.get(name)
        if isinstance(value, float | int):
            settings = {**experiment.settings, name: value + shift}
            experiment = replace(experiment, settings=settings)
        experiments.append(experiment)
    return replace(measurement, experiments=tuple(experiments))


def prior_sigmas_in_box(parameters: Sequence[Parameter]) -> FloatArray:
    """Standard deviations of the prior in x, (n,): the box as if uniform and a Gaussian together.

    A box wider than a period holds everything twice: the period counts then. (The fit, whose box is
    no more than where it searches, takes the Gaussian alone: `campaign.parameters.prior_sigmas`.)
    """
    lower, upper = search_bounds(parameters)
    widths, gaussian = upper - lower, np.zeros(len(parameters))
    for i, parameter in enumerate(parameters):
        if parameter.period is not None:
            widths[i] = min(widths[i], parameter.period / parameter.scale)
        if parameter.prior_sigma is not None:
            gaussian[i] = (parameter.scale / parameter.prior_sigma) ** 2
    return np.asarray(1.0 / np.sqrt((UNIFORM_WIDTH / widths) ** 2 + gaussian))


@dataclass(frozen=True, kw_only=True)
class Rows:
    """Candidates of m values each at one place, in the unit of the values.

    `values` (c, m) are amplitudes, samples, or complex values whose real and imaginary parts are
    rows; `by_x` (c, m, n) their derivatives in the search vector, `shared` (c, m, l) by what
    candidates have in common, the logarithm of the scale of the data first, `inside` (c, m, k) by
    what each has of its own and nothing is known of, `errors` (c, m, s) by settings that drift,
    over their standard deviations. `rectified`: amplitudes are magnitudes of noisy quadratures.
    """

    values: FloatArray | ComplexArray
    by_x: FloatArray | ComplexArray
    shared: FloatArray | ComplexArray
    inside: FloatArray | ComplexArray
    errors: FloatArray | ComplexArray
    rectified: bool = False

    @property
    def peaks(self) -> FloatArray:
        """Sizes of the values, (c, m)."""
        return np.abs(self.values)

    def information(self, sigmas: FloatArray) -> FloatArray:
        """J^T V^-1 J of every candidate, what it has of its own eliminated, (c, n + l, n + l).

        Args:
            sigmas: standard deviations of the values, of each part of complex ones, shape (c, m).
        """
        largest = np.max(self.peaks, axis=1, keepdims=True)
        noise = np.maximum(sigmas, SMALLEST_SIGMA * np.where(largest > 0.0, largest, 1.0))
        weights = 1.0 / noise
        if self.rectified:
            flat = rician(self.peaks.ravel(), noise.ravel())
            weights = flat.slope.reshape(noise.shape) / noise

        def weighted(columns: FloatArray | ComplexArray) -> FloatArray:
            rows = np.asarray(weights[..., np.newaxis] * columns, dtype=complex)
            return both_parts(rows, axis=1) if np.iscomplexobj(self.values) else rows.real

        matrix = weighted(np.concatenate([self.by_x, self.shared], axis=-1))
        own = weighted(self.inside)
        sizes = np.linalg.norm(own, axis=1, keepdims=True)
        own = UNKNOWN * own / np.where(sizes > 0.0, sizes, 1.0)
        common = np.concatenate([own, weighted(self.errors)], axis=-1)
        if common.shape[-1]:
            # V = 1 + U U^T of whitened rows, by the singular vectors of U
            axes, singular, _ = np.linalg.svd(common, full_matrices=False)
            shares = (1.0 - 1.0 / np.hypot(1.0, singular))[..., np.newaxis]
            matrix = matrix - axes @ (shares * (np.swapaxes(axes, 1, 2) @ matrix))
        return np.asarray(np.swapaxes(matrix, 1, 2) @ matrix)


# --- points of equal fit -----------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class LinearisedFit(Linearisation):
    """The problem linearised at a place."""

    place: Place

    def step(self, damping: float) -> FloatArray:
        """Step to the fit in units of the prior, along what the data determine only."""
        return damped_step(self.scaled, self.rows, damping, least=DETERMINED)


@dataclass(frozen=True, kw_only=True)
class WhitenedData:
    """Data so far: series, covariance of all their rows, prior standard deviations in x, (n,).

    All series have the parameters of the first.
    """

    series: tuple[Series, ...]
    covariance: RowCovariance
    prior: FloatArray

    def at(self, places: Sequence[Place]) -> list[LinearisedFit]:
        """Rows and Jacobians at places of one alternative, in one batch for each series."""
        around = [self.series[0].around(place) for place in places]
        xs = [x for p, each in zip(places, around, strict=True) for x in (p.x, *each.nodes)]
        rows = iter(self.rows([Place(places[0].alternative, x) for x in xs]) if places else ())
        fits = []
        for place, each in zip(places, around, strict=True):
            here, matrix = next(rows), each.quotients([next(rows) for _ in each.nodes])
            fits.append(LinearisedFit(rows=here, matrix=matrix, prior=self.prior, place=place))
        return fits

    def rows(self, places: Sequence[Place]) -> list[FloatArray]:
        """Whitened rows (m,) at places of one alternative, in one batch for each series."""
        xs = [place.x for place in places]
        objectives = [series.objective(places[0].alternative) for series in self.series]
        points = [evaluate_many(objective, xs) for objective in objectives]
        return [
            whitened(np.concatenate([point.residuals for point in each]), self.covariance)
            for each in zip(*points, strict=True)
        ]

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
                steepest = float(np.linalg.norm(here.scaled, 2) ** 2)
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
    is_estimated = any(not np.all(each.data.sigma > 0.0) for each in series)

    def data_at(place: Place) -> WhitenedData:
        blocks = []
        for each in series:
            covariance = each.linearised(place, setting_sigmas).covariance
            blocks.append(covariance.beside(np.full(covariance.size, each.scale_sigma)))
        covariance = RowCovariance.joined(blocks)
        return WhitenedData(series=series, covariance=covariance, prior=prior)

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
        dof = max(1, fitted.rows.size - start.x.size)
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
    rows = series.linearised(place, {}).residuals
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
    if not start.undetermined(DETERMINED).size:
        return []
    rng = np.random.default_rng(seed)
    walkers, reached = [start] * WALKERS, list[LinearisedFit]()
    headings = list(rng.standard_normal((WALKERS, len(data.prior))))
    for _ in range(STRIDES):
        places = []
        for k, walker in enumerate(walkers):
            # a unit vector along the heading, within what the data leave open
            free = walker.undetermined(DETERMINED)
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
