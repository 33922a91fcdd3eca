"""Information of measurements through the FMU, and points that fit the data so far as well as any.

A candidate is a measurement that is added to the problem of the data so far. Its values S follow
from the model with what is solved inside (scales, gains, backgrounds, free responses: unknowns c)
as the data so far have it; its rows at a place p of the parameters are linear in all unknowns,

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
place leaves, anew at the fit that results, until the two agree.
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
    PlannedFmu,
    Point,
    Record,
    RowCovariance,
    Stencil,
    central,
    evaluate_many,
    noise_of,
    search_bounds,
    to_model,
    whitened,
)
from fitting.extension.records import BoundCampaign, Measurement, Prediction
from fitting.measurements.complex_sweep import ComplexSweep
from fitting.measurements.dataset import Dataset
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.plan import Plan
from fitting.signal.least_squares import damped_step
from fitting.signal.roughness import rician
from fitting.signal.student import tail
from fitting.simulate.batch import Batch, answered
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
#: Probability of a chi-square below which noise does not explain it; of sweeps without a stated
#: noise what remains, over the scatter of the points about a smooth curve.
TOO_LARGE_P, MUCH_LEFT = 1e-4, 2.0


@dataclass(frozen=True)
class Place:
    """A point of the parameter space: one of the alternatives, and a search vector (n,)."""

    alternative: Mapping[str, Scalar]
    x: FloatArray


@dataclass(frozen=True)
class DataSoFar:
    """All that was measured, as one problem, and the FMU that answers for it.

    `steps` (n,) are those of difference quotients in x.
    """

    problem: Record
    planned: PlannedFmu
    steps: FloatArray

    @property
    def bound(self) -> BoundCampaign:
        """The first campaign, which is to be continued."""
        return next(iter(self.problem.campaigns.values()))

    @property
    def series(self) -> str:
        """The name of its series."""
        return next(iter(self.problem.campaigns))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All that are fitted."""
        return self.problem.parameters

    @property
    def scale_sigma(self) -> float:
        """Relative standard deviation of its scale; zero without one, and where it is fitted."""
        return self.problem.data.scale_sigmas[0]

    def model(self, alternative: Mapping[str, Scalar]) -> DrivenModel:
        """How the FMU is driven by candidates, of which nothing is left out as it is for the data.

        Args:
            alternative: one of those of the problem.
        """
        return self.planned.response(alternative).models[self.series].whole

    def around(self, place: Place) -> Stencil:
        """Points for difference quotients at a place, within the box.

        Args:
            place: of the parameters.
        """
        return central(place.x, self.steps, *search_bounds(self.parameters))

    def table(self, xs: Sequence[FloatArray]) -> FloatArray:
        """Parameters in their units at search vectors, (k, n).

        Args:
            xs: search vectors, (n,) each.
        """
        return np.array([to_model(self.parameters, x) for x in xs])

    def objective(self, alternative: Mapping[str, Scalar]) -> Objective:
        """The objective of one alternative.

        Args:
            alternative: one of those of the problem.
        """
        return Objective(
            response=self.planned.response(alternative),
            parameters=self.parameters,
            data=self.problem.data,
            steps=self.steps,
        )

    def predicted(
        self, measurement: Measurement, place: Place, xs: Sequence[FloatArray], plan: Plan
    ) -> list[Prediction]:
        """What a measurement of the first campaign is predicted as at search vectors.

        Args:
            measurement: of any kind.
            place: whose alternative counts.
            xs: search vectors, (n,) each.
            plan: of its runs.
        """
        batch, model = Batch(), replace(self.model(place.alternative), plan=plan)
        task = measurement.predict(model, self.table(xs), batch)
        return answered(task, batch, self.planned.workers)

    def moved(
        self, place: Place, data: Dataset, errors: Mapping[str, float]
    ) -> tuple[Point, Stencil, list[Point]]:
        """Rows of data at a place, and at points moved along parameters and errors of settings.

        Args:
            place: of the parameters.
            data: experiments of the first campaign, as measured or as they would be.
            errors: standard deviations of settings of its experiments, in the FMU's units.
        """
        # an error is a parameter that is added to a setting in every experiment that has it
        further = []
        experiments = [e for tones in data.tones for e in tones.experiments]
        for name, sigma in errors.items():
            labels = [e.label for e in experiments if isinstance(e.settings.get(name), float | int)]
            if labels:
                error = Parameter(
                    name=f"error of {name}",
                    unit="",
                    lower=-sigma,
                    upper=sigma,
                    start=0.0,
                    reference=0.0,
                    scale=sigma,
                    adds_to=(name,),
                    experiment=labels[0],
                    further=tuple(labels[1:]),
                )
                further.append(error)
        parameters, zeros = (*self.parameters, *further), np.zeros(len(further))
        model = replace(self.model(place.alternative), parameters=parameters)
        response = replace(
            self.planned.response(place.alternative),
            measurements=data.measurements,
            parameters=parameters,
            models={self.series: model},
        )
        steps, x = np.append(self.steps, zeros + SHIFT), np.append(place.x, zeros)
        objective = Objective(response=response, parameters=parameters, data=data, steps=steps)
        around = central(x, steps, *search_bounds(parameters))
        here, *nodes = evaluate_many(objective, [x, *around.nodes])
        return here, around, nodes


def prior_sigmas_in_box(parameters: Sequence[Parameter]) -> FloatArray:
    """Standard deviations of the prior in x, (n,): the box as if uniform and a Gaussian together.

    A box wider than a period holds everything twice: the period counts then. (The fit, whose box is
    no more than where it searches, takes the Gaussian alone: `campaign.parameters.prior_sigmas`.)

    Args:
        parameters: all that are fitted.
    """
    lower, upper = search_bounds(parameters)
    periods = np.array([np.inf if p.period is None else p.period / p.scale for p in parameters])
    gaussian = np.array([p.scale / p.prior_sigma if p.prior_sigma else 0.0 for p in parameters])
    widths = np.minimum(upper - lower, periods)
    return np.asarray(1.0 / np.hypot(UNIFORM_WIDTH / widths, gaussian))


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

    def information(self, sigmas: FloatArray) -> FloatArray:
        """J^T V^-1 J of every candidate, what it has of its own eliminated, (c, n + l, n + l).

        Args:
            sigmas: standard deviations of the values, of each part of complex ones, shape (c, m).
        """
        peaks = np.abs(self.values)
        largest = np.max(peaks, axis=1, keepdims=True)
        noise = np.maximum(sigmas, SMALLEST_SIGMA * np.where(largest > 0.0, largest, 1.0))
        weights = 1.0 / noise
        if self.rectified:
            flat = rician(peaks.ravel(), noise.ravel())
            weights = flat.slope.reshape(noise.shape) / noise

        def weighted(*columns: FloatArray | ComplexArray) -> FloatArray:
            joined = np.concatenate(columns, axis=-1)
            rows = np.asarray(weights[..., np.newaxis] * joined, dtype=complex)
            return both_parts(rows, axis=1) if np.iscomplexobj(self.values) else rows.real

        matrix, own = weighted(self.by_x, self.shared), weighted(self.inside)
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
    """Data so far, covariance of their rows, and prior standard deviations in x, (n,)."""

    data: DataSoFar
    covariance: RowCovariance
    prior: FloatArray

    @classmethod
    def weighed_at(cls, data: DataSoFar, place: Place, prior: FloatArray) -> WhitenedData:
        """The data by their noise as a fit has it; what is not stated is what a place leaves."""
        objective = data.objective(place.alternative)
        [point] = evaluate_many(objective, [place.x])
        return cls(data=data, covariance=noise_of(objective, point).covariance, prior=prior)

    def rows(self, alternative: Mapping[str, Scalar], xs: Sequence[FloatArray]) -> list[FloatArray]:
        """Whitened rows (m,) at search vectors of one alternative, in one batch."""
        points = evaluate_many(self.data.objective(alternative), xs)
        return [whitened(point.residuals, self.covariance) for point in points]

    def at(self, places: Sequence[Place]) -> list[LinearisedFit]:
        """Rows and Jacobians at places of one alternative, in one batch."""
        around = [self.data.around(place) for place in places]
        xs = [x for p, each in zip(places, around, strict=True) for x in (p.x, *each.nodes)]
        rows = iter(self.rows(places[0].alternative, xs))
        fits = []
        for place, each in zip(places, around, strict=True):
            here, matrix = next(rows), each.quotients([next(rows) for _ in each.nodes])
            fits.append(LinearisedFit(rows=here, matrix=matrix, prior=self.prior, place=place))
        return fits

    def moved(self, fitted: LinearisedFit, dy: FloatArray) -> Place:
        """The place dy (n,) prior standard deviations away, within the box."""
        x = np.clip(fitted.place.x + self.prior * dy, *search_bounds(self.data.parameters))
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
    """

    data: WhitenedData
    fitted: LinearisedFit
    inflation: float


def start_fit(data: DataSoFar, place: Place, prior: FloatArray) -> StartFit:
    """The fit nearest to a place.

    Args:
        data: that were measured.
        place: where it begins.
        prior: standard deviations in x, shape (n,).
    """
    whole = data.problem.data
    is_estimated = not np.all(whole.sigma > 0.0)
    # noise that is not stated is what a fit leaves, which moves the fit
    for _ in range(1 + ROUNDS * is_estimated):
        white = WhitenedData.weighed_at(data, place, prior)
        [before], fitted = white.at([place]), white.nearest_fit(place)
        if before.chi_square - fitted.chi_square <= SETTLED * before.chi_square:
            break
        place = fitted.place
    dof = max(1, fitted.rows.size - place.x.size)
    excess = float(np.sqrt(fitted.chi_square / dof))
    is_noise = is_estimated or tail(fitted.chi_square, float(dof)) >= TOO_LARGE_P
    # noise that is not stated explains anything, but for complex sweeps: their points scatter about
    # a smooth curve by as much
    for m, mine in zip(whole.measurements, whole.slices, strict=True):
        if isinstance(m, ComplexSweep) and not np.any(m.sigma > 0.0):
            scatter = np.sqrt(np.mean([(c.scatter() / c.largest) ** 2 for c in m.records]))
            excess = (
                float(np.mean(white.covariance.sigma[mine]) / scatter) if scatter > 0.0 else 1.0
            )
            is_noise = excess <= MUCH_LEFT
    return StartFit(data=white, fitted=fitted, inflation=1.0 if is_noise else max(1.0, excess))


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
    parameters: Sequence[Parameter], places: Sequence[Place], number: int, prior: FloatArray
) -> list[Place]:
    """The first of the places and up to `number` - 1 others that lie far from each other.

    Args:
        parameters: for their periods.
        places: to choose from; the first is kept in any case.
        number: of points, at most.
        prior: standard deviations in x, shape (n,).
    """
    periods = np.array([np.inf if p.period is None else p.period / p.scale for p in parameters])
    xs = np.array([place.x for place in places])
    gaps = np.abs(xs[:, np.newaxis] - xs) % periods
    # in prior standard deviations; another alternative counts as half of one
    apart = np.linalg.norm(np.minimum(gaps, periods - gaps) / prior, axis=-1)
    apart += [[0.5 * (a.alternative != b.alternative) for b in places] for a in places]
    chosen = [0]
    while len(chosen) < number:
        nearest = apart[:, chosen].min(axis=1)
        if nearest.max() <= 0.0:
            break
        chosen.append(int(np.argmax(nearest)))
    return [places[k] for k in chosen]
