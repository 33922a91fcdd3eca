"""Ways to take the scale chi from a sweep: bias and claimed scatter over many measured series.

Truth: the gain of the virtual laboratory (`fitting.lab.string`); the model's sweep is that of
`tests.closed_form`, at the true parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign import bind, read_campaign
from fitting.campaign.measured import SweepData
from fitting.campaign.noise import Noise, scale_parameter, sweep_scale_sigma, sweep_sigmas
from fitting.fit.interior_point import solve
from fitting.fit.objective import Evaluator, Objective, weights
from fitting.fit.options import options_of
from fitting.fit.problem import problem_of
from fitting.fmu.description import read_description
from fitting.fmu.pool import FmuWorkers
from fitting.lab.bench import Measured, measure
from fitting.lab.benches import string_bench
from fitting.lab.writer import campaign_files
from fitting.measurements.dataset import Dataset
from fitting.measurements.measurement import Evaluation
from fitting.measurements.sweep import Sweep
from fitting.signal.scale import Maximum, chi_robust, laboratory_maximum
from fitting.text.arrays import FloatArray
from tests.support import closed_form
from tests.support.datasets import answer, dataset, sweep_measurement
from tests.support.reconstruction import ReconstructionOptions, reconstruct_through

SEEDS = range(24)
#: A short series: the sweep is what matters here.
BENCH = replace(string_bench("q1"), pairs_hz=string_bench("q1").pairs_hz[:1], curvature_hz=0.0)


@lru_cache(maxsize=2)
def series(step_hz: float = 5.0) -> tuple[Measured, ...]:
    return tuple(measure(replace(BENCH, sweep_step_hz=step_hz), seed) for seed in SEEDS)


def model_of(one: Measured) -> Evaluation:
    """The model's sweep and peaks at the truth, in its own unit."""
    first, state = one.bench.at(0.0).modes, one.true_modes[0]
    d = closed_form.damping(one.bench.modes.theta_rad, 120.0, 90.0, False)
    eta = (first.eta_plus_hz, first.eta_minus_hz)
    swept = closed_form.amplitude(one.sweep.frequency_hz, eta, d, 0)
    fine = closed_form.amplitude(eta[0] + np.linspace(-0.5, 0.5, 2001), eta, d, 0)
    peaks = closed_form.amplitude(
        one.bench.pairs_hz[0], (state.eta_plus_hz, state.eta_minus_hz), d, 0
    )
    return answer(
        peaks,
        swept,
        Maximum(value=float(np.max(fine)), frequency_hz=eta[0], bias=0.0, bracketed=True),
    )


def shape_of(one: Measured) -> FloatArray:
    """The model's sweep alone."""
    return np.asarray(model_of(one).predictions[1].values, dtype=float)


def measured(one: Measured, scale: str, noise: float = 0.01, *, swept: bool = False) -> Dataset:
    """Peaks with relative noise and the sweep of a series, scaled as asked."""
    generator = np.random.default_rng([one.seed, 7])
    peaks = one.true_peaks_v[0] * (1.0 + noise * generator.standard_normal(2))
    sweep = one.sweep
    made = sweep_measurement(
        sweep.amplitude_v,
        scale=scale,
        fitted=swept,
        maximum_v=float(np.max(sweep.amplitude_v)),
        sigmas_v=sweep_sigmas(SweepData(sweep.frequency_hz, sweep.amplitude_v), Noise()),
    )
    return dataset(peaks, noise * peaks, made, weigh=True)


def errors(scale: str, step_hz: float = 5.0) -> tuple[np.ndarray, np.ndarray]:
    """Relative error of chi and its claimed standard deviation, for every series."""
    wrong, claimed = [], []
    for one in series(step_hz):
        data = measured(one, scale)
        [scale_found] = data.scales(model_of(one).predictions, [])
        wrong.append(scale_found.value / one.gain - 1.0)
        claimed.append(data.scale_sigmas[0])
    return np.array(wrong), np.array(claimed)


@pytest.mark.parametrize("scale", ["fit", "robust"])
def test_scales_of_a_whole_sweep_are_unbiased_and_honest(scale: str) -> None:
    wrong, claimed = errors(scale)
    spread = float(np.std(wrong, ddof=1))
    assert abs(np.mean(wrong)) < 3.0 * spread / np.sqrt(len(wrong))
    assert 0.75 < spread / np.sqrt(np.mean(claimed**2)) < 1.3
    assert spread < 0.003


def test_the_ratio_of_maxima_is_biased_and_says_by_how_much() -> None:
    """The largest of many noisy points is too large; its scatter is about that of one point."""
    wrong, claimed = errors("maximum", step_hz=1.0)
    spread = float(np.std(wrong, ddof=1))
    assert np.mean(wrong) > 5.0 * spread / np.sqrt(len(wrong))
    assert 0.4 < spread / np.sqrt(np.mean(claimed**2)) < 1.5
    told = [laboratory_maximum(s.sweep.frequency_hz, s.sweep.amplitude_v) for s in series(1.0)]
    bias = np.array([top.bias for top in told])
    assert np.mean(bias) == pytest.approx(
        np.mean(wrong), abs=3.0 * np.std(bias) / np.sqrt(len(bias))
    )
    assert np.sqrt(np.mean(wrong**2)) > 5.0 * np.sqrt(np.mean(errors("fit", 1.0)[0] ** 2))


class Still:
    """A response that does not change: all that moves is the scale."""

    def __init__(self, evaluation: Evaluation) -> None:
        self.evaluation = evaluation

    def evaluate_many(self, ps: Sequence[FloatArray], *, whole: bool = False) -> list[Evaluation]:
        return [self.evaluation for _ in ps]

    def derived_many(self, ps: Sequence[FloatArray]) -> list[dict[str, FloatArray]]:
        return []


@pytest.mark.parametrize("swept", [False, True])
def test_a_fitted_scale_weighs_sweep_and_peaks_by_their_noise(swept: bool) -> None:
    """Two peaks of 0.3 % and the sweep: the weighted mean of the two, and its error."""
    wrong, claimed = [], []
    for one in series():
        data = measured(one, "free", 0.003, swept=swept)
        [sweep] = [m for m in data.measurements if isinstance(m, Sweep)]
        sigma = sweep_scale_sigma(sweep.amplitude_v, sweep.sigmas_v, "fit")
        parameter = scale_parameter(sigma, swept=swept)
        assert (parameter.prior_sigma is None) == swept
        objective = Objective(
            response=Still(model_of(one)),
            parameters=(parameter,),
            data=data,
            steps=np.array([1e-3]),
        )
        evaluator = Evaluator(objective)
        held = weights(objective, 1e-12, "squares")
        x = solve(evaluator, np.zeros(1), held, "squares").x
        wrong.append(evaluator.point(x).chi / one.gain - 1.0)
        claimed.append(1.0 / np.sqrt(2 / 0.003**2 + sigma**-2))
        assert data.scale_sigmas == (0.0,)
    spread = float(np.std(wrong, ddof=1))
    assert abs(np.mean(wrong)) < 3.0 * spread / np.sqrt(len(wrong))
    assert 0.75 < spread / np.sqrt(np.mean(np.square(claimed))) < 1.3


def test_bad_points_do_not_carry_a_robust_scale_away() -> None:
    one = series()[0]
    sweep = one.sweep.amplitude_v.copy()
    sweep[::9] *= 3.0
    shape = shape_of(one)
    assert chi_robust(sweep, shape) == pytest.approx(one.gain, rel=0.01)
    least = float(sweep @ shape / (shape @ shape))
    assert least > 1.15 * one.gain


def test_a_robust_scale_of_clean_data_is_exact() -> None:
    shape = shape_of(series()[0])
    assert chi_robust(3.7e5 * shape, shape) == pytest.approx(3.7e5, rel=1e-12)


@pytest.mark.parametrize("scale", ["free"])
def test_scales_through_the_fmu(swift_fmu: Path, tmp_path: Path, scale: str) -> None:
    """A whole campaign: width and scale within three standard deviations of the truth."""
    bench = replace(string_bench("q1"), curvature_hz=0.0, sweep_step_hz=25.0)
    one = measure(bench, 11)
    for name, text in campaign_files(one, "test").items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text.replace('scale = "maximum"', f'scale = "{scale}"'))
    variables = read_description(swift_fmu).variables
    bound = bind(read_campaign(tmp_path / "campaign.toml"), variables)
    bound = replace(bound, alternatives=bound.alternatives[:1])
    problem = problem_of([bound])
    options = options_of(bound.continuation)
    options = replace(
        options,
        schedule=replace(options.schedule, starts=1, iterations=2, nu_start=1e-2),
        misfit="squares",
    )
    with FmuWorkers(swift_fmu, workers=2) as workers:
        asked = ReconstructionOptions(options, profiles=False)
        result = reconstruct_through(workers, problem, asked)
    width = result.derived["width_plus"]
    assert abs(width.value - bench.modes.widths_hz()[0]) < 3.0 * width.std
    assert width.std < 1.5
    assert result.scale.final == pytest.approx(one.gain, rel=0.012)
    assert ("ln_scale" in result.parameters) == (scale == "free")
    assert [m.scaled_by for m in problem.measurements if isinstance(m, Sweep)] == [scale]
