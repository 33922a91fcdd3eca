"""The information of measurements, J^T V^-1 J, through the FMU: of the data so far, of candidates.

A candidate is a measurement that is added to the problem. Its values S follow from the model with
what is solved inside (scales, gains, backgrounds, free responses: unknowns c) as the data so far
have it; its rows at a place p of the parameters are linear in all that is unknown,

    dS = dS/dp dp + dS/dc dc + dS/dw dw          V = diag(sigma^2)

Each candidate's own c is eliminated: nothing is known of it. Errors w of what drifts, new in every
experiment, have a standard deviation. What several candidates share (the scale of the data, a
reference phase, a common gain) stays a variable after the parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign import Experiment
from fitting.extension.problem import (
    SMALLEST_SIGMA,
    UNIFORM_WIDTH,
    Objective,
    Parameter,
    Point,
    RowCovariance,
    central,
    evaluate_many,
    information,
    make_objective,
    planning_points,
    problem_of,
    row_sigmas,
    search_bounds,
)
from fitting.extension.records import BoundCampaign, Measurement
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.fmu_response import FmuResponse
from fitting.measurements.planning import plan_series
from fitting.measurements.tones import Tones
from fitting.signal.rician import rician
from fitting.simulate.batch import Workers
from fitting.text.arrays import ComplexArray, FloatArray, Scalar, both_parts

#: Settings are moved by this share of their error for a difference quotient.
SHIFT = 0.2
#: Standard deviation, in units of the noise, of an unknown of which nothing is known.
UNKNOWN = 1e8


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
    """

    def __init__(self, bound: BoundCampaign, workers: Workers, *, refined: bool = False) -> None:
        self.bound, self.workers, self.refined = bound, workers, refined
        problem = problem_of([bound])
        self.data = problem.data
        self.plan = plan_series(problem.planned_together(""))
        for measurement in self.data.measurements if refined else ():
            model, points = self.model(bound.alternatives[0]), planning_points(bound.parameters)
            self.plan = measurement.refined(model, points, workers)
        self._steps: FloatArray | None = None

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

    def objective(self, alternative: Mapping[str, Scalar], steps: FloatArray) -> Objective:
        """The objective of one alternative with given difference steps in x, (n,)."""
        return Objective(
            response=self.response(alternative),
            parameters=self.bound.parameters,
            data=self.data,
            steps=steps,
        )

    def steps(self) -> FloatArray:
        """Difference steps in x, (n,), that suit this series, measured once."""
        if self._steps is None:
            response = self.response(self.bound.alternatives[0])
            self._steps = make_objective(response, self.bound.parameters, self.data).steps
        return self._steps

    @property
    def scale_sigma(self) -> float:
        """Relative standard deviation of the scale; zero without one, and where it is fitted."""
        return max(self.data.scale_sigmas, default=0.0)

    def linearised(
        self, place: Place, steps: FloatArray, setting_sigmas: Mapping[str, float]
    ) -> Linearised:
        """Residuals, derivatives and covariance of what was measured, at a place.

        Args:
            place: of the parameters.
            steps: difference steps in x, shape (n,).
            setting_sigmas: errors of settings that drift, in the FMU's units, common to the rows of
                an experiment. Settings that the campaign fits an offset to carry none.
        """
        objective = self.objective(place.alternative, steps)
        around = central(place.x, steps, *search_bounds(self.bound.parameters))
        here, *nodes = evaluate_many(objective, [place.x, *around.nodes])
        rows, data = here.residuals, self.data
        by_x = around.quotients([node.residuals for node in nodes])
        fitted = {name for parameter in self.bound.offsets for name in parameter.adds_to}
        moved = [
            (above.residuals - below.residuals) / (2.0 * SHIFT)
            for name, sigma in setting_sigmas.items()
            if name not in fitted
            for above, below in [self.moved(objective, place, name, SHIFT * sigma)]
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

    def moved(
        self, objective: Objective, place: Place, name: str, shift: float
    ) -> tuple[Point, Point]:
        """Points at a place with a setting of all experiments above and below its value."""
        ends = []
        for sign in (1.0, -1.0):
            measurements = tuple(_moved(m, name, sign * shift) for m in self.data.measurements)
            response = replace(self.response(place.alternative), measurements=measurements)
            ends.append(evaluate_many(replace(objective, response=response), [place.x])[0])
        return ends[0], ends[1]


def _moved(measurement: Measurement, name: str, shift: float) -> Measurement:
    """The measurement with a setting of every experiment moved; a sweep stays."""

    def shifted(experiment: Experiment) -> Experiment:
        value = experiment.settings.get(name)
        if not isinstance(value, float | int):
            return experiment
        return replace(experiment, settings={**experiment.settings, name: value + shift})

    if not isinstance(measurement, Tones):
        return measurement
    return replace(measurement, experiments=tuple(map(shifted, measurement.experiments)))


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
