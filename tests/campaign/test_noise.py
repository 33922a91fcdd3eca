"""Noise of peaks and rows: floor, declared, repeats, outliers; truth simulated or by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.campaign import BoundCampaign, bind, read_campaign
from fitting.campaign.file import WrittenNoise
from fitting.campaign.measured import SweepData
from fitting.campaign.noise import Noise, repeat_scatter, sweep_scale_sigma, sweep_sigmas
from fitting.fit.interior_point import solve
from fitting.fit.linearisation import Linearisation
from fitting.fit.noise import noise_of
from fitting.fit.objective import Evaluator, Objective, evaluate_many, make_objective
from fitting.fit.problem import problem_of
from fitting.fmu.description import read_description
from fitting.inference.checks.mistakes import outlying_peaks
from fitting.measurements.dataset import Dataset
from fitting.measurements.sweep import Sweep
from fitting.measurements.tones import peak_sigmas
from fitting.text.errors import BadInput
from fitting.text.schema import read_record
from tests.support.closed_form import (
    measured_by,
    measured_peaks,
    string_campaign,
    string_parameters,
    string_response,
)
from tests.support.datasets import dataset, peaks_measurement

OFFSETS = 'model = "offsets"\nprior = "30 Hz"\n'
STRING_Q1 = Path(__file__).parents[2] / "data/string_q1"


def swept(data: Dataset) -> Sweep:
    """The only sweep of some measurements."""
    [sweep] = [m for m in data.measurements if isinstance(m, Sweep)]
    return sweep


def string_q1(fmu: Path, folder: Path, noise: str) -> BoundCampaign:
    """The shipped campaign with a table [noise]."""
    for path in STRING_Q1.rglob("*.*"):
        target = folder / path.relative_to(STRING_Q1)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(path.read_text())
    text = (folder / "campaign.toml").read_text().replace(OFFSETS, "", 1)
    (folder / "campaign.toml").write_text(text.replace("[drift]", f"[noise]\n{noise}\n[drift]", 1))
    return bind(read_campaign(folder / "campaign.toml"), read_description(fmu).variables)


def row_by_row(evaluator: Evaluator, x: np.ndarray, sigma: np.ndarray) -> Linearisation:
    """Rows over their noise at x, priors of precision 0.1 beside them."""
    rows, matrix = evaluator.point(x).residuals, evaluator.jacobian(x)
    return Linearisation(
        rows=rows / sigma, matrix=matrix / sigma[:, np.newaxis], prior=np.full(3, 0.1**-0.5)
    )


def test_declared_parts_add_in_quadrature_to_the_floor(swift_fmu: Path, tmp_path: Path) -> None:
    plain = string_q1(swift_fmu, tmp_path / "plain", "")
    noise = 'relative = "1 %"\nabsolute = "0.4 uV"'
    both = string_q1(swift_fmu, tmp_path / "both", noise)
    peaks = np.concatenate([e.peaks_v for e in plain.experiments])
    floor = np.concatenate([e.sigmas_v for e in plain.experiments])
    sigmas, sentence = peak_sigmas(both)
    assert sigmas == pytest.approx(np.sqrt(floor**2 + (0.01 * peaks) ** 2 + 0.4e-6**2))
    assert "1 % as declared" in sentence
    assert "floor" in sentence
    data = problem_of([both]).data
    assert np.array_equal(data.sigma, sigmas / peaks)
    assert np.array_equal(peak_sigmas(plain)[0], floor)
    sweep = both.sweep
    assert sweep is not None
    declared = np.sqrt((0.01 * sweep.amplitude_v) ** 2 + 0.4e-6**2)
    assert swept(data).sigmas_v == pytest.approx(declared)


@pytest.mark.parametrize(
    ("noise", "found"),
    [
        ('relative = "1 V"', "wanted a share"),
        ("relative = -0.1", "wanted a share"),
        ('absolute = "3 Hz"', "absolute"),
        ('outliers = "drop"', "outliers"),
        ("relativ = 0.1", "did you mean 'relative'"),
        ("threshold = 0", "wanted a positive number"),
    ],
)
def test_noise_that_makes_no_sense_is_refused(
    swift_fmu: Path, tmp_path: Path, noise: str, found: str
) -> None:
    with pytest.raises(BadInput, match=r"\[noise\].*" + found):
        string_q1(swift_fmu, tmp_path, noise)


def test_rms_noise_is_a_peak_noise_of_root_two() -> None:
    table = read_record(WrittenNoise, {"relative": 0.02}, Path("c.toml"), "noise")
    assert table.relative == 0.02
    assert Noise(relative=0.0, absolute_v=3.0).with_floor(
        np.ones(2), np.full(2, 4.0)
    ) == pytest.approx([5.0, 5.0])


def test_repeats_tell_the_scatter_beyond_the_floor() -> None:
    """Pooled over many draws: the relative part that was put in, whatever the amplitudes are."""
    generator = np.random.default_rng(3)
    truth, floor = 0.02, 0.01
    found = []
    for _ in range(40):
        amplitudes = [np.array([1.0, 5.0]), np.array([30.0, 2.0])]
        groups = ["a"] * 4 + ["b"] * 3 + ["alone"]
        which = [0] * 4 + [1] * 3 + [0]
        peaks = [
            amplitudes[k] * (1.0 + np.hypot(truth, floor) * generator.standard_normal(2))
            for k in which
        ]
        scatter, freedom = repeat_scatter(groups, peaks, [floor * p for p in peaks])
        assert freedom == (3 + 2) * 2
        found.append(scatter)
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(truth, rel=0.1)
    assert repeat_scatter(["a", "b"], peaks[:2], peaks[:2]) == (0.0, 0)


def test_the_error_of_the_scale_moves_rows_as_it_should(tmp_path: Path) -> None:
    """U is the change of the rows when the measured sweep changes by one standard deviation."""
    response = string_response(drift_hz=80.0, with_sweep=True)
    for scale, fit_sweep in (("maximum", False), ("fit", False), ("maximum", True)):
        made = measured_by(response, noise=0.01, scale=scale, fit_sweep=fit_sweep)
        [tones] = made.tones
        amplitude_v = swept(made).amplitude_v
        spread = np.full(amplitude_v.size, 0.02 * float(np.max(amplitude_v)))
        sweep = replace(swept(made), sigmas_v=spread)
        data = Dataset((tones, sweep))
        objective = Objective(
            response=response, parameters=string_parameters(), data=data, steps=np.full(3, 1e-3)
        )
        x = np.array([-0.1, 0.3, 0.1])
        [point] = evaluate_many(objective, [x])
        noise = noise_of(objective, point)
        sigma = sweep_scale_sigma(amplitude_v, spread, scale)
        louder = replace(
            sweep,
            amplitude_v=amplitude_v * (1.0 + sigma),
            maximum_v=sweep.maximum_v * (1.0 + sigma if not fit_sweep else 1.0),
        )
        [moved] = evaluate_many(replace(objective, data=Dataset((tones, louder))), [x])
        count = tones.rows
        if not fit_sweep:
            change = moved.residuals - point.residuals
            assert noise.common[:, 0] == pytest.approx(change, rel=1e-6)
        else:
            rows = point.chi * response.sweep(point.parameters) / sweep.maximum_v
            assert noise.common[count:, 0] == pytest.approx(sigma * rows)
        assert noise.covariance.size == point.residuals.size


def test_scale_errors_of_joined_campaigns_stay_apart() -> None:
    response = string_response(with_sweep=True)
    made = measured_by(response, noise=0.01, scale="fit")
    sweep = swept(made)
    one = peaks_measurement(made.tones[0].peaks_v, made.tones[0].sigmas_v, series="one")
    two = peaks_measurement(one.peaks_v[:4], one.sigmas_v[:4], series="two")
    spread = 0.01 * sweep.amplitude_v
    joint = Dataset(
        (
            one,
            two,
            replace(sweep, series="one", sigmas_v=spread),
            replace(sweep, series="two", sigmas_v=spread, fitted=True),
        )
    )
    count = sweep.amplitude_v.size
    assert joint.series_of_rows.tolist() == [0] * 10 + [1] * 4 + [1] * count
    assert joint.measured_rows[:14] == pytest.approx(1.0)
    assert joint.sigma.size == joint.measured_rows.size


def with_an_outlier(outliers: str) -> tuple[Objective, np.ndarray]:
    response = string_response(drift_hz=80.0)
    made = measured_by(response, noise=0.01, seed=4)
    peaks = measured_peaks(made)
    peaks[3] *= 1.4
    data = dataset(peaks, 0.01 * peaks, swept(made), weigh=True, outliers=outliers)
    return make_objective(response, string_parameters(), data), data.sigma


def test_an_outlier_is_named_and_counts_less(tmp_path: Path) -> None:
    widths = {}
    for outliers in ("keep", "huber"):
        objective, sigma = with_an_outlier(outliers)
        evaluator = Evaluator(objective)
        x = solve(evaluator, np.zeros(3), 1e-4, "squares").x
        point = evaluator.point(x)
        theta, d1, d2 = point.parameters
        widths[outliers] = d1 * np.cos(theta) ** 2 + d2 * np.sin(theta) ** 2
        bound = string_campaign(objective.data, string_response(drift_hz=80.0), tmp_path)
        problem = problem_of([replace(bound, noise=Noise(outliers=outliers))])
        fits = [row_by_row(evaluator, x, sigma)]
        [found] = outlying_peaks(problem.data, problem.threshold, fits)
        assert found.subject == "pair2"
        assert found.numbers["frequency_hz"] == pytest.approx(6.94034e6)
        assert bool(found.names["reduced"]) == (outliers == "huber")
    truth = 120.0 * np.cos(1.9498) ** 2 + 90.0 * np.sin(1.9498) ** 2
    assert abs(widths["huber"] - truth) < 0.5 * abs(widths["keep"] - truth)


def test_no_outlier_is_named_in_honest_noise(tmp_path: Path) -> None:
    named = 0
    for seed in range(20):
        response = string_response(drift_hz=80.0)
        measured = measured_by(response, noise=0.01, seed=seed)
        objective = Objective(
            response=response, parameters=string_parameters(), data=measured, steps=np.full(3, 1e-3)
        )
        x = (np.array([1.9498, 120.0, 90.0]) - [p.reference for p in string_parameters()]) / [
            p.scale for p in string_parameters()
        ]
        evaluator = Evaluator(objective)
        problem = problem_of([string_campaign(measured, response, tmp_path)])
        fits = [row_by_row(evaluator, x, measured.sigma)]
        named += len([*outlying_peaks(problem.data, problem.threshold, fits)])
    assert named <= 1


def test_weights_follow_the_noise() -> None:
    """Weighted squares are chi square in units of the mean precision; Huber is linear far out."""
    sigma = np.array([0.01, 0.02, 0.04])
    measured = dataset(np.ones(3), sigma, weigh=True)
    rows = np.array([0.03, -0.01, 0.02])
    value, weights = measured.squares(rows)
    mean = np.mean(sigma**-2)
    assert value * mean == pytest.approx(np.sum((rows / sigma) ** 2))
    assert weights == pytest.approx(sigma**-2 / mean)
    tamed = replace(measured, outliers="huber")
    far = np.array([0.03, 0.0, 0.0]) * 10.0
    step = np.array([1e-6, 0.0, 0.0])
    slope = (tamed.squares(far + step)[0] - tamed.squares(far - step)[0]) / 2e-6
    assert slope == pytest.approx(2 * 1.345 * 0.01 * weights[0], rel=1e-6)
    assert slope == pytest.approx(2 * tamed.squares(far)[1][0] * far[0], rel=1e-6)


def test_a_sweep_tells_its_noise_by_its_top() -> None:
    generator = np.random.default_rng(2)
    f = np.linspace(-300.0, 300.0, 241)
    clean = 1.0 / np.sqrt(1.0 + (2 * f / 94.0) ** 2)
    found = [
        sweep_sigmas(
            SweepData(1e6 + f, clean + 0.005 * generator.standard_normal(f.size)), Noise()
        )[0]
        for _ in range(30)
    ]
    assert np.mean(found) == pytest.approx(0.005, rel=0.15)
