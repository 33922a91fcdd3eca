"""Draws against sums over a grid and closed forms, five seeds each; all but the first nightly."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import iv

import fitting as ff
from fitting.text.arrays import FloatArray
from tests.support import closed_posteriors as closed
from tests.support.virtual.answers import ModesResponse

SEEDS = [1, *(pytest.param(seed, marks=pytest.mark.nightly) for seed in (2, 3, 4, 5))]


def fitted(problem: ff.Problem) -> ff.Inference:
    return ff.profile(ff.fit(problem, ff.Tikhonov(levels=4, misfit="squares"), starts=1))


def means_of_grid(
    log: Callable[[FloatArray], FloatArray],
    axes: tuple[FloatArray, ...],
    functions: list[Callable[[FloatArray], FloatArray]],
) -> tuple[FloatArray, FloatArray]:
    """Means and standard deviations of functions of p (k, n) in exp(log) over a grid."""
    grid = np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], axis=1)
    logs = log(grid)
    weight = np.exp(logs - np.max(logs))
    weight /= np.sum(weight)
    table = np.array([f(grid) for f in functions])
    means = table @ weight
    return means, np.sqrt((table - means[:, None]) ** 2 @ weight)


def require_means(
    found: ff.Posterior,
    functions: list[Callable[[FloatArray], FloatArray]],
    truth: tuple[FloatArray, FloatArray],
) -> None:
    """Means of functions of the draws within four errors of as many draws as they are worth."""
    assert found.status == "converged", found.message
    flat = found.draws.reshape(-1, len(found.names))
    effective = min(value.effective for value in found.values.values())
    for f, mean, std in zip(functions, *truth, strict=True):
        assert float(np.mean(f(flat))) == pytest.approx(mean, abs=4.0 * std / math.sqrt(effective))


@pytest.mark.parametrize("seed", SEEDS)
def test_an_angle_that_wraps(seed: int) -> None:
    """z = (cos p, sin p) measured at p = 0.05 with noise 0.8: von Mises of kappa = 1/0.64."""
    circle = closed.Formula(lambda p: np.column_stack([3.0 + np.cos(p), 3.0 + np.sin(p)]))
    angle = replace(closed.parameter("p", 0.0, 2.0 * math.pi, 0.1), period=2.0 * math.pi)
    measured = np.array([3.0 + math.cos(0.05), 3.0 + math.sin(0.05)])
    problem = closed.problem(circle, [angle], measured, np.array([0.8, 0.8]))
    found = ff.posterior(problem, fitted(problem), ff.Sampling(seed=seed))
    kappa = 0.8**-2
    first, second, fourth = (float(iv(k, kappa) / iv(0, kappa)) for k in (1, 2, 4))
    # of cos and cos 2 of the angle from 0.05, and of its sine, whose mean is 0
    truth = np.array([first, second, 0.0])
    squares = np.array([0.5 * (1.0 + second), 0.5 * (1.0 + fourth), 0.5 * (1.0 - second)])
    functions: list[Callable[[FloatArray], FloatArray]] = [
        lambda p: np.cos(p[:, 0] - 0.05),
        lambda p: np.cos(2.0 * (p[:, 0] - 0.05)),
        lambda p: np.sin(p[:, 0] - 0.05),
    ]
    require_means(found, functions, (truth, np.sqrt(squares - truth**2)))
    assert len(found.summary.modes) == 1
    assert float(np.ptp(found.draws)) > 6.0


@pytest.mark.parametrize("seed", SEEDS)
def test_two_minima_with_a_prior_have_their_shares(seed: int) -> None:
    problem = closed.exchange()
    found = ff.posterior(problem, fitted(problem), ff.Sampling(seed=seed))
    assert found.status == "converged"
    share = closed.exchange_share()
    for mode in found.summary.modes:
        true = share if mode.parameters["p1"] > mode.parameters["p2"] else 1.0 - share
        assert abs(mode.share - true) < 3.0 * mode.share_error < 0.1
    assert len(found.summary.modes) == 2


@pytest.mark.parametrize("seed", SEEDS)
def test_a_bent_valley_that_bounds_cut(seed: int) -> None:
    """z = p2 - p1^2 = 0 with noise 0.1, cut at both ends by p2 < 2 and at one side by p1 > -1."""
    problem = closed.problem(
        closed.Formula(lambda p: 10.0 + p[:, 1:] - p[:, :1] ** 2),
        [closed.parameter("p1", -1.0, 3.0, 0.5), closed.parameter("p2", -1.0, 2.0, 0.2)],
        np.array([10.0]),
        np.array([0.1]),
    )
    found = ff.posterior(problem, fitted(problem), ff.Sampling(seed=seed, steps=20_000))
    axes = (np.arange(-0.998, 3.0, 0.004), np.arange(-0.9975, 2.0, 0.005))
    functions: list[Callable[[FloatArray], FloatArray]] = [
        lambda p: p[:, 0],
        lambda p: p[:, 1],
        lambda p: p[:, 0] ** 2,
        lambda p: (p[:, 0] < -0.8).astype(float),
        lambda p: (p[:, 1] > 1.8).astype(float),
    ]
    truth = means_of_grid(lambda p: -0.5 * ((p[:, 1] - p[:, 0] ** 2) / 0.1) ** 2, axes, functions)
    require_means(found, functions, truth)
    assert len(found.summary.modes) == 1


@pytest.mark.parametrize("seed", SEEDS)
def test_noise_that_nothing_states(seed: int) -> None:
    """A decay of eight values: its size is integrated out, S^(-8/2)."""
    t = np.arange(8.0)
    noise = np.random.default_rng(3).standard_normal(8)
    measured = 5.0 * np.exp(-0.3 * t) * (1.0 + 0.1 * noise)
    names = [closed.parameter("a", 1.0, 10.0, 4.0), closed.parameter("k", 0.0, 1.0, 0.2)]
    decay = closed.Formula(lambda p: p[:, :1] * np.exp(-p[:, 1:] * t))
    problem = closed.problem(decay, names, measured, np.zeros(8))
    found = ff.posterior(problem, fitted(problem), ff.Sampling(seed=seed))
    functions: list[Callable[[FloatArray], FloatArray]] = [
        lambda p: p[:, 0],
        lambda p: p[:, 1],
        lambda p: p[:, 0] * p[:, 1],
        lambda p: (p[:, 1] < 0.28).astype(float),
    ]
    truth = means_of_grid(
        lambda p: -4.0 * np.log(np.sum((decay.of(p) / measured - 1.0) ** 2, axis=1)),
        (np.arange(1.01, 10.0, 0.02), np.arange(0.001, 1.0, 0.002)),
        functions,
    )
    require_means(found, functions, truth)


@pytest.fixture(scope="module")
def q1() -> tuple[ff.Problem, ff.Inference]:
    """The shipped series, the closed form in place of the FMU, and its fit."""
    fmu = ff.Fmu("CoupledOscillator", workers=1)
    record = ff.Problem.of("data/string_q1/campaign.toml", fmu).record
    problem = ff.Problem.answered_by(lambda chosen: ModesResponse(record, chosen), record)
    return problem, ff.profile(ff.fit(problem))


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5])
def test_q1_has_equal_marginals_of_d1_and_d2(
    q1: tuple[ff.Problem, ff.Inference], seed: int
) -> None:
    """Its posterior is the same under theta -> pi/2 - theta with d1 and d2 exchanged."""
    found = ff.posterior(*q1, ff.Sampling(seed=seed))
    d1, d2 = (np.sort(found.draws[..., found.names.index(n)], axis=None) for n in ("d1", "d2"))
    fewest = min(found.values[name].effective for name in ("d1", "d2"))
    at = np.geomspace(2.0, 900.0, 40)
    shares = [np.searchsorted(d, at) / d.size for d in (d1, d2)]
    assert np.max(np.abs(shares[0] - shares[1])) < 3.0 * math.sqrt(0.5 / fewest)
    # both reach what the profile accepts, which is all of their bounds, and the valley is one
    assert max(d1[0], d2[0]) < 2.0
    assert min(d1[-1], d2[-1]) > 900.0
    assert len(found.summary.modes) == 1
