"""Draws by way of a surrogate: closed forms where noise is not known, chains that go on, sizes."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import t

import fitting as ff
from fitting.api.written import CHAIN_FILE
from fitting.inference.posterior.learnt import fits
from tests.support import closed_posteriors as closed

LEARNT = "fitting.inference.posterior.learnt"
NIGHTLY = pytest.mark.nightly


@pytest.fixture(autouse=True)
def always_and_small(monkeypatch: pytest.MonkeyPatch) -> None:
    """A surrogate whatever the posterior, learnt in no time."""
    monkeypatch.setattr("fitting.api.posterior.GOOD", 1.1)
    monkeypatch.setattr("fitting.inference.posterior.follow.WALKED", 10)
    for name, few in (("ROUNDS", 2), ("WALKS", 32), ("LAST", 1), ("PARTS", 20)):
        monkeypatch.setattr(f"{LEARNT}.{name}", few)


def fitted(problem: ff.Problem) -> ff.Fit:
    return ff.fit(problem, ff.Tikhonov(levels=4, misfit="squares"), starts=1)


def ring() -> ff.Problem:
    """z = p1^2 + p2^2, measured 1 with noise 0.1: any angle."""
    names = [closed.parameter("p1", -2.0, 2.0, 1.0), closed.parameter("p2", -2.0, 2.0, 0.1)]
    formula = closed.Formula(lambda p: np.sum(p**2, axis=1, keepdims=True))
    return closed.problem(formula, names, np.array([1.0]), np.array([0.1]))


def test_a_chain_with_a_surrogate_goes_on_as_if_it_had_not_been_interrupted(
    tmp_path: Path,
) -> None:
    problem = ring()
    at = fitted(problem)
    whole = ff.posterior(problem, at, ff.Sampling(steps=220))

    def stop(words: str) -> None:
        if "correlation times" in words:
            raise KeyboardInterrupt

    ff.posterior(problem, at, ff.Sampling(steps=220), out=tmp_path, progress=stop)
    path = tmp_path / CHAIN_FILE
    with np.load(path) as file:
        kept = {name: file[name] for name in file.files}
    assert {"known_places", "known_rows", "known_slopes"} <= set(kept)
    ended = ff.posterior(problem, at, ff.Sampling(steps=220, resume=True), out=tmp_path)
    assert np.array_equal(ended.draws, whole.draws)
    assert ended.summary.accepted == pytest.approx(whole.summary.accepted)


def test_a_chain_of_before_surrogates_goes_on_without_one(tmp_path: Path) -> None:
    problem = ring()
    at = fitted(problem)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fitting.api.posterior.GOOD", 0.0)  # draws about the minimum will do
        begun = ff.posterior(problem, at, ff.Sampling(steps=200), out=tmp_path)
    with np.load(tmp_path / CHAIN_FILE) as file:
        assert "known_places" not in file.files
    told: list[str] = []
    ended = ff.posterior(
        problem, at, ff.Sampling(steps=220, resume=True), out=tmp_path, progress=told.append
    )
    assert ended.summary.steps == 220
    assert np.array_equal(ended.draws[: len(begun.draws) - 4], begun.draws[4:])
    assert not any("learning" in words for words in told)


def test_noise_that_is_not_known_makes_student_s_t_with_a_surrogate_too() -> None:
    """z = p + noise twelve times: t of eleven degrees of freedom about the mean of what is seen."""
    seen = 40.0 + 3.0 + 0.1 * np.random.default_rng(5).standard_normal(12)
    formula = closed.Formula(lambda p: np.repeat(p, 12, axis=1) + 40.0)
    problem = closed.problem(formula, [closed.parameter("p", -20.0, 20.0, 1.0)], seen, np.zeros(12))
    told: list[str] = []
    found = ff.posterior(problem, fitted(problem), progress=told.append)
    assert any("learning" in words for words in told)
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
    assert value.interval95[1] - value.interval95[0] == pytest.approx(2.0 * half, rel=1.5 * error)


def test_while_draws_are_made_it_says_so_and_how_far_they_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The line stays until the next one: none may tell what has ended while another thing runs."""
    monkeypatch.setattr("fitting.inference.posterior.summary.LONG_ENOUGH", 1e9)
    problem, told = ring(), list[str]()
    ff.posterior(problem, fitted(problem), ff.Sampling(steps=220), progress=told.append)
    begun = next(k for k, words in enumerate(told) if words.startswith("drawing "))
    assert re.findall(r"\d+", told[begun]) == ["1", "200", "220"]
    assert told[begun - 1].startswith("proposals ")
    assert "round 2" in told[begun - 2]
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


def test_a_surrogate_is_not_made_of_what_is_too_large(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    assert fits(8, 1388)
    assert not fits(8, 1389)
    assert fits(12)
    assert not fits(13)


@pytest.mark.parametrize("limit", ["DIMENSIONS", pytest.param("LARGEST", marks=NIGHTLY)])
def test_what_is_too_large_is_drawn_without_a_surrogate(
    monkeypatch: pytest.MonkeyPatch, limit: str
) -> None:
    monkeypatch.setattr(f"{LEARNT}.{limit}", 1)
    problem, told = ring(), list[str]()
    at = fitted(problem)
    found = ff.posterior(problem, at, ff.Sampling(steps=200), progress=told.append)
    assert any("no surrogate" in words for words in told)
    assert any("2 of 2" in words for words in told)
    assert not any("round" in words for words in told)
    assert np.mean(np.sum(found.draws**2, axis=2)) == pytest.approx(1.0, abs=0.04)
    assert ff.posterior_cost(problem, at).surrogate_s == 0.0


def test_the_cost_has_the_time_of_a_surrogate() -> None:
    """It takes as long as the steps are many, beside the evaluations, where it is in use."""
    problem = ring()
    at = fitted(problem)
    few = ff.posterior_cost(problem, at, ff.Sampling(steps=200))
    assert few.surrogate_s > 0.0
    least, most = few.seconds
    assert most == pytest.approx(few.evaluations[1] * few.seconds_each + few.surrogate_s)
    assert least == pytest.approx(few.evaluations[0] * few.seconds_each)
