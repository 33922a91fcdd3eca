"""Draws by way of first walks: closed forms where noise is not known, chains that go on."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import t

import fitting as ff
from fitting.posterior import CHAIN_FILE, job, summary
from tests.support import closed_posteriors as closed


@pytest.fixture(autouse=True)
def always(monkeypatch: pytest.MonkeyPatch) -> None:
    """First walks whatever the posterior, and short ones."""
    monkeypatch.setattr(job, "GOOD", 1.1)
    monkeypatch.setattr(job, "LEARNING", 1)


def fitted(problem: ff.Problem) -> ff.Fit:
    return ff.fit(problem, ff.Tikhonov(levels=4, misfit="squares"), starts=1)


def ring() -> ff.Problem:
    """z = p1^2 + p2^2, measured 1 with noise 0.1: any angle."""
    names = [closed.parameter("p1", -2.0, 2.0, 1.0), closed.parameter("p2", -2.0, 2.0, 0.1)]
    formula = closed.Formula(lambda p: np.sum(p**2, axis=1, keepdims=True))
    return closed.problem(formula, names, np.array([1.0]), np.array([0.1]))


def test_a_chain_behind_first_walks_goes_on_as_if_it_had_not_been_interrupted(
    tmp_path: Path,
) -> None:
    problem = ring()
    at = fitted(problem)
    whole = ff.posterior(problem, at, ff.Sampling(steps=220, walkers=8))

    def stop(words: str) -> None:
        if "correlation times" in words:
            raise KeyboardInterrupt

    ff.posterior(problem, at, ff.Sampling(steps=220, walkers=8), out=tmp_path, progress=stop)
    assert (tmp_path / CHAIN_FILE).is_file()
    ended = ff.posterior(problem, at, ff.Sampling(steps=220, walkers=8, resume=True), out=tmp_path)
    assert np.array_equal(ended.draws, whole.draws)
    assert ended.summary.accepted == pytest.approx(whole.summary.accepted)
    assert ended.summary.findings == whole.summary.findings


def test_noise_that_is_not_known_makes_student_s_t_behind_first_walks_too() -> None:
    """z = p + noise twelve times: t of eleven degrees of freedom about the mean of what is seen."""
    seen = 40.0 + 3.0 + 0.1 * np.random.default_rng(5).standard_normal(12)
    formula = closed.Formula(lambda p: np.repeat(p, 12, axis=1) + 40.0)
    problem = closed.problem(formula, [closed.parameter("p", -20.0, 20.0, 1.0)], seen, np.zeros(12))
    told: list[str] = []
    at = ff.profile(fitted(problem))  # what the draws have to come near
    found = ff.posterior(problem, at, ff.Sampling(walkers=12), progress=told.append)
    assert any("first walk" in words for words in told)
    assert found.status == "converged"
    # rows are relative, z/z* - 1: weights 1/z*^2
    weighed, right = 1.0 / seen, (seen - 40.0) / seen
    middle = float(weighed @ right / (weighed @ weighed))
    scale = math.sqrt(np.sum((right - weighed * middle) ** 2) / 11.0 / (weighed @ weighed))
    value = found.values["p"]
    error = 4.0 / math.sqrt(value.effective)
    assert value.mean == pytest.approx(middle, abs=error * scale)
    assert value.std == pytest.approx(scale * math.sqrt(11.0 / 9.0), rel=1.5 * error)
    half = t.ppf(0.975, 11) * scale
    assert value.ci95[1] - value.ci95[0] == pytest.approx(2.0 * half, rel=1.5 * error)


def test_while_draws_are_made_it_says_so_and_how_far_they_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The line stays until the next one: none may tell what has ended while another thing runs."""
    monkeypatch.setattr(summary, "LONG_ENOUGH", 1e9)
    problem, told = ring(), list[str]()
    ff.posterior(problem, fitted(problem), ff.Sampling(steps=220, walkers=8), progress=told.append)
    begun = next(k for k, words in enumerate(told) if words.startswith("drawing "))
    assert re.findall(r"\d+", told[begun]) == ["1", "200", "220"]
    assert re.findall(r"\d+", told[begun - 1]) == ["1", "1"]
    assert told[begun + 1].startswith("160 steps ")
    further = told[begun + 2].removesuffix(told[begun + 1])
    assert re.findall(r"\d+", further) == ["201", "220", "220"]
    assert told[begun + 3].startswith("176 steps ")


def test_rows_with_the_scatter_of_one_place_have_the_derivatives_that_are_told() -> None:
    """z = p^2 + noise, twelve times; with the scatter of each place they have others."""
    seen = 40.0 + 3.0 + 0.1 * np.random.default_rng(5).standard_normal(12)
    formula = closed.Formula(lambda p: np.repeat(p**2, 12, axis=1) + 40.0)
    problem = closed.problem(formula, [closed.parameter("p", 0.0, 20.0, 1.0)], seen, np.zeros(12))
    best, p, step = [math.sqrt(3.0)], 1.5, 1e-4
    rows, slopes = problem.white_rows([p], best)
    further, _ = problem.white_rows([p + step], best)
    assert (further - rows) / step == pytest.approx(slopes[:, 0], rel=1e-3)
    there, _ = problem.white_rows(best)
    assert there @ there == pytest.approx(12.0, rel=1e-6)  # rows
    own, _ = problem.white_rows([p])
    assert own @ own == pytest.approx(12.0, rel=1e-6)
    assert rows @ rows > 100.0
