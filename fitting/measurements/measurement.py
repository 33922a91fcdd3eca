"""The seam between what was measured, the FMU that answers for it, and the fit.

A kind of measurement is one file in this folder: a frozen record, derived from `Measurement`, that
holds its data as arrays; its methods ask for the runs of the FMU, predict from these, and make
residual rows of known noise. `tones` and `sweep` are two such kinds. Whoever adds a kind adds a
file: neither Algorithm 2 nor the inference knows any of them by name.

Rows are real numbers whose squares add up to chi square once they are divided by their noise:
complex values give two rows each, a spectrum with the Whittle likelihood the signed roots of its
deviances, a trace one row per sample. What enters a prediction linearly (a scale, a background, an
offset) is solved inside `residuals` and is no parameter. Values that follow a control quantity are
settings of the runs, by label, as those of an experiment are.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Protocol, Self, cast, runtime_checkable

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag

from fitting.campaign import Setup
from fitting.campaign.parameters import Parameter
from fitting.measurements.driven_model import DrivenModel
from fitting.measurements.figure import Figure
from fitting.measurements.gain import Solved
from fitting.measurements.plan import Plan
from fitting.measurements.residuals import ResidualCurve, least_noise
from fitting.signal.misfit import leaves_noise
from fitting.signal.scale import Maximum
from fitting.signal.window import Window
from fitting.simulate.batch import Batch, Workers
from fitting.simulate.drive import Drive
from fitting.text.arrays import ComplexArray, FloatArray, Scalar
from fitting.text.errors import BadInput
from fitting.text.finding import Finding

#: Unknowns of a response beside what is solved inside: those of one mode, and of another one.
SHAPE = 8
#: Share of the variance of a curve that may be left where the model still counts as following it;
#: and residuals, as a share of its maximum, below which it does so however flat it is.
VARIANCE_LEFT, SMALLEST_MISFIT = 0.5, 1e-3
#: Predicted or measured values (n,), real or complex.
Values = npt.NDArray[np.float64] | npt.NDArray[np.complex128]


@dataclass(frozen=True)
class Prediction:
    """What the model answers to one measurement, in the model's own unit.

    `values` (n,) at the places that were measured, real or complex; empty where the fit does not
    need them. `maximum` is that of a simulated sweep, where the scale is taken from it. Of records
    in which something is solved inside, each has its part `solved`; of complex sweeps, each its
    response H (n,), `responses`.
    """

    values: Values
    maximum: Maximum | None = None
    solved: tuple[Solved, ...] = ()
    responses: tuple[ComplexArray, ...] = ()


@dataclass(frozen=True)
class Scale:
    """The factor between simulated and measured amplitudes: `value`, relative error `bias`."""

    value: float
    bias: float = 0.0


@dataclass(frozen=True)
class Scaling:
    """How a scale follows from a measurement.

    ``from_rows``: it is the least-squares one over its own rows, and so costs one of them;
    ``is_free``: the logarithm of a factor on it is a parameter of the fit; ``sigma``: its relative
    standard deviation, zero where it is fitted, or none is given.
    """

    from_rows: bool = False
    is_free: bool = False
    sigma: float = 0.0


@dataclass(frozen=True)
class Estimated:
    """A value, and the standard deviation that it has at fixed parameters of the fit.

    ``is_loss``: both are those of its inverse, 1/Q, as losses add up and may be zero.
    """

    value: float
    sigma: float
    is_loss: bool = False


@dataclass(frozen=True)
class Sampled:
    """A run of a batch, by number, whose `output` over `window` should be mean and tones alone."""

    run: int
    window: Window
    output: str


#: Yields whenever what it has asked of the batch is wanted; returns a prediction per row.
Predicting = Generator[None, None, list[Prediction]]


class Measurement:
    """One kind of measurement of one series: a base class for its frozen record.

    A kind has rows, their noise, predictions and residuals of its own. For the rest the answers
    here hold: rows of no curve that no scale multiplies, and nothing to plan but the settling.
    """

    #: How its series drives the FMU.
    setup: Setup
    #: Name of the series that it belongs to: measurements of one series share a scale.
    series: str
    #: Whether its rows are samples over time, with which the runs of the FMU begin.
    is_trace: ClassVar[bool] = False
    #: Whether its rows hold amplitudes and phases: two for each value.
    has_phases: ClassVar[bool] = False

    @property
    def rows(self) -> int:
        """Number of residual rows, zero where it serves the scale alone."""
        return int(self.sigma.size)

    @property
    def sigma(self) -> FloatArray:
        """Standard deviation of every row, (rows,), in units of the row; zero where unknown."""
        raise NotImplementedError

    @property
    def measured_rows(self) -> FloatArray:
        """What the scale multiplies in each row where the model fits: dr/d ln chi = r + it."""
        return np.zeros(self.rows)

    @property
    def datum_noise(self) -> float:
        """Relative standard deviation of its least noisy datum, stated or estimated; else zero."""
        return least_noise(self.sigma, self.measured_rows)

    @property
    def is_curve(self) -> bool:
        """Whether its rows are points of one curve, whose residuals may be correlated."""
        return False

    @property
    def left_out(self) -> tuple[Finding, ...]:
        """Points of its files that are not fitted, as findings."""
        return ()

    @property
    def sampled_hz(self) -> tuple[float, ...]:
        """Rates of samples: frequencies that differ by multiples of one have the same rows."""
        return ()

    @property
    def solved_inside(self) -> int:
        """Number of real unknowns that `residuals` solves for: its rows are worth so many less."""
        return 0

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What is fitted with the FMU's parameters, as the delay of a cable."""
        return ()

    @property
    def noise_freedom(self) -> float:
        """Degrees of freedom of the noise of its rows; infinite where it is not estimated."""
        return math.inf

    @property
    def scaling(self) -> Scaling:
        """How the scale of its series follows from it, where it does."""
        return Scaling()

    @property
    def line_width_hz(self) -> float | None:
        """Width of a line that the data show, Hz; None where they show none."""
        return None

    @property
    def places(self) -> tuple[tuple[str, Mapping[str, Scalar]], ...]:
        """Label and settings of everything that was measured, one for each run of its own."""
        return ()

    @property
    def control_units(self) -> Mapping[str, str]:
        """Units of those settings that no variable of the FMU holds, for laws."""
        return {}

    @property
    def setting_sigmas(self) -> Mapping[str, Mapping[str, float]]:
        """Declared standard deviations of settings, by label; of kinds that can declare them."""
        return {}

    def named(self, label: str) -> Self:
        """The same with a label for the place that has none, where errors of settings need it.

        Args:
            label: of a place without one.
        """
        return self

    def drives(self, model: DrivenModel, p: FloatArray) -> list[Drive]:
        """Drives, at parameters p (n,), by which the plan of its series is measured.

        Args:
            model: how the FMU is driven for one series, and by which plan.
            p: parameters (n,), each in its own unit.
        """
        return []

    def planned(self, plan: Plan) -> Plan:
        """The plan of its series, with points and decisions of its own added.

        Args:
            plan: settings, settling and windows, with what they promise.
        """
        return plan

    def refined(self, model: DrivenModel, points: Sequence[FloatArray], workers: Workers) -> Plan:
        """The model's plan, with fewer runs where these are measured to do.

        Args:
            model: the FMU as the series drives it.
            points: parameter vectors (n,) at which it is measured.
            workers: of the FMU.
        """
        return model.plan

    def reviewed(self, model: DrivenModel, p: FloatArray, workers: Workers) -> Plan:
        """The model's plan, with what it can promise at further parameters, as those of a fit.

        Args:
            model: the FMU as the series drives it.
            p: parameters (n,), each in its own unit.
            workers: of the FMU.
        """
        return model.plan

    def predict(
        self, model: DrivenModel, table: FloatArray, batch: Batch, *, whole: bool = False
    ) -> Predicting:
        """Ask the batch for runs, yield for their answers as often as needed, return predictions.

        Args:
            model: the FMU as the series drives it.
            table: parameter vectors, shape (k, n), in the parameters' units.
            batch: where runs are asked for; equal runs are simulated once.
            whole: predict every measured place, also those that the fit does not need.
        """
        raise NotImplementedError

    def sampled(self, model: DrivenModel, p: FloatArray, batch: Batch) -> list[Sampled]:
        """Ask for the runs whose samples should hold nothing but their mean and their tones.

        Args:
            model: how the FMU is driven for one series, and by which plan.
            p: parameters (n,), each in its own unit.
            batch: where runs are asked for; equal runs are simulated once.
        """
        return []

    def scale(self, prediction: Prediction) -> Scale | None:
        """The scale that a prediction gives; None where this measurement gives none.

        Args:
            prediction: of the measurement, without scale.
        """
        return None

    def residuals(self, prediction: Prediction, chi: float) -> FloatArray:
        """Rows (rows,) of a prediction that is multiplied by `chi`.

        Args:
            prediction: of the measurement, without scale.
            chi: scale, laboratory over simulation.
        """
        raise NotImplementedError

    def solved_blocks(self, prediction: Prediction) -> Sequence[FloatArray]:
        """Derivatives of the rows by what is solved inside.

        They come as stretches of rows, one after the other, each with unknowns of its own.

        Args:
            prediction: of the measurement, without scale.
        """
        return (np.empty((self.rows, 0)),)

    def solved_columns(self, prediction: Prediction) -> FloatArray:
        """The same of all rows, (rows, solved_inside).

        Args:
            prediction: of the measurement, without scale.
        """
        return np.asarray(block_diag(*self.solved_blocks(prediction)))

    def amplitude_rows(self, prediction: Prediction, rows: FloatArray) -> FloatArray:
        """What changes (rows, k) of the rows change of amplitudes alone, (m, k).

        Args:
            prediction: of the measurement, without scale.
            rows: changes of its rows, as their derivatives are.
        """
        return rows

    def qualities(self, prediction: Prediction, sigma: FloatArray) -> Mapping[str, Estimated]:
        """Values that follow from what is solved inside, by name, as the coupling quality does.

        Args:
            prediction: of the measurement, without scale.
            sigma: standard deviations of its rows, (rows,).
        """
        return {}

    def scaled(self, prediction: Prediction, chi: float) -> Values:
        """What is compared with the measured values, (n,), in their unit.

        Args:
            prediction: of the measurement, without scale.
            chi: scale, laboratory over simulation.
        """
        return cast(Values, np.asarray(chi * prediction.values))

    @property
    def rows_without_response(self) -> FloatArray:
        """Rows (rows,) where a constant, or what is added to the response, is all there is.

        Empty where that is not examined: peaks of tones are there.
        """
        return np.empty(0)

    def _misses_curve(self, deviations: FloatArray, residuals: FloatArray) -> bool:
        """Whether less than half of the variance of a curve, rows about its mean, is explained.

        One with so much noise that it is most of its variance may be followed nevertheless.
        """
        spread, left = float(deviations @ deviations), float(residuals @ residuals)
        if not (left > VARIANCE_LEFT * spread and left > SMALLEST_MISFIT**2 * residuals.size):
            return False
        shape, unknowns = self.rows_without_response, self.solved_inside + SHAPE
        return not (shape.size and leaves_noise(shape, residuals, self.sigma, unknowns))

    def unexplained(self, residuals: FloatArray) -> str:
        """Why rows (rows,) do not follow the data at all; empty where they do.

        Args:
            residuals: rows (m,), relative.
        """
        return ""

    def share_left(self, residuals: FloatArray) -> float:
        """Residual of the curve described worst, over its largest amplitude.

        Root mean square over the points; of complex values of their distance from the model. NaN
        where the rows are no shares of an amplitude.

        Args:
            residuals: rows (m,), relative.
        """
        return math.nan

    def residual_curves(self, residuals: FloatArray) -> Sequence[ResidualCurve]:
        """Its rows along every axis that they have; none where structure cannot be tested.

        Args:
            residuals: rows (rows,), relative.
        """
        if not (self.is_curve and residuals.size):
            return ()
        return (ResidualCurve(rows=np.arange(residuals.size), share=np.ones(residuals.size)),)

    def figures(self, before: Values, after: Values) -> Sequence[Figure]:
        """What was measured with the model, for report and plots.

        Args:
            before: predictions (n,) of everything that was measured, times the scale, at the start
                parameters.
            after: the same at the fitted parameters.
        """
        return ()

    def within(self, setup: Setup, series: str) -> Self:
        """The same as part of a series; what has labelled places puts the name before them.

        Args:
            setup: how the series drives the FMU.
            series: its name.
        """
        changed: Any = replace(self, setup=setup, series=series)  # type: ignore[type-var]
        return cast(Self, changed)

    def part(self, labels: Collection[str]) -> Self | None:
        """What was measured at the places of these labels, all of it or nothing (None).

        Args:
            labels: of places.

        Raises:
            BadInput: some of its places are among them, and some are not.
        """
        own = [label for label, _ in self.places]
        inside = [label for label in own if label in labels]
        if inside and len(inside) < len(own):
            raise BadInput(
                f"of the measurements {', '.join(own)} only {', '.join(inside)} would be left; "
                "this kind of measurement is not divided"
            )
        return self if inside else None


@dataclass(frozen=True)
class Evaluation:
    """Answers to one parameter vector: a prediction per measurement; `runs` simulations it took.

    `promised` is the relative error that the values of each prediction may have, at most, as far as
    whoever answers can exclude a larger one; empty where they are exact. `shift` (m,) is what all
    rows are off by besides, measured with its sign; empty: nothing.
    """

    predictions: tuple[Prediction, ...]
    runs: int = 0
    promised: tuple[float, ...] = ()
    shift: FloatArray = field(default_factory=lambda: np.empty(0))


class Response(Protocol):
    """Model of a series of measurements; p is (n,) in the parameters' own units.

    Whatever answers like this can be fitted; the FMU does in `fitting.measurements.fmu_response`.
    """

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        """Predictions for several parameter vectors, in one batch.

        Args:
            ps: parameter vectors (n,), each in its own unit.
            whole: whether everything is wanted that reports show, not residuals only.
        """
        ...

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        """Derived outputs by name, each (n_places,); NaN where the model has no value.

        Args:
            ps: parameter vectors (n,), each in its own unit.
        """
        ...


@runtime_checkable
class DivisibleResponse(Response, Protocol):
    """A response that can answer for parts of its measurements."""

    def answering(self, measurements: tuple[Measurement, ...]) -> Response:
        """The same model, asked for these measurements.

        Args:
            measurements: parts of those that it answers for.
        """
        ...


@runtime_checkable
class ReadingResponse(Response, Protocol):
    """A response that can read derived outputs in the runs of its measurements."""

    def evaluate_and_read(
        self, ps: Sequence[FloatArray], places: Collection[int]
    ) -> list[Evaluation]:
        """Predictions as `evaluate_many` gives them; `derived_many` costs less at some ps then.

        Args:
            ps: parameter vectors (n,), each in its own unit.
            places: numbers of those at which derived outputs are read, too.
        """
        ...


@runtime_checkable
class PlacedResponse(Response, Protocol):
    """A response that can read derived outputs at fewer places than it was measured at."""

    def read_at(self, most: int) -> Response:
        """The same model, whose outputs are read at about so many places at most.

        Args:
            most: places, of all series together.
        """
        ...
