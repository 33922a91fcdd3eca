"""Residual rows, their Jacobian and the Tikhonov term against closed forms and mpmath."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from fitting.campaign.parameters import search_bounds, to_model, to_search
from fitting.fit.objective import (
    Evaluator,
    Objective,
    evaluate_many,
    jacobian,
    make_objective,
    noise_level,
    total,
)
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import Evaluation
from fitting.measurements.sweep import Sweep
from fitting.text.arrays import FloatArray
from fitting.text.errors import NoScale
from tests.support import closed_form
from tests.support.datasets import SETUP, dataset, sweep_measurement
from tests.support.rows import rows_objective

TRUTH = np.array([1.9498, 120.0, 90.0])


@pytest.fixture(scope="module")
def objective() -> Objective:
    response = closed_form.string_response()
    return make_objective(
        response, closed_form.string_parameters(), closed_form.measured_by(response)
    )


def mp_row(x: list[mp.mpf]) -> mp.mpf:
    """Row of tone 6.94016 MHz of the first pair at 40 digits, straight from the equations."""
    reference, scale = (closed_form.THETA_REFERENCE, 94.0, 94.0), (1.0, 50.0, 50.0)

    def amplitude(u: mp.mpf, p: list[mp.mpf]) -> mp.mpf:
        theta, d1, d2 = p
        t = mp.matrix([[mp.cos(theta), -mp.sin(theta)], [mp.sin(theta), mp.cos(theta)]])
        d = t * mp.diag([d1, d2]) * t.T
        square = (2 * mp.pi) ** 2
        a = [square * (mp.mpf(e) ** 2 - u**2) for e in (6.94026e6, 7.02760e6)]
        a11, a22 = (a[i] + 1j * square * u * d[i, i] for i in range(2))
        a12 = 1j * square * u * d[0, 1]
        return abs((a22 - a12) / (a11 * a22 - a12**2))

    def normalised(p: list[mp.mpf]) -> mp.mpf:
        centre = mp.mpf(6.94026e6)
        top = mp.findroot(lambda u: mp.diff(lambda v: amplitude(v, p), u), centre, tol=1e-60)
        return amplitude(mp.mpf(6940160.0), p) / amplitude(top, p)

    p = [mp.mpf(r) + mp.mpf(s) * xi for r, s, xi in zip(reference, scale, x, strict=True)]
    return normalised(p) / normalised([mp.mpf(v) for v in TRUTH]) - 1


def test_rows_and_jacobian_equal_the_equations_at_40_digits(objective: Objective) -> None:
    x = np.array([0.3, 0.4, -0.2])
    with mp.workdps(40):
        at = [mp.mpf(v) for v in x]
        value = float(mp_row(at))
        slopes = [
            float(mp.diff(lambda t, i=i: mp_row([*at[:i], t, *at[i + 1 :]]), at[i]))
            for i in range(3)
        ]
    point = evaluate_many(objective, [x])[0]
    assert point.residuals[0] == pytest.approx(value, abs=1e-9)
    assert jacobian(objective, x)[0] == pytest.approx(slopes, rel=1e-6, abs=1e-8)


def louder(data: Dataset, factor: float) -> Dataset:
    """The same measurements by a laboratory of another gain."""
    [tones], [sweep] = data.tones, [m for m in data.measurements if isinstance(m, Sweep)]
    amplitude_v, maximum_v = factor * sweep.amplitude_v, factor * sweep.maximum_v
    return dataset(
        factor * tones.peaks_v,
        factor * tones.sigmas_v,
        replace(sweep, amplitude_v=amplitude_v, maximum_v=maximum_v),
    )


def test_the_truth_leaves_nothing_and_scale_and_units_do_not_matter(objective: Objective) -> None:
    x = to_search(objective.parameters, TRUTH)
    assert evaluate_many(objective, [x])[0].j_fit < 1e-8
    elsewhere = np.array([0.3, 0.4, -0.2])
    response = closed_form.string_response()
    data = louder(closed_form.measured_by(response), 3.7e6)
    other = Objective(
        response=response, parameters=objective.parameters, data=data, steps=objective.steps
    )
    one, two = (evaluate_many(o, [elsewhere])[0] for o in (objective, other))
    assert two.residuals == pytest.approx(one.residuals, rel=1e-12)
    assert two.chi / one.chi == pytest.approx(3.7e6, rel=1e-12)


def test_the_scale_follows_the_parameters(objective: Objective) -> None:
    narrow, wide = evaluate_many(objective, [np.array([0.0, -0.5, -0.5]), np.array([0, 0.5, 0.5])])
    # the peak of a mode falls as its width grows: chi grows with it (69 to 119 Hz)
    assert wide.chi / narrow.chi == pytest.approx(119.0 / 69.0, rel=1e-3)


def test_one_batch_per_jacobian_and_nothing_twice(objective: Objective) -> None:
    response = objective.response
    assert isinstance(response, closed_form.ClosedFormResponse)
    evaluator = Evaluator(objective)
    response.calls.clear()
    x = np.array([0.1, 0.0, 0.0])
    evaluator.point(x)
    evaluator.jacobian(x)
    evaluator.jacobian(x.copy())
    evaluator.point(x.copy())
    assert response.calls == [1, 6]
    assert (evaluator.counts.evaluations, evaluator.counts.jacobians) == (7, 1)


def test_evaluating_changes_nothing(objective: Objective) -> None:
    x = np.array([0.1, 0.2, 0.3])
    first = evaluate_many(objective, [x])[0]
    kept = first.residuals.copy()
    x[:] = 9.0
    again = evaluate_many(objective, [np.array([0.1, 0.2, 0.3])])[0]
    assert np.array_equal(first.residuals, kept)
    assert np.array_equal(again.residuals, kept)
    assert first.x[0] == 0.1


class Unchanged:
    """What a response has beside its predictions."""

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return [{} for _ in ps]


def test_the_jacobian_stays_inside_the_box(objective: Objective) -> None:
    lower, _ = search_bounds(objective.parameters)
    seen: list[np.ndarray] = []
    response = objective.response

    class Watched(Unchanged):
        def evaluate_many(
            self, ps: Sequence[FloatArray], *, whole: bool = False
        ) -> list[Evaluation]:
            seen.extend(ps)
            return response.evaluate_many(ps, whole=whole)

    watched = Objective(
        response=Watched(),
        parameters=objective.parameters,
        data=objective.data,
        steps=objective.steps,
    )
    matrix = jacobian(watched, lower)
    box = to_model(objective.parameters, lower)
    assert all(np.all(p >= box - 1e-12) for p in seen)
    assert np.all(np.isfinite(matrix))


@pytest.mark.parametrize("noise", [1e-12, 1e-9, 1e-6])
def test_the_noise_of_a_response_is_measured(objective: Objective, noise: float) -> None:
    generator = np.random.default_rng(1)
    response = objective.response

    class Noisy(Unchanged):
        def evaluate_many(
            self, ps: Sequence[FloatArray], *, whole: bool = False
        ) -> list[Evaluation]:
            answers = response.evaluate_many(ps, whole=whole)
            for peaks in (answer.predictions[0].values for answer in answers):
                peaks[:] *= 1.0 + noise * generator.standard_normal(peaks.size)
            return answers

    noisy = Objective(
        response=Noisy(),
        parameters=objective.parameters,
        data=objective.data,
        steps=objective.steps,
    )
    found = noise_level(noisy, np.zeros(3), np.full(3, 0.3))
    assert noise / 3.0 < found < 3.0 * noise


def test_sweep_rows_are_relative_to_the_maximum() -> None:
    response = closed_form.string_response(with_sweep=True)
    data = closed_form.measured_by(response, scale="fit", fit_sweep=True)
    [sweep_v] = [m.amplitude_v for m in data.measurements if isinstance(m, Sweep)]
    objective = make_objective(response, closed_form.string_parameters(), data)
    point = evaluate_many(objective, [np.array([0.1, 0.1, 0.1])])[0]
    swept = point.chi * response.sweep(point.parameters)
    expected = (swept - sweep_v) / np.max(sweep_v)
    assert point.residuals[10:] == pytest.approx(expected, rel=1e-4, abs=1e-12)
    assert point.residuals.size == 51


@pytest.mark.parametrize(("times", "refused"), [(1e100, False), (1e149, False), (1e151, True)])
def test_a_model_whose_squared_distance_is_no_number_is_refused(
    times: float, refused: bool
) -> None:
    """Squares of 1e154 and more are infinite."""
    objective = rows_objective(lambda p: times * np.array([0.5, -1.0]), [-1.0], [1.0])
    if refused:
        with pytest.raises(NoScale, match=r"1e\+151"):
            evaluate_many(objective, [np.zeros(1)])
    else:
        [point] = evaluate_many(objective, [np.zeros(1)])
        assert point.squares == pytest.approx(1.25 * times**2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"peaks_v": np.array([1.0, -1.0])}, "not positive"),
        ({"peaks_v": np.array([1.0])}, "2 sigmas"),
        ({"scale": "guess"}, "guess"),
        ({"sweep_v": np.empty(0)}, "needs a sweep"),
        ({"peaks_v": np.empty(0), "sigmas_v": np.empty(0)}, "nothing to minimise"),
    ],
)
def test_data_that_cannot_be_are_refused(change: dict[str, Any], words: str) -> None:
    good: dict[str, Any] = {
        "peaks_v": np.ones(2),
        "sigmas_v": np.ones(2),
        "sweep_v": np.ones(3),
        "scale": "maximum",
    }
    with pytest.raises(ValueError, match=words):
        data_of(**(good | change))


def data_of(peaks_v: FloatArray, sigmas_v: FloatArray, sweep_v: FloatArray, scale: str) -> Dataset:
    return dataset(peaks_v, sigmas_v, sweep_measurement(sweep_v, scale=scale))


def test_a_sweep_without_a_frequency_for_every_point_is_refused() -> None:
    with pytest.raises(ValueError, match=r"2 .*\b3\b"):
        Sweep(setup=SETUP, frequency_hz=np.ones(2), amplitude_v=np.ones(3))


def test_totals(objective: Objective) -> None:
    point = evaluate_many(objective, [np.array([0.1, 0.2, 0.3])])[0]
    rows = point.residuals
    assert total(point, 0.0, "slack") == pytest.approx(sum(abs(r) for r in rows), rel=1e-15)
    assert total(point, 0.2, "squares") == pytest.approx(
        sum(r * r for r in rows) + 0.1 * 0.14, rel=1e-14
    )
