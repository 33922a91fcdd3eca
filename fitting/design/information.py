"""What measurements say, through the FMU: information matrices of data so far and of candidates.

A measurement is ln of a scaled peak amplitude. With J = d ln(chi z)/dx by central differences, the
relative variances of the peaks on the diagonal of V and, common to the tones of one experiment, the
errors of what drifts (g = d ln(chi z)/d setting, standard deviation s),

    F = sum over experiments of [J 1]^T V^-1 [J 1],      V = diag(sigma^2/A^2) + sum s^2 g g^T

The last variable is the logarithm of the scale chi, a nuisance that all experiments share; its
prior is the scatter of the sweep that it rests on. Where phases are measured, each is a row like
that of its amplitude, and the reference phase, common to all that is new, a further nuisance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitting.campaign import Experiment
from fitting.extension.problem import (
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
from fitting.measurements.dataset import Dataset
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.fmu_response import FmuResponse
from fitting.measurements.planning import plan_series
from fitting.measurements.tones import Tones
from fitting.simulate.batch import Workers
from fitting.text.arrays import ComplexArray, FloatArray, IntArray, Scalar

#: Settings are moved by this share of their error for a difference quotient.
SHIFT = 0.2


@dataclass(frozen=True)
class Place:
    """A point of the parameter space: one of the alternatives, and a search vector (n,)."""

    alternative: Mapping[str, Scalar]
    x: FloatArray


@dataclass(frozen=True, kw_only=True)
class Rows:
    """Peaks of some experiments at one place.

    `amplitude_v` (m,), `by_x` (m, n) and `by_setting` (m, s) derivatives of their logarithms,
    `residuals` (m,) against what was measured. `further_residuals` (k,), `further_by_x` (k, n) and
    `further_by_setting` (k, s) are of all other rows: complex values, points of a sweep.
    `phase_by_x` and `phase_by_setting` belong to setups that read phases: derivatives of these.
    """

    amplitude_v: FloatArray
    by_x: FloatArray
    by_setting: FloatArray
    residuals: FloatArray
    further_residuals: FloatArray
    further_by_x: FloatArray
    further_by_setting: FloatArray
    phase_by_x: FloatArray
    phase_by_setting: FloatArray


class Series:
    """Experiments of a campaign - those measured, or setups not measured yet - and their FMU."""

    def __init__(
        self,
        bound: BoundCampaign,
        workers: Workers,
        *,
        setups: bool = False,
        refined: bool = False,
    ) -> None:
        self.bound, self.workers = bound, workers
        self.setups, self.refined = setups, refined
        problem = problem_of([bound])
        self.data = problem.data
        self.plan = plan_series(problem.planned_together(""))
        if refined:
            self._refine()
        self._steps: FloatArray | None = None

    def _refine(self) -> None:
        """Plan few runs for every curve whose response is measured to be rational."""
        parameters = self.bound.parameters
        points = planning_points(parameters)
        for measurement in self.data.measurements:
            model = self.model(self.bound.alternatives[0])
            self.plan = measurement.refined(model, points, self.workers)

    def model(self, alternative: Mapping[str, Scalar]) -> DrivenModel:
        """How the FMU is driven in one alternative.

        Args:
            alternative: discrete settings, by name.
        """
        return DrivenModel(
            setup=self.bound.setup,
            parameters=self.bound.parameters,
            plan=self.plan,
            alternative=alternative,
        )

    def response(self, alternative: Mapping[str, Scalar]) -> FmuResponse:
        """The FMU as the response of one alternative.

        Args:
            alternative: discrete settings, by name.
        """
        bound = self.bound
        return FmuResponse(
            workers=self.workers,
            parameters=bound.parameters,
            measurements=self.data.measurements,
            models={"": self.model(alternative)},
            derived={"": bound.derived},
        )

    def objective(self, alternative: Mapping[str, Scalar], steps: FloatArray) -> Objective:
        """The objective of one alternative with given difference steps.

        Args:
            alternative: discrete settings, by name.
            steps: lengths of the difference steps (n,), in units of x.
        """
        return Objective(
            response=self.response(alternative),
            parameters=self.bound.parameters,
            data=self.data,
            steps=steps,
        )

    def peaks(self, point: Point) -> FloatArray:
        """Scaled amplitudes of all tones without measured phases at a point, shape (m,).

        Args:
            point: residual rows at a search vector.
        """
        return np.abs(self._lines(point))

    def _lines(self, point: Point) -> ComplexArray:
        """Scaled values of all tones that are no measured complex ones, (m,)."""
        pairs = zip(self.data.measurements, point.scaled, strict=True)
        mine = [v for m, v in pairs if self._is_line(m)]
        return np.concatenate([np.empty(0, dtype=complex), *mine])

    def residuals(self, place: Place, steps: FloatArray) -> FloatArray:
        """All residual rows at a place, (m,).

        Args:
            place: where they are wanted.
            steps: difference steps in x, shape (n,).
        """
        return evaluate_many(self.objective(place.alternative, steps), [place.x])[0].residuals

    def steps(self) -> FloatArray:
        """Difference steps in x that suit this series, found once."""
        if self._steps is None:
            made = make_objective(
                self.response(self.bound.alternatives[0]), self.bound.parameters, self.data
            )
            self._steps = made.steps
        return self._steps

    def rows(
        self, places: Sequence[Place], steps: FloatArray, setting_sigmas: Mapping[str, float]
    ) -> list[Rows]:
        """Peaks and their derivatives at several places, a few batches for each.

        Args:
            places: where they are wanted.
            steps: difference steps in x, shape (n,).
            setting_sigmas: errors of settings that drift, in the FMU's units.
        """
        return [self._rows(place, steps, setting_sigmas) for place in places]

    def _rows(self, place: Place, steps: FloatArray, setting_sigmas: Mapping[str, float]) -> Rows:
        objective = self.objective(place.alternative, steps)
        around = central(place.x, steps, *search_bounds(self.bound.parameters))
        here, *nodes = evaluate_many(objective, [place.x, *around.nodes])
        amplitude_v = self.peaks(here)
        count = amplitude_v.size
        further = here.residuals[self._own_rows :]
        shifted = [
            self._by_setting(place, steps, name, SHIFT * sigma)
            for name, sigma in setting_sigmas.items()
        ]
        table = np.zeros((2 * count + further.size, 0))
        table = np.stack(shifted, axis=1) if shifted else table
        logs, rest, phases = np.split(table, [count, count + further.size])
        lines = [self._lines(node) for node in nodes]
        return Rows(
            amplitude_v=amplitude_v,
            by_x=around.quotients([np.abs(each) for each in lines], log_ratio),
            by_setting=logs,
            residuals=here.residuals[:count],
            further_residuals=further,
            further_by_x=around.quotients([n.residuals[self._own_rows :] for n in nodes]),
            further_by_setting=rest,
            phase_by_x=around.quotients([np.angle(each) for each in lines], turned),
            phase_by_setting=phases,
        )

    @property
    def _own_rows(self) -> int:
        """Number of rows of those tones; they stand first."""
        return sum(m.rows for m in self.data.measurements if self._is_line(m))

    def _is_line(self, measurement: Measurement) -> bool:
        """Whether its values are looked at: of amplitudes, and of setups with their phases."""
        read = self.setups or not measurement.has_phases
        return isinstance(measurement, Tones) and read

    def _by_setting(self, place: Place, steps: FloatArray, name: str, shift: float) -> FloatArray:
        """By a setting: d ln|chi z|, of further rows, and of phases; the sweep's is not moved."""
        ends = []
        objective, own = self.objective(place.alternative, steps), self.response(place.alternative)
        for sign in (1.0, -1.0):
            moved = tuple(_moved(m, name, sign * shift) for m in self.data.measurements)
            response = replace(own, measurements=moved)
            ends.append(evaluate_many(replace(objective, response=response), [place.x])[0])
        above, below = (self._lines(point) for point in ends)
        further = [point.residuals[self._own_rows :] for point in ends]
        changes = (
            log_ratio(np.abs(above), np.abs(below)),
            further[0] - further[1],
            turned(np.angle(above), np.angle(below)),
        )
        return np.concatenate(changes) / (2.0 * shift)


def _moved(measurement: Measurement, name: str, shift: float) -> Measurement:
    """The measurement with a setting of every experiment moved; a sweep stays."""
    if not isinstance(measurement, Tones):
        return measurement
    experiments = tuple(_shifted(e, name, shift) for e in measurement.experiments)
    return replace(measurement, experiments=experiments)


def _shifted(experiment: Experiment, name: str, shift: float) -> Experiment:
    value = experiment.settings.get(name)
    if not isinstance(value, float | int):
        return experiment
    return replace(experiment, settings={**experiment.settings, name: value + shift})


def log_ratio(above: FloatArray, below: FloatArray) -> FloatArray:
    """ln(above/below), amplitudes (m,); zero where one does not answer at all (it says nothing).

    Args:
        above: amplitudes, any shape and unit.
        below: likewise.
    """
    silent = (above <= 0.0) | (below <= 0.0)
    return np.asarray(np.log(np.where(silent, 1.0, above) / np.where(silent, 1.0, below)))


def turned(above: FloatArray, below: FloatArray) -> FloatArray:
    """Difference of phases, rad, the short way round.

    Args:
        above: phases, any shape, rad.
        below: likewise.
    """
    return np.asarray(np.angle(np.exp(1j * (above - below))))


def unmeasured(bound: BoundCampaign) -> BoundCampaign:
    """The campaign with peaks of one in place of measured ones, its sweep for the scale only.

    Measurements of other kinds are left out: nothing of them is asked.

    Args:
        bound: campaign, bound to its FMU.
    """
    ones = tuple(
        replace(e, peaks_v=np.ones(len(e.read_hz)), sigmas_v=np.zeros(len(e.read_hz)))
        for e in bound.experiments
    )
    sweep = None if bound.sweep is None else replace(bound.sweep, use="scale")
    return replace(bound, experiments=ones, sweep=sweep, measurements={})


def prior_sigmas_in_box(parameters: Sequence[Parameter]) -> FloatArray:
    """Standard deviations of the prior in x, (n,): the box as if uniform and a Gaussian together.

    A box wider than a period holds everything twice: the period counts then. (The fit, whose box is
    no more than where it looks, takes the Gaussian alone: `campaign.parameters.prior_sigmas`.)

    Args:
        parameters: n of them.
    """
    lower, upper = search_bounds(parameters)
    widths = upper - lower
    gaussian = np.zeros(len(parameters))
    for i, parameter in enumerate(parameters):
        if parameter.period is not None:
            widths[i] = min(widths[i], parameter.period / parameter.scale)
        if parameter.prior_sigma is not None:
            gaussian[i] = (parameter.scale / parameter.prior_sigma) ** 2
    return np.asarray(1.0 / np.sqrt((UNIFORM_WIDTH / widths) ** 2 + gaussian))


def scale_sigma(data: Dataset) -> float:
    """Relative standard deviation of the scale; zero without one, and where it is fitted.

    Args:
        data: rows of all measurements.
    """
    return max(data.scale_sigmas, default=0.0)


def noise_covariance(
    sigmas: FloatArray, by_setting: FloatArray, setting_sigmas: FloatArray, same: FloatArray
) -> FloatArray:
    """V (..., m, m) from `sigmas` (..., m), relative, and `by_setting` (..., m, s).

    `same` (m, m) is one for rows of one experiment: an error of a setting is common to them and
    new in the next.

    Args:
        sigmas: relative, of each row alone, shape (..., m).
        by_setting: d ln z/d setting, shape (..., m, s), per unit of the setting.
        setting_sigmas: errors of the settings, shape (s,), in the FMU's units.
        same: one for rows of one experiment, shape (m, m).
    """
    moved = by_setting * setting_sigmas
    diagonal = sigmas[..., :, np.newaxis] ** 2 * np.eye(sigmas.shape[-1])
    return np.asarray(diagonal + same * (moved @ np.swapaxes(moved, -1, -2)))


def _with_scale(by_x: FloatArray) -> FloatArray:
    """Derivatives of logarithms with that to the logarithm of the scale, which is one, beside."""
    return np.concatenate([by_x, np.ones((*by_x.shape[:-1], 1))], axis=-1)


def information_of_data(
    series: Series, rows: Rows, setting_sigmas: Mapping[str, float]
) -> tuple[FloatArray, RowCovariance, FloatArray]:
    """Information (n + 1, n + 1) of what was measured, and V and J of its rows.

    Settings that the campaign fits an offset to carry no error of their own here.

    Args:
        series: that was measured.
        rows: its rows at a place.
        setting_sigmas: errors of settings that drift, in the FMU's units.
    """
    count = rows.amplitude_v.size
    fitted = {name for parameter in series.bound.offsets for name in parameter.adds_to}
    errors = np.array([0.0 if name in fitted else s for name, s in setting_sigmas.items()])
    residuals = np.concatenate([rows.residuals, rows.further_residuals])
    given = series.data.sigma
    sigmas = np.concatenate(
        [row_sigmas(given[part], residuals[part]) for part in (slice(count), slice(count, None))]
    )
    by_setting = np.concatenate([rows.by_setting, rows.further_by_setting])
    covariance = _of_rows(sigmas, by_setting * errors, _experiments_of_rows(series))
    # d residual = (1 + residual) d ln(chi z) for a peak; a fitted sweep is relative to its maximum
    peaks = _with_scale(rows.by_x) * (1.0 + rows.residuals[:, np.newaxis])
    by_scale = rows.further_residuals + series.data.measured_rows[count:]
    columns = np.concatenate([peaks, np.column_stack([rows.further_by_x, by_scale])])
    return information(columns, covariance), covariance, columns


def _of_rows(sigmas: FloatArray, moved: FloatArray, index: IntArray) -> RowCovariance:
    """V of all rows: `moved` (m, s) is common to rows of one experiment, by its `index` (m,)."""
    alone = index < 0
    own = np.hypot(sigmas, alone * np.linalg.norm(moved, axis=1))
    of_each = [moved * (index == k)[:, np.newaxis] for k in np.unique(index[~alone])]
    return RowCovariance(own, np.concatenate([np.zeros((sigmas.size, 0)), *of_each], axis=1))


def _experiments_of_rows(series: Series) -> IntArray:
    """Which experiment each row belongs to, (m,); points of sweeps to none that others have."""
    found: list[int] = []
    begin = 0
    for m in series.data.measurements:
        if not isinstance(m, Tones):
            found += [-1 - len(found) - k for k in range(m.rows)]
            continue
        counts = [len(e.read_hz) for e in m.experiments]
        mine = np.repeat(np.arange(begin, begin + len(counts)), counts)
        found += np.tile(mine, m.rows // mine.size).tolist()
        begin += len(counts)
    return np.array(found, dtype=np.intp)


def information_of_setups(
    rows: Rows,
    relative: FloatArray,
    kept: Sequence[int],
    setting_sigmas: Mapping[str, float],
    *,
    phases: bool = False,
) -> FloatArray:
    """Information (kept, n + 1, n + 1) of the setups kept; with phases (kept, n + 2, n + 2).

    `relative` (kept, tones) are the relative standard deviations of their peaks.

    Args:
        rows: of all setups at a place.
        relative: standard deviations of the peaks of those kept, shape (kept, tones).
        kept: places of the setups in the rows.
        setting_sigmas: errors of settings that drift, in the FMU's units.
        phases: whether the phases are measured as well.
    """
    tones = relative.shape[1]
    errors = np.array(list(setting_sigmas.values()))
    shape = (rows.amplitude_v.size // tones, tones)
    parts = [(rows.by_x, rows.by_setting)]
    parts += [(rows.phase_by_x, rows.phase_by_setting)] if phases else []
    by_x, by_setting = (
        np.concatenate([part[k].reshape(*shape, -1 if part[k].size else 0) for part in parts], 1)[
            list(kept)
        ]
        for k in (0, 1)
    )
    every = len(parts) * tones
    sigmas = np.tile(relative, len(parts))
    covariance = noise_covariance(sigmas, by_setting, errors, np.ones((every, every)))
    nuisances = np.repeat(np.eye(len(parts)), tones, axis=0)  # of ln chi, and of the reference
    columns = np.broadcast_to(nuisances, (*by_x.shape[:-1], len(parts)))
    return information(np.concatenate([by_x, columns], axis=-1), covariance)
