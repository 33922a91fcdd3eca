"""The end of a fit linearised, and what rows are worth: rules by hand, noise by columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from fitting.fit.fit import solution_of
from fitting.fit.noise import RowNoise, noise_of
from fitting.fit.objective import Objective, evaluate_many, weights
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import Evaluation, Prediction
from fitting.signal.scale import Maximum
from fitting.text.arrays import FloatArray
from tests.support.datasets import answer, dataset, peaks_measurement, sweep_measurement
from tests.support.rows import RowsResponse, rows_evaluator, rows_objective
from tests.support.whitened import parameter, whitened

# --- noise of the rows


def noise(measured: Dataset, rows: Callable[[FloatArray], FloatArray]) -> RowNoise:
    own = parameter("p", -1.0, 1.0)
    objective = Objective(
        response=RowsResponse(rows), parameters=(own,), data=measured, steps=np.full(1, 1e-4)
    )
    [point] = evaluate_many(objective, [np.zeros(1)])
    return noise_of(objective, point)


def test_known_noise_is_its_own_and_unknown_noise_the_scatter_of_its_rows() -> None:
    rows = lambda p: np.array([0.3, -0.4, 0.0, 0.1])  # noqa: E731
    known = noise(dataset(np.ones(4), np.array([0.1, 0.2, 0.3, 0.4])), rows)
    assert known.sigma == pytest.approx([0.1, 0.2, 0.3, 0.4])
    assert known.common.shape == (4, 0)
    assert known.bounded.columns == 0
    mixed = noise(dataset(np.ones(4), np.array([0.0, 0.0, 0.3, 0.4])), rows)
    assert mixed.sigma == pytest.approx([np.sqrt(0.125), np.sqrt(0.125), 0.3, 0.4])


MAXIMUM = Maximum(value=2.0, frequency_hz=2.0, bias=0.0, bracketed=True)


class Scaled(RowsResponse):
    """Peaks and, before their scale is taken, the maximum of a sweep."""

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [answer(self.rows(p), maximum=MAXIMUM) for p in ps]


def test_the_error_of_a_scale_is_shared_by_all_rows_that_it_scales() -> None:
    """Half as large as measured at the maximum: chi = 2, whose error e moves a row by e (1 + r)."""
    sweep = sweep_measurement(np.array([1.0, 4.0, 1.0]), sigmas_v=np.array([0.5, 0.08, 0.5]))
    objective = Objective(
        response=Scaled(lambda p: np.array([0.5, 0.25, 0.75])),
        parameters=(parameter("p", -1.0, 1.0),),
        data=dataset(np.ones(3), np.full(3, 0.1), sweep),
        steps=np.full(1, 1e-4),
    )
    [point] = evaluate_many(objective, [np.zeros(1)])
    assert point.residuals == pytest.approx([0.0, -0.5, 0.5])
    assert noise_of(objective, point).common == pytest.approx(
        0.02 * np.array([[1.0], [0.5], [1.5]])
    )


def test_widened_rows_are_those_that_were_meant() -> None:
    own = RowNoise(np.array([0.1, 0.2, 0.3]), np.zeros((3, 0)))
    assert own.widened(slice(1, 3), 2.0).sigma == pytest.approx([0.1, 0.4, 0.6])
    assert own.sigma == pytest.approx([0.1, 0.2, 0.3])
    assert own.loosest.sigma == pytest.approx(own.sigma)
    assert own.covariance.row_sigma == pytest.approx(own.sigma)


def test_what_is_promised_bounds_every_row_by_its_share() -> None:
    """e (1 + r) for its own row: no scale is simulated, so that no column is shared."""

    class Promising(RowsResponse):
        def evaluate_many(
            self, ps: Sequence[FloatArray], *, whole: bool = False
        ) -> list[Evaluation]:
            return [replace(each, promised=(1e-3,)) for each in super().evaluate_many(ps)]

    rows = np.array([0.25, -0.5, 0.0])
    objective = replace(
        rows_objective(lambda p: rows, [-1.0], [1.0]), response=Promising(lambda p: rows)
    )
    [point] = evaluate_many(objective, [np.zeros(1)])
    bounded = noise_of(objective, point).bounded
    assert np.abs(bounded.own) == pytest.approx(1e-3 * (1.0 + rows))
    assert bounded.common.shape == (3, 0)


def test_what_is_promised_of_a_scale_bounds_the_rows_of_its_series_alone() -> None:
    """Two series, each scaled by its own maximum, the one by 2 and the other by 4.

    An error e of a maximum moves a row of its series by e (1 + r), and none of the other.
    """
    names = ("one", "other")
    peaks = [peaks_measurement(np.ones(2), np.full(2, 0.1), series=name) for name in names]
    sweeps = [sweep_measurement(np.array([1.0, 4.0, 1.0]), series=name) for name in names]
    tops = [Maximum(value=v, frequency_hz=2.0, bias=0.0, bracketed=True) for v in (2.0, 1.0)]
    answered = Evaluation(
        (
            Prediction(np.array([0.25, 0.75])),
            Prediction(np.array([0.5, 0.125])),
            *(Prediction(np.empty(0), top) for top in tops),
        ),
        promised=(1e-3,) * 4,
    )

    class Both(RowsResponse):
        def evaluate_many(
            self, ps: Sequence[FloatArray], *, whole: bool = False
        ) -> list[Evaluation]:
            return [answered for _ in ps]

    objective = Objective(
        response=Both(lambda p: np.zeros(4)),
        parameters=(parameter("p", -1.0, 1.0),),
        data=Dataset((*peaks, *sweeps)),
        steps=np.full(1, 1e-4),
    )
    [point] = evaluate_many(objective, [np.zeros(1)])
    scaled = np.array([0.5, 1.5, 2.0, 0.5])
    assert point.residuals == pytest.approx(scaled - 1.0)
    wanted = 1e-3 * np.array([[0.5, 0.0], [1.5, 0.0], [0.0, 2.0], [0.0, 0.5]])
    assert np.abs(noise_of(objective, point).bounded.common) == pytest.approx(wanted)


# --- weights and ends


def test_weights_of_priors_are_those_of_the_noise() -> None:
    """2 sigma^2 for squares, sigma^-2 on average; sqrt(2/pi) sigma for absolute values."""
    sigma = np.array([0.1, 0.2])
    own = parameter("a", -1.0, 1.0), parameter("b", -1.0, 1.0, prior=0.5, scale=2.0)
    objective = replace(whitened(lambda p: p[:2], *own), data=dataset(np.ones(2), sigma))
    squares = weights(objective, 0.3, "squares")
    assert squares == pytest.approx([0.3, 16.0 * 2.0 / np.mean(sigma**-2)])
    for misfit in ("slack", "absolute"):
        assert weights(objective, 0.3, misfit) == pytest.approx(
            [0.3, 16.0 * np.sqrt(2.0 / np.pi) * 0.15]
        )
    unknown = replace(objective, data=dataset(np.ones(2)))
    assert weights(unknown, 0.3, "squares")[1] == pytest.approx(16.0 * 2.0 * 0.01**2)


def test_the_end_of_a_fit_is_evaluated_and_linearised() -> None:
    """Rows x - 1 and 2 x at x = 0.5: slopes 1 and 2, prior of the box and Tikhonov's nu."""
    evaluator = rows_evaluator(lambda p: np.array([p[0] - 1.0, 2.0 * p[0]]), [-3.0], [3.0])
    end = solution_of(evaluator, np.array([0.5]), 0.2)
    assert end.nu == 0.2
    assert end.initial.x == pytest.approx([0.0])
    assert end.final.residuals == pytest.approx([-0.5, 1.0])
    assert end.matrix == pytest.approx(np.array([[1.0], [2.0]]))
    assert end.structure is None
    assert end.j_reg == pytest.approx(0.5 * 0.2 * 0.25)
    scatter = np.sqrt(1.25 / 1.0)  # of two rows of unknown noise and one parameter
    precision = 5.0 / scatter**2 + 12.0 / 36.0 + 0.2
    assert end.errors.covariance == pytest.approx(np.array([[1.0 / precision]]))
    freedom = 2.0 - 8.0 / (8.0 + 12.0 / 36.0 + 0.2)  # what the parameter leaves of two rows
    assert end.noise.freedom == pytest.approx(freedom)
    assert end.errors.inflation == pytest.approx(np.sqrt(freedom))


@pytest.mark.parametrize(
    ("x", "decrease"),
    [
        (0.5, 0.45),  # of 1.25, the least at x = 0.2 is 0.8
        (0.2, 0.0),
    ],
)
def test_what_a_linearised_step_promises_is_the_decrease_of_straight_rows(
    x: float, decrease: float
) -> None:
    evaluator = rows_evaluator(lambda p: np.array([p[0] - 1.0, 2.0 * p[0]]), [-3.0], [3.0])
    end = solution_of(evaluator, np.array([x]), 1e-9)
    sigma = end.errors.inflation * end.noise.sigma[0]
    assert end.predicted_decrease == pytest.approx(decrease / sigma**2, abs=1e-9)


def test_a_bound_that_holds_promises_nothing() -> None:
    evaluator = rows_evaluator(lambda p: np.array([p[0] - 1.0, 0.1]), [-3.0], [0.5])
    assert solution_of(evaluator, np.array([0.5]), 1e-9).predicted_decrease == 0.0


def test_a_sweep_beside_peaks_has_rows_of_its_own() -> None:
    """Curves stand last; their noise is known or not by itself."""
    both = Dataset(
        (
            peaks_measurement(np.ones(2), np.full(2, 0.1)),
            sweep_measurement(np.ones(3), fitted=True, maximum_v=1.0),
        )
    )
    assert both.sigma == pytest.approx([0.1, 0.1, 0.0, 0.0, 0.0])
    assert both.curve_rows == slice(2, None)
