"""What a simulation may be off by is in the intervals: they hold the truth whatever it does there.

Virtual laboratories measure a line in closed form; the model that is fitted answers with amplitudes
that are off by a share within its promise, in the same way at every repetition.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from fitting.fit.fit import solve_problem
from fitting.fit.noise import noise_of
from fitting.fit.objective import Objective, evaluate_many, make_objective
from fitting.fit.options import Options, Schedule
from fitting.fit.problem import Problem
from fitting.inference.determine import InferenceOptions, determine
from fitting.inference.infer import Inference, infer
from fitting.inference.likelihood.knowledge import Determined
from fitting.measurements.measurement import Evaluation
from fitting.signal.scale import Maximum
from fitting.text.arrays import FloatArray
from fitting.text.estimate import Verdict
from fitting.text.finding import Kind, of_kind
from tests.support.datasets import answer, dataset, sweep_measurement
from tests.support.single_line import ETA_HZ, TOP, WIDTH_HZ, LineResponse, line_parameters
from tests.support.whitened import SIGMA, Z95, WhitenedResponse, parameter, whitened

TRUTH = {"eta": ETA_HZ, "w": WIDTH_HZ, "A": TOP, "Q": ETA_HZ / WIDTH_HZ}
NOISE = 2e-3
PROMISED = 1.1e-2
#: Of each shape, and of each at night.
LABORATORIES, MANY = 2, 6
TONES_HZ = ETA_HZ + WIDTH_HZ * np.linspace(-1.5, 1.5, 13)
FROM_TOP = (TONES_HZ - ETA_HZ) / WIDTH_HZ

#: Errors within the promise, as shares of it: alike, along the line, beside its top, to and fro.
SHAPES: dict[str, FloatArray] = {
    "alike": np.ones(FROM_TOP.size),
    "along the line": np.tanh(2.0 * FROM_TOP),
    "one for its wings, one for its top": np.where(np.abs(FROM_TOP) < 0.7, 1.0, -1.0),
    "to and fro": np.where(np.arange(FROM_TOP.size) % 2 == 0, 1.0, -1.0),
}


@dataclass(frozen=True)
class Coarse(LineResponse):
    """The line with a relative error (k,) of every amplitude, and what it promises of them."""

    error: FloatArray
    promised: float

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        found = [answer(self.peaks(p) * (1.0 + self.error), runs=1) for p in ps]
        return [replace(each, promised=(self.promised,)) for each in found]


def laboratory(seed: int, shape: FloatArray, promised: float) -> Objective:
    """Exact amplitudes with noise, and a model that is off by `PROMISED` in that shape."""
    exact = LineResponse(TONES_HZ).peaks(np.array([ETA_HZ, WIDTH_HZ, TOP]))
    noise = NOISE * exact * np.random.default_rng(seed).standard_normal(exact.size)
    response = Coarse(TONES_HZ, PROMISED * shape, promised)
    return make_objective(response, line_parameters(), dataset(exact + noise, NOISE * exact))


def known(objective: Objective) -> Determined:
    begin = np.array([0.0, -0.2, 1.0])
    [point] = evaluate_many(objective, [begin])
    options = InferenceOptions(directions=False)
    return determine(objective, begin, noise_of(objective, point), options)


def held(determined: Determined) -> dict[str, bool]:
    return {
        name: profile.ci95[0] <= TRUTH[name] <= profile.ci95[1]
        for name, profile in determined.profiled.items()
    }


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("count", [LABORATORIES, pytest.param(MANY, marks=pytest.mark.nightly)])
def test_intervals_hold_the_truth_whatever_the_simulation_does_within_its_promise(
    shape: str, count: int
) -> None:
    found = [known(laboratory(seed, SHAPES[shape], PROMISED)) for seed in range(count)]
    assert all(determined.knowledge.adequacy.describes for determined in found)
    for determined in found:
        assert held(determined) == dict.fromkeys(TRUTH, True)
        assert determined.parameters["eta"].status is Verdict.DETERMINED


def test_without_the_promise_they_do_not() -> None:
    """The same data and the same model: it is the promise that makes the intervals honest."""
    blind = [
        known(laboratory(seed, SHAPES["one for its wings, one for its top"], 0.0))
        for seed in range(LABORATORIES)
    ]
    assert not any(determined.knowledge.adequacy.describes for determined in blind)
    blind = [known(laboratory(seed, SHAPES["along the line"], 0.0)) for seed in range(LABORATORIES)]
    assert not any(k.knowledge.adequacy.describes and held(k)["eta"] for k in blind)


Rows = Callable[[FloatArray], FloatArray]


def straight(promised: float) -> tuple[FloatArray, FloatArray, Objective]:
    """Rows A p - y in sigma, of a model that answers 1 + SIGMA rows within `promised`."""
    generator = np.random.default_rng(5)
    matrix = np.stack([np.ones(12), np.linspace(-1.0, 1.0, 12)], axis=1) * [3.0, 5.0]
    measured = matrix @ [9.0, 11.0] + generator.standard_normal(12)

    @dataclass(frozen=True)
    class Promising(WhitenedResponse):
        def evaluate_many(
            self, ps: Sequence[FloatArray], *, whole: bool = False
        ) -> list[Evaluation]:
            found = super().evaluate_many(ps, whole=whole)
            return [replace(each, promised=(promised,)) for each in found]

    rows: Rows = lambda x: matrix @ x - measured  # noqa: E731
    plain = whitened(rows, *(parameter(name, 1.0, 40.0, start=9.0) for name in "pq"))
    return matrix, measured, replace(plain, response=Promising(rows))


def inferred(objective: Objective, *, profiles: bool) -> Inference:
    problem = Problem(objective.parameters, objective.data)
    options = Options(schedule=Schedule(starts=1, nu_start=1e-9, iterations=1))
    fit = solve_problem(problem, lambda _: objective.response, options)
    return infer(fit, profiles=profiles)


@pytest.mark.parametrize("profiles", [True, False])
def test_a_bounded_error_adds_its_worst_to_what_noise_makes(profiles: bool) -> None:
    """Of a linear problem in closed form: sum_i |G_i| e (1 + r_i), G the pseudo-inverse."""
    promised = 3e-3
    matrix, measured, objective = straight(promised)
    solution, *_ = np.linalg.lstsq(matrix, measured)
    amplitudes = 1.0 + SIGMA * (matrix @ solution - measured)
    worst = np.abs(np.linalg.pinv(matrix)) @ (promised * amplitudes / SIGMA)
    errors = np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))
    found = inferred(objective, profiles=profiles)
    for k, result in enumerate(found.parameters.values()):
        assert result.simulation == pytest.approx(worst[k], rel=0.02)
        assert result.std == pytest.approx(errors[k] + worst[k], rel=0.03)
        half = Z95 * errors[k] + worst[k]
        ends = result.most_likely - half, result.most_likely + half
        assert result.ci95 == pytest.approx(ends, abs=0.03 * half)
    [said] = of_kind(found.findings, Kind.simulation_error)
    assert said.numbers["error"] == pytest.approx(promised)
    for name in said.names["values"]:
        value = found.parameters[name]
        assert said.numbers[name] == value.simulation
        assert said.numbers[f"{name}_noise"] == pytest.approx(value.std - value.simulation)


@pytest.mark.parametrize("height", [0.0, 1.0, 3.0])
def test_in_another_valley_the_worst_is_added_to_the_side_of_that_valley(height: float) -> None:
    """Chi^2 is (k - 10)^2/s^2 and h + (k - 90)^2/s^2: s (1.96 + reach) where both are as low.

    What the simulation may be off by moves k by s reach where chi^2 is straight; where h is left
    of 3.84, in the ratio of both thresholds.
    """
    s, promised = 0.02, 4e-3

    @dataclass(frozen=True)
    class Promising(WhitenedResponse):
        def evaluate_many(
            self, ps: Sequence[FloatArray], *, whole: bool = False
        ) -> list[Evaluation]:
            found = super().evaluate_many(ps, whole=whole)
            return [replace(each, promised=(promised,)) for each in found]

    def rows(x: FloatArray) -> FloatArray:
        k = float(x[0])
        there = k > 50.0
        row = (k - (90.0 if there else 10.0)) / s / math.sqrt(3.0)
        return np.array([row, row, row, math.sqrt(height) if there else 0.0, 0.0])

    plain = whitened(rows, parameter("k", 1.0, 100.0, start=10.0))
    objective = replace(plain, response=Promising(rows))
    begin = np.zeros(1)
    [point] = evaluate_many(objective, [begin])
    options = InferenceOptions(minima=[np.array([80.0])], twins=())
    k = determine(objective, begin, noise_of(objective, point), options).parameters["k"]
    # sum_i |G_i| e/sigma of three rows of slope 1/(s sqrt 3): G_i = s/sqrt 3
    worst = math.sqrt(3.0) * s * promised / SIGMA
    assert k.simulation == pytest.approx(worst, rel=0.01)
    assert k.ci95[0] == pytest.approx(10.0 - s * Z95 - worst, abs=0.02 * s)
    there = s * math.sqrt(Z95**2 - height)
    assert k.ci95[1] >= 90.0 + there + worst * there / (s * Z95) - 0.02 * s
    assert k.ci95[1] <= 90.0 + there + worst * s * Z95 / there + 0.02 * s


def test_a_promise_far_below_the_noise_changes_nothing_and_is_not_told() -> None:
    fine = inferred(straight(1e-6)[2], profiles=True)
    exact = inferred(straight(0.0)[2], profiles=True)
    for name, result in fine.parameters.items():
        assert result.ci95 == pytest.approx(exact.parameters[name].ci95, rel=1e-5)
        assert result.std == pytest.approx(exact.parameters[name].std, rel=1e-3)
    assert not of_kind(fine.findings, Kind.simulation_error)


def test_a_value_that_the_simulation_hides_is_not_called_determined() -> None:
    """Noise would give it to a part in a thousand, the simulation to no better than itself."""
    _, _, objective = straight(promised=0.4)
    for result in inferred(objective, profiles=True).parameters.values():
        assert result.status is not Verdict.DETERMINED


@pytest.mark.parametrize("scale", ["none", "maximum", "fit"])
def test_no_error_within_the_promise_moves_a_row_by_more_than_its_columns(scale: str) -> None:
    """Peaks, sweep and the maximum that sets the scale are each off as they like."""
    generator = np.random.default_rng(3)
    curve = LineResponse(TONES_HZ).peaks(np.array([ETA_HZ, WIDTH_HZ, TOP]))
    data = dataset(
        1.1 * curve,
        NOISE * curve,
        sweep_measurement(
            1.2 * curve, scale=scale, fitted=True, maximum_v=2.4, sigmas_v=NOISE * curve
        ),
    )

    @dataclass(frozen=True)
    class Off(LineResponse):
        errors: tuple[FloatArray, FloatArray, float] = (np.zeros(1), np.zeros(1), 0.0)

        def evaluate_many(
            self, ps: Sequence[FloatArray], *, whole: bool = False
        ) -> list[Evaluation]:
            peaks, swept, top = self.errors
            maximum = Maximum(
                value=TOP * (1.0 + top), frequency_hz=ETA_HZ, bias=0.0, bracketed=True
            )
            found = [
                answer(self.peaks(p) * (1.0 + peaks), self.peaks(p) * (1.0 + swept), maximum)
                for p in ps
            ]
            return [replace(each, promised=(1e-4, 1e-4)) for each in found]

    objective = make_objective(Off(TONES_HZ), line_parameters(), data)
    x = np.array([0.0, -0.2, 1.0])
    [exact] = evaluate_many(objective, [x])
    bounds = noise_of(objective, exact).bounded.largest
    seen = np.zeros(bounds.size)
    for _ in range(300):
        n = TONES_HZ.size
        errors = (*(1e-4 * generator.choice([-1.0, 1.0], (2, n))), 1e-4 * generator.choice([-1, 1]))
        [off] = evaluate_many(replace(objective, response=Off(TONES_HZ, errors)), [x])
        moved = np.abs(off.residuals - exact.residuals)
        assert np.all(moved <= 1.001 * bounds)
        seen = np.maximum(seen, moved)
    assert np.all(seen > 0.4 * bounds)  # none is larger than it need be by much
